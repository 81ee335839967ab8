"""What is wrong with a theta_min line."""

from __future__ import annotations

import math

import numpy as np

from estim.checks import P_POOR_FIT, sampling_findings
from estim.common import Finding, Kind, wrong
from estim.line.interval import SlopeInterval
from estim.line.least_squares import LineFit
from estim.sampling import Chain


def line_findings(fit: LineFit, interval: SlopeInterval, chain: Chain) -> tuple[Finding, ...]:
    """What is wrong with a theta_min line: `fit` with all uncertainties, exact slope `interval`, `chain` of the Bayesian line."""
    findings = sampling_findings(chain)
    if not (math.isfinite(interval.low) and math.isfinite(interval.high) and interval.low > 0.0):
        ends = {"low": interval.low, "high": interval.high, "probability": interval.probability}
        findings.append(Finding(Kind.LINE_NOT_RISING, numbers=ends))
    else:
        slope = chain.flat[:, chain.names.index("slope")]
        u = float(np.hypot(fit.standard_errors[fit.recommended].u_slope, slope.std()))
        apart = float(slope.mean()) - fit.slope
        if abs(apart) > u:
            findings.append(Finding(Kind.SLOPES_DIFFER, size=apart, numbers={"york": fit.slope, "bayes": float(slope.mean()), "u": u}))
        if fit.slope < 1.0:
            findings.append(Finding(Kind.GAMMA_TOO_LARGE, size=1.0 / fit.slope))
    if fit.p_value < P_POOR_FIT:
        findings.append(Finding(Kind.POINTS_SCATTER, p=fit.p_value, size=fit.chi2, numbers={"dof": fit.dof}))
    return wrong(findings)
