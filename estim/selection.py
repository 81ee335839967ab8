"""Which rows of a run are fit, and why the others are not.

- Outside the `window` of the campaign: left out.
- For speeds made by differences, within five standard deviations of a position reading from the release or from the
  turning point: there the curve bends so sharply that an error of the position moves the speed by more than a linear
  law says.  A window that names that end (`x_min_m = 0`) keeps them.
- After the largest position reached, where speeds are fit: the way back is another motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Mask = NDArray[np.bool_]

_WAY_BACK = "after the farthest point (the way back is another motion)"
_GUARD = 5.0
_SLOW = 0.25  # of the largest speed: slower than this at its farthest, a body is taken to have turned there


@dataclass(frozen=True)
class Window:
    """Limits of time (s) and position (m or rad); -inf or inf where open."""

    t_min: float
    t_max: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Selection:
    """kept : (n,) indices of the speeds to fit.  reasons : why and how many others were left out."""

    kept: NDArray[np.int64]
    reasons: tuple[str, ...]


def way_back(reasons: Sequence[str]) -> int:
    """How many frames were left out as those of the way back, according to the `reasons` of a selection."""
    return sum(int(words.partition(" ")[0]) for words in reasons if words.endswith(_WAY_BACK))


def select(position: FloatArray, speed: FloatArray | None, t: FloatArray | None, *, window: Window, sigma_position: float) -> Selection:
    """The rows to fit out of (n,) positions, speeds and times.

    `sigma_position` 0 switches the guard zones off.  Without speeds it is the positions that are fit, on every way.
    """
    left = np.ones(position.size, dtype=bool)
    reasons: list[str] = []

    def leave_out(mask: Mask, why: str) -> None:
        nonlocal left
        count = int(np.sum(mask & left))
        if count:
            reasons.append(f"{count} {why}")
        left &= ~mask

    if t is not None:
        leave_out((t < window.t_min) | (t > window.t_max), "outside the window of time")
    leave_out((position < window.low) | (position > window.high), "outside the window of position")
    inside = np.flatnonzero(left)
    if inside.size and speed is not None:
        farthest = inside[np.argmax(position[inside])]
        if t is not None:
            leave_out(t > t[farthest], _WAY_BACK)
        guard = _GUARD * sigma_position
        if guard > 0.0 and not np.isfinite(window.low):
            leave_out(position < guard, "within five standard deviations of a reading from the release")
        slow = abs(speed[farthest]) < _SLOW * np.max(np.abs(speed[inside]))
        if guard > 0.0 and slow and not np.isfinite(window.high):
            leave_out(position > position[farthest] - guard, "within five standard deviations of a reading from the turning point")
    return Selection(np.flatnonzero(left), tuple(reasons))
