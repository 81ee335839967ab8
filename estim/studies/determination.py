"""A closer look at a finished analysis, for its report: profile intervals and the pull of the
priors.
"""

from __future__ import annotations

from dataclasses import dataclass

from estim.checks import Sensitivity, power_scaling
from estim.fitting import ProfileInterval, profile_intervals
from estim.pipeline import Analysis

_DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Determination:
    """Profile intervals, of those parameters that a report has room for, and prior sensitivity of
    every parameter.

    intervals : in the order of the parameters; of many those that runs share and some more; of very
        many none, nor where none was asked for.
    """

    intervals: tuple[ProfileInterval, ...]
    sensitivity: tuple[Sensitivity, ...]


def determine(analysis: Analysis, *, profiles: bool = True) -> Determination:
    """What the data determine about each parameter of an analysis.  profiles : whether by profile
    intervals too.
    """
    draws = analysis.chain.thinned(_DRAWS)
    problem = analysis.problem
    # beyond, each search over all the others takes too long, and their posterior is as good as
    # normal
    few = problem.foremost(24) if profiles and problem.n_par <= 150 else []
    intervals = (
        profile_intervals(analysis.fit, names=[problem.names[i] for i in few]) if few else ()
    )
    log_likelihood = analysis.fit.posterior.log_likelihood(draws)
    return Determination(intervals, power_scaling(problem, draws, log_likelihood))
