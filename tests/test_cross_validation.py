"""Leave-one-out densities from one set of draws against exact ones, for a straight line with normal
errors and priors.

There every density is normal, so that what a frame's density is without that frame follows from
conditioning one joint normal distribution of all frames: no importance sampling, no whitening,
nothing in common with the code tested.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from arviz_stats.base import array_stats
from scipy import stats
from scipy.special import logsumexp

from estim.checks.cross_validation import LeaveOneOut, difference, leave_one_out
from estim.problem.curve import LocalCurve
from estim.problem.finite_differences import STENCILS, differentiate
from estim.problem.noise import Differentiated, Independent
from estim.problem.noise_variance import Scale
from estim.problem.observations import Observations, Parameter
from estim.problem.posterior import Posterior, Problem
from estim.problem.priors import Normal
from estim.sampling import K_HAT_LIMIT

PRIOR_SD, SIGMA, SCATTER, INTERVAL = 3.0, 0.02, 0.1, 0.1
N_DRAW = 8000


@dataclass(frozen=True)
class Line:
    """y = a + b s at fixed places s, whatever the measured abscissa: errors of x do not reach y."""

    s: np.ndarray
    mass = None

    def value(self, x, arguments):
        return np.atleast_2d(arguments["a"] + arguments["b"] * self.s)

    def local(self, x, arguments):
        ones = np.ones((1, x.size))
        return LocalCurve(self.value(x, arguments), 0.0 * ones, {"a": ones, "b": self.s * ones})

    def time_derivative(self, x, arguments, order):
        return np.zeros((1, x.size))


@dataclass(frozen=True, eq=False)
class Case:
    """A posterior, its exact draws, and the mean and covariance of all frames before they are
    seen.
    """

    posterior: Posterior
    draws: np.ndarray
    y: np.ndarray
    cov: np.ndarray
    joint: np.ndarray


def case(rng, *, correlated, s=None, shift=None):
    s = np.linspace(-1.0, 1.0, 14) if s is None else s
    design = np.column_stack([np.ones(s.size), s])
    if correlated:
        derivative = differentiate(
            INTERVAL * np.arange(s.size + 2), np.zeros(s.size + 2), STENCILS["central"]
        )
        noise = Differentiated(Scale(SIGMA), Scale(SCATTER), 0.0, derivative, np.arange(s.size))
        steps = (np.eye(s.size, s.size + 2, 2) - np.eye(s.size, s.size + 2)) / (2.0 * INTERVAL)
        cov = SIGMA**2 * steps @ steps.T + SCATTER**2 * np.eye(s.size)
    else:
        noise = Independent(Scale(SCATTER), Scale(), np.ones(s.size))
        cov = SCATTER**2 * np.eye(s.size)
    y = (
        design @ [0.3, 0.7]
        + np.linalg.cholesky(cov) @ rng.standard_normal(s.size)
        + (0.0 if shift is None else shift)
    )
    run = Observations(
        "line",
        s,
        y,
        None,
        Line(s),
        {"a": "a", "b": "b"},
        noise,
        "s",
        "1",
        "y",
        "1",
        (),
        np.zeros((0, 2)),
    )
    problem = Problem(tuple(Parameter(n, "1", Normal(0.0, PRIOR_SD), "") for n in "ab"), (run,))
    precision = design.T @ np.linalg.solve(cov, design) + np.eye(2) / PRIOR_SD**2
    centre = np.linalg.solve(precision, design.T @ np.linalg.solve(cov, y))
    draws = rng.multivariate_normal(centre, np.linalg.inv(precision), N_DRAW)
    return Case(problem.linearised(centre), draws, y, cov, cov + PRIOR_SD**2 * design @ design.T)


def exact_leave_one_out(case: Case) -> np.ndarray:
    """(n_obs,) log density of each frame given all others, the line integrated out: log p(all) -
    log p(all others).
    """
    return np.array([density_without(case.joint, case.y, i) for i in range(case.y.size)])


def density_without(cov: np.ndarray, y: np.ndarray, i: int) -> float:
    others = np.delete(np.arange(y.size), i)
    every = stats.multivariate_normal(np.zeros(y.size), cov).logpdf(y)
    return float(
        every
        - stats.multivariate_normal(np.zeros(others.size), cov[np.ix_(others, others)]).logpdf(
            y[others]
        )
    )


@pytest.mark.parametrize("correlated", [False, True])
def test_leave_one_out_is_that_of_exact_refits(rng, correlated):
    known = case(rng, correlated=correlated)
    loo, exact = leave_one_out(known.posterior, known.draws), exact_leave_one_out(known)
    # Monte-Carlo errors of one term are below 0.01, of the sum below 0.03
    np.testing.assert_allclose(loo.pointwise[0], exact, atol=0.04)
    assert loo.elpd == pytest.approx(exact.sum(), abs=0.1)
    assert loo.se == pytest.approx(np.sqrt(exact.size) * np.std(exact, ddof=1), rel=0.03)
    assert np.all(loo.k_hat[0] < K_HAT_LIMIT)
    # densities of frames that the fit has seen are another, larger number
    seen = stats.norm(known.y, SCATTER) if not correlated else None
    if seen is not None:
        curve = known.draws @ np.vstack([np.ones(known.y.size), known.posterior.problem.runs[0].x])
        flattering = np.log(np.mean(seen.pdf(curve), axis=0)).sum()
        assert flattering - exact.sum() > 0.5
        assert loo.p_loo == pytest.approx(flattering - exact.sum(), abs=0.1)


def test_a_correlated_frame_is_predicted_from_its_neighbours(rng):
    known = case(rng, correlated=True)
    a, b = known.draws[0]
    residual = known.y - a - b * known.posterior.problem.runs[0].x
    conditional = [density_without(known.cov, residual, i) for i in range(residual.size)]
    np.testing.assert_allclose(
        known.posterior.pointwise(known.draws[:1])[0][0], conditional, atol=1e-9
    )
    # densities that forget the neighbours are other numbers
    alone = stats.norm(0.0, np.sqrt(np.diag(known.cov))).logpdf(residual)
    assert np.max(np.abs(alone - conditional)) > 0.1


def test_a_frame_that_decides_the_fit_by_itself_is_marked(rng):
    s = np.concatenate([np.linspace(-0.02, 0.02, 13), [4.0]])
    known = case(rng, correlated=False, s=s, shift=np.where(s == 4.0, 2.0, 0.0))
    k_hat = leave_one_out(known.posterior, known.draws).k_hat[0]
    assert k_hat[-1] > K_HAT_LIMIT
    assert np.all(k_hat[:-1] < K_HAT_LIMIT)


def test_the_weights_of_a_heavy_tail_are_smoothed_as_by_arviz(rng):
    """A frame that says much of the slope, where smoothing tells and k-hat is still to be
    trusted.
    """
    known = case(rng, correlated=False, s=np.concatenate([np.linspace(-0.5, 0.5, 13), [1.0]]))
    loo, (log_density,) = (
        leave_one_out(known.posterior, known.draws),
        known.posterior.pointwise(known.draws),
    )
    weights = [array_stats.psislw(column)[0] for column in log_density.T]
    smoothed, raw = (
        np.array(
            [
                logsumexp(w + column) - logsumexp(w)
                for w, column in zip(every, log_density.T, strict=True)
            ]
        )
        for every in (weights, -log_density.T)
    )
    assert 0.5 < loo.k_hat[0][-1] < K_HAT_LIMIT
    np.testing.assert_allclose(loo.pointwise[0], smoothed, atol=1e-9)
    assert abs(raw[-1] - smoothed[-1]) > 2e-3


def test_two_runs_have_the_effective_parameters_of_both(rng):
    known = case(rng, correlated=False)
    (run,), one = known.posterior.problem.runs, leave_one_out(known.posterior, known.draws)
    twice = Problem(
        known.posterior.problem.parameters, (run, replace(run, name="again"))
    ).linearised(known.draws[0])
    both = leave_one_out(twice, known.draws)
    assert (both.elpd, both.p_loo) == pytest.approx((2.0 * one.elpd, 2.0 * one.p_loo))


def terms(*values):
    parts = tuple(np.asarray(v, dtype=float) for v in values)
    flat = np.concatenate(parts)
    return LeaveOneOut(
        float(flat.sum()),
        float(np.sqrt(flat.size) * np.std(flat, ddof=1)),
        0.0,
        parts,
        tuple(np.zeros(p.size) for p in parts),
    )


def test_standard_error_of_a_difference_is_the_spread_of_resampled_frames(rng):
    common = rng.normal(0.0, 3.0, 60)
    a, b = common + 0.1 + 0.5 * rng.standard_normal(60), common
    first, second = terms(a[:20], a[20:]), terms(b[:20], b[20:])
    value, se = difference(first, second)
    assert value == pytest.approx((a - b).sum())
    resampled = rng.integers(0, 60, (4000, 60))
    assert se == pytest.approx(np.std((a - b)[resampled].sum(axis=1)), rel=0.06)
    # frames that are hard for both models cancel; the two standard errors by themselves do not know
    # that
    assert np.hypot(first.se, second.se) > 4.0 * se
    assert difference(second, first) == pytest.approx((-value, se))
    assert difference(first, first) == (0.0, 0.0)
