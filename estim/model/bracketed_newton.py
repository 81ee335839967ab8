"""Where rising functions are 0, of many draws at once: Newton steps inside brackets, halvings where
they leave them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from estim.arrays import FloatArray

_MOST_STEPS = 80
_ROUNDING = 1e-14  # by which the last step may lie beyond an end


def zero_between(
    ahead: Callable[[FloatArray], FloatArray],
    slope: Callable[[FloatArray], FloatArray],
    low: FloatArray,
    high: FloatArray,
    z: FloatArray,
    *,
    settled: float,
) -> tuple[FloatArray, FloatArray]:
    """z at which `ahead` is 0, from a guess `z`, and the length of the last step; steps end where
    all are shorter than `settled`.
    """
    moved = np.zeros(z.shape)
    for _ in range(_MOST_STEPS):
        here = ahead(z)
        low, high = np.where(here <= 0.0, z, low), np.where(here >= 0.0, z, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = z - here / slope(z)
        inside = (newton >= low - _ROUNDING) & (newton <= high + _ROUNDING)
        following = np.where(inside, newton, 0.5 * (low + high))
        moved, z = np.abs(following - z), following
        if not np.any(moved >= settled):
            break
    return z, moved
