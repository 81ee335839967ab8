"""What is wrong with a theta_min line."""

from __future__ import annotations

import math

import numpy as np

from estim.checks import P_POOR_FIT, sampling_findings
from estim.common import STATUSES, Finding
from estim.line.interval import SlopeInterval
from estim.line.least_squares import LineFit
from estim.sampling import Chain


def line_findings(fit: LineFit, interval: SlopeInterval, chain: Chain) -> tuple[Finding, ...]:
    """What is wrong with a theta_min line: `fit` with all uncertainties, exact slope `interval`, `chain` of the Bayesian line."""
    findings = sampling_findings(chain)
    if not (math.isfinite(interval.low) and math.isfinite(interval.high) and interval.low > 0.0):
        shown = f"[{interval.low:.3g}, {interval.high:.3g}]"
        reason = f"the points do not determine a rising line: the exact {interval.probability:.0%} interval of its slope is {shown}"
        findings.append(Finding("not-identified", reason, "gamma = 1/slope needs a slope that is surely positive: measure at more and steeper tilts"))
    else:
        slope = chain.flat[:, chain.names.index("slope")]
        u = float(np.hypot(fit.standard_errors[fit.recommended].u_slope, slope.std()))
        if abs(slope.mean() - fit.slope) > u:
            reason = f"York's slope {fit.slope:.3g} and the Bayesian one {slope.mean():.3g} differ by more than their combined uncertainty {u:.2g}"
            findings.append(Finding("methods-disagree", reason, "the priors of the Bayesian line carry weight: take more points"))
        if fit.slope < 1.0:
            reason = f"gamma = 1/slope would be {1.0 / fit.slope:.2g}, but a centre of mass inside the body has gamma below 1"
            findings.append(Finding("poor-fit", reason, "are the columns phi_deg and theta_min_deg swapped, or is the unit of one of them wrong?"))
    if fit.p_value < P_POOR_FIT:
        reason = f"the points scatter more than their uncertainties allow (S = {fit.chi2:.1f}, {fit.dof} degrees of freedom, p = {fit.p_value:.1g})"
        findings.append(Finding("poor-fit", reason, "check the uncertainties and look for a bad point"))
    return tuple(sorted(findings, key=lambda finding: STATUSES.index(finding.status)))
