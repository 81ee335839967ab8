"""Starting values of a sum of named curves, from the points alone.

A curve is linear in its amplitudes, so only widths, places and rates are searched, each term over a
grid of its own; the amplitudes of all terms are solved for at every point of the grid (variable
projection; Golub and Pereyra, SIAM J. Numer. Anal. 10 (1973) 413).  Terms enter one by one, the one
first that explains most (orthogonal matching pursuit; Pati, Rezaiifar and Krishnaprasad, Asilomar
Conf. 27 (1993) 40), and each is looked for again beside the others until nothing gets better.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError
from estim.curves.formula import Formula, read_formula
from estim.curves.models import Extent, Limits, ModelSum, Term

_CHUNK = 2_000_000  # numbers in memory at a time
_SWEEPS = 6
_STEPS = 25  # of a descent
# of the best values of a grid, how many of them to start from, correlation of curves that are one
_LOOKED_AT, _SEVERAL, _ALIKE = 400, 6, 0.95
_KEPT = 2  # of the runs with all terms
_BETTER = 1e-6  # share of the squares that a sweep must save
_FLAT = 1e-9  # share of a column that must be left where the columns before it are taken out


def find_starts(
    asked: ModelSum,
    x: FloatArray,
    y: FloatArray,
    u: FloatArray,
    *,
    known: Mapping[str, float],
    limits: Mapping[str, Limits],
) -> dict[str, float]:
    """Name -> a value near the best, for each parameter of `asked`.

    x, y, u : (n_obs,) points and their relative errors.
    known : values that are held, or from which the user wishes to start.
    limits : the search keeps within them.  Raises InputError where no curve of this kind has a
        finite value at the points.
    """
    places = np.unique(x)
    if places.size < 2:
        raise InputError(
            "must have two different values at least, for starting values to be found",
            field="x",
            value=float(x[0]),
        )
    extent = Extent(
        float(places[0]), float(places[-1]), float(np.median(np.diff(places))), places.size
    )
    searches = [
        _TermSearch(term, read_formula(term.expression), _candidates(term, extent, known, limits))
        for term in asked.terms
    ]
    weight = 1.0 / (u / float(np.median(u)))
    chosen = _pursued(searches, x, y * weight, weight, limits)
    columns = _Data(x, y, weight).columns(searches, dict(enumerate(chosen)))
    size = np.linalg.norm(columns, axis=1)
    solved = np.linalg.lstsq((columns / size[:, None]).T, y * weight, rcond=None)[0] / size
    values: dict[str, float] = {}
    for search, bent in zip(searches, chosen, strict=True):
        n = len(search.term.model.units)
        values |= search.values(bent, solved[:n])
        solved = solved[n:]
    return {
        name: _within(known.get(name, value), limits.get(name)) for name, value in values.items()
    }


@dataclass(frozen=True, eq=False)
class _TermSearch:
    """A term with the values (n, n_bent) of its bent parameters to be tried."""

    term: Term
    formula: Formula
    grid: FloatArray

    def columns(self, x: FloatArray, bent: FloatArray) -> FloatArray:
        """(n, n_unit, n_obs) curves at the values bent (n, n_bent), one for each unit of the
        others.
        """
        model = self.term.model
        given = {self.term.prefix + name: bent[:, [i]] for i, name in enumerate(model.bent)}
        with np.errstate(all="ignore"):
            curves = [
                self.formula.value(x, {**given, **self.term.renamed(unit)}) for unit in model.units
            ]
        return np.stack(
            [np.broadcast_to(curve, (bent.shape[0], x.size)) for curve in curves], axis=1
        )

    def values(self, bent: FloatArray, solved: FloatArray) -> dict[str, float]:
        """Name -> value from the coefficients (n_unit,) of the units."""
        model = self.term.model
        if "phase" in model.units[0]:
            others = {
                "amplitude": float(np.hypot(*solved)),
                "phase": math.atan2(-solved[1], solved[0]),
            }
        else:
            others = dict(zip(model.units[0], solved.tolist(), strict=True))
        return self.term.renamed({**others, **dict(zip(model.bent, bent.tolist(), strict=True))})


def _candidates(
    term: Term, extent: Extent, known: Mapping[str, float], limits: Mapping[str, Limits]
) -> FloatArray:
    """Values of the bent parameters to try: the known ones held, the others within their limits if
    any of the grid's are.
    """
    grid = term.model.grid(extent)
    for i, name in enumerate(term.model.bent):
        if term.prefix + name in known:
            grid[:, i] = known[term.prefix + name]
            continue
        low, high = limits.get(term.prefix + name, (None, None))
        inside = (grid[:, i] > (-math.inf if low is None else low)) & (
            grid[:, i] < (math.inf if high is None else high)
        )
        if np.any(inside):
            grid = grid[inside]
        else:
            ends = [
                _within(float(end), (low, high)) for end in (grid[:, i].min(), grid[:, i].max())
            ]
            middles = np.linspace(ends[0], ends[1], 25)
            grid = np.concatenate(
                [
                    np.where(np.arange(grid.shape[1]) == i, middle, grid)
                    for middle in np.unique(middles)
                ]
            )
    return np.unique(grid, axis=0)


def _pursued(
    searches: Sequence[_TermSearch],
    x: FloatArray,
    y: FloatArray,
    weight: FloatArray,
    limits: Mapping[str, Limits],
) -> list[FloatArray]:
    """Values (n_bent,) of the bent parameters of each term; y is weighted."""
    data = _Data(x, y, weight)
    straight = {
        i: search.grid[0] for i, search in enumerate(searches) if not search.term.model.bent
    }
    bent = [i for i in range(len(searches)) if i not in straight]
    runs = (
        [(straight, math.inf)]
        if not bent
        else [
            _completed(searches, {**straight, i: value}, squares, data, limits)
            for i in bent
            for value, squares in _best(searches, i, straight, data)
        ]
    )
    runs.sort(key=lambda run: run[1])
    if len(bent) > 1:
        runs = [
            _swept(searches, chosen, remainder, bent, data, limits)
            for chosen, remainder in runs[:_KEPT]
        ]
    chosen, _ = min(runs, key=lambda run: run[1])
    return [chosen[i] for i in range(len(searches))]


def _completed(
    searches: Sequence[_TermSearch],
    chosen: dict[int, FloatArray],
    left: float,
    data: _Data,
    limits: Mapping[str, Limits],
) -> tuple[dict[int, FloatArray], float]:
    """All terms and the squares they leave, from the terms `chosen`, which leave the squares
    `left`.
    """
    chosen, left = _polished(searches, chosen, left, data, limits)
    while len(chosen) < len(searches):
        candidates = {
            i: _best(searches, i, chosen, data)[0] for i in range(len(searches)) if i not in chosen
        }
        first = min(candidates, key=lambda i: candidates[i][1])
        chosen, left = _polished(
            searches, {**chosen, first: candidates[first][0]}, candidates[first][1], data, limits
        )
    return chosen, left


def _swept(
    searches: Sequence[_TermSearch],
    chosen: dict[int, FloatArray],
    left: float,
    bent: Sequence[int],
    data: _Data,
    limits: Mapping[str, Limits],
) -> tuple[dict[int, FloatArray], float]:
    """The same after each bent term was looked for again beside the others."""
    for _ in range(_SWEEPS):
        before = left
        for i in bent:
            value, squares = _best(
                searches, i, {j: other for j, other in chosen.items() if j != i}, data
            )[0]
            tried, squares = _polished(searches, {**chosen, i: value}, squares, data, limits)
            if squares < left:
                chosen, left = tried, squares
        if not left < before * (1.0 - _BETTER):
            break
    return chosen, left


@dataclass(frozen=True, eq=False)
class _Data:
    """Points (n_obs,), y weighted."""

    x: FloatArray
    y: FloatArray
    weight: FloatArray

    def left(self, searches: Sequence[_TermSearch], chosen: Mapping[int, FloatArray]) -> FloatArray:
        """(n_obs,) what the terms `chosen` do not explain of y."""
        base = _basis(self.columns(searches, chosen))
        return np.asarray(self.y - base @ (base.T @ self.y))

    def columns(
        self, searches: Sequence[_TermSearch], chosen: Mapping[int, FloatArray]
    ) -> FloatArray:
        """(n, n_obs) weighted curves of the terms."""
        curves = [
            searches[j].columns(self.x, bent[None, :])[0] * self.weight
            for j, bent in chosen.items()
        ]
        return np.concatenate(curves) if curves else np.zeros((0, self.x.size))


def _polished(
    searches: Sequence[_TermSearch],
    chosen: dict[int, FloatArray],
    squares: float,
    data: _Data,
    limits: Mapping[str, Limits],
) -> tuple[dict[int, FloatArray], float]:
    """The same after a descent in all bent parameters, if that is better and within the limits."""
    from scipy.optimize import least_squares

    names = {
        i: [searches[i].term.prefix + name for name in searches[i].term.model.bent] for i in chosen
    }
    held = {
        i: [len(np.unique(searches[i].grid[:, k])) == 1 for k in range(len(names[i]))]
        for i in chosen
    }
    free = [(i, k) for i in chosen for k in range(len(names[i])) if not held[i][k]]
    if not free:
        return chosen, squares

    def at(point: FloatArray) -> dict[int, FloatArray]:
        moved = {i: bent.copy() for i, bent in chosen.items()}
        for (i, k), value in zip(free, point, strict=True):
            moved[i][k] = value
        return moved

    def residuals(point: FloatArray) -> FloatArray:
        residual = data.left(searches, at(point))
        return (
            residual
            if np.all(np.isfinite(residual))
            else np.full(residual.size, 1e3 * math.sqrt(squares + 1e-300))
        )

    first = np.array([chosen[i][k] for i, k in free])
    with np.errstate(all="ignore"):
        size = math.sqrt(squares) or 1.0
        result = least_squares(
            lambda point: residuals(point) / size,
            first,
            method="trf",
            x_scale="jac",
            max_nfev=_STEPS,
        )
    inside = all(
        _allowed(value, limits.get(names[i][k]))
        for (i, k), value in zip(free, result.x, strict=True)
    )
    after = 2.0 * float(result.cost) * size**2
    return (at(result.x), after) if inside and after < squares else (chosen, squares)


def _best(
    searches: Sequence[_TermSearch], which: int, others: Mapping[int, FloatArray], data: _Data
) -> list[tuple[FloatArray, float]]:
    """Values of the grid of one term that leave the fewest squares beside the others, each with
    these squares; the best first, none like another.
    """
    base = _basis(data.columns(searches, others))
    rest = data.y - base @ (base.T @ data.y)
    search = searches[which]
    size = max(1, _CHUNK // data.x.size)
    with np.errstate(all="ignore"):
        parts = [search.grid[k : k + size] for k in range(0, search.grid.shape[0], size)]
        saved = np.concatenate(
            [_saved(search.columns(data.x, part) * data.weight, base, rest) for part in parts]
        )
    order = np.argsort(-saved, kind="stable")[:_LOOKED_AT]
    order = order[saved[order] > -math.inf]
    if not order.size:
        raise InputError(
            f"'{search.term.model.name}' has no finite value at these x: {search.term.expression}",
            field="curve",
        )
    columns = search.columns(data.x, search.grid[order])[:, 0] * data.weight
    columns = columns / np.linalg.norm(columns, axis=1, keepdims=True)
    selected: list[int] = []
    for k in range(order.size):
        if all(abs(float(columns[k] @ columns[other])) < _ALIKE for other in selected):
            selected.append(k)
        if len(selected) == _SEVERAL:
            break
    return [(search.grid[order[k]], float(rest @ rest - saved[order[k]])) for k in selected]


def _saved(tried: FloatArray, base: FloatArray, rest: FloatArray) -> FloatArray:
    """(n,) squares of `rest` that the columns tried (n, k, n_obs) explain beside the orthonormal
    `base`; -inf where one is not finite.
    """
    saved, taken = np.zeros(tried.shape[0]), list[FloatArray]()
    for k in range(tried.shape[1]):
        whole = np.linalg.norm(tried[:, k], axis=1, keepdims=True)
        column = tried[:, k] / whole
        column = column - (column @ base) @ base.T
        for earlier in taken:
            column = column - np.sum(column * earlier, axis=1, keepdims=True) * earlier
        length = np.linalg.norm(column, axis=1, keepdims=True)
        column = np.where(length > _FLAT, column / length, 0.0)
        taken.append(column)
        saved = np.where(
            np.isfinite(whole[:, 0]) & (whole[:, 0] > 0.0), saved + (column @ rest) ** 2, -math.inf
        )
    return saved


def _basis(columns: FloatArray) -> FloatArray:
    """(n_obs, n) orthonormal columns that span (k, n_obs)."""
    size = np.linalg.norm(columns, axis=1, keepdims=True)
    if not columns.size or not np.all(np.isfinite(columns)):
        return np.full((columns.shape[1], min(1, columns.shape[0])), np.nan)
    left, singular, _ = np.linalg.svd(
        (columns / np.where(size > 0.0, size, 1.0)).T, full_matrices=False
    )
    return np.asarray(left[:, singular > _FLAT * singular[0]])


def _allowed(value: float, limits: Limits | None) -> bool:
    low, high = limits or (None, None)
    return (low is None or value > low) and (high is None or value < high)


def _within(value: float, limits: Limits | None) -> float:
    low, high = limits or (None, None)
    low, high = -math.inf if low is None else low, math.inf if high is None else high
    if low < value < high:
        return value
    if math.isfinite(low) and math.isfinite(high):
        return 0.5 * (low + high)
    return (
        (low + max(1.0, abs(low)) if math.isfinite(low) else high - max(1.0, abs(high)))
        if low > -math.inf or high < math.inf
        else value
    )
