"""The best point of a problem whose starting values may be far off.

Parameters that the curve is linear in need no start: they are solved for at every step (variable projection; Golub and
Pereyra, SIAM J. Numer. Anal. 10 (1973) 413, with Kaufman's Jacobian), so the search runs in the others alone.  It starts
from the user's values and from the best of many points around them, because a frequency or a rate has many local optima.
The winner is polished by Gauss-Newton steps with a QR decomposition until they are at rounding error.

Where two optima are equally good (two exponentials can change places) the one closest to the user's start is taken.  The
others are kept where a prior, and not a start, says which values are possible: then each of them is a solution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from estim.errors import InputError
from estim.fitting import WITHIN_REACH, Fit, far_apart, fit_least_squares
from estim.flat import Flat
from estim.problem import Problem
from estim.separable import Search, rounding, set_apart

FloatArray = NDArray[np.float64]

_N_SCREEN = 200
N_START = 8
_N_TWIN = 200  # exchanges of parameters that are looked at
_DECADES = 1.0  # spread of the points around the start, standard deviation of log10
_SAME = 1e-6  # relative difference of sums of squares between equal optima
_SINGULAR = 1e-11  # ratio of singular values, columns scaled to unit length
_SETTLED = 1e-7  # last step, in standard deviations
_MOST_OTHERS = 6  # other optima that are looked at


@dataclass(frozen=True, eq=False)
class Optimum:
    """The best point found.

    values : (n_par,).  cov : (n_par, n_par) inverse information in the whitened residuals' units; `free` parameters only,
    zero elsewhere (noise parameters, parameters on a bound).  chi2 : sum of squares, priors included.
    step : size of the last Gauss-Newton step in standard deviations; tolerance : what rounding errors may leave of it.
    condition : smallest / largest singular value.
    at_bound : (n_par,) which parameters lie on a bound.  n_start, n_same : searches run, and how many ended here.
    others : (n_other, n_par) other points at which a search ended or that are as good by symmetry, best first.
    """

    values: FloatArray
    cov: FloatArray
    chi2: float
    step: float
    tolerance: float
    condition: float
    at_bound: NDArray[np.bool_]
    n_start: int
    n_same: int
    others: FloatArray

    @property
    def singular(self) -> bool:
        return not self.condition > _SINGULAR

    @property
    def settled(self) -> bool:
        return self.step < self.tolerance


def find_optimum(problem: Problem, start: FloatArray, *, rng: np.random.Generator, n_start: int = N_START) -> Optimum:
    """The best point of `problem` in its curve parameters; noise parameters stay at `start` (n_par,).

    Raises InputError where the curve is not finite at the start nor at any point around it.
    """
    with np.errstate(all="ignore"):  # far from the optimum a curve may overflow: such points lose
        return _found(set_apart(problem, start, rng), start, rng, n_start)


def _found(search: Search, start: FloatArray, rng: np.random.Generator, n_start: int) -> Optimum:
    tried = [_descend(search, start)]
    if search.bent.size and n_start > 1:
        tried += [_descend(search, point) for point in _screened(search, start, rng, n_start - 1)]
    finished = [(values, chi2) for values in tried if math.isfinite(chi2 := search.chi2(values))]
    if not finished:
        raise InputError("gives a curve that is not finite at the data, there and around", field="start")
    least = min(chi2 for _, chi2 in finished)
    enough = least * (1.0 + _SAME) + rounding(search)
    equal = [values for values, chi2 in finished if chi2 <= enough]
    twins = [twin for values in equal for twin in _relabelled(search, values) if search.chi2(twin) <= enough]
    values = min([*equal, *twins], key=lambda candidate: _distance(search, candidate, start))
    ranked = [*twins, *(point for point, _ in sorted(finished, key=lambda end: end[1]))]
    others = np.array([point for point in ranked if point is not values]).reshape(-1, start.size)
    return _polished(search, values, others, n_start=len(tried), n_same=len(equal))


def _relabelled(search: Search, values: FloatArray) -> list[FloatArray]:
    """The same point with two, or two pairs, of the nonlinear parameters exchanged, or one with the other sign or turned by half circles."""
    found = []
    pairs = list(combinations(search.bent, 2))
    exchanges = [(pair,) for pair in pairs] + [(a, b) for a, b in combinations(pairs, 2) if not set(a) & set(b)]
    for exchange in exchanges[:_N_TWIN]:
        twin = values.copy()
        for i, j in exchange:
            twin[i], twin[j] = twin[j], twin[i]
        found.append(twin)
    for i in search.bent:
        turns = [math.pi * round((search.held[i] - values[i]) / math.pi), 180.0 * round((search.held[i] - values[i]) / 180.0)]
        others = [-values[i], *(values[i] + turn + half for turn, half in zip(turns, (math.pi, 180.0), strict=True))]
        others += [values[i] + turn - half for turn, half in zip(turns, (math.pi, 180.0), strict=True)] + [values[i] + turn for turn in turns]
        found += [np.where(np.arange(values.size) == i, other, values) for other in others]
    inside = [twin for twin in found if np.all((twin >= search.low) & (twin <= search.high))]
    return [search.solved(twin) for twin in inside]


def fit_optimum(problem: Problem, *, rng: np.random.Generator) -> Fit:
    """The posterior mode of a problem with a user's own curve, as `fit_least_squares` returns it, but found from afar."""
    best = find_optimum(problem, problem.start(), rng=rng)
    fit = fit_least_squares(problem, rng=rng, n_start=1, start=best.values)
    others = _other_solutions(problem, fit, best, rng)
    if not problem.noise_names and not np.any(best.at_bound):
        sds = np.where(np.isfinite(fit.sds), np.sqrt(np.diag(best.cov)), np.nan)
        fit = replace(fit, values=best.values, cov=best.cov, sds=sds, singular=best.singular)
    words = fit.message if fit.singular or not fit.success else f"settled; {best.n_same} of {best.n_start} starts led to this optimum"
    return replace(fit, n_start=best.n_start, n_same=best.n_same, message=words, others=others)


def _other_solutions(problem: Problem, fit: Fit, best: Optimum, rng: np.random.Generator) -> FloatArray:
    """(n_other, n_par) optima not much worse than that of `fit`, far from it, that no start has ruled out."""
    curvature = np.sqrt(np.diag(fit.cov))
    scale = np.where(curvature > 0.0, curvature, np.inf)
    chosen = np.array([isinstance(p.prior, Flat) for p in problem.parameters])
    found = []
    for point in far_apart(fit.values, list(best.others), scale)[:_MOST_OTHERS]:
        other = fit_least_squares(problem, rng=rng, n_start=1, start=point)
        worse = float(np.diff(fit.posterior.log_density(np.vstack([other.values, fit.values])))[0])
        twin = abs(worse) < 1e-3 and not np.any(np.abs(other.values - fit.values)[~chosen] > 3.0 * scale[~chosen])
        if worse < WITHIN_REACH and not twin:
            found.append(other.values)
    return far_apart(fit.values, found, scale)


def _descend(search: Search, start: FloatArray) -> FloatArray:
    """Least squares from one point, the linear parameters solved for at each step."""
    from scipy.optimize import least_squares

    if not search.bent.size:
        return search.solved(start)
    bent = search.bent
    low, high = search.low[bent], search.high[bent]
    first = _inside(start[bent], low, high)
    unit = np.where(first != 0.0, np.abs(first), 1.0)

    last: tuple[FloatArray, FloatArray] | None = None  # least_squares asks for residuals and Jacobian at the same point

    def filled(shape: FloatArray) -> FloatArray:
        nonlocal last
        if last is None or not np.array_equal(last[0], shape):
            full = start.copy()
            full[bent] = np.clip(shape * unit, low, high)
            last = shape.copy(), search.solved(full)
        return last[1]

    size = math.sqrt(search.chi2(filled(first / unit)))
    if not 0.0 < size < math.inf:
        return filled(first / unit)

    def residuals(shape: FloatArray) -> FloatArray:
        return search.residuals(filled(shape)) / size

    def jacobian(shape: FloatArray) -> FloatArray:
        columns = search.jacobian(filled(shape))
        columns[~np.isfinite(columns)] = 0.0
        turned = columns[:, bent]
        if search.linear.size:
            basis, _ = np.linalg.qr(columns[:, search.linear])
            turned = turned - basis @ (basis.T @ turned)
        return turned * unit / size

    result = least_squares(
        residuals, first / unit, jac=jacobian, bounds=(low / unit, high / unit), x_scale="jac", ftol=1e-11, xtol=1e-11, gtol=None, max_nfev=200
    )
    return filled(result.x if np.all(np.isfinite(result.x)) else first / unit)  # nan: no parameter changes the residuals here


def _inside(values: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """`values` moved strictly between the limits."""
    inner = [edge + sign * 1e-9 * (1.0 + np.abs(np.where(np.isfinite(edge), edge, 0.0))) for edge, sign in ((low, 1.0), (high, -1.0))]
    return np.clip(values, *inner)


def _screened(search: Search, start: FloatArray, rng: np.random.Generator, n: int) -> list[FloatArray]:
    """The best `n` of many points around the start, no two of them alike."""
    points = [search.solved(_scattered(search, start, rng)) for _ in range(_N_SCREEN)]
    ranked = sorted(((search.chi2(point), i) for i, point in enumerate(points)))
    chosen: list[FloatArray] = []
    for chi2, i in ranked:
        if len(chosen) == n or not math.isfinite(chi2):
            break
        if all(_distance(search, points[i], other) > 0.01 for other in chosen):
            chosen.append(points[i])
    return chosen


def _scattered(search: Search, start: FloatArray, rng: np.random.Generator) -> FloatArray:
    """A point around the start: each nonlinear parameter times a factor, or drawn between its limits or from its prior."""
    values = start.copy()
    for i in search.bent:
        prior = search.posterior.problem.parameters[i].prior
        if math.isfinite(prior.sd) and math.isfinite(prior.low) == math.isfinite(prior.high):
            values[i] = float(prior.draw(rng, 1)[0])
            continue
        size = abs(start[i])
        factor = 10.0 ** (_DECADES * rng.standard_normal())
        values[i] = start[i] * factor if size > 0.0 else rng.choice([-1.0, 1.0]) * factor
        values[i] = min(max(values[i], search.low[i]), search.high[i])
    return values


def _distance(search: Search, values: FloatArray, other: FloatArray) -> float:
    """How far apart two points are: changes of sign, then factors, of the nonlinear parameters; signs of the linear ones."""
    a, b = values[search.bent], other[search.bent]
    with np.errstate(all="ignore"):
        factors = np.where(b == 0.0, np.minimum(np.abs(a), 10.0), np.log(np.maximum(np.abs(a / np.where(b == 0.0, 1.0, b)), 1e-6)))
    signs = np.sum(values[search.linear] * other[search.linear] < 0.0)
    return float(np.sum(np.where(a * b < 0.0, 100.0, 0.0) + factors**2) + 30.0 * signs)


def _polished(search: Search, values: FloatArray, others: FloatArray, *, n_start: int, n_same: int) -> Optimum:
    """Gauss-Newton steps from `values` while they help; parameters on a bound that they would cross stay there."""
    step_size, chi2 = math.inf, search.chi2(values)
    free = search.free
    for _ in range(100):
        jacobian, residual = search.jacobian(values), search.residuals(values)
        near = _near_bound(search, values, jacobian.T @ residual)
        moving = free[~near[free]]
        if not moving.size:
            step_size = 0.0
            break
        step, sds = _gauss_newton(jacobian[:, moving], residual)
        noise = math.sqrt(max(chi2, 10.0 * rounding(search), 1e-300) / max(1, residual.size - moving.size))
        size = float(np.max(np.abs(step) / np.where(sds > 0.0, sds, np.inf), initial=0.0)) / noise
        length, better = 1.0, False
        while length > 1e-4 and not better:
            trial = values.copy()
            trial[moving] = np.clip(values[moving] + length * step, search.low[moving], search.high[moving])
            reached = search.chi2(trial)
            better = reached < chi2 or (reached <= chi2 * (1.0 + 1e-9) and size < 0.9 * step_size)
            length *= 0.5
        if not better:
            step_size = min(step_size, size)
            break
        values, chi2, step_size = trial, reached, size
        if size < 1e-13:
            break
    left = 0.1 * math.sqrt(rounding(search) / max(chi2, 1e-300) * max(1, search.residuals(values).size - free.size))
    jacobian, residual = search.jacobian(values), search.residuals(values)
    near = _near_bound(search, values, jacobian.T @ residual)
    moving = free[~near[free]]
    cov, condition = _covariance(jacobian[:, moving])
    full = np.zeros((values.size, values.size))
    full[np.ix_(moving, moving)] = cov
    return Optimum(values, full, chi2, step_size, max(_SETTLED, left), condition, near, n_start, n_same, others)


def _near_bound(search: Search, values: FloatArray, gradient: FloatArray) -> NDArray[np.bool_]:
    """Which parameters lie on a bound that the descent would push them across."""
    margin = 1e-8 * (1.0 + np.abs(values))
    with np.errstate(invalid="ignore"):
        return ((values - search.low < margin) & (gradient > 0.0)) | ((search.high - values < margin) & (gradient < 0.0))


def _scaled(jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0.0] = 1.0
    return jacobian / scale, scale


def _gauss_newton(jacobian: FloatArray, residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Step (n,) and standard deviations (n,) for unit residuals, by a singular value decomposition of scaled columns."""
    scaled, scale = _scaled(jacobian)
    left, singular, right = np.linalg.svd(scaled, full_matrices=False)
    inverse = np.where(singular > _SINGULAR * singular[0], 1.0 / np.maximum(singular, 1e-300), 0.0)
    step = -(right.T * inverse) @ (left.T @ residual) / scale
    return step, np.sqrt(np.sum((right.T * inverse) ** 2, axis=1)) / scale


def _covariance(jacobian: FloatArray) -> tuple[FloatArray, float]:
    """(J^T J)^-1 and the ratio of the smallest to the largest singular value of J with unit columns."""
    if not jacobian.shape[1]:
        return np.zeros((0, 0)), 1.0
    scaled, scale = _scaled(jacobian)
    _, singular, right = np.linalg.svd(scaled, full_matrices=False)
    condition = float(singular[-1] / singular[0]) if singular[0] > 0.0 and jacobian.shape[0] >= jacobian.shape[1] else 0.0
    inverse = np.where(singular > _SINGULAR * singular[0], 1.0 / np.maximum(singular, 1e-300), 0.0)
    return (right.T * inverse**2) @ right / np.outer(scale, scale), condition
