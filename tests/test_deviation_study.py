"""An unmodelled force in use: coverage on simulated runs, the draws of a chain, and repeated runs
of a real wheel that agree.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from one_way import fine_places, position_response
from scipy import stats
from scipy.linalg import block_diag
from test_deviation import innovations
from wheels import FINE, FIRST, G_R, PHI, SIGMA, Wheel, WhiteFit, places, white_fit

from estim.discrepancy.force import ForceTrack, Response, force_shapes, shared_force_shapes, track
from estim.discrepancy.grid import FORCE_SCALE, START_SD, prior_grid
from estim.discrepancy.inferred_force import find_force
from estim.discrepancy.linearised import linearise
from estim.discrepancy.mixture_likelihood import keep_probable
from estim.discrepancy.scale_mixture import diagonalise
from estim.problem.roots import root_of


def moved(along: ForceTrack, fit: WhiteFit) -> Response:
    """What a force does to the angles of a fit."""
    fine = fine_places(along, FIRST)
    rate = np.sqrt(
        2.0 * G_R * np.maximum(fit.wheel.energy(fine) + fit.start, 1e-5) / fit.wheel.inertia(fine)
    )
    return position_response(along, fine, fit.at, rate, fit.wheel.inertia(fine), acceleration=G_R)


def with_force(fit: WhiteFit, y: np.ndarray, *, radius: float | None = None):
    """The linearised posterior with a force, and the force."""
    along = track(float(np.max(y)))
    response = moved(along, fit)
    deviation = diagonalise(
        root_of(np.full(y.size, SIGMA**2)),
        force_shapes(along, response, radius=radius),
        prior_grid(FORCE_SCALE),
    )
    found = linearise(
        deviation, fit.residuals, fit.jacobian, precision=fit.precision, pull=fit.pull
    )
    return found, find_force(found, along, response, radius=radius)


WHEEL = Path(__file__).resolve().parents[1] / "data" / "wheel"
CLASS = {"balanced": range(1, 5), "unbalanced": range(1, 4)}


def measured(name: str) -> tuple[np.ndarray, np.ndarray]:
    t, y = np.loadtxt(WHEEL / f"class-{name}.csv", delimiter=",", skiprows=2).T
    used = (y >= 0.5) & (np.arange(y.size) < (np.argmax(y > 15.0) or y.size))
    return t[used], y[used]


def handout(kind: str) -> tuple[Wheel, float]:
    """The wheel of the lab's handout (data/wheel/README.md) and its weight times the radius (N
    m).
    """
    radius, extra = 0.235, 3.4 if kind == "unbalanced" else 0.0
    mass = 11.7 + 0.7 + extra
    inertia = 11.7 * 0.203**2 + extra * (0.178**2 + 0.019**2 / 2.0)
    return Wheel(
        extra * 0.178 / (mass * radius), np.radians(5.5), 0.03, inertia / (mass * radius**2)
    ), mass * 9.81 * radius * np.cos(PHI)


@pytest.mark.parametrize("kind", ["balanced", "unbalanced"])
def test_repeated_runs_of_a_real_wheel_agree_once_the_force_is_known_of(kind):
    """The study's result: P(a > 0) = 1 in every run, and moments that agree with uncertainties of
    one to ten times their spread.
    """
    wheel, weight = handout(kind)
    sds = np.array(
        [
            0.05,
            0.0 if kind == "balanced" else 1e-4,
            0.0 if kind == "balanced" else np.radians(10.0),
            START_SD,
            1e3,
        ]
    )
    moments, white = [], []
    for run in CLASS[kind]:
        t, y = measured(f"{kind}_{run}")
        fit = white_fit(t, y, wheel, sds)
        found, force = with_force(fit, y, radius=1.0)
        moments.append(
            [weight * (fit.wheel.c_rr + found.mean[0]), weight * np.sqrt(found.covariance[0, 0])]
        )
        white.append([weight * fit.wheel.c_rr, weight * np.sqrt(fit.covariance[0, 0])])
        assert force.probability > 0.999
        assert 0.003 < force.amplitude[1] < 0.04
        assert 0.8 < found.size("scale")[1] < 2.0
        assert 0.2 * force.amplitude[1] < force.material_sd < force.amplitude[1]
        left = innovations(found)
        assert abs(left[1:] @ left[:-1]) / (left @ left) < 0.45
        assert stats.chi2(y.size).sf(left @ left) > 1e-3
    assert 0.9 < np.mean(moments, axis=0)[0] < 1.15

    def disagreement(values):
        value, sd = np.array(values).T
        mean = np.sum(value / sd**2) / np.sum(sd**-2.0)
        return stats.chi2(value.size - 1).sf(np.sum(np.square((value - mean) / sd)))

    assert disagreement(moments) > 0.05
    assert disagreement(white) < 1e-8


def test_repeated_runs_share_a_profile_and_each_has_some_of_its_own():
    """One resisting moment for four runs: a shared force alone leaves residuals red, with own ones
    beside it they are white.
    """
    wheel, weight = handout("balanced")
    runs = [measured(f"balanced_{run}") for run in CLASS["balanced"]]
    fits = [white_fit(t, y, wheel, np.array([0.05, 0.0, 0.0, START_SD, 1e3])) for t, y in runs]
    along = track(max(float(y[-1]) for _, y in runs))
    responses = tuple(moved(along, fit) for fit in fits)
    # c_rr is shared, about the first run's; the start and the time of each run are its own
    c_rr = fits[0].wheel.c_rr
    residuals = np.concatenate(
        [fit.residuals + fit.jacobian[:, 0] * (fit.wheel.c_rr - c_rr) for fit in fits]
    )
    jacobian = np.hstack(
        [
            np.concatenate([fit.jacobian[:, 0] for fit in fits])[:, None],
            block_diag(*(fit.jacobian[:, 1:] for fit in fits)),
        ]
    )
    precision = block_diag(fits[0].precision[:1, :1], *(fit.precision[1:, 1:] for fit in fits))
    pull = np.r_[wheel.c_rr - c_rr, np.concatenate([fit.pull[1:] for fit in fits])]

    def joint(own):
        deviation = diagonalise(
            root_of(np.full(residuals.size, SIGMA**2)),
            shared_force_shapes(along, responses, own=own),
            prior_grid(FORCE_SCALE),
        )
        return linearise(deviation, residuals, jacobian, precision=precision, pull=pull)

    def memory(found):
        left = innovations(found)
        return left[1:] @ left[:-1] / (left @ left)

    both, shared = joint((0.0, 0.1, 0.3, 1.0)), joint((0.0,))
    assert abs(memory(both)) < 2.5 / np.sqrt(residuals.size) < memory(shared)
    assert 0.9 < weight * (c_rr + both.mean[0]) < 1.0
    assert 0.015 < weight * np.sqrt(both.covariance[0, 0]) < 0.05

    # the shared profile is that of each single run
    force = find_force(both, along, Response.stacked(responses))
    assert force.probability > 0.999
    for fit, (_, y) in zip(fits, runs, strict=True):
        alone = with_force(fit, y)[1]
        same = np.interp(force.x, alone.x, alone.mean)
        assert np.corrcoef(force.mean[20:], same[20:])[0, 1] > 0.6


def simulated(rng: np.random.Generator, size: float, push: float):
    """Thirty frames of a wheel at 10 Hz with a smooth force of amplitude `size` and an energy at
    release up to about `push`.

    Also the rolling resistance as the average over the track says it, from the release to the last
    frame.
    """
    wheel = Wheel(theta0=np.radians(5.5) + 0.1 * rng.standard_normal())
    smooth = np.exp(-0.5 * np.square((FINE[:, None] - FINE) / 3.0))[:, ::7]
    force = (
        size
        * smooth
        @ rng.standard_normal(smooth.shape[1])
        / np.sqrt(np.sum(np.square(smooth), axis=1))
    )
    work = np.r_[0.0, np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(FINE))] + FIRST * force[0]
    t = np.arange(0.0, 6.0, 0.1) + rng.uniform(0.0, 0.1)
    y = places(wheel, abs(push * rng.standard_normal()), 0.6, t, work)
    used = (y > 0.5) & (y < 15.0)
    y = y[used] + SIGMA * rng.standard_normal(np.sum(used))
    return wheel, wheel.c_rr - np.interp(y[-1], FINE, work) / y[-1] / np.cos(PHI), t[used], y


@pytest.mark.statistics
@pytest.mark.parametrize(
    ("size", "push", "white"),
    [(0.0, 0.0, "covers"), (0.0028, 0.0, "misses"), (0.0, 0.01, "misses")],
)
def test_the_rolling_resistance_of_a_track_is_covered_with_a_force_and_a_free_start(
    rng, size, push, white
):
    """Nothing missing; a smooth profile, residuals of two standard deviations; a push.  White
    errors and a start from rest miss the last two.
    """
    n_run, inside, plain, alarms = 75, [], [], 0
    usual = np.array([0.05, 0.002, np.radians(10.0), START_SD, 1e3])
    at_rest = np.where(np.arange(5) == 3, 0.0, usual)
    for _ in range(n_run):
        wheel, truth, t, y = simulated(rng, size, push)
        start = replace(
            wheel, gamma=wheel.gamma + 0.002 * rng.standard_normal(), theta0=np.radians(5.5)
        )
        fit = white_fit(t, y, start, usual)
        found, _ = with_force(fit, y)
        below = found.probability_below(np.eye(5)[0], truth - fit.wheel.c_rr)
        inside.append([abs(below - 0.5) < 0.5 * p for p in (0.68, 0.95)])
        alarms += found.p_deviation > 0.95
        rest = white_fit(t, y, start, at_rest)
        plain.append(abs(rest.wheel.c_rr - truth) < np.sqrt(rest.covariance[0, 0]))
    covered = np.mean(inside, axis=0)
    tolerance = 3.0 * np.sqrt(0.68 * 0.32 / n_run)
    assert 0.68 - tolerance < covered[0] < 0.88
    assert covered[1] > 0.95 - 3.0 * np.sqrt(0.95 * 0.05 / n_run)
    assert (
        (np.mean(plain) > 0.68 - tolerance)
        if white == "covers"
        else (np.mean(plain) < 0.68 - 2.0 * tolerance)
    )
    assert (alarms <= 0.02 * n_run) == (size == 0.0)


def test_draws_of_the_curve_itself_agree_with_the_linearised_answer(rng):
    """Importance sampling of the mixture with the full curve, proposed by a normal distribution
    half as wide again.
    """
    wheel, _, t, y = simulated(rng, 0.0028, 0.0)
    fit = white_fit(t, y, wheel, np.array([0.05, 0.002, np.radians(10.0), START_SD, 1e3]))
    found, _ = with_force(fit, y)
    mixture = keep_probable(found)
    spread = 1.5 * np.linalg.cholesky(found.covariance)
    unit = rng.standard_normal((3000, 5))
    steps = found.mean + unit @ spread.T
    p = fit.values + steps
    curves = np.array(
        [places(replace(wheel, c_rr=q[0], gamma=q[1], theta0=q[2]), q[3], q[4], t) for q in p]
    )
    off = steps - fit.pull
    log_weight = (
        mixture.log_likelihood(y - curves)
        - 0.5 * np.einsum("ij,jk,ik->i", off, fit.precision, off)
        + 0.5 * np.sum(unit**2, axis=1)
    )
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    assert 1.0 / np.sum(weight**2) > 300.0
    mean = weight @ steps
    sd = np.sqrt(weight @ np.square(steps - mean))
    claimed = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose((mean - found.mean) / claimed, 0.0, atol=0.25)
    np.testing.assert_allclose(sd / claimed, 1.0, atol=0.2)
