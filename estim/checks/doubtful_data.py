"""What the data of a fit look like beside what is said of them.

Counts that were stated as readings, whole y whose u_y is their own square root: errors taken from
the counts themselves make what came out low look precise, and drop an empty bin or give it an
arbitrary error.  The curve is pulled down, and its intervals have less than their nominal coverage
(docs/statistics.md).

Readings that stand in two runs of a joint fit, as of a table and its copy: they count twice, and
uncertainties come out too small by as much as the square root of 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from estim.arrays import FloatArray
from estim.common import Finding, Kind
from estim.problem import Observations, reading_sd

_CLOSE = 0.01  # relative, of a root that was written with two or three digits
_LEAST_COPIED, _LEAST_VALUES = 5, 4  # readings, and different ones: fewer may be equal by chance


def data_remarks(runs: Sequence[Observations]) -> list[Finding]:
    """A note on each run whose y look like counts with their square roots as errors, and on pairs
    of runs of which one holds all readings of the other.
    """
    counts = [Finding(Kind.COUNTS_AS_READINGS, run=run.name) for run in runs if _are_counts(run)]
    several = runs if len(runs) > 1 else ()
    rows = {run.name: {*zip(run.x.tolist(), run.y.tolist(), strict=True)} for run in several}
    copies = [
        Finding(Kind.READINGS_COPIED, names=(a, b))
        for a, b in combinations(rows, 2)
        if _copied(*sorted((rows[a], rows[b]), key=len))
    ]
    return counts + copies


def _copied(few: set[tuple[float, float]], many: set[tuple[float, float]]) -> bool:
    return len(few) >= _LEAST_COPIED and few <= many and len({y for _, y in few}) >= _LEAST_VALUES


def _are_counts(run: Observations) -> bool:
    noise, y = run.noise, run.y
    if (
        run.motion is not None
        or noise.counted is not None
        or noise.parameters
        or noise.robust
        or run.lacks is not None
    ):
        return False
    u: FloatArray = np.ravel(reading_sd(noise, {}))
    root = np.sqrt(np.maximum(y, 1.0))  # an empty bin is often given the error 1
    integers = bool(np.all((y >= 0.0) & (y == np.rint(y))))
    return (
        integers
        and y.size >= 3
        and bool(np.ptp(y) > 0.0)
        and bool(np.all(np.abs(u - root) <= _CLOSE * root))
    )
