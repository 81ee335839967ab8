"""What a force does to positions in time, on every way: against finite differences of an ODE solver
that shares no code with the engine.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

from estim.curves.rolling import MotionCurve, RollingMotion
from estim.discrepancy.force import force_priors, track_with_ways
from estim.discrepancy.trajectory import TrackResponse, Trajectory
from estim.problem.likelihood import Points
from estim.problem.noise import Independent
from estim.problem.noise_variance import Scale

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from truth.motion import Truth, solve

BASE, RELEASE = Truth(rolling_resistance=0.01), 0.2
ARGUMENTS = {
    "radius": BASE.radius,
    "gamma": BASE.gamma,
    "kappa": BASE.kappa,
    "rho": 1.0,
    "trailing_fraction": 0.0,
    "particle_gyration": 0.0,
    "phi": BASE.phi,
    "theta0": BASE.theta0,
    "rolling_resistance": BASE.rolling_resistance,
    "g": BASE.g,
    "release_time": RELEASE,
    "offset": 0.004,
}
WEIGHT, SIZE = BASE.mass * BASE.g, 1e-5
TURNS = 1.4294  # s after the release


def hills(x: float) -> float:
    return math.sin(9.0 * x + 0.4) + 0.3 * math.cos(23.0 * x)


def along(t: np.ndarray, *, pushed: float | None = None) -> TrackResponse:
    arguments = ARGUMENTS if pushed is None else {**ARGUMENTS, "release_speed": pushed}
    return Trajectory(RollingMotion(False, None, True)).along(
        Points(MotionCurve(False), t, 0.0 * t, arguments),
        {},
        Independent(Scale(0.001), Scale(), np.ones(t.size)),
        about=None,
    )


def answer(t: np.ndarray, **changed) -> np.ndarray:
    """Change of the positions at times t, halved between a motion with more and one with less."""
    more, less = (
        solve(replace(BASE, **{name: change(sign) for name, change in changed.items()}), t[-1])(
            t - RELEASE
        )[0]
        for sign in (SIZE, -SIZE)
    )
    return (more - less) / (2.0 * SIZE)


@pytest.mark.parametrize("last", [1.3, 3.4])
def test_positions_answer_to_a_force_on_every_way_as_an_integrator_says(last: float) -> None:
    t = np.arange(RELEASE + 0.02, RELEASE + last, 1.0 / 15.0)
    found = along(t)
    assert found.track.n_way == (2 if last > TURNS else 1)
    truth = answer(t, gusts=lambda size: lambda x: size * WEIGHT * hills(x))
    # the nodes stand at readings, 4 mm above the places of the solver
    profile = np.tile([hills(x - 0.004) for x in found.track.nodes], found.track.n_way)
    np.testing.assert_allclose(
        found.response.force @ profile, truth, atol=1e-3 * np.abs(truth).max()
    )


def test_friction_that_changes_its_direction_is_another_force_on_the_way_back() -> None:
    t = np.arange(RELEASE + 0.02, RELEASE + 3.4, 1.0 / 15.0)
    found = along(t)
    truth = -answer(t, rolling_resistance=lambda size: BASE.rolling_resistance + size) / math.cos(
        BASE.phi
    )
    out = np.ones(found.track.nodes.size)
    np.testing.assert_allclose(
        found.response.force @ np.r_[out, -out], truth, atol=4e-3 * np.abs(truth).max()
    )
    # the same force on both ways is something else
    assert np.abs(found.response.force @ np.r_[out, out] - truth).max() > 0.3 * np.abs(truth).max()


def test_a_push_is_an_energy_at_release_but_for_a_shift_of_time() -> None:
    t, speed = np.arange(RELEASE + 0.1, RELEASE + 2.6, 1.0 / 15.0), 0.005
    found, plain = along(t), solve(BASE, 3.0)
    pushed = solve(replace(BASE, release_speed=speed), 3.0)(t - RELEASE)[0]
    inertia = (
        1.0
        + (1.0 - BASE.gamma) * BASE.kappa
        + BASE.gamma
        + 2.0 * BASE.gamma * math.cos(BASE.theta0 + BASE.phi)
    )
    energy = speed**2 * inertia / (2.0 * BASE.g)

    def rest(p: np.ndarray) -> np.ndarray:
        return (
            pushed - plain(t - RELEASE + p[0])[0] - p[1] * energy * found.response.start
        ) / energy

    shift, times = least_squares(rest, [0.02, 1.0], x_scale=[1e-3, 1.0], diff_step=1e-6).x
    assert times == pytest.approx(1.0, abs=0.15)  # the rest is of second order in the speed
    assert shift == pytest.approx(speed / plain(np.array([1e-3]))[1][0] * 1e-3, rel=0.03)


def test_a_body_with_a_speed_at_release_answers_to_more_of_it() -> None:
    t, speed, step = np.arange(RELEASE + 0.02, RELEASE + 2.6, 1.0 / 15.0), 0.3, 1e-4
    found = along(t, pushed=speed)
    more, less = (
        solve(replace(BASE, release_speed=speed + sign * step), 3.0)(t - RELEASE)[0]
        for sign in (1.0, -1.0)
    )
    inertia = (
        1.0
        + (1.0 - BASE.gamma) * BASE.kappa
        + BASE.gamma
        + 2.0 * BASE.gamma * math.cos(BASE.theta0 + BASE.phi)
    )
    truth = (more - less) / (2.0 * step) / (speed * inertia / BASE.g)
    velocity = solve(replace(BASE, release_speed=speed), 3.0)(t - RELEASE)[1][:, None]
    left = truth - found.response.start
    left -= velocity @ np.linalg.lstsq(velocity, left, rcond=None)[0]
    assert np.abs(left).max() < 5e-3 * np.abs(truth).max()


def test_what_is_constant_on_either_way_is_taken_out_there() -> None:
    t = np.linspace(0.0, 3.0, 400)
    x = np.sin(t)
    here = track_with_ways(x, np.diff(x))
    assert here.weights.sum() == pytest.approx(1.0)
    assert here.back is not None
    # out from 0 to 1, back from 1 to 0.14
    assert here.back[here.nodes < 0.12].sum() == 0.0
    assert here.weights[here.nodes < 0.12].sum() == pytest.approx(0.12, abs=0.01)
    same, other = force_priors(here)[:2]
    n = here.nodes.size
    for weights in (np.r_[here.weights, np.zeros(n)], np.r_[np.zeros(n), here.back]):
        for prior in (same, other):
            assert weights @ prior.covariance @ weights == pytest.approx(0.0, abs=1e-12)
    assert np.exp(
        np.logaddexp.reduce([prior.log_prior for prior in force_priors(here)])
    ) == pytest.approx(1.0)
    assert np.abs(other.covariance[:n, n:]).max() == pytest.approx(0.0, abs=1e-12)
    assert same.covariance[40, n + 40] > 0.1


def test_a_body_that_friction_holds_stays_where_it_stopped() -> None:
    held = {**ARGUMENTS, "rolling_resistance": 0.09}
    t = np.linspace(RELEASE + 0.05, RELEASE + 8.0, 60)
    points = Points(MotionCurve(False), t, 0.0 * t, held)
    _, v = points.curve.state(t, held)
    assert v[0, -1] == 0.0
    found = Trajectory(RollingMotion(False, None, True)).along(
        points, {}, Independent(Scale(0.001), Scale(), np.ones(t.size)), about=None
    )
    still = v[0] == 0.0
    assert np.all(np.isfinite(found.response.force))
    assert np.ptp(found.response.force[still], axis=0).max() < 1e-9
