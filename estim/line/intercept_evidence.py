"""Evidence for or against an intercept of a line: that of the line with one over that of the line
through the origin.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from estim.common import InputError, phrase
from estim.line.posterior import LinePosterior, without_intercept
from estim.sampling import Certificate, adapt_proposal, certify


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
