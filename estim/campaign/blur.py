"""Motion blur: while the shutter is open the body moves on, and any place within the smear may be marked."""

from __future__ import annotations

import math

import numpy as np

from estim.arrays import FloatArray
from estim.campaign.campaign_file import NoiseTable
from estim.campaign.levels import Levels, Path
from estim.curves import size_with_blur
from estim.reading import Run

_REACH = 3  # frames on either side over which a speed is taken: its error does not matter beside that of a reading


def relative_blur(table: NoiseTable, run: Run, size: FloatArray, levels: Levels, path: Path) -> FloatArray | None:
    """Standard deviation of each reading (n_row,) / what it is of a body at rest, `size` (n_row,), 0 where it is inferred; None without exposure.

    Raises InputError where the exposure is no time between two frames, or there is no such size.
    """
    exposure = table.exposure_s
    if exposure is None:
        return None
    t, position = run.columns["t_s"], run.columns[run.coordinate]
    interval = float(np.median(np.diff(t)))
    if not (math.isfinite(exposure) and 0.0 < exposure <= interval * (1.0 + 1e-6)):
        rule = f"must be > 0 and at most the time between two frames, {interval:.4g} s (is it in ms?)"
        raise levels.error(rule, (*path, "exposure_s"), value=exposure)
    if not np.all(size > 0.0):
        raise levels.error("needs a fixed standard deviation of one reading beside it: that of a body at rest", (*path, "exposure_s"))
    frames = np.arange(t.size)
    before, after = np.maximum(frames - _REACH, 0), np.minimum(frames + _REACH, t.size - 1)
    speed = (position[after] - position[before]) / (t[after] - t[before])
    return np.asarray(size_with_blur(size, speed, exposure) / size)
