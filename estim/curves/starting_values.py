"""Starting values of a formula's parameters, from the points alone.

The formula says in which unit each parameter must be (`dimensions`), and the points say how large
such a thing may be: a place or a length along x, a rate or a frequency up to half a turn from one
point to the next, a pure number (`scales`).  The linear parameters are solved for (`projected`), so
only the others are drawn, thousands of times, and the terms of a sum are looked for one after the
other.  The best trials go down to their optima, and each parameter is looked for again beside the
others.  Nothing is taken for found until three descents of a search (where the curve is no sum of
terms), or two searches that share no random number, end at the same squares.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError
from estim.curves.formula import Formula
from estim.curves.models import Limits
from estim.curves.projected import ProjectedCurve, projected

_DRAWN, _DRAWN_EACH = 3000, 1500  # trials, and more for each parameter that is drawn
_GO_DOWN = 12
# where the curve is no sum of terms: trials to begin with, descents that end at the best squares
_FEW, _ENOUGH = 1000, 3
_ROUGH, _FINE = 12, 100  # steps of a descent
# at most; parameters that are drawn, from which on three searches are made at least
_SEARCHES, _MANY = 6, 4
_AGREE = 1e-3  # of the squares
_SAME = 1e-6  # of the squares: minima in noise differ by more
_FINELY = 20  # places for each point, at which curves through the points are told apart


def guess_starts(
    formula: Formula,
    x: FloatArray,
    y: FloatArray,
    u: FloatArray,
    *,
    known: Mapping[str, float],
    limits: Mapping[str, Limits],
) -> dict[str, float]:
    """Name -> a value near the best, for each parameter of `formula`.

    x, y, u : (n_obs,) points and their relative errors.
    known : values that are held.  limits : the search keeps within them.  Raises InputError naming
        the parameters where several searches did not end at one place.
    """
    sought = [name for name in formula.names if name not in known]
    search = projected(formula, x, y, u, known, limits, sought)
    ends: list[tuple[FloatArray, float]] = []
    for seed in range(_SEARCHES if search.nonlinear else 1):
        end, sure = _searched(search, np.random.default_rng(seed + 1))
        ends.append(end)
        ends.sort(key=lambda end: end[1])
        if ends[0][1] == math.inf:
            continue
        if sure or (
            len(ends) > (1 if len(search.nonlinear) < _MANY else 2)
            and ends[1][1] <= ends[0][1] * (1.0 + _AGREE) + search.rounding
        ):
            return {**search.whole(_positive(search, *_smoothest(search, ends))), **known}
    names = search.nonlinear or sought
    why = (
        "from the points"
        if math.isfinite(ends[0][1])
        else "since the curve has no finite value at these x with any that was tried"
    )
    rule = (
        f"of {' and '.join(names)} could not be found {why}: give one of the right "
        f"sign and size, for example {names[0]} = 1"
    )
    raise InputError(
        f"{rule} (--start {names[0]}=1, or {{start = 1.0}} in a campaign)", field="start"
    )


def _searched(
    search: ProjectedCurve, rng: np.random.Generator
) -> tuple[tuple[FloatArray, float], bool]:
    """The best values (n_bent,) of one search, the squares that they leave, and whether several of
    its descents ended there.
    """
    if not search.nonlinear:
        return (np.zeros(0), float(search.squares(np.zeros((1, 0)))[0])), True
    n = _DRAWN + _DRAWN_EACH * len(search.nonlinear)
    drawn = np.column_stack([scale.draw(rng, n) for scale in search.scales])
    alone = len(search.blocks) < 2
    ends: list[tuple[FloatArray, float]] = []
    for points in (drawn[:_FEW], drawn) if alone else (drawn,):
        ends += _down(search, _best_apart(search, points, _GO_DOWN), _ROUGH)
        ends.sort(key=lambda end: end[1])
        same = ends[0][1] * (1.0 + _SAME) + search.rounding if ends else math.nan
        if alone and sum(end[1] <= same for end in ends) >= _ENOUGH:
            return _smoothest(search, ends), True
    ends += _down(search, _term_by_term(search, rng), _ROUGH)
    if not ends:
        return (drawn[0], math.inf), False
    return _swept(search, _smoothest(search, ends), rng), False


def _smoothest(
    search: ProjectedCurve, ends: Sequence[tuple[FloatArray, float]]
) -> tuple[FloatArray, float]:
    """The first of the best ends whose curve goes up and down between the points as little as
    any: of a product of oscillations no angle says that slower ones draw the same there.
    """
    same = min(end[1] for end in ends) * (1.0 + _SAME) + search.rounding
    equal = [end for end in ends if end[1] <= same]
    x = np.linspace(search.x.min(), search.x.max(), _FINELY * search.x.size)
    with np.errstate(all="ignore"):
        rough = [
            float(np.sum(np.abs(np.diff(search.formula.value(x, values)[0]))))
            for values in ({**search.whole(end[0]), **search.known} for end in equal)
        ]
    return next(end for end, r in zip(equal, rough, strict=True) if not r > 1.05 * min(rough))


def _term_by_term(search: ProjectedCurve, rng: np.random.Generator) -> list[FloatArray]:
    """Points at which the terms of a sum were found one after the other, the one first that
    explains most, each beside those before it.
    """
    blocks = [block for block in search.blocks if search.linear_of(block)]
    alone = [i for i in range(len(search.nonlinear)) if not any(i in block for block in blocks)]
    if len(blocks) < 2 or alone:
        return []
    points = []
    for first in blocks:
        absent = [block for block in blocks if block != first]
        # places of the first term to go on from
        for point in _best_apart(
            search, _drawn_for(search, first, np.zeros(len(search.nonlinear)), rng), 6, absent
        ):
            remaining = list(absent)
            while remaining:
                tries = []
                for block in remaining:
                    others = [other for other in remaining if other != block]
                    best = _best_apart(search, _drawn_for(search, block, point, rng), 1, others)
                    tries += [
                        (float(search.squares(candidate[None, :], others)[0]), candidate, block)
                        for candidate in best
                    ]
                if not tries:
                    break
                _, point, block = min(tries, key=lambda candidate: candidate[0])
                remaining.remove(block)
            points += [] if remaining else [point]
    return points


def _drawn_for(
    search: ProjectedCurve, block: Sequence[int], point: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """(n, n_bent) `point` with other values of the parameters of a block."""
    # values of one parameter, the others held
    n = 300 * len(block) ** 2
    tried = np.repeat(point[None, :], n, axis=0)
    for i in block:
        tried[:, i] = search.scales[i].draw(rng, n)
    return tried


def _swept(
    search: ProjectedCurve, end: tuple[FloatArray, float], rng: np.random.Generator
) -> tuple[FloatArray, float]:
    """The same after each parameter was looked for again beside the others, as long as that
    helps.
    """
    blocks: list[tuple[int, ...]] = [
        (i,) for i in range(len(search.nonlinear)) if len(search.nonlinear) > 1
    ]
    blocks += [block for block in search.blocks if 1 < len(block) < len(search.nonlinear)]
    for _ in range(4):
        before = end[1]
        for block in blocks:
            tried = _drawn_for(search, block, end[0], rng)
            end = min(
                [end, *_down(search, _best_apart(search, tried, 2), _ROUGH)],
                key=lambda candidate: candidate[1],
            )
        if not end[1] < before * (1.0 - 0.01 * _AGREE):
            break
    return _down(search, [end[0]], _FINE)[0]


def _positive(search: ProjectedCurve, values: FloatArray, squares: float) -> FloatArray:
    """The same curve with as few negative parameters as changes of one or two signs make it, within
    limits; sizes come before places and angles.
    """
    low, high = (
        np.array([getattr(scale, end) for scale in search.scales]) for end in ("low", "high")
    )
    worth = np.array([1.0 if scale.places is None else 0.1 for scale in search.scales])
    flips = [
        np.array([-1.0 if i in pair else 1.0 for i in range(values.size)])
        for n in (1, 2)
        for pair in combinations(range(values.size), n)
    ]
    for flip in flips:
        tried = values * flip
        fewer = worth @ (tried < 0.0) < worth @ (values < 0.0) and bool(
            np.all((tried > low) & (tried < high))
        )
        if (
            fewer
            and float(search.squares(tried[None, :])[0]) <= squares * (1.0 + 1e-9) + search.rounding
        ):
            values = tried
    return values


def _best_apart(
    search: ProjectedCurve, points: FloatArray, n: int, absent: Sequence[Sequence[int]] = ()
) -> list[FloatArray]:
    """The best `n` of `points` (n_point, n_bent), whose residuals are not alike, without the terms
    of the blocks `absent`.
    """
    squares = search.squares(points, absent)
    order = np.argsort(squares, kind="stable")[: 40 * n]
    order = order[np.isfinite(squares[order])]
    chosen: list[FloatArray] = []
    shapes = np.zeros((0, search.x.size))
    for first in range(0, order.size, 2 * n):
        tried = points[order[first : first + 2 * n]]
        with np.errstate(all="ignore"):
            residuals = search.left(tried, absent)
            residuals /= np.linalg.norm(residuals, axis=1, keepdims=True)
        for point, shape in zip(tried, residuals, strict=True):
            if len(chosen) < n and np.all(shapes @ shape < 0.9995):
                chosen.append(point)
                shapes = np.vstack([shapes, shape])
        if len(chosen) == n:
            break
    return chosen


def _down(
    search: ProjectedCurve, starts: Sequence[FloatArray], steps: int
) -> list[tuple[FloatArray, float]]:
    """Where descents in the drawn parameters end, and the squares there."""
    if not starts:
        return []
    points = np.array(starts)
    first = search.squares(points)
    # predicted decrease of the squares at which a descent ends
    ends, _, _ = search.function().descend(points, ftol=1e-8, max_steps=steps)
    after = search.squares(ends)
    lower = (after < first)[:, None]
    return list(zip(np.where(lower, ends, points), np.minimum(after, first).tolist(), strict=True))
