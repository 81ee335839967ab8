"""Checks that find nothing wrong by themselves: what priors do to a result, and what errors would
that no residual shows.
"""

from estim.checks.prior_sensitivity import CONFLICT, THRESHOLD, Sensitivity, power_scaling
from estim.checks.what_if import Influence, influences

__all__ = ["CONFLICT", "THRESHOLD", "Influence", "Sensitivity", "influences", "power_scaling"]
