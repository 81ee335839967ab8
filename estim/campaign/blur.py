"""Motion blur: while the shutter is open the body moves on, and any place within the smear may be
marked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial

import msgspec
import numpy as np

from estim.arrays import FloatArray
from estim.campaign.campaign_file import LevelTable
from estim.campaign.candidate_causes import Candidate
from estim.campaign.lookup_levels import Levels, StatedNoise, stated_noise
from estim.common import Notation, phrase
from estim.curves import size_with_blur
from estim.explanation import Estimated
from estim.reading import Run

# frames on either side over which a speed is taken: its error does not matter beside that of a
# reading
_REACH = 3


def relative_blur(run: Run, noise: StatedNoise, size: FloatArray) -> FloatArray | None:
    """Standard deviation of each reading (n_row,) / what it is of a body at rest, `size` (n_row,),
    0 where it is inferred; None without exposure.

    Raises InputError where the exposure is no time between two frames, or there is no such size.
    """
    exposure = noise.table.exposure_s
    if exposure is None:
        return None
    t, position = run.columns["t_s"], run.position
    interval = float(np.median(np.diff(t)))
    if not (math.isfinite(exposure) and 0.0 < exposure <= interval * (1.0 + 1e-6)):
        raise noise.error(
            f"must be > 0 and at most the time between two frames, {interval:.4g} s (is it in ms?)",
            "exposure_s",
            value=exposure,
        )
    if not np.all(size > 0.0):
        raise noise.error(
            "also needs a fixed standard deviation of one reading: that of a body at rest",
            "exposure_s",
        )
    frames = np.arange(t.size)
    before, after = np.maximum(frames - _REACH, 0), np.minimum(frames + _REACH, t.size - 1)
    speed = (position[after] - position[before]) / (t[after] - t[before])
    return size_with_blur(size, speed, exposure) / size


def blurs(levels: Sequence[Levels], runs: Sequence[Run]) -> Iterator[Candidate]:
    """Exposures that pictures may have had which the campaign does not state.

    Of runs with one noise table, in m, whose readings have a fixed error; none elsewhere.
    """
    tables = [stated_noise(of_run).table for of_run in levels]
    first = tables[0]
    if (
        any(table != first for table in tables[1:])
        or first.exposure_s is not None
        or not isinstance(first.sigma_x_m, float)
    ):
        return
    if first.model == "independent" or any(
        "t_s" not in run.columns or run.coordinate != "x_m" for run in runs
    ):
        return
    interval = min(float(np.median(np.diff(run.columns["t_s"]))) for run in runs)
    words = phrase(
        "motion blur: the readings are uncertain by the distance that the body moves during an "
        "exposure"
    )
    # of the time between two frames
    for exposure in (interval, 0.5 * interval, 0.25 * interval):
        yield Candidate(
            "blur",
            words,
            levels[0].source.with_levels(partial(_with_exposure, exposure=exposure)),
            (),
            ("noise", f"exposure_s = {exposure:.3g}"),
            scanned=Estimated("exposure", exposure, np.nan, Notation("exposure").label("s")),
        )


def _with_exposure(table: LevelTable, exposure: float) -> LevelTable:
    if table.noise is None:
        return table
    noise = msgspec.structs.replace(table.noise, exposure_s=exposure)
    return msgspec.structs.replace(table, noise=noise)
