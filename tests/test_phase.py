"""The phase curve.  Sources of the numbers: arXiv 1403.7220 (eq. phase_curve, eq. theta_min); the
handout of ASEN 2003 lab 4 (masses and lengths of the wheel); a turn at 231.79452219 deg,
0.449757007 m, checked once against an ODE solver.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from estim.curves.rolling import PhaseCurve
from estim.model import (
    Body,
    angular_rate,
    ascends,
    speed,
    theta_max,
    theta_min,
    turning_angle,
    turning_point,
)
from estim.model.phase_curve import (
    STANDARD_GRAVITY,
    energy_ratio,
    energy_ratio_derivatives,
    time_derivative,
)

PAPER = Body(radius=0.15, gamma=0.187, kappa=0.45)
RUN = {"phi": math.radians(4.0), "theta0": math.radians(60.0), "g": 9.81}
# a body with everything there is: rho, trailing mass, extended particle
ANY = Body(
    radius=0.21, gamma=0.23, kappa=0.6, rho=0.8, trailing_fraction=0.1, particle_gyration=0.12
)
ANY_RUN = {"phi": 0.07, "theta0": 1.1, "rolling_resistance": 0.02, "g": 9.7}


def speed_derivatives(x, body, *, angular=False, **run):
    """Value, slope and gradient (name -> array) of the curve that is fit."""
    of_body = {f.name: getattr(body, f.name) for f in dataclasses.fields(Body) if f.name != "mass"}
    arguments = {**of_body, "rolling_resistance": 0.0, "g": 9.81, **run}
    local = PhaseCurve(angular).local(x, arguments)
    return local.value, local.slope, local.gradient


def angular_rate_derivatives(angle, body, **run):
    return speed_derivatives(angle, body, angular=True, **run)


# special cases that others have written down


def test_paper_equation_is_the_special_case_without_trailing_mass_or_resistance():
    gamma, kappa, radius, g = 0.187, 0.45, 0.15, 9.81
    for phi, theta0, far in ((4.0, 60.0, 0.44), (2.0, 40.0, 0.55), (8.0, 75.0, 0.2)):
        phi, theta0 = math.radians(phi), math.radians(theta0)
        x = np.linspace(0.001, far, 50)
        theta = x / radius + theta0
        above = (theta - theta0) * np.sin(phi) + gamma * (np.cos(theta) - np.cos(theta0))
        below = (1 - gamma) * (1 + kappa) + 2 * gamma * (1 + np.cos(theta + phi))
        paper = np.sqrt(-2 * g * radius * above / below)
        assert speed(x, PAPER, phi=phi, theta0=theta0, g=g) == pytest.approx(paper, rel=1e-12)


def test_wheel_of_the_lab_handout_rolls_down_with_the_energy_of_its_parts():
    cylinder, frame, extra, tilt, g = 11.7, 0.7, 3.4, math.radians(5.5), 9.81
    radius, gyration, arm, rod, moment = 0.235, 0.203, 0.178, 0.019, 1.1
    angle = np.linspace(0.1, 15.0, 200)  # rolled since the extra mass stood on the ramp's normal
    lost = (cylinder + frame + extra) * g * radius * angle * math.sin(tilt) + extra * g * arm * (
        math.cos(tilt) - np.cos(angle + tilt)
    )
    inertia = (cylinder + frame) * radius**2 + cylinder * gyration**2  # moving along and turning
    inertia = (
        inertia
        + extra * (radius**2 + arm**2 + 2 * radius * arm * np.cos(angle))
        + 0.5 * extra * rod**2
    )
    handout = np.sqrt(2 * (lost - moment * angle) / inertia)

    wheel = Body.from_masses(
        radius,
        cylinder,
        extra,
        kappa=(gyration / radius) ** 2,
        rho=arm / radius,
        mass_trailing=frame,
        particle_gyration=rod / radius / 2**0.5,
    )
    resistance = moment / (wheel.mass * g * radius * math.cos(tilt))
    omega = angular_rate(angle, wheel, phi=-tilt, theta0=tilt, rolling_resistance=resistance, g=g)
    assert omega == pytest.approx(handout, rel=1e-12)
    assert omega.max() > 7.0


def test_balanced_wheel_accelerates_uniformly():
    balanced = Body(radius=0.235, gamma=0.0, kappa=0.746)
    x, phi = np.linspace(0.0, 3.0, 40), -0.096
    acceleration = 9.81 * math.sin(-phi) / (1 + 0.746)
    assert speed(x, balanced, phi=phi, theta0=0.4, g=9.81) == pytest.approx(
        np.sqrt(2 * acceleration * x), rel=1e-13
    )


def test_on_a_level_plane_the_speed_comes_back_at_the_mirrored_angle():
    # phi = 0: W depends on cos(theta) only, so theta and 2 pi - theta have one speed and the body
    # stops at 2 pi - theta0
    angle = np.linspace(0.1, 2 * (math.pi - 1.0) - 0.1, 30)
    mirrored = 2 * (math.pi - 1.0) - angle
    assert speed(angle * 0.15, PAPER, phi=0.0, theta0=1.0) == pytest.approx(
        speed(mirrored * 0.15, PAPER, phi=0.0, theta0=1.0), rel=1e-12
    )
    assert turning_angle(PAPER, phi=0.0, theta0=1.0) == pytest.approx(
        2 * (math.pi - 1.0), rel=1e-14
    )


def test_shallow_slope_tends_to_the_level_plane():
    x = np.linspace(0.05, 0.4, 9)
    level = speed(x, PAPER, phi=0.0, theta0=1.0)
    assert speed(x, PAPER, phi=1e-9, theta0=1.0) == pytest.approx(level, rel=1e-6)


def test_default_gravity_is_the_conventional_one():
    assert STANDARD_GRAVITY == 9.80665
    at_default = speed(0.1, PAPER, phi=0.07, theta0=1.0)
    assert at_default == pytest.approx(
        speed(0.1, PAPER, phi=0.07, theta0=1.0, g=9.80665), rel=1e-15
    )


# energy, counted from point masses


@pytest.mark.parametrize(
    ("phi", "theta0", "resistance"),
    [(0.07, 1.1, 0.0), (0.07, 1.1, 0.02), (-0.096, 0.1, 0.01), (0.0, 2.0, 0.005)],
)
def test_kinetic_energy_of_all_points_is_the_potential_energy_lost(phi, theta0, resistance):
    mass_disk, mass_particle, mass_trailing, radius, rho, g = 0.303, 0.09, 0.05, 0.2, 0.8, 9.81
    # a uniform disk (kappa = 1/2) as 50 rings of equal area with 12 points each
    ring, spoke = np.meshgrid(
        radius * np.sqrt((np.arange(50) + 0.5) / 50), np.arange(12) * math.pi / 6
    )
    mass = np.concatenate([np.full(600, mass_disk / 600), [mass_particle, mass_trailing]])
    distance = np.concatenate([ring.ravel(), [rho * radius, 0.0]])
    start = np.concatenate([spoke.ravel(), [theta0, 0.0]])

    def places(turned):
        """Positions (2, n) of all points: horizontal and height."""
        axle = turned * radius * np.array([[math.cos(phi)], [math.sin(phi)]])
        return axle + distance * np.stack([np.sin(start + turned), np.cos(start + turned)])

    body = Body.from_masses(
        radius, mass_disk, mass_particle, kappa=0.5, rho=rho, mass_trailing=mass_trailing
    )
    compared = 0
    for turned in (0.3, 0.9, 1.7, 2.3):
        omega = float(
            angular_rate(turned, body, phi=phi, theta0=theta0, rolling_resistance=resistance, g=g)
        )
        step = 1e-5
        velocity = (places(turned + step) - places(turned - step)) / (2 * step) * omega
        kinetic = 0.5 * np.sum(mass * np.sum(velocity**2, axis=0))
        lost = g * np.sum(mass * (places(0.0) - places(turned))[1])
        heat = resistance * mass.sum() * g * math.cos(phi) * turned * radius
        if lost > heat:
            compared += 1
            assert kinetic == pytest.approx(lost - heat, rel=1e-7)
        else:
            assert omega == 0.0
    assert compared >= 3


def test_energy_ratio_is_what_drives_both_speeds():
    angle = np.linspace(0.1, 2.5, 7)
    keywords = {k: ANY_RUN[k] for k in ("phi", "theta0", "rolling_resistance")}
    ratio = energy_ratio(angle, ANY, **keywords)
    assert speed(angle * 0.21, ANY, **ANY_RUN) ** 2 == pytest.approx(
        2 * 9.7 * 0.21 * ratio, rel=1e-12
    )
    assert angular_rate(angle, ANY, **ANY_RUN) * 0.21 == pytest.approx(
        speed(angle * 0.21, ANY, **ANY_RUN), rel=1e-12
    )


def test_close_to_release_the_speed_keeps_its_digits():
    # v^2 = 2 a x with a = g (gamma sin theta0 - s)/D(theta0); cos theta0 - cos theta would lose
    # everything at 1e-12
    x, theta0, phi = 1e-12, math.radians(60), math.radians(4)
    acceleration = (
        9.81
        * (0.187 * math.sin(theta0) - math.sin(phi))
        / (1 + PAPER.inertia_ratio + 2 * 0.187 * math.cos(theta0 + phi))
    )
    assert speed(x, PAPER, phi=phi, theta0=theta0, g=9.81) == pytest.approx(
        math.sqrt(2 * acceleration * x), rel=1e-9
    )


def test_every_turn_has_the_digits_of_longer_numbers():
    """Against sines and cosines of 64-bit mantissas, also where tan(u/4) is huge: errors of some
    units in the last place of a term of order 1.
    """
    angle = np.concatenate(
        [
            np.linspace(-20.0, 40.0, 2001),
            2.0 * np.pi * np.arange(-3.0, 7.0),
            2.0 * np.pi + np.array([-1e-9, 1e-9]),
        ]
    )
    theta0, phi, long = np.radians(60.0), np.radians(4.0), angle.astype(np.longdouble)
    work = 0.187 * (np.cos(np.longdouble(theta0)) - np.cos(theta0 + long)) - long * np.sin(
        np.longdouble(phi)
    )
    exact = work / (1.0 + PAPER.inertia_ratio + 2.0 * 0.187 * np.cos(theta0 + phi + long))
    assert np.max(np.abs(energy_ratio(angle, PAPER, phi=phi, theta0=theta0) - exact)) < 5e-15


# gradients


def _with(body, run, name, value):
    """`body` and `run` with one parameter replaced."""
    if name in run:
        return body, {**run, name: value}
    return dataclasses.replace(body, **{name: value}), run


@pytest.mark.parametrize(
    ("derivatives", "function", "unit"),
    [(speed_derivatives, speed, 0.21), (angular_rate_derivatives, angular_rate, 1.0)],
)
def test_gradients_in_every_parameter_are_central_differences(derivatives, function, unit):
    x = np.linspace(0.05, 2.6, 40) * unit
    (value,), (slope,), gradient = derivatives(x, ANY, **ANY_RUN)
    names = {f.name for f in dataclasses.fields(Body)} - {"mass"} | set(ANY_RUN)
    assert set(gradient) == names
    assert value == pytest.approx(function(x, ANY, **ANY_RUN), rel=1e-13)
    assert value.min() > 0.0

    def five_point(f, at, step):
        return (f(at - 2 * step) - 8 * f(at - step) + 8 * f(at + step) - f(at + 2 * step)) / (
            12 * step
        )

    assert slope == pytest.approx(
        five_point(lambda z: function(z, ANY, **ANY_RUN), x, 1e-3 * unit), rel=1e-5
    )
    for name in sorted(names):
        at = ANY_RUN[name] if name in ANY_RUN else getattr(ANY, name)

        def moved(value, name=name):
            body, run = _with(ANY, ANY_RUN, name, value)
            return function(x, body, **run)

        expected = five_point(moved, at, 1e-3 * at)
        assert np.abs(gradient[name] - expected).max() <= 1e-7 * np.abs(expected).max(), name
        assert np.abs(expected).max() > 1e-4, name  # each of them matters here


def test_gradient_of_the_speed_and_of_the_rate_are_one_chain_rule():
    # v(x) = R omega(x/R): dv/dR at fixed x = omega - (x/R) omega' + R domega/dR
    x = np.linspace(0.05, 0.5, 20)
    _, _, of_speed = speed_derivatives(x, ANY, **ANY_RUN)
    omega, slope, of_rate = angular_rate_derivatives(x / 0.21, ANY, **ANY_RUN)
    assert of_speed["radius"] == pytest.approx(
        omega - x / 0.21 * slope + 0.21 * of_rate["radius"], rel=1e-7, abs=1e-7
    )


def test_all_derivatives_are_zero_where_the_speed_is_clipped():
    end = float(turning_point(PAPER, phi=RUN["phi"], theta0=RUN["theta0"]))
    x = np.array([-0.01, 0.0, end + 0.001, end + 0.05])
    for derivatives, position in ((speed_derivatives, x), (angular_rate_derivatives, x / 0.15)):
        value, slope, gradient = derivatives(position, PAPER, **RUN)
        assert np.all(value == 0.0)
        assert np.all(slope == 0.0)
        for name, d in gradient.items():
            assert np.all(d == 0.0), name
    inside, _, gradient = speed_derivatives(np.array([end - 0.001]), PAPER, **RUN)
    assert inside[0, 0] > 0.0
    assert gradient["theta0"][0, 0] != 0.0


def test_derivatives_of_the_energy_ratio_are_differences_of_each_other():
    keywords = {k: ANY_RUN[k] for k in ("phi", "theta0", "rolling_resistance")}
    angle, step = np.linspace(0.2, 2.5, 12), 1e-3
    orders = [
        np.stack(energy_ratio_derivatives(angle + k * step, ANY, **keywords, order=4))
        for k in (-2, -1, 1, 2)
    ]
    numeric = (orders[0] - 8 * orders[1] + 8 * orders[2] - orders[3]) / (12 * step)
    exact = np.stack(energy_ratio_derivatives(angle, ANY, **keywords, order=4))
    assert exact[1:] == pytest.approx(numeric[:-1], rel=1e-8, abs=1e-10)


# what speeds cannot tell


@pytest.mark.parametrize("factor", [0.5, 0.9, 1.3])
def test_gamma_slope_and_inertia_scaled_by_one_factor_leave_the_curve(factor):
    # tilt alone enters D too, so the slope is scaled through the resistance; j through kappa
    phi, resistance, theta0 = 0.05, 0.01, 1.1
    slope = math.sin(phi) + resistance * math.cos(phi)
    gamma = factor * PAPER.gamma
    inertia = factor * (1.0 + PAPER.inertia_ratio) - 1.0
    scaled = Body(radius=0.15, gamma=gamma, kappa=(inertia - gamma) / (1.0 - gamma))
    assert scaled.inertia_ratio == pytest.approx(inertia)
    x = np.linspace(0.0, 0.45, 60)
    original = speed(x, PAPER, phi=phi, theta0=theta0, rolling_resistance=resistance)
    changed = speed(
        x,
        scaled,
        phi=phi,
        theta0=theta0,
        rolling_resistance=(factor * slope - math.sin(phi)) / math.cos(phi),
    )
    assert changed == pytest.approx(original, rel=1e-12, abs=1e-12)
    alone = speed(
        x,
        dataclasses.replace(PAPER, gamma=gamma),
        phi=phi,
        theta0=theta0,
        rolling_resistance=resistance,
    )
    assert np.abs(alone - original).max() > 0.02  # gamma by itself is seen


# where the motion starts and ends


def test_sine_of_the_smallest_angle_is_the_slope_over_gamma():
    phi = np.radians([1.0, 4.0, 8.0])
    assert np.sin(theta_min(0.187, phi)) == pytest.approx(np.sin(phi) / 0.187, rel=1e-14)
    assert theta_max(0.187, phi) + theta_min(0.187, phi) == pytest.approx(
        np.full(3, math.pi), rel=1e-14
    )


def test_rolling_resistance_lifts_the_theta_min_line_by_its_share_of_gamma():
    phi = np.radians([0.0, 1.0, 4.0])
    lifted = np.sin(theta_min(0.187, phi, rolling_resistance=0.0028))
    assert lifted - np.sin(phi) / 0.187 == pytest.approx(0.0028 / 0.187 * np.cos(phi), rel=1e-12)


def test_no_smallest_angle_where_the_slope_exceeds_gamma():
    phi = np.array([math.asin(0.187) - 1e-6, math.asin(0.187) + 1e-6])
    assert np.isnan(theta_min(0.187, phi)).tolist() == [False, True]
    assert np.isnan(theta_max(0.187, phi)).tolist() == [False, True]
    body = Body(radius=0.15, gamma=0.05, kappa=0.45)
    assert not np.any(ascends(body, phi=0.1, theta0=np.linspace(0, 2 * math.pi, 50)))
    assert np.all(turning_angle(body, phi=0.1, theta0=np.linspace(0, 2 * math.pi, 50)) == 0.0)


def test_a_balanced_body_has_no_smallest_angle_and_only_rolls_down():
    balanced = Body(radius=0.15, gamma=0.0, kappa=0.45)
    assert turning_angle(balanced, phi=np.array([0.1, 0.0, -0.1]), theta0=1.0).tolist() == [
        0.0,
        0.0,
        math.inf,
    ]
    assert np.isnan(theta_min(0.0, 0.07))
    assert np.isnan(theta_min(np.array([0.187, 0.0]), 0.07)).tolist() == [False, True]


def test_the_body_ascends_between_the_two_angles_and_nowhere_else():
    low, high = theta_min(0.187, 0.07), theta_max(0.187, 0.07)
    theta0 = np.array([low - 1e-6, low + 1e-6, high - 1e-6, high + 1e-6])
    assert ascends(PAPER, phi=0.07, theta0=theta0).tolist() == [False, True, True, False]
    assert (turning_angle(PAPER, phi=0.07, theta0=theta0) > 0.0).tolist() == [
        False,
        True,
        True,
        False,
    ]
    # and the curve says the same: there is a speed just beyond the release
    assert (speed(1e-9, PAPER, phi=0.07, theta0=theta0) > 0.0).tolist() == [
        False,
        True,
        True,
        False,
    ]


def test_reference_turning_point():
    angle = turning_angle(PAPER, phi=math.radians(4), theta0=math.radians(60))
    assert math.degrees(angle) + 60.0 == pytest.approx(231.79452219, abs=1e-8)
    assert turning_point(PAPER, phi=math.radians(4), theta0=math.radians(60)) == pytest.approx(
        0.449757007, abs=1e-9
    )


def _first_zero(gamma, phi, theta0, resistance, *, far):
    """Where W first falls below zero, by walking along it in small steps: (angle, step), or inf."""
    angle = np.linspace(0.0, far, 200_001)[1:]
    slope = math.sin(phi) + resistance * math.cos(phi)
    work = gamma * (math.cos(theta0) - np.cos(theta0 + angle)) - angle * slope
    if work[0] <= 0.0:
        return 0.0, far / 200_000
    negative = np.flatnonzero(work <= 0.0)
    return (angle[negative[0]] if negative.size else math.inf), far / 200_000


@pytest.mark.slow
def test_turning_angle_is_the_first_zero_of_the_work(rng):
    stopped = rolled = stayed = revived = 0
    for _ in range(300):
        gamma, phi = rng.uniform(0.02, 0.5), rng.normal(0.0, 0.03)
        theta0, resistance = rng.uniform(-7.0, 7.0), abs(rng.normal(0.0, 0.003))
        expected, step = _first_zero(gamma, phi, theta0, resistance, far=80.0)
        found = float(
            turning_angle(
                Body(radius=0.1, gamma=gamma, kappa=0.5),
                phi=phi,
                theta0=theta0,
                rolling_resistance=resistance,
            )
        )
        if math.isinf(expected):
            assert found > 80.0
            rolled += 1
        elif expected == 0.0:
            assert found == 0.0
            stayed += 1
        else:
            assert expected - step <= found <= expected + 1e-9
            stopped += 1
            beyond = theta0 + np.linspace(expected, 80.0, 5000)
            slope = math.sin(phi) + resistance * math.cos(phi)
            revived += np.any(
                gamma * (math.cos(theta0) - np.cos(beyond)) > (beyond - theta0) * slope
            )
    # the scan met every case; some curves have several zeros
    assert min(stopped, rolled, stayed, revived) >= 10


def test_gentle_descent_rolls_over_the_top_for_ever():
    assert turning_angle(PAPER, phi=-0.2, theta0=0.3) == math.inf
    assert turning_point(PAPER, phi=-0.2, theta0=0.3) == math.inf
    assert np.all(speed(np.linspace(0.01, 40.0, 2000), PAPER, phi=-0.2, theta0=0.3) > 0.0)


def test_descent_on_a_faint_slope_still_ends_before_the_top():
    # released at 60 deg, a slope of -0.1 deg does not carry the particle back over the top
    angle = float(turning_angle(PAPER, phi=math.radians(-0.1), theta0=math.radians(60)))
    assert math.pi < angle < 2 * math.pi
    assert (
        speed(
            np.array([0.999, 1.001]) * angle * 0.15,
            PAPER,
            phi=math.radians(-0.1),
            theta0=math.radians(60),
        )[0]
        > 0.0
    )


def test_behind_the_turning_point_the_formula_may_come_back_to_life():
    # theta0 just below the top on a slight slope down: W < 0 for a while, then > 0; the first zero
    # counts
    body, phi, theta0 = PAPER, -0.02, 1.2
    end = float(turning_angle(body, phi=phi, theta0=theta0))
    assert math.isfinite(end)
    beyond = end + np.linspace(0.01, 6.0, 400)
    assert np.any(speed(beyond * 0.15, body, phi=phi, theta0=theta0) > 0.0)


def test_at_the_turning_point_the_speed_vanishes_like_a_square_root():
    end = float(turning_point(PAPER, phi=RUN["phi"], theta0=RUN["theta0"]))
    near, nearer = (float(speed(end * (1 - d), PAPER, **RUN)) for d in (1e-6, 1e-8))
    assert near / nearer == pytest.approx(10.0, rel=1e-3)


# axes


def test_draws_in_rows_and_positions_in_columns_equal_one_by_one(rng):
    n_draw, x = 5, np.linspace(0.0, 0.4, 7)
    columns = {
        "radius": rng.uniform(0.1, 0.2, (n_draw, 1)),
        "gamma": rng.uniform(0.1, 0.2, (n_draw, 1)),
        "kappa": rng.uniform(0.3, 0.6, (n_draw, 1)),
        "phi": rng.uniform(0.02, 0.1, (n_draw, 1)),
        "theta0": rng.uniform(0.9, 1.2, (n_draw, 1)),
        "g": rng.uniform(9.7, 9.9, (n_draw, 1)),
    }

    def evaluate(row):
        at = {k: v if row is None else float(v[row, 0]) for k, v in columns.items()}
        body, motion = (
            Body(at["radius"], at["gamma"], at["kappa"]),
            {"phi": at["phi"], "theta0": at["theta0"]},
        )
        value, slope, gradient = speed_derivatives(x, body, **motion, g=at["g"])
        return [
            speed(x, body, **motion, g=at["g"]),
            value,
            slope,
            gradient["gamma"],
            gradient["radius"],
            turning_point(body, **motion),
        ]

    together = evaluate(None)
    assert together[0].shape == (n_draw, 7)
    assert together[-1].shape == (n_draw, 1)
    for row in range(n_draw):
        for all_draws, one in zip(together, evaluate(row), strict=True):
            assert all_draws[row] == pytest.approx(np.ravel(one), rel=1e-11, abs=1e-14)


# time derivatives along the motion


def _ode_rate(body, run, t):
    """Angular rate at times t from the equation of motion, very accurately, started a little after
    the release by its series.
    """
    slope = math.sin(run["phi"]) + run.get("rolling_resistance", 0.0) * math.cos(run["phi"])

    def motion(_, y):
        theta, rate = y
        d = 1 + body.inertia_ratio + 2 * body.gamma * math.cos(theta + run["phi"])
        return [
            rate,
            (
                run["g"] / body.radius * (body.gamma * math.sin(theta) - slope)
                + body.gamma * math.sin(theta + run["phi"]) * rate**2
            )
            / d,
        ]

    solution = solve_ivp(
        motion,
        (0.0, float(np.max(t))),
        [run["theta0"], 0.0],
        method="DOP853",
        t_eval=t,
        rtol=1e-13,
        atol=1e-14,
    )
    return solution.y[0] - run["theta0"], solution.y[1]


@pytest.mark.parametrize("order", [2, 4])
def test_time_derivatives_along_the_curve_are_those_of_the_motion(order):
    step, middle = 0.02, 0.25
    t = middle + step * np.arange(-4, 5)
    angle, rate = _ode_rate(ANY, ANY_RUN, t)
    # derivative of the interpolating polynomial of degree 8 through nine points
    numeric = np.polynomial.Polynomial.fit(t - middle, rate, 8, domain=[-1, 1]).deriv(order)(0.0)
    keywords = {k: ANY_RUN[k] for k in ("phi", "theta0", "rolling_resistance")}
    ratios = energy_ratio_derivatives(angle[4], ANY, **keywords, order=order)
    exact = time_derivative([2 * 9.7 / 0.21 * h for h in ratios], order)
    assert exact == pytest.approx(numeric, rel=1e-4 if order == 4 else 1e-6)
    in_metres = time_derivative([2 * 9.7 * 0.21 * h / 0.21**n for n, h in enumerate(ratios)], order)
    assert in_metres == pytest.approx(0.21 * exact, rel=1e-12)


def test_uniform_acceleration_has_no_higher_time_derivative():
    square = [np.array([3.0]), np.array([0.8]), *(np.zeros(1) for _ in range(3))]
    assert time_derivative(square[:3], 2) == 0.0
    assert time_derivative(square, 4) == 0.0


def test_an_oscillator_is_its_own_fourth_derivative():
    # v^2 = w^2 (A^2 - x^2): v'' = -w^2 v, v'''' = w^4 v
    w, amplitude, x = 1.7, 0.6, np.linspace(-0.5, 0.5, 11)
    zero = np.zeros_like(x)
    square = [w**2 * (amplitude**2 - x**2), -2 * w**2 * x, np.full_like(x, -2 * w**2), zero, zero]
    v = np.sqrt(square[0])
    assert time_derivative(square[:3], 2) == pytest.approx(-(w**2) * v, rel=1e-13)
    assert time_derivative(square, 4) == pytest.approx(w**4 * v, rel=1e-13)


def test_only_even_orders_are_known():
    with pytest.raises(ValueError, match="2 or 4: 3"):
        time_derivative([np.ones(1)] * 4, 3)
