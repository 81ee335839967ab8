"""Where a body was read, without most of the errors of the readings, for evaluations of a curve
that must not depend on these errors.

A column of a linear model that is evaluated at the readings has their errors e in it: d(column)/dx
times e.  Where frames are so dense that a body moves less than e between them this is no longer
small beside the column, and it is not independent of the residuals, which are made of the same e:
whitened residuals of a run that lacks nothing lean on the column (on a shift of the clock, beside
the release, by 9 standard deviations with 1,400 frames in 3 s, where the body moves by a fifth of e
from one frame to the next).
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray, IntArray

# sds of a reading, by which the body moves to either side; readings for a line
_REACH, _FEW = 2.0, 5
GUARD = 5.0  # sds from the release or from a turning point


def smoothed_positions(t: FloatArray, x: FloatArray, speed: FloatArray, sd: float) -> FloatArray:
    """(n_row,) by straight lines through the readings x (n_row,) at t (n_row,) s (five or more)
    between which the body moves 2 `sd` either way.

    In such a window +-w a path of acceleration a lies on average a w^2/6 above its middle: by sd/15
    at most where it is as fast as it gets from rest within five sds, v^2 = 10 a sd. Slower than
    this, beside a turning point, it counts as so fast, a being (largest speed)^2/(length of the
    way).  Readings that are farther apart stay as they are.
    speed : (n_row,) of the curve, unit of x per s.
    """
    least = float(np.max(speed)) * np.sqrt(GUARD * 2.0 * sd / np.ptp(x))
    if not least > 0.0:  # a curve that never moves, which is reported elsewhere
        return x
    reach = _REACH * sd / np.maximum(speed, least)
    first, last = np.searchsorted(t, t - reach, "left"), np.searchsorted(t, t + reach, "right")
    many = np.flatnonzero(last - first >= _FEW)
    smoothed = x.copy()
    since, rise = t - np.mean(t), x - np.mean(x)
    n = (last - first)[many]
    mean_t, mean_x = (_between(column, first[many], last[many]) / n for column in (since, rise))
    square = _between(since * since, first[many], last[many]) - n * mean_t**2
    slope = (_between(since * rise, first[many], last[many]) - n * mean_t * mean_x) / square
    smoothed[many] = np.mean(x) + mean_x + slope * (since[many] - mean_t)
    return smoothed


def _between(values: FloatArray, first: IntArray, last: IntArray) -> FloatArray:
    """Sums of values[first:last]."""
    total = np.append(0.0, np.cumsum(values))
    return total[last] - total[first]
