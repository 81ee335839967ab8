"""The second computation of a posterior, which shares no proposal with the chain; and the chain's
proposal, improved by what it found.

It is importance sampling, half of whose draws come from a proposal that follows the ridges of the
density (`estim.sampling.ridges`) and never saw a draw of the adapted one.  A tail that the adapted
proposal leaves out is put into it before the chain starts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estim.arrays import FloatArray, root_mean_square
from estim.sampling.certificate import Certificate, certify
from estim.sampling.log_density import Density, Support
from estim.sampling.proposal import Proposal, mixture_of_draws
from estim.sampling.ridges import ridge_proposal

_RIDGE_SHARE = 0.35


def second_opinion(
    density: Density,
    start: FloatArray,
    cov: FloatArray,
    adapted: Proposal,
    *,
    rng: np.random.Generator,
    starts: Sequence[FloatArray] = (),
    support: Support | None = None,
) -> tuple[Certificate, Proposal]:
    """A certificate of `density`, and the proposal for its chain: `adapted`, or a better one where
    that leaves something out.

    start, cov, starts : the fit, its covariance, and further optima.
    support : limits of the parameters.

    Raises NumericalError where the density is not a number.
    """
    ridges = ridge_proposal(density, start, cov, starts=starts, support=support)
    certificate = certify(density, adapted.mixed_with(ridges, 0.5), rng=rng)
    if not certificate.reliable:
        return certificate, adapted
    return certificate, repaired(adapted, ridges, certificate, rng=rng)


def repaired(
    adapted: Proposal, ridges: Proposal, certificate: Certificate, *, rng: np.random.Generator
) -> Proposal:
    """The `adapted` proposal; where it leaves out what the draws of the `certificate` hold, a
    mixture of it with one fitted to them and with the `ridges`, which guard the tails.

    What counts is the density over the proposal, both normalised, at draws of the posterior, which
    come from elsewhere: its mean is the reciprocal of the effective share of the proposal's draws,
    its largest values how long a chain of such steps would stay in what the proposal leaves out.
    The root of its mean square heeds both.
    """
    draws, heights = certificate.draws, certificate.log_density - certificate.log_evidence
    ratio = np.exp(np.minimum(heights - adapted.log_density(draws), 300.0))
    # density over proposal, root mean square at draws of the posterior, from which another is made
    if root_mean_square(ratio) < 2.0:
        return adapted
    mixture = adapted.mixed_with(mixture_of_draws(draws, rng), 0.5)
    return mixture.mixed_with(ridges, _RIDGE_SHARE)
