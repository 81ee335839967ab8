"""What is wrong with a straight line: whether it explains its points, by the tests of every curve,
and what a theta_min line must be beside that.
"""

from __future__ import annotations

import math

import numpy as np

from estim.checks import Goodness, check_linear, failed_tests, sampling_findings
from estim.common import Finding, Kind, Stream, stream, wrong
from estim.line.interval import SlopeInterval
from estim.line.joint_errors import joint_covariance
from estim.line.regression import LineFit
from estim.sampling import Chain


def line_findings(fit: LineFit, interval: SlopeInterval, chain: Chain) -> tuple[Finding, ...]:
    """What is wrong with a theta_min line: `fit` with all uncertainties, exact slope `interval`,
    `chain` of the Bayesian line.
    """
    findings = sampling_findings(chain)
    if not (math.isfinite(interval.low) and math.isfinite(interval.high) and interval.low > 0.0):
        ends = {"low": interval.low, "high": interval.high, "probability": interval.probability}
        findings.append(Finding(Kind.LINE_NOT_RISING, numbers=ends))
    else:
        slope = chain.flat[:, chain.names.index("slope")]
        u = float(np.hypot(fit.standard_errors[fit.recommended].u_slope, slope.std()))
        apart = float(slope.mean()) - fit.slope
        if abs(apart) > u:
            findings.append(
                Finding(
                    Kind.SLOPES_DIFFER,
                    size=apart,
                    numbers={"york": fit.slope, "bayes": float(slope.mean()), "u": u},
                )
            )
        if fit.slope < 1.0:
            findings.append(Finding(Kind.GAMMA_TOO_LARGE, size=1.0 / fit.slope))
    return wrong([*findings, *points_findings(fit)])


def points_findings(fit: LineFit) -> list[Finding]:
    """What the residuals say against a line through its points."""
    if not (
        math.isfinite(fit.slope)
        and all(np.isfinite(u) for error in fit.standard_errors.values() for u in error)
    ):
        return []
    scatter = Finding(Kind.POINTS_SCATTER, p=fit.p_value, size=fit.chi2, numbers={"dof": fit.dof})
    return [
        scatter if finding.test == "chi2" else finding
        for finding in failed_tests((line_goodness(fit),), dof=fit.dof)
    ]


def line_goodness(fit: LineFit) -> Goodness:
    """The tests of the points of a line, in the order of x: their misfits along y, whitened, S the
    sum of their squares.
    """
    data, a, b, stated = fit.data, fit.intercept, fit.slope, fit.method != "ols"
    n = data.x.size
    u_y = data.u_y if stated else np.full(n, math.sqrt(fit.chi2 / fit.dof))
    joint = joint_covariance(data.u_x, u_y, data.r_xy) if data.cov is None else data.cov
    v_xx, v_xy, v_yy = joint[:n, :n], joint[:n, n:], joint[n:, n:]
    across = v_yy - b * (v_xy + v_xy.T) + b * b * v_xx
    misfit, order = data.y - a - b * data.x, np.argsort(data.x, kind="stable")
    adjusted = data.x + (b * v_xx - v_xy) @ np.linalg.solve(across, misfit)
    lower = np.linalg.cholesky(across[np.ix_(order, order)])
    white = np.linalg.solve(lower, np.column_stack([misfit, np.ones(n), adjusted])[order])
    return check_linear(
        white[:, 0],
        white[:, 1:],
        x=data.x[order],
        f=(a + b * data.x)[order],
        sd=np.sqrt(np.diag(across))[order],
        stated=stated,
        rng=stream(0, Stream.GOODNESS),
    )
