"""Starting values of a formula's parameters, from the points alone.

The formula says in which unit each parameter must be (`dimensions`), and the points show how large
such a thing may be: a place or a length along x, a rate or a frequency up to half a turn from one
point to the next, a pure number (`scales`).  The linear parameters are solved for
(`variable_projection`), so only the others are drawn, thousands of times.  The best trials go down
to their optima, and each parameter, and those of each term of a sum, are looked for again beside
the others.  Nothing is taken for found until three descents of a search (where the curve is no sum
of terms), or two searches that share no random number, end at the same squares.  Of numbers that
draw the same curve the search of the fit takes the usual ones (`estim.fitting.optimum`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError
from estim.curves.formula import Formula
from estim.curves.models import Limits
from estim.curves.variable_projection import ProjectedCurve, project_curve

_DRAWN, _DRAWN_EACH = 3000, 1500  # trials, and more for each parameter that is drawn
_GO_DOWN = 12
# where the curve is no sum of terms: trials to begin with, descents that end at the best squares
_FEW, _ENOUGH = 1000, 3
_ROUGH, _FINE = 12, 100  # steps of a descent
# at most; parameters that are drawn, from which on three searches are made at least
_SEARCHES, _MANY = 6, 4
_AGREE = 1e-3  # of the squares
_FINELY = 20  # abscissas for each point, at which curves through the points are compared
_SAME = 1e-6  # of the squares: minima in noise differ by more

End = tuple[FloatArray, float]  # values (n_bent,) of the drawn parameters, and the squares left


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
    unknown = [name for name in formula.names if name not in known]
    search = project_curve(formula, x, y, u, known, limits, unknown)
    ends: list[End] = []
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
            return {**search.parameters_at(_plainest(search, ends)[0]), **known}
    names = search.nonlinear or unknown
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


def _searched(search: ProjectedCurve, rng: np.random.Generator) -> tuple[End, bool]:
    """The best values (n_bent,) of one search, the squares that they leave, and whether several of
    its descents ended there.
    """
    if not search.nonlinear:
        return (np.zeros(0), float(search.squares(np.zeros((1, 0)))[0])), True
    n = _DRAWN + _DRAWN_EACH * len(search.nonlinear)
    drawn = np.column_stack([scale.draw(rng, n) for scale in search.scales])
    alone = len(search.blocks) < 2
    ends: list[End] = []
    for points in (drawn[:_FEW], drawn) if alone else (drawn,):
        ends += _down(search, _best(search, points, _GO_DOWN), _ROUGH)
        if alone and len(_equal(search, ends)) >= _ENOUGH:
            return _plainest(search, ends), True
    if not ends:
        return (drawn[0], math.inf), False
    return _swept(search, _plainest(search, ends), rng), False


def _equal(search: ProjectedCurve, ends: Sequence[End]) -> list[End]:
    """Those that are as good as the best."""
    limit = min((end[1] for end in ends), default=math.nan) * (1.0 + _SAME) + search.rounding
    return [end for end in ends if end[1] <= limit]


def _plainest(search: ProjectedCurve, ends: Sequence[End]) -> End:
    """Of the best ends one whose curve goes up and down between the points as little as any (of
    oscillations the slowest), with the fewest negative numbers.
    """
    equal = _equal(search, ends)
    x = np.linspace(search.x.min(), search.x.max(), _FINELY * search.x.size)
    with np.errstate(all="ignore"):
        rough = [
            float(np.sum(np.abs(np.diff(search.formula.value(x, values)[0]))))
            for values in ({**search.parameters_at(end[0]), **search.known} for end in equal)
        ]
    smooth = [end for end, r in zip(equal, rough, strict=True) if not r > 1.05 * min(rough)]
    return min(smooth, key=lambda end: int(np.sum(end[0] < 0.0)))


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


def _swept(search: ProjectedCurve, end: End, rng: np.random.Generator) -> End:
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
                [end, *_down(search, _best(search, tried, 2), _ROUGH)],
                key=lambda candidate: candidate[1],
            )
        if not end[1] < before * (1.0 - 0.01 * _AGREE):
            break
    return _down(search, end[0][None, :], _FINE)[0]


def _best(search: ProjectedCurve, points: FloatArray, n: int) -> FloatArray:
    """The best `n` of `points` (n_point, n_bent), or fewer where the curve is not finite."""
    squares = search.squares(points)
    order = np.argsort(squares, kind="stable")[:n]
    return points[order[np.isfinite(squares[order])]]


def _down(search: ProjectedCurve, points: FloatArray, steps: int) -> list[End]:
    """Where descents in the drawn parameters end, and the squares there."""
    if not len(points):
        return []
    # predicted decrease of the squares at which a descent ends
    ends, squares, _ = search.function.descend(points, ftol=1e-8, max_steps=steps)
    return list(zip(ends, squares.tolist(), strict=True))
