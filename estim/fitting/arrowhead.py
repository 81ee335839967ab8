"""Least squares of runs, perhaps many: each depends on a few parameters that runs share and on a
few of its own.

No run is widened to the parameters of all others: its information is added where it belongs, to the
information of all, or goes as a triangle (QR) of its own into a root of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from estim.arrays import FloatArray, IntArray, finite_or, positive_or
from estim.levenberg_marquardt import bounded_steps
from estim.problem import Posterior, Problem

MANY_RUNS = 16
_ROUNDING = 1e-13  # of chi^2
_LEAST_DAMPING, _FIRST_DAMPING, _FACTOR, _MOST_DAMPING = 1e-13, 1e-6, 10.0, 1e12
_NOTHING = 1e-13  # of the largest singular value


def many(problem: Problem) -> bool:
    """Whether the problem has so many independent groups of runs that each settles at a pace of its
    own.
    """
    return len(problem.groups) > MANY_RUNS


def own_columns(columns: Sequence[IntArray], n_par: int) -> list[IntArray]:
    """For each group, given the columns that it uses, the parameters that no other one uses."""
    uses = np.zeros(n_par, dtype=np.int64)
    for used in columns:
        uses[used] += 1
    return [used[uses[used] == 1] for used in columns]


def spreads_by_runs(
    roots: Sequence[FloatArray], columns: Sequence[IntArray], pulls: FloatArray
) -> list[FloatArray]:
    """For each group a root F (n_used, n_used or fewer) of the covariance F F^T of the least
    squares of all, between the parameters `columns` that it uses.

    roots : of each group (n, n_used), in units of the standard deviation.  pulls : (n_par, n_par)
        rows of the priors.  A parameter without information has no covariance.
    """
    rows = [pulls]
    for root, used in zip(roots, columns, strict=True):
        triangle = np.linalg.qr(root, mode="r")
        rows.append(np.zeros((len(triangle), len(pulls))))
        rows[-1][:, used] = triangle
    design = np.linalg.qr(np.vstack(rows), mode="r")
    scale = positive_or(np.linalg.norm(design, axis=0), 1.0)
    design /= scale
    full_rank = np.min(np.abs(np.diag(design)), initial=1.0) > _NOTHING
    spread = np.linalg.inv(design) if full_rank else np.linalg.pinv(design, rcond=_NOTHING)
    spread /= scale[:, None]
    return [np.transpose(np.linalg.qr(spread[used].T, mode="r")) for used in columns]


@np.errstate(all="ignore")
def descend_by_runs(
    posterior: Posterior, values: FloatArray, free: Sequence[int], *, most: int = 200
) -> FloatArray:
    """`values` (n_par,) with the parameters `free` where the squared residuals are least, between
    the limits of their priors; after `most` steps.

    Damped Gauss-Newton steps (Levenberg and Marquardt); a parameter that a step would take beyond a
    limit goes to the limit, and the others make the best of it.
    """
    problem = posterior.problem
    low, high = problem.support()
    moving = np.isin(np.arange(problem.n_par), list(free))
    values = np.where(moving, np.clip(values, low, high), values)
    height = _height(posterior, values)
    damping, before = _LEAST_DAMPING, math.inf
    for _ in range(most):
        slope, curvature = _shape(posterior, values)
        while True:
            (step,), (promise,) = bounded_steps(
                slope[None],
                curvature[None],
                np.array([damping]),
                moving[None],
                low - values,
                high - values,
            )
            trial = np.where(moving, np.clip(values + step, low, high), values)
            reached = _height(posterior, trial)
            if reached < height or promise < _ROUNDING * height:
                break
            damping = max(_FACTOR * damping, _FIRST_DAMPING)
            if damping > _MOST_DAMPING:
                return values
        # the sum of squares does not decide any more: on while the steps get shorter
        if promise < _ROUNDING * height:
            # what a step promises, of the step before
            if not (promise < 0.1 * before and math.isfinite(reached)):
                break
            before = promise
        damping = damping / _FACTOR if damping > _FIRST_DAMPING else _LEAST_DAMPING
        values, height = trial, reached
    return values


def _height(posterior: Posterior, values: FloatArray) -> float:
    """Half the sum of squared residuals, inf where it is not a number."""
    with np.errstate(all="ignore"):
        total = 0.5 * float(np.sum(posterior.residuals(values) ** 2))
    return total if math.isfinite(total) else math.inf


def _shape(posterior: Posterior, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slope (n_par,) and curvature (n_par, n_par) of that, points without derivatives left out."""
    pairs = posterior.narrow_scoring(values)
    problem = posterior.problem
    slope, curvature = problem.prior_gradient(values), problem.prior_information(values)
    for (jacobian, residuals), used in zip(pairs, problem.columns, strict=True):
        columns = finite_or(jacobian, 0.0)
        slope[used] += columns.T @ residuals
        curvature[np.ix_(used, used)] += columns.T @ columns
    return slope, curvature
