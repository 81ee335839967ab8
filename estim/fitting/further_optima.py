"""A search for further optima: each nonlinear parameter is scanned through its whole range, and
every dip on the way is descended into.

At each place of a scan all other parameters are fit to first order (their tangents are projected
out: for a frequency with amplitude and phase that is the least-squares periodogram), so one
vectorised call looks at thousands of places.  Places are spaced by how fast the curve changes its
shape: by about 1/(6 range of x) for a frequency, by factors for a rate.  The lowest dips are then
descended together by Levenberg-Marquardt steps with numerical derivatives.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray, all_finite, finite_or
from estim.fitting.separable import SeparableSearch
from estim.levenberg_marquardt import solve

_N_COARSE = 48  # places at which the speed of change is taken
_SPACING = 0.35  # of a change of shape by its own size
_MOST_NUMBERS = 3_000_000  # residuals in all calls for one parameter
_MOST_DIPS = 40
_DECADES = 2.0  # to either side of the start, where there are no limits
_PRIOR_SDS = 5.0
_WIDE = 1e-4  # of a parameter's size, for mixed second differences
_SETTLED, _N_STEP = 1e-9, 14
_BEYOND = np.array(
    [0.25, 0.5, 1.0, 1.4]
)  # of the way to where the curve is the same to second order
_FAR = np.geomspace(1.0, 3.0, 5)  # places in a reach


def further_optima(
    search: SeparableSearch, values: FloatArray, period: FloatArray | None = None
) -> FloatArray:
    """(n_found, n_par) ends of descents from the dips of a scan of every nonlinear parameter
    through its range, others as in `values`, and from beyond folds.

    period : (n_par,) full turns of those that are phases, else inf: each dip is then tried with
        four phases.
    """
    starts = [
        _dips(search, values, i, *ends)
        for i in search.nonlinear.tolist()
        for ends in _ranges(search, i)
    ]
    starts.append(_beyond_folds(search, values))
    points = np.vstack(starts)
    if not points.size:
        return points
    period = np.full(values.size, np.inf) if period is None else period
    for i in np.flatnonzero(np.isfinite(period)):
        turned = np.repeat(points, 4, axis=0)
        turned[:, i] += np.tile(0.25 * np.arange(4), points.shape[0]) * period[i]
        over = turned[:, i] > search.high[i]
        turned[over, i] -= period[i] * np.ceil((turned[over, i] - search.high[i]) / period[i])
        turned = turned[turned[:, i] >= search.low[i]]
        heights = search.squares.objectives(turned)
        points = turned[np.argsort(heights, kind="stable")[: max(points.shape[0], 4 * _MOST_DIPS)]]
    return descended(search, points)


def _beyond_folds(search: SeparableSearch, values: FloatArray) -> FloatArray:
    """(n_point, n_par) where, to second order, the curve is as at `values` again while a nonlinear
    parameter goes and the others follow it: it turns back where its derivatives are no longer
    independent, as those of R/(x - b) - a/x^2 at b = 0, and its optima on both sides may be nearer
    to each other than the points of a scan.
    """
    residuals, columns = (
        part[0]
        for part in search.squares.tangents(values[None, :], search.free, search.squares.step)
    )
    unit = np.linalg.norm(columns, axis=0)
    if not (all_finite(columns) and np.all(unit > 0.0)):
        return np.zeros((0, values.size))
    columns, points = columns / unit, []
    for k in np.flatnonzero(np.isin(search.free, search.nonlinear)):
        others = np.delete(columns, k, axis=1)
        following = -np.linalg.pinv(others)
        tangent = np.insert(following @ columns[:, k], k, 1.0)
        step, moved = np.zeros(values.size), np.zeros(values.size)
        with np.errstate(all="ignore"):
            step[search.free] = tangent / np.linalg.norm(columns @ tangent) / unit
            ends = search.squares.residuals(values + np.array([step, -step]), np.arange(2))
            slope, bend = 0.5 * (ends[0] - ends[1]), ends[0] + ends[1] - 2.0 * residuals
            correction = following @ bend
            moved[search.free] = np.insert(correction, k, 0.0) / unit
            bend += others @ correction
            far = -2.0 * (slope @ bend) / (bend @ bend) * _BEYOND
            points.append(values + far[:, None] * step + 0.5 * np.square(far)[:, None] * moved)
    candidates = np.array(points).reshape(-1, values.size)
    return np.clip(candidates[np.all(np.isfinite(candidates), axis=1)], search.low, search.high)


def far_points(
    search: SeparableSearch, values: FloatArray, spread: FloatArray, period: FloatArray
) -> dict[int, tuple[FloatArray, FloatArray]]:
    """Nonlinear parameter without a limit -> points (n, n_par) where it is far from `values`
    (n_par,) and the other parameters are as good as can be, and the sums of squares (n,) there.

    spread : (n_par,) standard deviations.  Looked at are two reaches to each side: too far out,
        terms cancel.  Of the points in one the median is given, for a frequency meets an alias here
        and there.
    """
    far: dict[int, tuple[FloatArray, FloatArray]] = {}
    for i in (
        int(i)
        for i in search.nonlinear
        if not _informed(search, int(i)) and not math.isfinite(period[i])
    ):
        reaches = [
            factor * max(abs(float(values[i])), n_sd * float(spread[i])) * _FAR
            for factor, n_sd in ((30.0, 3.0), (300.0, 30.0))
        ]
        sides = [
            sign * reach
            for sign, end in ((1.0, search.high[i]), (-1.0, search.low[i]))
            if not math.isfinite(end)
            for reach in reaches
        ]
        fixed = replace(search, nonlinear=search.nonlinear[search.nonlinear != i])
        points = np.repeat(values[None, :], _FAR.size * len(sides), axis=0)
        points[:, i] = np.concatenate([np.zeros(0), *sides])
        ends, heights, _ = fixed.squares.descend(points, ftol=_SETTLED, max_steps=_N_STEP)
        middle = np.argsort(heights.reshape(len(sides), _FAR.size))[:, _FAR.size // 2]
        chosen = np.arange(len(sides)) * _FAR.size + middle
        far[i] = ends[chosen], heights[chosen]
    return far


def _informed(search: SeparableSearch, i: int) -> bool:
    return math.isfinite(search.posterior.problem.parameters[i].prior.sd)


def _ranges(search: SeparableSearch, i: int) -> list[tuple[float, float]]:
    """What is looked at of parameter i: values about as large as its start and, since it may be a
    place on the axis of x, the places beyond them.
    """
    problem, at = search.posterior.problem, float(search.start_values[i])
    prior, low, high = problem.parameters[i].prior, float(search.low[i]), float(search.high[i])
    limited = math.isfinite(low), math.isfinite(high)
    if _informed(search, i) and not (all(limited) and high - low < 2.0 * _PRIOR_SDS * prior.sd):
        reach = _PRIOR_SDS * prior.sd
        return [(max(low, prior.centre - reach), min(high, prior.centre + reach))]
    reach, least = 10.0**_DECADES * (abs(at) if at else 0.1), at / 10.0**_DECADES
    own = (
        low if limited[0] else least if at > 0.0 else -reach,
        high if limited[1] else least if at < 0.0 else reach,
    )
    places = [x for run in problem.runs for x in (run.places or {"": run.x}).values()]
    first, last = min(float(np.min(x)) for x in places), max(float(np.max(x)) for x in places)
    ranges = [own]
    if not limited[0] and first < min(own[0], 0.0):
        ranges.append((first, own[0]))
    if not limited[1] and last > max(own[1], 0.0):
        ranges.append((own[1], last))
    return ranges


def _dips(
    search: SeparableSearch, values: FloatArray, i: int, low: float, high: float
) -> FloatArray:
    """(n_dip, n_par) where a scan of parameter i from low to high has its lowest local minima;
    beside each the same with the others moved to first order, where not all of them are linear.
    """
    if not high > low:
        return np.zeros((0, values.size))
    n_par, n_obs = search.free.size, search.posterior.problem.n_obs
    others = search.free[search.free != i]
    most = min(6000, _MOST_NUMBERS // ((1 + n_par) * max(1, n_obs)))
    grid = _grid(search, values, i, low, high, most)
    if grid.size < 3:
        return np.zeros((0, values.size))
    points = np.repeat(values[None, :], grid.size, axis=0)
    points[:, i] = grid
    squares = search.squares
    moved, heights = squares.solved_for(others, points, np.arange(grid.size), squares.step)
    padded = np.concatenate([[np.inf], heights, [np.inf]])
    dips = np.flatnonzero((heights <= padded[:-2]) & (heights <= padded[2:]) & np.isfinite(heights))
    dips = dips[np.argsort(heights[dips])][:_MOST_DIPS]
    if np.array_equal(others, search.linear):  # which a descent solves for at its first look
        return points[dips]
    return np.vstack([points[dips], np.clip(moved[dips], search.low, search.high)])


def _bending(
    search: SeparableSearch, values: FloatArray, i: int, coarse: FloatArray, high: float
) -> FloatArray:
    """(n,) how fast the shape of the curve changes with parameter i at values `coarse` (n,) of
    it.
    """
    points = np.repeat(values[None, :], coarse.size, axis=0)
    points[:, i] = coarse
    step = _WIDE * np.maximum(np.abs(coarse), search.squares.size[i])
    neighbours = points.copy()
    neighbours[:, i] += np.where(coarse + step > high, -step, step)
    _, tangents = search.squares.tangents(points, search.free, _WIDE)
    _, changes = search.squares.tangents(neighbours, search.free, _WIDE)
    with np.errstate(all="ignore"):
        changes -= tangents
        changes -= tangents @ solve(tangents, changes, 1e-9)
        squares = [np.einsum("kij,kij->kj", part, part) for part in (changes, tangents)]
        relative = (
            np.sqrt(squares[0] / squares[1]) / np.abs(neighbours[:, i] - points[:, i])[:, None]
        )
    return np.max(finite_or(relative, 0.0), axis=1)


def _grid(
    search: SeparableSearch, values: FloatArray, i: int, low: float, high: float, most: int
) -> FloatArray:
    """Values of parameter i from low to high, spaced by the change of the curve's shape."""
    straight = np.linspace(low, high, _N_COARSE)
    nearest = 0.0 if low < 0.0 < high else min(abs(low), abs(high))
    least = max(nearest, 1e-4 * max(abs(low), abs(high)))
    by_factors = np.geomspace(least, max(abs(low), abs(high)), _N_COARSE)
    coarse = np.unique(
        np.concatenate(
            [straight, *(side[(side > low) & (side < high)] for side in (by_factors, -by_factors))]
        )
    )
    parts = search.squares.parts(coarse.size, search.free.size)
    rate = np.concatenate([_bending(search, values, i, coarse[part], high) for part in parts])
    length = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(coarse))])
    if not (math.isfinite(length[-1]) and length[-1] > _SPACING):
        return np.zeros(0)
    # without a limit no further than the data can resolve, as many changes of shape as there are
    # points; but as far as the slow end of a frequency or a period, where a factor changes less
    at = float(np.interp(search.start_values[i], coarse, length))
    reach = float(search.posterior.problem.n_obs)
    log_rate = rate[[0, -1]] * np.abs(coarse[[0, -1]])
    to_end = (
        low == search.low[i] or log_rate[0] <= log_rate[1],
        high == search.high[i] or log_rate[1] < log_rate[0],
    )
    first = 0.0 if to_end[0] else max(0.0, at - reach)
    last = length[-1] if to_end[1] else min(length[-1], at + reach)
    n = int(min(max(12, (last - first) / _SPACING), max(3, most)))
    return np.interp(np.linspace(first, last, n), length, coarse)


def descended(search: SeparableSearch, points: FloatArray) -> FloatArray:
    """(n_point, n_par) points after some Levenberg-Marquardt steps in all curve parameters, those
    without a finite curve left out.
    """
    most = max(
        8, _MOST_NUMBERS // (10 * (1 + search.free.size) * max(1, search.posterior.problem.n_obs))
    )
    at = points[np.argsort(search.squares.objectives(points))][:most]
    # times the lowest squares that a descent has come to
    at, height, _ = search.squares.descend(at, ftol=_SETTLED, max_steps=_N_STEP, hopeless=10.0)
    at, height = at[np.isfinite(height)], height[np.isfinite(height)]
    return at[np.argsort(height)]
