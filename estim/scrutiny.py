"""A closer look at a finished analysis, for its report: profile intervals and the pull of the priors."""

from __future__ import annotations

from dataclasses import dataclass

from estim.identify_report import IdentifySection, identify_section
from estim.pipeline import Analysis
from estim.power_scaling import Sensitivity, power_scaling
from estim.profile import ProfileInterval, profile_intervals

_DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Scrutiny:
    """Profile intervals and prior sensitivity of every parameter, and the section that a report makes of them."""

    intervals: tuple[ProfileInterval, ...]
    sensitivity: tuple[Sensitivity, ...]
    section: IdentifySection


def scrutinise(analysis: Analysis) -> Scrutiny:
    """What the data can tell about each parameter of an analysis."""
    draws = analysis.chain.thinned(_DRAWS)
    intervals = profile_intervals(analysis.fit)
    sensitivity = power_scaling(analysis.problem, analysis.fit.posterior, draws)
    section = identify_section(analysis.problem, analysis.identifiability, intervals, sensitivity, draws)
    return Scrutiny(intervals, sensitivity, section)
