"""The force of the ramp, against Newton's law for the parts of the body
(`benchmarks/truth/motion.py`, no code or formula shared), textbook limits and published conditions
for hopping.
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
    contact_forces,
    moment_ratio,
    needed_friction,
    trajectory,
    turn_components,
)

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from truth.motion import Truth

PHI_SLOPE = 0.05
BODIES = {
    "paper": Truth(),
    "everything": Truth(0.21, 0.23, 0.6, 0.8, 0.1, 0.12, 1.3, 0.04, 1.1),
    "downhill": Truth(0.235, 0.16, 0.74, 0.757, 0.05, 0.0, 15.8, -0.096, 0.1),
    "massive particle": Truth(0.3, 0.8, 1.0, 0.9, 0.0, 0.0, 0.2, 0.0, 0.3),
}
CASES = {
    "nothing": {},
    "resistance": {"rolling_resistance": 0.01, "moment": 0.02},
    "load": {"load_resistance": 0.02},
    "drag": {"viscous": 0.1, "quadratic": 0.3},
    "turning": {"once": (0.03, 0.7), "twice": (0.02, -0.7)},
    "curved": {"tilt": lambda x: PHI_SLOPE * x, "bend": lambda _x: PHI_SLOPE},
}


def posed(truth, case):
    """(truth, body, place, forces): moments are given as shares of M g R, drags as shares of M."""
    weight, shares = truth.mass * truth.g * truth.radius, dict(CASES[case])
    once, twice = (turn_components(*shares.get(name, (0.0, 0.0))) for name in ("once", "twice"))
    forces = Forces(
        moment=moment_ratio(shares.get("moment", 0.0) * weight, truth.mass, truth.radius, truth.g),
        load_resistance=shares.get("load_resistance", 0.0), viscous_drag=shares.get("viscous", 0.0),
        quadratic_drag=shares.get("quadratic", 0.0),
        once_cos=once[0], once_sin=once[1], twice_cos=twice[0], twice_sin=twice[1],
        phi_slope=PHI_SLOPE if case == "curved" else 0.0,
    )  # fmt: skip
    scale = {"moment": weight, "viscous": truth.mass, "quadratic": truth.mass}
    shares = {
        name: (weight * v[0], v[1])
        if isinstance(v, tuple)
        else scale.get(name, 1.0) * v
        if name in scale
        else v
        for name, v in shares.items()
    }
    truth = Truth(**{name: getattr(truth, name) for name in Truth.__dataclass_fields__} | shares)
    body = Body(
        truth.radius,
        truth.gamma,
        truth.kappa,
        truth.rho,
        truth.trailing_fraction,
        truth.particle_gyration,
    )
    return (
        truth,
        body,
        {
            "phi": truth.phi,
            "theta0": truth.theta0,
            "rolling_resistance": truth.rolling_resistance,
            "g": truth.g,
        },
        forces,
    )


def newton(truth, u, rate, sense):
    """N and F / (M g) as what the parts' accelerations leave over: sum m (a + g) without the drag,
    along and across the ramp.
    """
    particle = truth.gamma * truth.mass / truth.rho
    x, theta = truth.radius * u, truth.theta0 + u
    ramp = truth.phi + truth.tilt(x)
    along, up = (
        np.array([math.cos(ramp), math.sin(ramp)]),
        np.array([-math.sin(ramp), math.cos(ramp)]),
    )
    push = truth.acceleration(u, rate, sense)
    axle = truth.radius * push * along + truth.radius**2 * truth.bend(x) * rate**2 * up
    arm = truth.rho * truth.radius
    turned = arm * (
        push * np.array([math.cos(theta), -math.sin(theta)])
        - rate**2 * np.array([math.sin(theta), math.cos(theta)])
    )
    total = (
        (truth.mass - particle) * axle
        + particle * (axle + turned)
        + truth.mass * np.array([0.0, truth.g])
    )
    v = truth.radius * rate
    total += (truth.viscous + truth.quadratic * abs(v)) * v * along
    return up @ total / (truth.mass * truth.g), along @ total / (truth.mass * truth.g)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("name", BODIES)
def test_forces_are_those_of_newton_for_the_parts(name, case, rng):
    truth, body, place, forces = posed(BODIES[name], case)
    u, rate = rng.uniform(0.0, 6.0, 40), rng.uniform(-9.0, 9.0, 40)
    expected = np.array(
        [newton(truth, one, w, math.copysign(1.0, w)) for one, w in zip(u, rate, strict=True)]
    )
    got = contact_forces(u, body, **place, forces=forces, rate=rate)
    assert got.normal == pytest.approx(expected[:, 0], rel=1e-12, abs=1e-12)
    assert got.friction == pytest.approx(expected[:, 1], rel=1e-12, abs=1e-12)
    if case != "nothing":
        plain = contact_forces(u, body, **{**place, "rolling_resistance": 0.0}, rate=rate)
        assert np.max(np.abs(plain.friction - got.friction)) > 1e-3  # the term matters


@pytest.mark.parametrize("case", CASES)
def test_along_the_motion_they_are_those_of_its_speed(case):
    _, body, place, forces = posed(BODIES["paper"], case)
    angle = np.linspace(0.0, 2.5, 30)
    along = contact_forces(angle, body, **place, forces=forces)
    rate = angular_rate(angle, body, **place, forces=forces)
    assert contact_forces(angle, body, **place, forces=forces, rate=rate).normal == pytest.approx(
        along.normal, abs=1e-9
    )
    assert contact_forces(angle, body, **place, forces=forces, rate=rate).friction == pytest.approx(
        along.friction, abs=1e-9
    )


def test_moments_about_the_centre_of_mass():
    """(j - gamma^2) M R^2 theta'' = gamma R sin(a) N - R (1 + gamma cos(a)) F, with theta'' from
    the speed along the motion.
    """
    body, phi, theta0, g = Body(0.15, 0.187, 0.45), 0.07, 1.05, 9.81
    angle = np.linspace(0.0, 2.9, 50)
    contact = contact_forces(angle, body, phi=phi, theta0=theta0, g=g)
    rate = trajectory_rate(body, phi, theta0, g, angle)
    across = theta0 + angle + phi
    d = 1 + body.inertia_ratio + 2 * body.gamma * np.cos(across)
    # R theta''/g
    push = (
        body.gamma * np.sin(theta0 + angle)
        - math.sin(phi)
        + body.gamma * np.sin(across) * rate**2 * body.radius / g
    ) / d
    turning = (
        body.gamma * np.sin(across) * contact.normal
        - (1 + body.gamma * np.cos(across)) * contact.friction
    )
    assert turning == pytest.approx((body.inertia_ratio - body.gamma**2) * push, abs=1e-12)


def trajectory_rate(body, phi, theta0, g, angle):
    """theta' by the energy, written out anew."""
    fall = body.gamma * (math.cos(theta0) - np.cos(theta0 + angle)) - angle * math.sin(phi)
    d = 1 + body.inertia_ratio + 2 * body.gamma * np.cos(theta0 + angle + phi)
    return np.sqrt(2 * g / body.radius * fall / d)


def test_forces_are_the_second_differences_of_the_centre_of_mass():
    body, phi, theta0, g, h = Body(0.15, 0.187, 0.45), 0.07, 1.05, 9.81, 1e-3
    t = np.linspace(0.1, 1.2, 23)

    def centre(at):
        x = trajectory(at, body, phi=phi, theta0=theta0, g=g)[0][0]
        across = theta0 + x / body.radius + phi
        return np.array(
            [
                x + body.gamma * body.radius * np.sin(across),
                body.gamma * body.radius * np.cos(across),
            ]
        ), x

    (before, _), (here, x), (after, _) = centre(t - h), centre(t), centre(t + h)
    acceleration = (after - 2 * here + before) / h**2
    contact = contact_forces(x / body.radius, body, phi=phi, theta0=theta0, g=g)
    assert contact.friction == pytest.approx(acceleration[0] / g + math.sin(phi), abs=2e-5)
    assert contact.normal == pytest.approx(acceleration[1] / g + math.cos(phi), abs=2e-5)


@pytest.mark.parametrize(("kappa", "third"), [(0.5, 1 / 3), (1.0, 1 / 2), (0.4, 2 / 7)])
def test_a_balanced_body_needs_the_friction_of_the_textbook(kappa, third):
    """mu = tan(phi) kappa/(1 + kappa), wherever it is: a third of the slope for a disk, half for a
    hoop, 2/7 for a ball.
    """
    contact = contact_forces(np.linspace(0.0, 20.0, 7), Body(0.1, 0.0, kappa), phi=-0.3, theta0=0.2)
    assert needed_friction(contact) == pytest.approx(math.tan(0.3) * third, rel=1e-12)
    # downhill motion: it acts uphill where x points downhill
    assert contact.friction == pytest.approx(-math.sin(0.3) * third, rel=1e-12)
    assert contact.normal == pytest.approx(math.cos(0.3), rel=1e-12)


# a hoop without mass, a particle on its rim: N = M g cos(theta) from rest at the top
LITTLEWOOD = Body(1.0, 1.0, 1.0)


def test_littlewoods_hoop_hops_at_ninety_degrees():
    """J. E. Littlewood, A Mathematician's Miscellany (1953), as told by Theron and Maritz, Math.
    Comput. Model. 47 (2008) 1077, section 1.
    """
    theta0 = 1e-4
    angle = np.linspace(0.01, 3.0, 60)
    contact = contact_forces(angle, LITTLEWOOD, phi=0.0, theta0=theta0)
    assert contact.normal == pytest.approx(np.cos(theta0 + angle), abs=1e-6)
    assert contact.friction == pytest.approx(
        np.tan((theta0 + angle) / 2) * np.cos(theta0 + angle), abs=1e-6
    )
    # it slips before it hops, whatever the coefficient of friction
    held = angle + theta0 < math.pi / 2
    assert needed_friction(contact)[held] == pytest.approx(
        np.tan((theta0 + angle[held]) / 2), abs=1e-6
    )
    assert np.all(np.isinf(needed_friction(contact)[~held]))


@pytest.mark.parametrize("excess", [-1e-3, 1e-3])
def test_a_hoop_and_particle_of_equal_mass_bounce_from_the_speed_of_irodov_on(excess):
    """An exercise of I. E. Irodov, Problems in General Physics, section 1.5: no bouncing while v0
    <= sqrt(8 g R) with the particle at the bottom.

    At the top N/(M g) = 1 - 2 gamma H with H = (v0^2/(2 g R) - 2 gamma)/(2 + 2 gamma): 0 for gamma
    = 1/2 at that v0.
    """
    g, radius = 9.81, 0.2
    v0 = math.sqrt(8 * g * radius) * (1 + excess)
    body = Body(radius, 0.5, 1.0)
    energy = v0**2 / (2 * g * radius)  # D = 2 - 2 gamma = 1 there
    top = contact_forces(math.pi, body, phi=0.0, theta0=math.pi, g=g, release_energy=energy)
    assert (top.normal < 0.0) == (excess > 0.0)
    assert top.normal == pytest.approx(0.0, abs=0.01)


def test_beyond_the_turning_point_there_is_no_force():
    contact = contact_forces(np.array([1.0, 3.1]), Body(0.15, 0.187, 0.45), phi=0.07, theta0=1.05)
    assert (
        np.isnan(contact.normal).tolist()
        == np.isnan(needed_friction(contact)).tolist()
        == [False, True]
    )
    assert needed_friction(contact_forces(2.0, LITTLEWOOD, phi=0.0, theta0=0.1)) == np.inf


def test_draws_are_as_single_ones(rng):
    n = 50
    column = {"phi": rng.normal(0.07, 0.005, (n, 1)), "theta0": rng.normal(1.05, 0.02, (n, 1))}
    gamma, angle = rng.normal(0.187, 0.01, (n, 1)), np.linspace(0.0, 2.0, 9)
    many = needed_friction(contact_forces(angle, Body(0.15, gamma, 0.45), **column))
    assert many.shape == (n, 9)
    for i in (0, 31):
        one = contact_forces(
            angle,
            Body(0.15, gamma[i, 0], 0.45),
            phi=column["phi"][i, 0],
            theta0=column["theta0"][i, 0],
        )
        assert many[i] == pytest.approx(needed_friction(one), rel=1e-12)
