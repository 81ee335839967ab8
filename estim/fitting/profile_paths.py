"""One side of a profile: the path outward from the mode, where it crosses a level, and the valleys
beside it.  Tasks of `run_descents`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from estim.arrays import FloatArray
from estim.fitting.profile_search import ProfileSearch
from estim.levenberg_marquardt import End, Start, Task

_LOST = 16.0  # times the level
# standard deviations or, of the logarithm of a size, a distance, and a step in the square root of
# the objective: no end, but a search that lost its way; and standard deviations at which rounding
# errors end it
_FAR, _DECADES, _JUMP, _NOWHERE = 100.0, math.log(1e8), 0.1, 1e6
_SETTLED = 1e-4  # of a height: a point on the level


def path(
    search: ProfileSearch, mode: End, first: End, i: int, sign: float, rise: float
) -> Task[list[End]]:
    """Points outward from `first`, the mode or a point beside it, until the objective has risen by
    `rise` above that of the mode, to the edge of the prior, or out of reach.
    """
    edge = float(search.high[i] if sign > 0.0 else search.low[i])
    # prior standard deviations beyond which nothing is looked for
    far = float(mode.values[i]) + sign * 40.0 * float(search.prior_sd[i])
    end = min(edge, far) if sign > 0.0 else max(edge, far)
    points, step = [first], 0.5 * float(search.scale[i])
    while len(points) < 60 and points[-1].values[i] != end:
        current = float(points[-1].values[i])
        target = current + sign * step
        if sign * (end - target) < 0.1 * step:
            target = end
        point = yield _predicted(search, points, i, target)
        points.append(point)
        if not point.objective - mode.objective < rise:
            break
        gained = math.sqrt(max(point.objective - mode.objective, 0.0)) - math.sqrt(
            max(points[-2].objective - mode.objective, 0.0)
        )
        if gained < 0.25:
            step *= 1.6
    return points if first is not mode else points[1:]


def _predicted(search: ProfileSearch, points: Sequence[End], i: int, target: float) -> Start:
    """A start where the other parameters should be when parameter i is at `target`: on the line
    through the last two points.
    """
    last = points[-1].values
    if len(points) > 1 and points[-1].values[i] != points[-2].values[i]:
        slope = (last - points[-2].values) / (last[i] - points[-2].values[i])
    else:
        slope = search.tangent(last, i)
    values = np.clip(last + slope * (target - last[i]), search.low, search.high)
    values[i] = target
    return Start(values, (i,), points[-1], instead=_with(last, i, target))


def crossing(
    search: ProfileSearch, points: Sequence[End], i: int, rise: float
) -> Task[tuple[float | None, list[End]]]:
    """Where the objective passes `rise` for the last time on a path (None: it does not), and the
    points computed to find it.

    False position, the height of an end that stays halved (Illinois).
    """
    mode = points[0]
    inside = [k for k, point in enumerate(points) if point.objective - mode.objective < rise]
    outer = max(inside, default=0) + 1
    if outer >= len(points):
        return None, []
    inner, outer_point = points[outer - 1], points[outer]
    below, above = _height(inner, mode, rise), _height(outer_point, mode, rise)
    cuts: list[End] = []
    before = 0.0
    while (
        len(cuts) < 100
        and abs(float(outer_point.values[i] - inner.values[i])) > 1e-8 * search.scale[i]
    ):
        share = below / (below - above)
        values = inner.values + share * (outer_point.values - inner.values)
        # far above the level the others may be anywhere, as those of a power law with a < 0
        unbounded = not outer_point.objective - mode.objective < _LOST * rise
        if unbounded:
            values = _with(inner.values, i, float(values[i]))
        near = inner if share < 0.5 or unbounded else outer_point
        point = yield Start(values, (i,), near, instead=_with(inner.values, i, float(values[i])))
        cuts.append(point)
        height = _height(point, mode, rise)
        if height < 0.0:
            inner, below, above = point, height, above * (0.5 if before < 0.0 else 1.0)
        else:
            outer_point, above, below = point, height, below * (0.5 if before > 0.0 else 1.0)
        before = height
        # of the square root of the objective: the line through the two last points does the rest
        if abs(height) < _SETTLED:
            break
    unsettled = any(
        math.isfinite(point.objective) and not point.converged for point in (inner, outer_point)
    )
    below, above = _height(inner, mode, rise), _height(outer_point, mode, rise)
    distance = abs(float(inner.values[i] - mode.values[i]))
    # where a point on the level was found there is none, however far the bracket's other end is
    jump = above - below > _JUMP and min(above, -below) > _SETTLED
    if search.coordinates.by_size[i]:
        unbounded = unsettled or (jump and distance > _DECADES)
    else:
        unbounded = distance > (_FAR if jump else _NOWHERE) * search.scale[i]
    if unbounded:
        # the others may make up for any size
        return None, cuts
    share = below / (below - above)
    return float(inner.values[i] + share * (outer_point.values[i] - inner.values[i])), cuts


def _with(values: FloatArray, i: int, value: float) -> FloatArray:
    changed = values.copy()
    changed[i] = value
    return changed


def _height(point: End, mode: End, rise: float) -> float:
    """Square root of the rise of the objective, nearly a straight line, above that of the level."""
    risen = point.objective - mode.objective
    return min(
        math.sqrt(max(risen, 0.0)) if math.isfinite(risen) else math.inf, 4.0 * math.sqrt(rise)
    ) - math.sqrt(rise)


def returns(points: Sequence[End], rise: float) -> bool:
    """Whether the objective falls below `rise` again after it had risen above it."""
    above = [point.objective - points[0].objective >= rise for point in points]
    return any(before and not after for before, after in pairwise(above))


def dips(points: Sequence[End]) -> list[End]:
    """Points of a path that lie lower than the point before and not higher than the one after:
    valleys beside that of the mode.
    """
    triples = zip(points, points[1:], [*points[2:], points[-1]], strict=False)
    return [
        point
        for before, point, after in triples
        if point.objective < before.objective - 1e-6 and point.objective <= after.objective
    ]
