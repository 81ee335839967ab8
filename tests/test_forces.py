"""Forces beside weight and rolling resistance, against `benchmarks/truth/motion.py`: Lagrange's
equation for the parts of the body, solved by SciPy, which shares no code and no formula with
`model`.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

from estim.model import (
    Body,
    Forces,
    angular_rate,
    back_and_forth,
    moment_ratio,
    release_energy,
    release_speed,
    sagging,
    speed,
    turn_amplitude,
    turn_components,
    turning_angle,
    turning_point,
)
from estim.model.energy import kinetic_energy, potential_energy
from estim.model.phase_curve import energy_ratio, energy_ratio_derivatives

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from truth.motion import Truth, solve

PHI_SLOPE = 0.05
CURVED = {"tilt": lambda x: PHI_SLOPE * x, "bend": lambda _x: PHI_SLOPE}
BODIES = {
    "paper": {},
    "everything": {
        "radius": 0.21, "gamma": 0.23, "kappa": 0.6, "rho": 0.8, "trailing_fraction": 0.1,
        "particle_gyration": 0.12, "mass": 1.3, "phi": 0.04,
        "theta0": 1.1,
    },
    "downhill": {"radius": 0.235, "gamma": 0.16, "kappa": 0.74, "rho": 0.757,
    "trailing_fraction": 0.05, "mass": 15.8, "phi": -0.096, "theta0": 0.1},
}  # fmt: skip
# of M g R, or of M
SHARE = {"moment": 0.02, "viscous": 0.1, "quadratic": 0.3, "once": 0.03, "twice": 0.02}


def in_newton(case, mass, radius, g=9.81):
    """The keywords of a `Truth` of a case, whose moments are given as shares of M g R and drags by
    M.
    """
    scale = {
        "moment": mass * g * radius,
        "once": mass * g * radius,
        "twice": mass * g * radius,
        "viscous": mass,
        "quadratic": mass,
    }
    return {
        name: (scale[name] * v[0], v[1]) if isinstance(v, tuple) else scale.get(name, 1.0) * v
        for name, v in case.items()
    }


CASES = {
    "release": {"release_speed": 0.2},
    "moment": {"moment": 0.02},
    "load": {"load_resistance": 0.02},
    "viscous": {"viscous": 0.1},
    "quadratic": {"quadratic": 0.3},
    "once": {"once": (0.03, 0.7)},
    "twice": {"twice": (0.02, -0.7)},
    "curved": {"curved": True},
    "all": {
        "release_speed": 0.15, "rolling_resistance": 0.004, "moment": 0.006,
        "load_resistance": 0.005, "viscous": 0.05, "quadratic": 0.2,
        "once": (0.02, 0.7), "twice": (0.01, -0.7), "curved": True,
    },
}  # fmt: skip


def posed(body_name, case):
    """(truth, body, how it is placed, forces) of a case."""
    case = dict(case)
    curved = case.pop("curved", False)
    base = BODIES.get(body_name, case.pop("body", {}))
    mass, radius = base.get("mass", 0.4), base.get("radius", 0.15)
    truth = Truth(**base, **in_newton(case, mass, radius), **(CURVED if curved else {}))
    once, twice = (turn_components(*case.get(name, (0.0, 0.0))) for name in ("once", "twice"))
    forces = Forces(
        moment=moment_ratio(truth.moment, truth.mass, truth.radius, truth.g),
        load_resistance=truth.load_resistance,
        viscous_drag=truth.viscous / truth.mass, quadratic_drag=truth.quadratic / truth.mass,
        once_cos=once[0], once_sin=once[1],
        twice_cos=twice[0], twice_sin=twice[1], phi_slope=PHI_SLOPE if curved else 0.0,
    )  # fmt: skip
    body = Body(
        truth.radius,
        truth.gamma,
        truth.kappa,
        truth.rho,
        truth.trailing_fraction,
        truth.particle_gyration,
        truth.mass,
    )
    place = {
        "phi": truth.phi,
        "theta0": truth.theta0,
        "rolling_resistance": truth.rolling_resistance,
        "g": truth.g,
    }
    return truth, body, place, forces


def energy_at_release(truth, body):
    return release_energy(truth.release_speed, body, phi=truth.phi, theta0=truth.theta0, g=truth.g)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("body_name", BODIES)
def test_speed_and_turning_point_are_those_of_lagrange(body_name, case):
    truth, body, place, forces = posed(body_name, CASES[case])
    motion = solve(truth, 3.0)
    end = truth.radius * float(motion.legs[0][2](motion.legs[0][1])[0])
    x = np.linspace(0.002, 0.999, 40) * end
    e0 = energy_at_release(truth, body)
    got = np.ravel(speed(x, body, **place, release_energy=e0, forces=forces))
    assert got == pytest.approx(motion.speed_at(x), abs=1e-9)
    assert np.ravel(
        angular_rate(x / truth.radius, body, **place, release_energy=e0, forces=forces)
    ) * truth.radius == pytest.approx(got)
    if math.isfinite(motion.first_rest):
        assert turning_point(body, **place, release_energy=e0, forces=forces)[
            0, 0
        ] == pytest.approx(end, abs=1e-9)
    assert np.max(np.abs(got - speed(x, body, **place))) > 1e-3  # the term matters


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("body_name", BODIES)
def test_positions_are_those_of_lagrange_back_and_forth(body_name, case):
    truth, body, place, forces = posed(body_name, CASES[case])
    t = np.linspace(-0.1, 3.4, 90)
    motion = solve(truth, 3.5)
    x, v = motion(t)
    got_x, got_v = back_and_forth(
        t, body, **place, release_speed=truth.release_speed, forces=forces
    )
    assert got_x[0] == pytest.approx(x, abs=1e-9)
    assert got_v[0] == pytest.approx(v, abs=1e-9)
    assert (body_name == "downhill") or len(motion.legs) > 2  # friction has changed its sign twice


@pytest.mark.slow
def test_any_body_under_any_forces_moves_as_lagrange_says_up_to_where_it_turns(rng):
    turned = 0
    for _ in range(12):
        size, share = rng.uniform(0.5, 1.5, 5), rng.uniform(0.0, 1.0, 8)
        names = ("radius", "gamma", "kappa", "phi", "theta0")
        middle = (0.15, 0.19, 0.6, 0.05, 1.1)
        case = {
            "body": dict(zip(names, size * middle, strict=True)),
            "release_speed": 0.3 * share[0], "rolling_resistance": 0.01 * share[1],
            "load_resistance": 0.02 * share[2], "moment": 0.01 * share[3],
            "viscous": 0.3 * share[4], "quadratic": share[5], "curved": bool(share[6] > 0.5),
            "once": (0.03 * share[7], 6.0 * share[0]), "twice": (0.02 * share[1], 6.0 * share[3]),
        }  # fmt: skip
        truth, body, place, forces = posed("any", case)
        motion, t = solve(truth, 2.6), np.linspace(0.0, 2.5, 50)
        x, v = motion(t)
        got = back_and_forth(t, body, **place, release_speed=truth.release_speed, forces=forces)
        assert got[0][0] == pytest.approx(x, abs=1e-9)
        assert got[1][0] == pytest.approx(v, abs=1e-9)
        end = truth.radius * float(motion.legs[0][2](min(motion.legs[0][1], 2.5))[0])
        way = np.append(np.linspace(0.001, 0.99, 30), (0.999, 0.9999)) * end
        e0 = energy_at_release(truth, body)
        assert np.ravel(
            speed(way, body, **place, release_energy=e0, forces=forces)
        ) == pytest.approx(motion.speed_at(way), abs=1e-9)
        turned += motion.first_rest < 2.5
    assert turned > 3


def test_released_backwards_it_comes_back():
    truth, body, place, forces = posed("paper", {**CASES["all"], "release_speed": -0.2})
    t = np.linspace(0.0, 3.0, 60)
    x, v = solve(truth, 3.1)(t)
    got = back_and_forth(t, body, **place, release_speed=-0.2, forces=forces)
    assert got[0][0] == pytest.approx(x, abs=1e-9)
    assert got[1][0] == pytest.approx(v, abs=1e-9)
    assert x.min() < -0.01 < 0.1 < x.max()


def test_many_draws_are_as_good_as_one(rng):
    n = 300  # more than one block
    column = {
        name: rng.normal(mean, sd, (n, 1))
        for name, (mean, sd) in {"phi": (0.07, 0.005), "theta0": (1.05, 0.05)}.items()
    }
    forces = Forces(
        viscous_drag=np.abs(rng.normal(0.0, 0.05, (n, 1))),
        once_sin=rng.normal(0.0, 0.01, (n, 1)),
        load_resistance=0.003,
    )
    e0 = np.abs(rng.normal(0.0, 0.01, (n, 1)))
    body, x, t = Body(0.15, 0.187, 0.45), np.linspace(0.01, 0.6, 20), np.linspace(0.0, 2.0, 20)
    v, position = (
        speed(x, body, **column, release_energy=e0, forces=forces),
        back_and_forth(t, body, **column, forces=forces)[0],
    )
    assert v.shape == position.shape == (n, 20)
    for i in (0, 17, n - 1):
        own = {name: float(value[i, 0]) for name, value in column.items()}
        one = Forces(
            viscous_drag=forces.viscous_drag[i, 0],
            once_sin=forces.once_sin[i, 0],
            load_resistance=0.003,
        )
        assert v[i] == pytest.approx(
            speed(x, body, **own, release_energy=e0[i, 0], forces=one)[0], abs=1e-9
        )
        assert position[i] == pytest.approx(
            back_and_forth(t, body, **own, forces=one)[0][0], abs=1e-9
        )


def test_positions_may_differ_from_draw_to_draw_and_be_unknown(rng):
    body, place, forces = (
        Body(0.15, 0.187, 0.45),
        {"phi": 0.07, "theta0": np.full((3, 1), 1.05)},
        Forces(viscous_drag=0.1),
    )
    x = np.linspace(0.02, 0.3, 5) + np.array([[0.0], [0.01], [0.02]])
    t = 3.0 * x
    v, (position, _) = (
        speed(x, body, **place, forces=forces),
        back_and_forth(t, body, **place, forces=forces),
    )
    for i in range(3):
        assert v[i] == pytest.approx(
            speed(x[i], body, phi=0.07, theta0=1.05, forces=forces)[0], abs=1e-9
        )
        assert position[i] == pytest.approx(
            back_and_forth(t[i], body, phi=0.07, theta0=1.05, forces=forces)[0][0], abs=1e-9
        )
    x[1, 2] = t[0, 1] = np.nan
    gap, moved = (
        speed(x, body, **place, forces=forces),
        back_and_forth(t, body, **place, forces=forces)[0],
    )
    assert np.argwhere(np.isnan(gap)).tolist() == [[1, 2]]
    assert np.argwhere(np.isnan(moved)).tolist() == [[0, 1]]
    assert np.delete(gap, 7) == pytest.approx(np.delete(v, 7), abs=1e-9)


# neutral values


@pytest.mark.parametrize("body_name", BODIES)
def test_no_force_is_the_plain_curve(body_name):
    _, body, place, _ = posed(body_name, {"rolling_resistance": 0.004})
    x, t = np.linspace(0.0, 0.6, 50), np.linspace(0.0, 3.0, 50)
    plain = speed(x, body, **place)
    assert np.array_equal(speed(x, body, **place, forces=None, release_energy=None), plain)
    assert speed(x, body, **place, forces=Forces()) == pytest.approx(plain, abs=1e-9)
    assert speed(x, body, **place, release_energy=0.0) == pytest.approx(plain, abs=1e-12)
    tiny = speed(x, body, **place, forces=Forces(viscous_drag=1e-12))
    assert np.max(np.abs(tiny[0] - plain)[plain > 0.05]) < 1e-9
    assert back_and_forth(t, body, **place, forces=Forces())[0] == pytest.approx(
        back_and_forth(t, body, **place)[0], abs=1e-9
    )
    place.pop("g")
    stop, plain_stop = turning_angle(body, **place, forces=Forces()), turning_angle(body, **place)
    assert stop[0, 0] == pytest.approx(float(plain_stop), abs=1e-9)


def test_energy_lacking_at_release_is_a_later_start_from_rest():
    # from rest at theta0 + u the body has at any later angle what it has with E0 = -W(u) from
    # theta0
    body, phi, theta0, later = Body(0.15, 0.187, 0.45), 0.07, 1.0, 0.05
    lacking = -(0.187 * (math.cos(theta0) - math.cos(theta0 + later)) - later * math.sin(phi))
    angle = np.linspace(0.06, 2.0, 30)
    rate = angular_rate(angle - later, body, phi=phi, theta0=theta0 + later)
    for forces in (None, Forces(), Forces(quadratic_drag=1e-13)):
        assert np.ravel(
            angular_rate(angle, body, phi=phi, theta0=theta0, release_energy=lacking, forces=forces)
        ) == pytest.approx(rate, abs=1e-6)
        assert np.all(
            angular_rate(
                [0.01, 0.04], body, phi=phi, theta0=theta0, release_energy=lacking, forces=forces
            )
            == 0.0
        )


def test_a_body_that_does_not_start_stays():
    body, heavy = Body(0.15, 0.187, 0.45), Forces(moment=0.5, viscous_drag=0.1)
    assert np.all(speed([0.1, 0.2], body, phi=0.07, theta0=1.0, forces=heavy) == 0.0)
    assert turning_angle(body, phi=0.07, theta0=1.0, forces=heavy)[0, 0] == 0.0
    assert np.all(back_and_forth([0.5, 1.0], body, phi=0.07, theta0=1.0, forces=heavy)[0] == 0.0)


# limits that are known


def test_quadratic_drag_has_a_terminal_speed_and_its_closed_form():
    k, phi = 0.5, -0.2
    body, x = Body(0.2, 0.0, 0.5), np.linspace(0.05, 6.0, 40)
    terminal = math.sqrt(9.81 * math.sin(-phi) / k)
    v = speed(x, body, phi=phi, theta0=0.0, g=9.81, forces=Forces(quadratic_drag=k))[0]
    assert v == pytest.approx(terminal * np.sqrt(-np.expm1(-2.0 * k * x / 1.5)), rel=1e-6)
    assert terminal * 0.98 < v[-1] < terminal


def test_viscous_drag_has_a_terminal_speed_and_its_closed_form():
    k, phi = 2.0, -0.2
    body, t = Body(0.2, 0.0, 0.5), np.linspace(0.05, 6.0, 40)
    terminal = 9.81 * math.sin(-phi) / k
    v = back_and_forth(t, body, phi=phi, theta0=0.0, g=9.81, forces=Forces(viscous_drag=k))[1][0]
    assert v == pytest.approx(-terminal * np.expm1(-k * t / 1.5), rel=1e-6)
    assert v[-1] == pytest.approx(terminal, rel=1e-3)


def test_resistance_by_load_of_a_balanced_wheel_is_plain_rolling_resistance():
    body, x = Body(0.2, 0.0, 0.5), np.linspace(0.01, 2.0, 30)
    place = {"phi": -0.1, "theta0": 0.3}
    plain = speed(x, body, **place, rolling_resistance=0.01)
    assert speed(x, body, **place, forces=Forces(load_resistance=0.01))[0] == pytest.approx(
        plain, abs=1e-6
    )


def test_a_moment_is_rolling_resistance_of_a_body_of_that_weight():
    body, x = Body(0.15, 0.187, 0.45), np.linspace(0.01, 0.4, 30)
    place = {"phi": 0.07, "theta0": 1.05, "g": 9.7}
    light, heavy = (moment_ratio(0.004, mass, 0.15, 9.7) for mass in (0.3, 0.6))
    assert light == pytest.approx(2.0 * heavy)
    as_resistance = speed(x, body, **place, rolling_resistance=light / math.cos(0.07))
    assert speed(x, body, **place, forces=Forces(moment=light)) == pytest.approx(
        as_resistance, rel=1e-12
    )


@pytest.mark.parametrize("case", ["release", "curved", "once", "twice", "moment"])
def test_energy_is_balanced(case):
    truth, body, place, forces = posed("everything", CASES[case])
    x = np.linspace(0.02, 0.6, 25)
    v = speed(x, body, **place, release_energy=energy_at_release(truth, body), forces=forces)
    at = {"phi": truth.phi, "theta0": truth.theta0, "forces": forces}
    total = kinetic_energy(x, v, body, **at) + potential_energy(x, body, **at, g=truth.g)
    start = kinetic_energy(0.0, truth.release_speed, body, **at) + potential_energy(
        0.0, body, **at, g=truth.g
    )
    theta, share = truth.theta0 + x / truth.radius, truth.mass * truth.radius
    spent = truth.moment * x / share
    spent = (
        spent
        + truth.once[0]
        * (np.sin(theta - truth.once[1]) - math.sin(truth.theta0 - truth.once[1]))
        / truth.mass
    )
    spent = (
        spent
        + truth.twice[0]
        * (np.sin(2 * theta - truth.twice[1]) - math.sin(2 * truth.theta0 - truth.twice[1]))
        / 2
        / truth.mass
    )
    assert total - start == pytest.approx(-spent, abs=1e-12)


def test_a_sagging_ramp_is_a_parabola_between_its_supports():
    sag, length, start, phi = 0.002, 0.9, 0.25, 0.07
    tilt, slope = sagging(phi, sag, length=length, start=start)
    x = np.linspace(-start, length - start, 101)
    below = np.concatenate(
        [
            [0.0],
            np.cumsum(
                0.5 * np.diff(x) * (phi - tilt - slope * x)[:-1]
                + 0.5 * np.diff(x) * (phi - tilt - slope * x)[1:]
            ),
        ]
    )
    assert below.max() == pytest.approx(sag, rel=1e-3)
    assert below[[0, -1]] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert np.array_equal(sagging(phi, 0.0, length=length, start=start, phi_slope=0.3), [phi, 0.3])
    # and its height is in the potential energy: sag .5 mm on .5 m against an independent solution
    tilt, slope = sagging(phi, 5e-4, length=0.5, start=0.05)
    truth = Truth(phi=phi, tilt=lambda x: tilt - phi + slope * x, bend=lambda _x: slope)
    x = np.linspace(0.01, 0.4, 20)
    v = speed(
        x,
        Body(0.15, 0.187, 0.45),
        phi=tilt,
        theta0=truth.theta0,
        g=9.81,
        forces=Forces(phi_slope=slope),
    )
    assert v == pytest.approx(solve(truth, 2.0).speed_at(x), abs=1e-9)


# derivatives along the curve


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("body_name", ["everything", "downhill"])
def test_derivatives_along_the_curve(body_name, case):
    truth, body, place, forces = posed(body_name, CASES[case])
    e0 = energy_at_release(truth, body)
    angle = np.linspace(0.6, 1.8, 8)
    h = 0.04 if forces.with_speed else 0.02  # what comes of series has rougher digits
    order = 4
    got = energy_ratio_derivatives(
        angle, body, **place, release_energy=e0, forces=forces, order=order
    )
    stencil = (angle[:, None] + h * np.arange(-4, 5)).ravel()
    values = np.reshape(
        energy_ratio(stencil, body, **place, release_energy=e0, forces=forces), (-1, 9)
    )
    for n in range(order + 1):
        weights = np.linalg.solve(
            np.vander(h * np.arange(-4, 5), increasing=True).T, np.eye(9)[n] * math.factorial(n)
        )
        digits = 5e-11 if forces.with_speed else 1e-13
        assert np.ravel(got[n]) == pytest.approx(values @ weights, rel=5e-6, abs=digits / h**n)


def test_release_energy_alone_adds_to_the_plain_curve_and_leaves_its_derivatives():
    body, place = (
        Body(0.15, 0.187, 0.45),
        {"phi": 0.07, "theta0": 1.05, "rolling_resistance": 0.003},
    )
    angle, h = np.linspace(0.1, 2.0, 9), 1e-4
    ratio, slope = energy_ratio_derivatives(angle, body, **place, release_energy=0.02, order=1)
    before, here, after = (
        energy_ratio(angle + step, body, **place, release_energy=0.02) for step in (-h, 0.0, h)
    )
    assert ratio == pytest.approx(here, abs=1e-14)
    assert slope == pytest.approx((after - before) / (2.0 * h), abs=1e-8)


# conversions


def test_conversions_are_inverse():
    body, place = Body(0.15, 0.187, 0.45), {"phi": 0.07, "theta0": 1.05, "g": 9.7}
    for v in (-0.3, 0.0, 0.2):
        assert release_speed(release_energy(v, body, **place), body, **place) == pytest.approx(v)
    e0 = release_energy(0.2, body, **place)
    assert speed(0.0, body, **place, release_energy=e0) == pytest.approx(0.2)
    assert turn_amplitude(*turn_components(0.02, 0.7)) == (pytest.approx(0.02), pytest.approx(0.7))
