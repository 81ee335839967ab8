"""A posterior computed a second time, without a Markov chain, and compared with the chain
(`estim.sampling.independent_check`: from which proposal).

Pareto-smoothed importance sampling from a proposal that was adapted to the posterior
(`estim.sampling.proposal`): weights density/proposal, their largest replaced by quantiles of a
fitted generalised Pareto distribution, whose shape k-hat shows whether the weights can be trusted
(below 0.7) (Vehtari, Simpson, Gelman, Yao, Gabry, J. Mach. Learn. Res. 25 (2024) 72).  It gives
means, standard deviations, quantiles and the evidence, each with its Monte-Carlo error.

What to use when: up to 14 parameters importance sampling checks a chain in some milliseconds;
beyond, weights degenerate and the comparison is "missing" instead of a verdict.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from estim.arrays import FloatArray, max_abs, positive_or
from estim.common import QUANTILES, Amount, Finding, Kind, later, phrase
from estim.distributions import normal_quantile
from estim.fitting import MAX_PARAMETERS
from estim.sampling.chain import Chain
from estim.sampling.diagnostics import effective_size
from estim.sampling.importance import (
    K_HAT_LIMIT,
    kish_ess,
    log_mean_uncertainty,
    pareto_smoothed,
    systematic,
)
from estim.sampling.log_density import Density, log_density_in_batches
from estim.sampling.proposal import Proposal
from estim.words import describe

# of runs that share a force: a chain is all that they have beside importance sampling, no marginal
# over runs
MAX_TIED = 20
_IMPORTANCE = later("importance sampling")
MOST_DRAWS = 64_000
# posterior sds, for each of `QUANTILES`: smaller differences are never called
_NEGLIGIBLE = np.array([0.05, 0.03, 0.03, 0.03, 0.05])[:, None]
# the same: errors that hide larger differences prove nothing
_COARSE = np.array([0.5, 0.25, 0.25, 0.25, 0.5])[:, None]
# posterior sds: error of an end of the 95 % interval that more draws are taken for
_UNSURE_END = 0.07


@dataclass(frozen=True, eq=False)
class Certificate:
    """A posterior without a chain.

    k_hat : shape of the tail of the weights; above 0.7 nothing here is reliable.
    n_draw : draws taken.  ess : effective size (sum w)^2/sum w^2.
    log_evidence, u_log_evidence : log of the integral of exp(log_density), and its Monte-Carlo
        standard error.
    mean, sd, mcse_mean, mcse_sd : (n_par,) with the Monte-Carlo standard errors of both.
    quantiles : probability -> (n_par,).
    mcse_shares : of the share of the posterior below each of them; as an error of the quantile
        itself it would need a density there, which a few draws in a tail estimate badly.
    draws : (4000, n_par) equally weighted, resampled with replacement, in random order.
    log_density : (4000,) of them.
    """

    names: tuple[str, ...]
    k_hat: float
    n_draw: int
    ess: float
    log_evidence: float
    u_log_evidence: float
    mean: FloatArray
    sd: FloatArray
    mcse_mean: FloatArray
    mcse_sd: FloatArray
    quantiles: Mapping[float, FloatArray]
    mcse_shares: Mapping[float, FloatArray]
    draws: FloatArray
    log_density: FloatArray

    @property
    def reliable(self) -> bool:
        return not self.k_hat > K_HAT_LIMIT


@dataclass(frozen=True, eq=False)
class Agreement:
    """A chain against a certificate.

    verdict : "agree", "disagree" or "missing".
    findings : why.
    differences : (5, n_par) chain minus certificate of the `QUANTILES`, in posterior standard
        deviations of the certificate.
    z : (5, n_par) the same of the shares of the draws below, in units of the combined Monte-Carlo
        standard error.
    limit : |z| above which a difference that is not negligible is called, all parameters
        considered.
    """

    verdict: str
    findings: tuple[Finding, ...]
    differences: FloatArray
    z: FloatArray
    limit: float

    @property
    def reason(self) -> str:
        """Why the verdict is what it is, in words."""
        return "; ".join(map(describe, self.findings))

    @property
    def largest_difference(self) -> float:
        """Largest difference of a median or of an end of a 68 or 95 % interval, in posterior
        standard deviations.
        """
        return max_abs(self.differences)


def certify(
    density: Density,
    proposal: Proposal,
    *,
    rng: np.random.Generator,
    n_draw: int = 8000,
    least_ess: float = 4000.0,
    max_draw: int = MOST_DRAWS,
) -> Certificate:
    """The posterior by Pareto-smoothed importance sampling from `proposal.widened()`.

    n_draw : draws to begin with.  More are taken, up to `max_draw` inside the support, while k-hat
        is above 0.7, the effective size below `least_ess`, or an end of a 95 % interval uncertain
        by 0.07 standard deviations: twice as many, or as many as the latter two need.

    Raises NumericalError where the density is not a number.
    """
    proposal = proposal.widened()
    draws, log_p, log_ratio = np.zeros((0, proposal.n_par)), np.zeros(0), np.zeros(0)
    n_total = n_draw
    while True:
        more = proposal.draw(rng, n_total - len(draws))
        draws = np.vstack([draws, more])
        log_p = np.append(log_p, log_density_in_batches(density, more))
        log_ratio = np.append(log_ratio, log_p[log_ratio.size :] - proposal.log_density(more))
        most = math.ceil(max_draw / max(float(np.mean(np.isfinite(log_ratio))), 0.25))
        log_weights, k_hat, log_mean = pareto_smoothed(log_ratio)
        columns = [_Column(column, np.exp(log_weights)) for column in draws.T]
        growth = (
            max(least_ess / kish_ess(log_weights), _growth_for_ends(columns))
            if k_hat <= K_HAT_LIMIT
            else 2.0
        )
        if growth <= 1.0 or n_total >= most:
            break
        # more draws than that: the errors that decide are estimates themselves
        n_total = min(int(min(1.2 * growth, 2.0) * n_total), most)
    return _summarise(density.names, draws, log_p, columns, log_weights, k_hat, log_mean, rng)


def _growth_for_ends(columns: Sequence[_Column]) -> float:
    """The factor by which the draws would have to grow for all ends of 95 % intervals to be known
    well enough to be compared; 1 at most if they are.
    """
    errors = [
        column.error_of_end(p) / column.sd
        for column in columns
        if column.sd > 0.0
        for p in (QUANTILES[0], QUANTILES[-1])
    ]
    return (max(errors, default=0.0) / _UNSURE_END) ** 2


def _summarise(
    names: tuple[str, ...],
    draws: FloatArray,
    log_p: FloatArray,
    columns: Sequence[_Column],
    log_weights: FloatArray,
    k_hat: float,
    log_mean: float,
    rng: np.random.Generator,
) -> Certificate:
    """Weighted moments with the delta-method errors of self-normalised importance sampling, sum
    w_i^2 (h_i - mean h)^2.
    """
    weights = np.exp(log_weights)
    mean = weights @ draws
    deviation = draws - mean
    variance = weights @ deviation**2
    sd = np.sqrt(variance)
    squares = weights**2
    quantiles, errors = {}, {}
    for p in QUANTILES:
        quantiles[p] = np.array([column.at(p) for column in columns])
        errors[p] = np.array([column.error_below(p) for column in columns])
    chosen = rng.permutation(systematic(weights, 4000, rng))
    resampled = draws[chosen]
    resampled.flags.writeable = False
    return Certificate(
        names=names,
        k_hat=k_hat,
        n_draw=weights.size,
        ess=kish_ess(log_weights),
        log_evidence=log_mean,
        u_log_evidence=log_mean_uncertainty(log_weights),
        mean=mean,
        sd=sd,
        mcse_mean=np.sqrt(squares @ deviation**2),
        # 0: all weight on one draw
        mcse_sd=np.sqrt(squares @ (deviation**2 - variance) ** 2) / (2.0 * positive_or(sd, np.nan)),
        quantiles=MappingProxyType(quantiles),
        mcse_shares=MappingProxyType(errors),
        draws=resampled,
        log_density=log_p[chosen],
    )


class _Column:
    """Quantiles of one weighted column."""

    def __init__(self, values: FloatArray, weights: FloatArray) -> None:
        order = np.argsort(values)
        self.values, self.weights = values[order], weights[order]
        self.below = np.cumsum(self.weights) - 0.5 * self.weights
        self.sd = math.sqrt(float(weights @ (values - weights @ values) ** 2))

    def at(self, p: float) -> float:
        return float(np.interp(p, self.below, self.values))

    def error_of_end(self, p: float) -> float:
        """Standard error of the quantile, half the way between those of p with its own error more
        and less.
        """
        u = self.error_below(p)
        return 0.5 * (self.at(min(p + u, 1.0)) - self.at(max(p - u, 0.0)))

    def error_below(self, p: float) -> float:
        """Standard error of the share below the quantile."""
        return math.sqrt(float(np.sum(self.weights**2 * ((self.values <= self.at(p)) - p) ** 2)))


def compare_with_chain(
    certificate: Certificate, chain: Chain, *, most: int = MAX_PARAMETERS
) -> Agreement:
    """Whether a chain and an independent certificate give the same medians and ends of the 68 and
    95 % intervals.

    Shares of the draws are compared, not moments: with few degrees of freedom the scatter of the
    points has a tail so heavy that a standard deviation, and even more its Monte-Carlo error, is
    decided by a few draws.  A difference is called where it is both larger than 0.03 posterior sds
    (0.05 for the ends of the 95 % interval) and beyond what the Monte-Carlo errors of both allow;
    with all 5 n_par differences considered (Bonferroni) a true agreement is called in one case of
    2000 at most.

    most : parameters beyond which there is no verdict.
    """
    n_par, flat = len(certificate.names), chain.flat
    sd = positive_or(certificate.sd, np.nan)
    quantiles = [certificate.quantiles[p] for p in QUANTILES]
    differences = (np.quantile(flat, QUANTILES, axis=0) - np.array(quantiles)) / sd
    z, errors = map(np.array, zip(*(_share(certificate, chain, p) for p in QUANTILES), strict=True))
    errors = errors / sd
    # chance that any of all differences is called where there is none
    limit = -float(normal_quantile(5e-4 / (2 * len(QUANTILES) * n_par)))
    verdict, finding = (
        ("missing", too_many(n_par, most))
        if n_par > most
        else _verdict(certificate, differences, z, errors, limit)
    )
    return Agreement(verdict, (finding,), differences, z, limit)


def _share(certificate: Certificate, chain: Chain, p: float) -> tuple[FloatArray, FloatArray]:
    """(n_par,) z and standard error, unit of the parameters, of the difference of a quantile.

    z compares shares, not quantiles: that of the draws above the certificate's quantile with 1 - p.
    """
    flat = chain.flat
    below = np.mean(flat <= certificate.quantiles[p], axis=0)
    # beyond the chain's own quantile, since there may be nothing beyond the certificate's
    above = chain.draws > np.quantile(flat, p, axis=0)
    size = effective_size(above.astype(float))
    u = np.hypot(np.sqrt(p * (1.0 - p) / size), certificate.mcse_shares[p])
    around = np.clip([p - u, p + u], 0.0, 1.0).T
    ends = [np.quantile(column, pair) for column, pair in zip(flat.T, around, strict=True)]
    return (p - below) / u, 0.5 * np.diff(ends)[:, 0]


def no_comparison(n_par: int, *findings: Finding) -> Agreement:
    """A second opinion that is missing, and why."""
    unknown = np.full((len(QUANTILES), n_par), np.nan)
    return Agreement("missing", findings, unknown, unknown, math.nan)


def too_many(n_par: int, most: int = MAX_PARAMETERS) -> Finding:
    """Why there is no certificate."""
    return Finding(Kind.TOO_MANY_PARAMETERS, size=n_par, numbers={"limit": most})


def _verdict(
    certificate: Certificate,
    differences: FloatArray,
    z: FloatArray,
    errors: FloatArray,
    limit: float,
) -> tuple[str, Finding]:
    """errors : (5, n_par) of the differences in posterior sds."""
    if not certificate.reliable:
        numbers = {"limit": K_HAT_LIMIT, "draws": certificate.n_draw}
        return "missing", Finding(Kind.WEIGHTS_UNRELIABLE, size=certificate.k_hat, numbers=numbers)
    detectable = limit * errors
    # the errors are as unsure as the values
    if certificate.ess < 400.0:
        return "missing", Finding(Kind.ERRORS_TOO_LARGE, size=float(np.nanmax(detectable)))
    called = [
        Finding(
            Kind.DIFFERENCE,
            test=_name_of(QUANTILES[i]),
            size=float(differences[i, j]),
            numbers={"errors": float(abs(z[i, j]))},
            parameters=(Amount(certificate.names[j]),),
        )
        for i, j in np.argwhere(~((np.abs(differences) <= _NEGLIGIBLE) | (np.abs(z) <= limit)))
    ]
    if called:
        called.sort(key=lambda finding: -finding.numbers["errors"])
        return "disagree", Finding(Kind.CHAIN_DIFFERS, test=_IMPORTANCE, parts=tuple(called[:3]))
    too_large = detectable[detectable > _COARSE]
    if too_large.size:
        return "missing", Finding(Kind.ERRORS_TOO_LARGE, size=float(np.max(too_large)))
    largest = max_abs(differences)
    return "agree", Finding(Kind.CHAIN_AGREES, size=largest)


def _name_of(p: float) -> str:
    return phrase("median") if p == 0.5 else phrase("{p:.1f} % quantile", p=100.0 * p)
