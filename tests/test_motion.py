"""Motion in time against an ODE solver that shares no code with it.

The reference case (gamma .187, kappa .45, 60 deg, 4 deg, .15 m, 9.81 m/s^2) turns after
1.406236634838 s.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from estim.model import Body, Forces, back_and_forth, speed, trajectory, travel_time, turning_point

PAPER = Body(radius=0.15, gamma=0.187, kappa=0.45)
RUN = {"phi": math.radians(4.0), "theta0": math.radians(60.0), "g": 9.81}
WHEEL = Body.from_masses(
    0.235,
    11.7,
    3.4,
    kappa=(0.203 / 0.235) ** 2,
    rho=0.178 / 0.235,
    mass_trailing=0.7,
    particle_gyration=0.019 / 0.235 / 2**0.5,
)
DOWN = {"phi": math.radians(-5.5), "theta0": math.radians(5.5), "g": 9.81}
# a run uphill that turns, and a wheel that never stops; without and with resistance
CASES = [
    pytest.param(PAPER, RUN, id="uphill"),
    pytest.param(PAPER, {**RUN, "rolling_resistance": 0.0028}, id="uphill-resisted"),
    pytest.param(
        Body(0.15, 0.094, 0.45), {"phi": 0.07, "theta0": 1.31, "g": 9.81}, id="barely-starts"
    ),
    pytest.param(WHEEL, DOWN, id="wheel"),
    pytest.param(WHEEL, {**DOWN, "rolling_resistance": 0.03}, id="wheel-resisted"),
    pytest.param(Body(0.2, 0.0, 0.5), {"phi": -0.1, "theta0": 0.3, "g": 9.81}, id="balanced"),
]


def solve(body, run, last):
    """Dense solution (theta, theta') of D theta'' = (g/R)(gamma sin theta - s) + gamma sin(theta +
    phi) theta'^2 from rest.
    """
    phi, slope = (
        run["phi"],
        math.sin(run["phi"]) + run.get("rolling_resistance", 0.0) * math.cos(run["phi"]),
    )
    gamma, inertia = body.gamma, body.inertia_ratio

    def motion(_, y):
        d = 1.0 + inertia + 2.0 * gamma * math.cos(y[0] + phi)
        return [
            y[1],
            (
                run["g"] / body.radius * (gamma * math.sin(y[0]) - slope)
                + gamma * math.sin(y[0] + phi) * y[1] ** 2
            )
            / d,
        ]

    def at_rest(_, y):
        return y[1]

    at_rest.direction = -1.0
    at_rest.terminal = True
    return solve_ivp(
        motion,
        (0.0, last),
        [run["theta0"], 0.0],
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
        dense_output=True,
        events=at_rest,
    )


@pytest.mark.parametrize(("body", "run"), CASES)
def test_trajectory_solves_the_equation_of_motion(body, run):
    solution = solve(body, run, 3.5)
    t = np.linspace(0.05, 0.98 * solution.t[-1], 60)
    theta, rate = solution.sol(t)
    x, v = trajectory(t, body, **run)
    assert x[0] == pytest.approx(body.radius * (theta - run["theta0"]), abs=2e-9)
    assert v[0] == pytest.approx(body.radius * rate, abs=2e-8)
    assert x[0, -1] > 0.05


@pytest.mark.parametrize(("body", "run"), CASES)
def test_travel_time_is_the_inverse_of_the_ode_solution(body, run):
    solution = solve(body, run, 3.5)
    t = np.linspace(0.05, 0.98 * solution.t[-1], 40)
    x = body.radius * (solution.sol(t)[0] - run["theta0"])
    assert travel_time(x, body, **run)[0] == pytest.approx(t, abs=2e-8)


@pytest.mark.parametrize(("body", "run"), CASES)
def test_position_at_the_travel_time_is_the_position(body, run):
    end = min(
        float(
            turning_point(
                body,
                phi=run["phi"],
                theta0=run["theta0"],
                rolling_resistance=run.get("rolling_resistance", 0.0),
            )
        ),
        4.0,
    )
    x = np.linspace(0.01, 0.999, 30) * end
    t = travel_time(x, body, **run)[0]
    assert np.all(np.diff(t) > 0.0)
    again, v = trajectory(t, body, **run)
    assert again[0] == pytest.approx(x, rel=1e-9)
    assert v[0] == pytest.approx(speed(x, body, **run), rel=1e-6)


def test_reference_travel_time_to_the_turning_point():
    end = turning_point(PAPER, phi=RUN["phi"], theta0=RUN["theta0"])
    assert travel_time(end, PAPER, **RUN)[0, 0] == pytest.approx(1.406236634838, abs=1e-11)


def test_the_solver_turns_where_the_travel_time_ends():
    solution = solve(PAPER, RUN, 3.0)
    assert solution.t_events[0][-1] == pytest.approx(1.406236634838, abs=1e-9)


def test_uniform_acceleration_in_closed_form():
    balanced, t = Body(radius=0.2, gamma=0.0, kappa=0.5), np.array([0.1, 1.0, 2.0])
    acceleration = 9.81 * math.sin(0.1) / 1.5
    x, v = trajectory(t, balanced, phi=-0.1, theta0=0.0, g=9.81)
    assert x[0] == pytest.approx(0.5 * acceleration * t**2, rel=1e-12)
    assert v[0] == pytest.approx(acceleration * t, rel=1e-12)
    assert travel_time(x[0], balanced, phi=-0.1, theta0=0.0, g=9.81)[0] == pytest.approx(
        t, rel=1e-12
    )


def test_at_rest_before_the_release():
    x, v = trajectory([-1.0, -1e-9, 0.0, 0.1], PAPER, **RUN)
    assert x[0, :3].tolist() == [0.0, 0.0, 0.0]
    assert v[0, :3].tolist() == [0.0, 0.0, 0.0]
    assert x[0, 3] > 0.0


def test_nothing_is_said_after_the_turning_point():
    x, v = trajectory([1.4062, 1.4063, 5.0], PAPER, **RUN)
    assert np.isnan(x[0]).tolist() == [False, True, True]
    assert np.isnan(v[0]).tolist() == [False, True, True]
    assert x[0, 0] == pytest.approx(0.449757007, abs=1e-8)
    assert np.isnan(travel_time([0.4497, 0.4498, -0.01], PAPER, **RUN)[0]).tolist() == [
        False,
        True,
        True,
    ]


def test_a_body_that_does_not_start_is_nowhere():
    still = {"phi": 0.1, "theta0": 0.0}
    x, v = trajectory([-0.1, 0.0, 0.5], PAPER, **still)
    assert np.isnan(x[0]).tolist() == [False, False, True]
    assert np.isnan(v[0]).tolist() == [False, False, True]
    assert np.isnan(travel_time([0.1, 0.2], PAPER, **still)).all()


def test_the_wheel_is_known_far_down_the_ramp():
    # 15 rad, as far as the measurements go, and the same whatever else is asked for
    x = np.array([0.5, 5.0, 15.0]) * 0.235
    t = travel_time(x, WHEEL, **DOWN)[0]
    assert travel_time(x[:1], WHEEL, **DOWN)[0, 0] == pytest.approx(t[0], abs=1e-10)
    assert trajectory(t[-1:], WHEEL, **DOWN)[0][0] == pytest.approx(x[-1:], rel=1e-10)


@pytest.mark.parametrize("last", [6.0, 16.0])
def test_the_wheel_is_known_as_long_as_it_rolls(last):
    solution = solve(WHEEL, DOWN, last)
    t = np.linspace(0.05, 1.0, 40) * last
    x = WHEEL.radius * (solution.sol(t)[0] - DOWN["theta0"])
    assert trajectory(t, WHEEL, **DOWN)[0][0] == pytest.approx(x, abs=1e-6)
    assert travel_time(x, WHEEL, **DOWN)[0] == pytest.approx(t, abs=1e-6)


def test_a_way_too_long_to_be_resolved_is_nan_and_not_a_place():
    t = np.array([-1.0, 20.0, 300.0])
    assert np.isfinite(back_and_forth(t[:2], WHEEL, **DOWN)[0]).all()
    for known in back_and_forth(t, WHEEL, **DOWN):
        assert np.isnan(known[0]).tolist() == [False, False, True]


@pytest.mark.parametrize("above", [1e-2, 1e-3, 1e-4])
def test_a_body_that_barely_rolls_over_the_top_is_followed_through_its_slowest_moment(above):
    # W at the first minimum (sin theta = s/gamma) is just above 0 for a slope a little steeper than
    # the one that stops it there
    def lowest(phi):
        theta = 2 * math.pi + math.asin(math.sin(phi) / 0.187)
        return 0.187 * (math.cos(0.8) - math.cos(theta)) - (theta - 0.8) * math.sin(phi)

    run = {"phi": brentq(lowest, -0.1, -1e-6) - above, "theta0": 0.8, "g": 9.81}
    assert turning_point(PAPER, phi=run["phi"], theta0=0.8) == math.inf
    solution = solve(PAPER, run, 4.0)
    t = np.linspace(0.05, 4.0, 40)
    assert trajectory(t, PAPER, **run)[0][0] == pytest.approx(
        0.15 * (solution.sol(t)[0] - 0.8), abs=1e-6
    )


def test_draws_together_equal_one_by_one(rng):
    n_draw, t = 6, np.linspace(-0.1, 2.5, 40)
    columns = {
        "radius": rng.uniform(0.1, 0.2, (n_draw, 1)),
        "gamma": rng.uniform(0.1, 0.2, (n_draw, 1)),
        "kappa": rng.uniform(0.3, 0.6, (n_draw, 1)),
        "phi": np.array([[0.05], [0.07], [-0.3], [0.02], [-0.2], [0.3]]),
        "theta0": rng.uniform(0.9, 1.2, (n_draw, 1)),
        "rolling_resistance": rng.uniform(0.0, 0.01, (n_draw, 1)),
        "g": rng.uniform(9.7, 9.9, (n_draw, 1)),
    }  # some turn, some roll for ever, the last does not start

    def evaluate(at):
        body = Body(at["radius"], at["gamma"], at["kappa"])
        motion = {name: at[name] for name in ("phi", "theta0", "rolling_resistance", "g")}
        return (
            *trajectory(t, body, **motion),
            travel_time(np.linspace(0.0, 0.5, 11), body, **motion),
        )

    together = evaluate(columns)
    assert [a.shape for a in together] == [(6, 40), (6, 40), (6, 11)]
    for row in range(n_draw):
        for all_draws, one in zip(
            together, evaluate({k: float(v[row, 0]) for k, v in columns.items()}), strict=True
        ):
            assert all_draws[row] == pytest.approx(one[0], abs=2e-9, nan_ok=True)
    assert np.isnan(together[0][5, t > 0]).all()
    assert np.isfinite(together[0][2]).all()


@pytest.mark.parametrize(("resistance", "t_max"), [(0.0, 6.0), (0.004, 6.0), (0.03, 4.0)])
def test_back_and_forth_is_the_equation_of_motion_with_resistance_against_each_way(
    resistance, t_max
):
    gamma, kappa, radius, phi, theta0, g = (
        0.187,
        0.45,
        0.15,
        np.radians(4.0),
        np.radians(60.0),
        9.81,
    )
    j = (1.0 - gamma) * kappa + gamma

    def push(theta, way):
        return gamma * np.sin(theta) - np.sin(phi) - way * resistance * np.cos(phi)

    def rates(way):
        # rolling resistance as energy loss c_rr M g cos(phi) per length, as the phase curve has it
        def rate(t, y):
            turned = y[0] + phi
            return [
                y[1],
                (g / radius * push(y[0], way) + gamma * np.sin(turned) * y[1] ** 2)
                / (1.0 + j + 2.0 * gamma * np.cos(turned)),
            ]

        return rate

    def stops(t, y):
        return way * y[1] if t > 1e-6 else 1.0

    stops.terminal = True
    t, x, state, clock, way = [], [], [theta0, 0.0], 0.0, 1.0
    while clock < t_max and way * push(state[0], way) > 0.0:
        state[1] = way * 1e-12
        out = solve_ivp(
            rates(way),
            (0.0, t_max - clock),
            state,
            rtol=1e-11,
            atol=1e-12,
            events=stops,
            dense_output=True,
        )
        here = np.linspace(0.0, out.t[-1], 60)[1:-1]
        t.extend(clock + here)
        x.extend(radius * (out.sol(here)[0] - theta0))
        clock, state, way = clock + out.t[-1], [out.y[0, -1], 0.0], -way
    if clock < t_max:  # held by the resistance
        t.append(t_max)
        x.append(radius * (state[0] - theta0))
    assert len(t) > 110
    assert np.ptp(np.diff(x)[50:110]) > 1e-3  # there is a way back
    body = Body(radius=radius, gamma=gamma, kappa=kappa)
    ours, v = back_and_forth(
        np.array(t),
        body,
        phi=phi,
        theta0=np.array([[theta0], [theta0]]),
        rolling_resistance=resistance,
        g=g,
    )
    np.testing.assert_allclose(ours, np.broadcast_to(x, ours.shape), atol=2e-6)
    assert np.all(np.isfinite(v))


def test_each_draw_may_have_its_own_times_and_rests_before_release():
    body = Body(radius=0.15, gamma=0.187, kappa=0.45)
    t = np.array([[-0.1, 0.0, 0.5, 1.5], [-0.2, -0.1, 0.4, 1.4]])
    both, v = back_and_forth(t, body, phi=np.radians(4.0), theta0=np.radians([[60.0], [60.0]]))
    for row, here in zip(both, t, strict=True):
        np.testing.assert_allclose(
            row,
            back_and_forth(here, body, phi=np.radians(4.0), theta0=np.radians(60.0))[0][0],
            atol=1e-12,
        )
    # one body, many clocks
    same, _ = back_and_forth(t, body, phi=np.radians(4.0), theta0=np.radians(60.0))
    np.testing.assert_allclose(same, both, atol=1e-12)
    assert np.all(both[t <= 0.0] == 0.0)
    assert np.all(v[t <= 0.0] == 0.0)
    assert v[0, 3] < 0.0


def test_a_body_that_cannot_start_stays():
    x, v = back_and_forth(
        [0.5, 1.0],
        Body(radius=0.15, gamma=0.1, kappa=0.45),
        phi=np.radians(10.0),
        theta0=np.radians(60.0),
    )
    assert np.all(x == 0.0)
    assert np.all(v == 0.0)


def test_no_draws_are_no_positions():
    none = np.zeros((0, 1))
    for forces in (None, Forces()):
        x, v = back_and_forth(np.zeros((0, 5)), PAPER, phi=none, theta0=none, forces=forces)
        assert x.shape == v.shape == (0, 5)


def _draws(n, phi, theta0):
    rng = np.random.default_rng(5)
    body = Body(
        radius=0.15,
        gamma=0.187 + 0.01 * rng.standard_normal((n, 1)),
        kappa=rng.uniform(0.0, 1.0, (n, 1)),
    )
    return body, {
        "phi": np.radians(phi + 0.2 * rng.standard_normal((n, 1))),
        "theta0": np.radians(theta0 + rng.standard_normal((n, 1))),
        "g": 9.81,
    }


@pytest.mark.parametrize(("phi", "theta0"), [(4.0, 60.0), (2.0, 40.0), (5.0, 36.0), (-5.5, 20.0)])
def test_the_place_that_is_read_off_a_table_is_reached_when_the_clock_says(phi, theta0):
    # there by the inverse, back by the clock itself
    body, run = _draws(30, phi, theta0)
    t = np.linspace(0.02, 1.2, 50)
    x, _ = trajectory(t, body, **run)
    for i in range(30):
        one = Body(radius=0.15, gamma=float(body.gamma[i, 0]), kappa=float(body.kappa[i, 0]))
        there = np.isfinite(x[i])
        back = travel_time(
            x[i][there],
            one,
            **{name: float(np.ravel(value)[i % np.size(value)]) for name, value in run.items()},
        )
        speeds = speed(
            x[i][there], one, phi=float(run["phi"][i, 0]), theta0=float(run["theta0"][i, 0]), g=9.81
        )[0]
        assert np.nanmax(np.abs(back[0] - t[there]) * speeds, initial=0.0) < 1e-9


def test_draws_in_blocks_are_the_draws_together(monkeypatch):
    from estim.model import time_integration

    body, run = _draws(40, 4.0, 60.0)
    t = np.linspace(-0.1, 2.5, 60)  # back again, and over the release
    whole = back_and_forth(t, body, **run)
    monkeypatch.setattr(time_integration, "_BLOCK", 7)
    for one, other in zip(back_and_forth(t, body, **run), whole, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9)
    assert np.any(whole[1] < 0.0)


def test_draws_that_are_hard_leave_their_neighbours_what_they_are_alone():
    # the third all but stops on its way; the first two come back before the last time
    crest = math.asin(math.sin(math.radians(4.0)) / 0.187)
    theta0, gamma = np.array([[1.05], [0.9], [1e-4 + crest], [1.2]]), np.full((4, 1), 0.187)
    t, place = np.linspace(0.0, 2.5, 30), {"phi": math.radians(4.0), "g": 9.81}
    together = back_and_forth(t, Body(0.15, gamma, 0.45), theta0=theta0, **place)
    for i in range(4):
        alone = back_and_forth(t, Body(0.15, 0.187, 0.45), theta0=float(theta0[i, 0]), **place)
        for one, every in zip(alone, together, strict=True):
            assert every[i] == pytest.approx(one[0], rel=0, abs=1e-10)
