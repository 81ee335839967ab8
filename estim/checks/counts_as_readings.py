"""Counts that were stated as readings: whole y whose u_y is their own square root.

Errors taken from the counts themselves make what came out low look precise, and drop an empty bin
or give it an arbitrary error: the curve is pulled down, and its intervals have less than their
nominal coverage (docs/statistics.md).
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.common import Finding, Kind
from estim.problem import Observations, reading_sd

_CLOSE = 0.01  # relative, of a root that was written with two or three digits


def counts_as_readings(run: Observations) -> list[Finding]:
    """A note where the y of a run look like counts with their square roots as errors."""
    noise = run.noise
    if (
        run.motion is not None
        or noise.counted is not None
        or noise.parameters
        or noise.robust
        or run.lacks is not None
    ):
        return []
    return (
        [Finding(Kind.COUNTS_AS_READINGS, run=run.name)]
        if _are_counts(run.y, np.ravel(reading_sd(noise, {})))
        else []
    )


def _are_counts(y: FloatArray, u: FloatArray) -> bool:
    root = np.sqrt(np.maximum(y, 1.0))  # an empty bin is often given the error 1
    integers = bool(np.all((y >= 0.0) & (y == np.rint(y))))
    return (
        integers
        and y.size >= 3
        and bool(np.ptp(y) > 0.0)
        and bool(np.all(np.abs(u - root) <= _CLOSE * root))
    )
