"""Motion blur: while the shutter is open the body moves on, and any place within the smear may be
marked.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from estim.arrays import FloatArray
from estim.campaign.campaign_file import NoiseTable
from estim.campaign.lookup_levels import Levels, StatedNoise, stated_noise
from estim.common import Notation, phrase
from estim.curves import size_with_blur
from estim.explanation import Cause, Estimated
from estim.problem import Problem
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


def blurs(levels: Sequence[Levels], runs: Sequence[Run]) -> Iterator[tuple[float, NoiseTable]]:
    """Exposures (s) that pictures may have had which the campaign does not say, each with the noise
    table that says it.

    Of runs with one noise table, in m, whose readings have a fixed error; none elsewhere.
    """
    tables = [stated_noise(of_run).table for of_run in levels]
    first, data = tables[0], runs[0]
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
    interval = min(float(np.median(np.diff(run.columns["t_s"]))) for run in (data, *runs[1:]))
    # of the time between two frames
    for share in (1.0, 0.5, 0.25):
        yield share * interval, msgspec.structs.replace(first, exposure_s=share * interval)


def blur_cause(problem: Problem, exposure: float) -> Cause:
    """Motion blur as a candidate for what is missing; `problem` has it."""
    lines = ("noise", f"exposure_s = {exposure:.3g}")
    return Cause(
        "blur",
        phrase(
            "motion blur: the readings are uncertain by the distance that the body moves during an "
            "exposure"
        ),
        problem,
        (),
        lines,
        scanned=Estimated("exposure", exposure, np.nan, Notation("exposure").label("s")),
    )
