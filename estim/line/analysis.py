"""The theta_min line of a campaign by every method: ordinary and weighted least squares, York, and
a Bayesian line.

gamma is 1/slope; the intercept is read in two ways that the points cannot distinguish, as rolling
resistance (c_rr = intercept * gamma) and as a zero error of a scale.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estim.arrays import FloatArray
from estim.checks import headline, posterior_table
from estim.common import Finding, InputError, Kind, Notation, Quantity, Stream, e_n, phrase, stream
from estim.line.findings import Judged, line_findings
from estim.line.posterior import LinePosterior, line_posterior, without_intercept
from estim.line.regression import (
    InversePrediction,
    LineFit,
    coverage_factor,
    fit_line,
    inverse_prediction,
    standard_error,
)
from estim.line.slope_interval import SlopeInterval, slope_interval
from estim.line.theta_min_series import ThetaMinSeries
from estim.sampling import (
    Certificate,
    Chain,
    Progress,
    Target,
    adapt_proposal,
    certify,
    parameter_cells,
    sample_posterior,
    summarise,
)
from estim.words import advice_for, describe


@dataclass(frozen=True)
class Reading:
    """The result of one method: gamma and c_rr with standard uncertainties, and E_n of gamma
    against the masses.

    e_n is nan where gamma from the masses is unknown; |E_n| <= 1 means agreement at k = 2.
    """

    gamma: Quantity
    resistance: Quantity
    e_n: float


@dataclass(frozen=True, eq=False)
class LineAnalysis(Judged):
    """The line of one series.

    ols, weighted, york : least squares without uncertainties, with those of theta_min, with both.
    posterior, chain : the Bayesian line and its draws.
    evidence : for or against an intercept.
    readings : method -> Reading.
    gamma_masses : from the masses (or the prior of gamma), None where unknown.
    slope_exact : the exact 95 % interval of the slope.
    steepest : sin(phi) at which theta_min reaches 90 degrees.
    findings : everything wrong; empty means ok.
    """

    series: ThetaMinSeries
    ols: LineFit
    weighted: LineFit
    york: LineFit
    posterior: LinePosterior
    chain: Chain
    evidence: InterceptEvidence
    readings: Mapping[str, Reading]
    gamma_masses: Quantity | None
    slope_exact: SlopeInterval
    steepest: InversePrediction
    findings: tuple[Finding, ...]
    seed: int

    @property
    def assumption(self) -> str:
        """What is assumed of rows that repeat a tilt; "" where none does."""
        _, counts = np.unique(self.series.phi, return_counts=True)
        n = int(np.sum(counts[counts > 1]))
        if not n:
            return ""
        return phrase(
            "{n} rows repeat a tilt, and the error of each is taken as independent: where one "
            "reading of a tilt serves several rows, state one row with the mean of their angles",
            n=n,
        )

    @property
    def disagreement(self) -> str:
        """The message where gamma of the line and gamma as stated differ at k = 2; "" where they
        agree, or one of them is missing.

        The line does not use the stated value, so this is no fault of the line.
        """
        reading = self.readings["posterior"]
        stated = self.gamma_masses
        if not self.status.ok or stated is None or not abs(reading.e_n) > 1.0:
            return ""
        numbers = {
            "line": reading.gamma.value,
            "u_line": reading.gamma.u,
            "stated": stated.value,
            "u_stated": stated.u,
        }
        return describe(Finding(Kind.GAMMA_DISAGREES, size=reading.e_n, numbers=numbers))

    def _repr_markdown_(self) -> str:
        """What a notebook shows: the values, or why there are none."""
        quantities = (
            (phrase("intercept"), self.chain.column("intercept"), phrase("sin θ_min at φ = 0")),
            ("γ", self.gamma_draws, phrase("1/slope")),
            (
                "c_rr",
                self.resistance_draws,
                phrase("intercept · γ, if all of it is rolling resistance"),
            ),
        )
        rows = [
            parameter_cells(
                summarise(values, unit="1", meaning=meaning), Notation(symbol).label("1")
            )
            for symbol, values, meaning in quantities
        ]
        return headline(
            phrase("θ_min line of {body}", body=self.series.body),
            kind="",
            status=self.status,
            reasons=self.reasons,
            advice=advice_for(self.findings),
            shown=posterior_table(rows),
        )

    @property
    def gamma_draws(self) -> FloatArray:
        """(n_draw,) posterior of gamma = 1/slope."""
        return 1.0 / self.chain.column("slope")

    @property
    def resistance_draws(self) -> FloatArray:
        """(n_draw,) posterior of c_rr = intercept * gamma."""
        return self.chain.column("intercept") * self.gamma_draws


def analyse_line(
    series: ThetaMinSeries,
    *,
    gamma_masses: Quantity | None,
    seed: int,
    target: Target | None = None,
    progress: Progress | None = None,
) -> LineAnalysis:
    """The line of a series by every method; the same seed gives the same numbers.

    gamma_masses : gamma from the masses of the body, to compare with; None where they are unknown.
    target, progress : of the sampling, as in `analyse`.

    Raises InputError where the points cannot hold a line.

    >>> from estim import Target, analyse_line, load_campaign, read_theta_min
    >>> series = read_theta_min(load_campaign("data/replica/campaign.toml").source)
    >>> found = analyse_line(series, gamma_masses=None, seed=1, target=Target(ess=400.0))
    >>> found.york.recommended, found.posterior.names
    ('propagated', ('intercept', 'slope', 'mu_x', 'log_tau'))
    """
    ols = fit_line(series.x, series.y)
    weighted = fit_line(series.x, series.y, u_y=series.u_y)
    york = fit_line(series.x, series.y, u_x=series.u_x, u_y=series.u_y)
    posterior = line_posterior(
        series.x,
        series.y,
        u_x=series.u_x,
        u_y=series.u_y,
        u_zero_x=series.u_zero_x,
        u_zero_y=series.u_zero_y,
        intercept_sd=0.1,
    )
    start, cov = posterior.start, np.diag(posterior.step**2)
    rng = stream(seed, Stream.LINE_CHAIN)
    proposal = adapt_proposal(posterior, start, cov, rng=rng)
    chain = sample_posterior(
        posterior,
        start,
        cov,
        target=target or Target(),
        rng=rng,
        progress=progress,
        proposal=proposal,
    )
    exact = slope_interval(york)
    readings = {
        name: _read(fit, gamma_masses)
        for name, fit in (("ols", ols), ("weighted", weighted), ("york", york))
    }
    gamma = 1.0 / chain.column("slope")
    resistance = gamma * chain.column("intercept")
    readings["posterior"] = _reading(Quantity.of(gamma), Quantity.of(resistance), gamma_masses)
    return LineAnalysis(
        series=series,
        ols=ols,
        weighted=weighted,
        york=york,
        posterior=posterior,
        chain=chain,
        evidence=intercept_evidence(
            posterior, rng=stream(seed, Stream.LINE_EVIDENCE), n_draw=20_000
        ),
        readings=readings,
        gamma_masses=gamma_masses,
        slope_exact=exact,
        steepest=_steepest(york),
        findings=line_findings(york, exact, chain),
        seed=seed,
    )


def _steepest(york: LineFit) -> InversePrediction:
    """sin(phi) at which the line reaches theta_min = 90 degrees; nan for a line that never does."""
    if york.slope == 0.0 or not math.isfinite(york.slope):
        return InversePrediction(*[math.nan] * 4)
    return inverse_prediction(york, 1.0, u_y0=0.0)


def _read(fit: LineFit, gamma_masses: Quantity | None) -> Reading:
    """gamma = 1/slope and c_rr = intercept/slope by linear propagation with the correlation of
    slope and intercept.

    Uncertainties of a fit whose scale comes from few residuals are widened to what Student's t
    requires at 68 %.
    """
    from uncertainties import correlated_values

    error = standard_error(fit)
    widening = coverage_factor(fit, probability=0.6827)
    cov = widening**2 * np.array([[error.u_intercept**2, error.cov], [error.cov, error.u_slope**2]])
    intercept, slope = correlated_values([fit.intercept, fit.slope], cov)
    if fit.slope == 0.0:
        return Reading(Quantity(math.nan, math.nan), Quantity(math.nan, math.nan), math.nan)
    gamma, resistance = 1.0 / slope, intercept / slope
    return _reading(
        Quantity(gamma.nominal_value, gamma.std_dev),
        Quantity(resistance.nominal_value, resistance.std_dev),
        gamma_masses,
    )


def _reading(gamma: Quantity, resistance: Quantity, gamma_masses: Quantity | None) -> Reading:
    return Reading(
        gamma, resistance, math.nan if gamma_masses is None else e_n(gamma, gamma_masses)
    )


class InterceptEvidence(NamedTuple):
    """Natural logarithm of the Bayes factor for an intercept (> 0) or against it (< 0)."""

    log_bayes_factor: float  # log evidence with intercept minus log evidence through the origin
    u_log_bayes_factor: float  # its Monte-Carlo standard error
    intercept_sd: float  # the normal prior it depends on, unit of y
    message: str  # why not to rely on it, a sentence; "" if there is no reason


def weigh_line(
    posterior: LinePosterior, *, rng: np.random.Generator, n_draw: int = 8000
) -> Certificate:
    """The posterior by importance sampling, without a Markov chain: some hundredths of a second."""
    rough = adapt_proposal(posterior, posterior.start, np.diag(posterior.step**2), rng=rng)
    return certify(posterior, rough, rng=rng, n_draw=n_draw)


def intercept_evidence(
    posterior: LinePosterior, *, rng: np.random.Generator, n_draw: int = 8000
) -> InterceptEvidence:
    """log evidence of the line with a normal intercept minus log evidence of the line through the
    origin.

    Flat priors that both share cancel.  The result depends on ``intercept_sd``: the wider
    that prior, the more an intercept near 0 counts for the origin; state it with the result.
    posterior : with ``intercept_sd``.  Raises InputError if it has none.  Source: Kass and Raftery
        1995, J. Am. Stat. Assoc. 90, 773.
    """
    if "intercept" not in posterior.priors:
        raise InputError(
            "must be given: the evidence depends on the prior of the intercept",
            field="intercept_sd",
        )
    free, fixed = (
        weigh_line(variant, rng=rng, n_draw=n_draw)
        for variant in (posterior, without_intercept(posterior))
    )
    return InterceptEvidence(
        free.log_evidence - fixed.log_evidence,
        float(np.hypot(free.u_log_evidence, fixed.u_log_evidence)),
        posterior.priors["intercept"].sd,
        ""
        if free.reliable and fixed.reliable
        else phrase(
            "The importance weights are uneven: the Monte-Carlo error is itself uncertain; "
            "use more draws."
        ),
    )
