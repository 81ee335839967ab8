"""A line's posterior by importance sampling, and what the points say for or against an intercept.

What to use when: ``sample_line`` gives weighted draws, intervals and the evidence in some
milliseconds, without a Markov chain; its ``n_effective`` says whether to believe it (below a tenth
of the draws: sample with a chain instead).  ``intercept_evidence`` compares the line with an
intercept to the line through the origin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, phrase
from estim.line.posterior import LineMode, LinePosterior, mode_or_guess, without_intercept

PROPOSAL_DOF = 5.0  # of the Student-t proposal: tails heavier than those of the posterior


@dataclass(frozen=True, eq=False)
class WeightedDraws:
    """Draws with weights that stand for the posterior."""

    names: tuple[str, ...]  # of the columns
    draws: FloatArray  # (n_draw, n_par)
    weights: FloatArray  # (n_draw,), sum 1
    log_evidence: float  # log of the integral of exp(log_density)
    u_log_evidence: float  # its Monte-Carlo standard error
    n_effective: float  # 1/sum(weights^2)


class InterceptEvidence(NamedTuple):
    """Natural logarithm of the Bayes factor for an intercept (> 0) or against it (< 0)."""

    log_bayes_factor: float  # log evidence with intercept minus log evidence through the origin
    u_log_bayes_factor: float  # its Monte-Carlo standard error
    intercept_sd: float  # the normal prior it depends on, unit of y
    message: str  # why not to rely on it, a sentence; "" if there is no reason


def sample_line(
    posterior: LinePosterior, mode: LineMode, *, rng: np.random.Generator, n_draw: int = 8000
) -> WeightedDraws:
    """Weighted draws from a Student-t distribution that is fitted to the posterior in two rounds.

    The first round (n_draw/4) is centred on the mode with its covariance, the second on mean and
    covariance of the first.  weight = density / proposal, evidence = mean weight.
    mode : of ``line_mode``; InputError if it has no covariance.  Source: Kloek and van Dijk 1978,
        Econometrica 46, 1.
    """
    if not np.all(np.isfinite(mode.cov)):
        raise InputError(f"has no covariance: {mode.message}", field="mode")
    first = _draw(posterior, mode.values, mode.cov, rng=rng, n_draw=max(n_draw // 4, 100))
    mean, cov = first.weights @ first.draws, np.cov(first.draws.T, aweights=first.weights, ddof=0)
    # a first round that rests on a few draws says less than the mode does
    centre, spread = (mean, cov) if first.n_effective > 50.0 else (mode.values, mode.cov)
    return _draw(posterior, centre, spread, rng=rng, n_draw=n_draw)


def _draw(
    posterior: LinePosterior,
    centre: FloatArray,
    cov: FloatArray,
    *,
    rng: np.random.Generator,
    n_draw: int,
) -> WeightedDraws:
    factor = np.linalg.cholesky(cov)
    spread = np.sqrt(rng.chisquare(PROPOSAL_DOF, size=n_draw) / PROPOSAL_DOF)
    standard = rng.standard_normal((n_draw, len(centre))) / spread[:, None]
    draws = centre + standard @ factor.T
    log_ratio = (
        posterior.log_density(draws)
        - log_student(standard, PROPOSAL_DOF)
        + np.log(np.diag(factor)).sum()
    )
    largest = float(np.max(log_ratio))
    ratio = np.exp(log_ratio - largest)
    mean = float(np.mean(ratio))
    weights = ratio / ratio.sum()
    draws.flags.writeable = weights.flags.writeable = False
    error = float(np.std(ratio)) / mean / n_draw**0.5
    return WeightedDraws(
        posterior.names,
        draws,
        weights,
        largest + float(np.log(mean)),
        error,
        float(1.0 / np.sum(weights**2)),
    )


def log_student(standard: FloatArray, dof: float) -> FloatArray:
    """(n_draw,) log density of the multivariate t distribution of location 0 and unit shape at
    `standard` (n_draw, n_par).
    """
    n_par = standard.shape[1]
    log_norm = (
        math.lgamma(0.5 * (dof + n_par))
        - math.lgamma(0.5 * dof)
        - 0.5 * n_par * math.log(dof * math.pi)
    )
    return log_norm - 0.5 * (dof + n_par) * np.log1p(np.sum(standard**2, axis=1) / dof)


def intercept_evidence(
    posterior: LinePosterior, *, rng: np.random.Generator, n_draw: int = 8000
) -> InterceptEvidence:
    """log evidence of the line with a normal intercept minus log evidence of the line through the
    origin.

    Flat priors that both share cancel.  The result depends on ``posterior.intercept_sd``: the wider
    that prior, the more an intercept near 0 counts for the origin; state it with the result.
    posterior : with ``intercept_sd``.  Raises InputError if it has none.  Source: Kass and Raftery
        1995, J. Am. Stat. Assoc. 90, 773.
    """
    if posterior.intercept_sd is None:
        raise InputError(
            "must be given: the evidence depends on the prior of the intercept",
            field="intercept_sd",
        )
    variants = (posterior, without_intercept(posterior))
    free, fixed = (
        sample_line(variant, mode_or_guess(variant), rng=rng, n_draw=n_draw) for variant in variants
    )
    poor = min(free.n_effective, fixed.n_effective) < 0.1 * n_draw
    return InterceptEvidence(
        free.log_evidence - fixed.log_evidence,
        float(np.hypot(free.u_log_evidence, fixed.u_log_evidence)),
        posterior.intercept_sd,
        phrase(
            "The importance weights are uneven: the Monte-Carlo error is itself uncertain; "
            "use more draws."
        )
        if poor
        else "",
    )
