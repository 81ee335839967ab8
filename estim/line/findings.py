"""What is wrong with a straight line: whether it explains its points, by the tests of every curve,
and what a theta_min line must be beside that.
"""

from __future__ import annotations

import math

import numpy as np

from estim.checks import Goodness, check_linear, failed_tests, sampling_findings
from estim.common import Finding, Kind, Status, Stream, decide, stream, wrong
from estim.line.angle_profile import scaled_points
from estim.line.regression import LineFit
from estim.line.slope_interval import SlopeInterval
from estim.sampling import Chain
from estim.words import describe


class Judged:
    """A result whose status follows from its findings."""

    findings: tuple[Finding, ...]

    @property
    def status(self) -> Status:
        return decide(self.findings)

    @property
    def reasons(self) -> tuple[str, ...]:
        return tuple(map(describe, self.findings))


def line_findings(fit: LineFit, interval: SlopeInterval, chain: Chain) -> tuple[Finding, ...]:
    """What is wrong with a theta_min line: `fit` with all uncertainties, exact slope `interval`,
    `chain` of the Bayesian line.
    """
    findings = sampling_findings(chain)
    if not (math.isfinite(interval.low) and math.isfinite(interval.high) and interval.low > 0.0):
        ends = {"low": interval.low, "high": interval.high, "probability": interval.probability}
        findings.append(Finding(Kind.LINE_NOT_RISING, numbers=ends))
    else:
        slope = chain.column("slope")
        u = float(np.hypot(fit.standard_errors[fit.recommended].u_slope, slope.std()))
        difference = float(slope.mean()) - fit.slope
        if abs(difference) > u:
            findings.append(
                Finding(
                    Kind.SLOPES_DIFFER,
                    size=difference,
                    numbers={"york": fit.slope, "bayes": float(slope.mean()), "u": u},
                )
            )
        if fit.slope < 1.0:
            findings.append(Finding(Kind.GAMMA_TOO_LARGE, size=1.0 / fit.slope))
    return wrong([*findings, *points_findings(fit)])


def points_findings(fit: LineFit) -> list[Finding]:
    """The evidence of the residuals against a line through its points."""
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
    data, points, stated = fit.data, scaled_points(fit.data), fit.method != "ols"
    scale_x, scale_y = points.scale
    b = fit.slope * scale_x / scale_y
    across = points.across(b) if stated else points.across(b) * fit.chi2 / fit.dof
    line = fit.intercept + fit.slope * data.x
    misfit, order = (data.y - line) / scale_y, np.argsort(data.x, kind="stable")
    shift = points.times(b * points.var_x - points.cov_xy, points.solve(across, misfit))
    columns = np.column_stack([misfit, np.ones(data.x.size), points.x + shift])[order]
    if points.dense:
        white = np.linalg.solve(np.linalg.cholesky(across[np.ix_(order, order)]), columns)
        variance = np.diag(across)
    else:
        white, variance = columns / np.sqrt(across[order])[:, None], across
    return check_linear(
        white[:, 0],
        white[:, 1:],
        x=data.x[order],
        y=data.y[order],
        f=line[order],
        sd=scale_y * np.sqrt(variance)[order],
        stated=stated,
        rng=stream(0, Stream.GOODNESS),
    )
