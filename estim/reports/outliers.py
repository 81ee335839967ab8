"""Frames that are more likely outliers than not, as a record."""

from __future__ import annotations

import msgspec

from estim.pipeline import Analysis
from estim.problem import Observations


class Outlier(msgspec.Struct, frozen=True):
    """A frame that is more likely an outlier than not."""

    row: int  # of the points that are fit, from 1
    x: float
    y: float
    probability: float


def outliers(analysis: Analysis, run: Observations) -> list[Outlier]:
    """Those of a run."""
    return [
        Outlier(int(i) + 1, float(run.x[i]), float(run.y[i]), float(found.probability[i]))
        for found in analysis.outliers if found.run == run.name for i in found.frames
    ]
