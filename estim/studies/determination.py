"""A closer look at a finished analysis, for its report: profile intervals and the pull of the priors."""

from __future__ import annotations

from dataclasses import dataclass

from estim.checks import Sensitivity, power_scaling
from estim.fitting import ProfileInterval, profile_intervals
from estim.pipeline import Analysis

_DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Determination:
    """Profile intervals and prior sensitivity of every parameter."""

    intervals: tuple[ProfileInterval, ...]
    sensitivity: tuple[Sensitivity, ...]


def determine(analysis: Analysis) -> Determination:
    """What the data can tell about each parameter of an analysis."""
    draws = analysis.chain.thinned(_DRAWS)
    intervals = profile_intervals(analysis.fit)
    sensitivity = power_scaling(analysis.problem, analysis.fit.posterior, draws)
    return Determination(intervals, sensitivity)
