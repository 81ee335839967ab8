"""Descents of a search, the steps that finish one, between the limits of the parameters, and what a
Jacobian says.
"""

from __future__ import annotations

import math

import numpy as np

from estim.arrays import BoolArray, FloatArray, all_finite, positive_or, sds_of
from estim.fitting.separable import RESOLVED, SeparableSearch

SILENT = 1e-11  # ratio of singular values
_NO_STEP = 1e-6  # standard deviations
_EQUAL = 1e-9  # relative difference of sums of squares
_TOGETHER = 1e-3  # standard deviations between descents that came to the same end
# predicted decrease of the squares at which a descent ends; Fisher scoring follows the rough one
_CLOSELY, _ROUGHLY, _MOST_STEPS = 1e-11, 1e-3, 100

End = tuple[FloatArray, float]  # values (n_par,) and their sum of squares


def descended(search: SeparableSearch, starts: FloatArray) -> list[End]:
    """Where least squares from starts (n, n_par) end: the minima, and what is lower than all of
    them.
    """
    points, chi2, converged = search.squares.descend(
        starts, ftol=_ROUGHLY if search.creeps else _CLOSELY, max_steps=_MOST_STEPS
    )
    # one exact step gives the digits that numerical derivatives leave out; a search with errors of
    # x ends by up to ten steps of Fisher scoring
    most = 10 if search.creeps else 1
    lowest = np.flatnonzero(np.isfinite(chi2) & (converged | (chi2 <= np.min(chi2))))
    if not lowest.size:
        return []

    def finished(k: int) -> End:
        return stepped(search, points[k], most=most)[:2]

    # of the lowest the first, which may have started where the user stated
    first = int(lowest[chi2[lowest] <= np.min(chi2[lowest]) * (1.0 + _EQUAL)][0])
    best = finished(first)
    spread = spread_at(search, best)
    ends = [
        best if k == first or is_close(points[k], best[0], spread, _TOGETHER) else finished(k)
        for k in lowest.tolist()
    ]
    return [end for end in ends if math.isfinite(end[1])]


def stepped(
    search: SeparableSearch, values: FloatArray, *, most: int = 100
) -> tuple[FloatArray, float, float, int]:
    """Gauss-Newton steps from `values` while they help; parameters on a bound that they would cross
    stay there.

    most : steps, of which the last is shorter than 1e-10 standard deviations.

    Returns where they end, the sum of squares there, the length of the last step in standard
    deviations, and the parameter that it moved most.
    """
    step_size, chi2 = math.inf, search.chi2(values)
    mover = int(search.free[0]) if search.free.size else 0
    for _ in range(most):
        jacobian, residual = search.posterior.scoring(values)
        if not all_finite(jacobian, residual):
            break
        near = near_bound(search, values, jacobian, residual, chi2)
        # what is beside a bound stays there, not on it
        free = search.free[~near[search.free]]
        if not free.size:
            step_size = 0.0
            break
        rows, low, high = jacobian[:, free], search.low[free], search.high[free]
        step = step_between(
            rows, residual, low - values[free], high - values[free], silent=search.resolved
        )
        rounded = search.rounding_at(values, jacobian)
        noise = math.sqrt(max(chi2, 10.0 * rounded, 1e-300) / max(1, residual.size - free.size))
        # beside a large constant of y a shorter step helps less than rounding hides
        equal = chi2 * (1.0 + 1e-9) + math.sqrt(chi2 * rounded)
        size = float(np.linalg.norm(rows @ step)) / noise
        mover = int(free[np.argmax(np.abs(step) * np.linalg.norm(rows, axis=0))])
        length, better = 1.0, False
        while length > 1e-4 and not better:
            trial = values.copy()
            trial[free] = np.clip(values[free] + length * step, low, high)
            reached = search.chi2(trial)
            better = reached < chi2 or (reached <= equal and size < 0.9 * step_size)
            length *= 0.5
        if not better:
            step_size = min(step_size, size)
            break
        values, chi2, step_size = trial, reached, size
        if size < 1e-10:
            break
    return values, chi2, step_size, mover


def step_between(
    rows: FloatArray, aim: FloatArray, low: FloatArray, high: FloatArray, *, silent: float = SILENT
) -> FloatArray:
    """(n_par,) step s of least |rows s + aim| with low <= s <= high; low <= 0 <= high.

    The free step, merely cut off at a limit, leads nowhere where parameters are correlated: what
    the others do for the one that is held must be taken back.

    rows : (n, n_par).
    aim : (n,).  silent : ratio of singular values of unit columns that counts as 0.
    """
    from scipy.optimize import lsq_linear

    scale = positive_or(np.linalg.norm(rows, axis=0), 1.0)
    scaled = rows / scale
    step = np.linalg.lstsq(scaled, -aim, rcond=silent)[0] / scale
    if np.all((step >= low) & (step <= high)):
        return step
    # what the data do not constrain stays where it is
    still = silent * np.linalg.norm(scaled, 2) * np.eye(scale.size)
    result = lsq_linear(
        np.vstack([scaled, still]),
        np.append(-aim, np.zeros(scale.size)),
        bounds=(low * scale, high * scale),
        method="bvls",
    )
    return np.clip(result.x / scale, low, high)


def near_bound(
    search: SeparableSearch,
    values: FloatArray,
    jacobian: FloatArray,
    residual: FloatArray,
    chi2: float,
) -> BoolArray:
    """Which parameters lie on a bound that the descent would push them across, or from which it
    would move them next to nothing.

    Where two parameters do the same at a bound, the gradient in one is that in the other, 0, and
    its sign is rounding.
    """
    if not search.limited:
        return np.zeros(values.size, dtype=bool)
    gradient, moves = jacobian.T @ residual, np.linalg.norm(jacobian, axis=0)
    nothing = _NO_STEP * math.sqrt(chi2 / max(1, residual.size - search.free.size))
    slack = nothing * moves
    # nanometres may be written in metres
    unit = np.where(search.start_values != 0.0, np.minimum(np.abs(search.start_values), 1.0), 1.0)
    margin = 1e-8 * (unit + np.abs(values))
    with np.errstate(invalid="ignore", divide="ignore"):
        # and a start may lie on the bound but for rounding
        margin = np.maximum(margin, np.where(moves > 0.0, nothing / moves, 0.0))
        return ((values - search.low < margin) & (gradient > -slack)) | (
            (search.high - values < margin) & (gradient < slack)
        )


def inverse_information(
    jacobian: FloatArray, resolved: float = RESOLVED
) -> tuple[FloatArray, float]:
    """(J^T J)^-1 and the ratio of the smallest to the largest singular value of J with unit
    columns.
    """
    if not jacobian.shape[1]:
        return np.zeros((0, 0)), 1.0
    scale = positive_or(np.linalg.norm(jacobian, axis=0), 1.0)
    _, singular, right = np.linalg.svd(jacobian / scale, full_matrices=False)
    condition = (
        float(singular[-1] / singular[0])
        if singular[0] > 0.0 and jacobian.shape[0] >= jacobian.shape[1]
        else 0.0
    )
    inverse = np.where(singular > resolved * singular[0], 1.0 / np.maximum(singular, 1e-300), 0.0)
    with np.errstate(over="ignore"):  # of what hardly changes the curve it is infinite
        return (right.T * inverse**2) @ right / np.outer(scale, scale), condition


def unit_at(search: SeparableSearch, best: End) -> float:
    """The standard deviation of a residual, by the residuals where it is not stated."""
    return math.sqrt(best[1] / search.dof) if search.unstated else 1.0


def spread_at(search: SeparableSearch, best: End) -> FloatArray:
    """(n_par,) standard deviations at an optimum, 0 for what the search does not move."""
    jacobian = search.posterior.scoring(best[0])[0][:, search.free]
    spread = np.zeros(best[0].size)
    if all_finite(jacobian):
        spread[search.free] = unit_at(search, best) * sds_of(inverse_information(jacobian)[0])
    return spread


def is_close(a: FloatArray, b: FloatArray, spread: FloatArray, limit: float) -> bool:
    return bool(np.all(np.abs(a - b) <= limit * spread + 1e-7 * np.abs(b)))
