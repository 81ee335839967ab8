"""The second computation of a posterior, which shares no proposal with the chain; and the chain's proposal, mended by what it found.

Up to four parameters it is adaptive quadrature (`estim.sampling.quadrature`).  Beyond, or where quadrature would need too many nodes
or does not settle, it is importance sampling, half of whose draws come from a proposal that follows the ridges of the density
(`estim.sampling.exploration`) and never saw a draw of the adapted one.  A tail that the adapted proposal leaves out is put into it
before the chain starts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import MappingProxyType

import numpy as np

from estim.arrays import FloatArray
from estim.sampling.certificate import PROBABILITIES, Certificate, certify
from estim.sampling.exploration import both, repaired, ridge_proposal
from estim.sampling.importance import systematic
from estim.sampling.proposal import Proposal
from estim.sampling.protocol import Density, Support
from estim.sampling.quadrature import COARSE, FINE, MOST_DIMENSIONS, MOST_NODES, Nodes, TooManyNodesError, integrate

QUADRATURE = "quadrature"
_POINTS = 3e7  # nodes of a rule times observations: some seconds
_SETTLED = 0.05  # posterior sds: a larger difference between the two rules proves nothing
_LEAST_ERROR = 1e-4  # posterior sds: rounding, and what lies beyond the ends
_LEAST_SHARE = 1e-5
_N_RESAMPLED = 4000
_AT_LIMIT = 0.05  # posterior sds
_FAR, _CLOSE = 4.0, 0.01  # errors, and a difference (of log evidences, or in posterior sds), that prove nothing


def second_opinion(
    density: Density, start: FloatArray, cov: FloatArray, adapted: Proposal, *, rng: np.random.Generator, starts: Sequence[FloatArray] = (),
    support: Support | None = None, n_obs: int = 1,
) -> tuple[Certificate, Proposal]:
    """A certificate of `density`, and the proposal for its chain: `adapted`, or a better one where that leaves something out.

    start, cov, starts : the fit, its covariance, and further optima.  support : limits of the parameters.
    n_obs : observations, which say what one evaluation of the density costs.

    Raises NumericalError where the density is not a number.
    """
    ridges = ridge_proposal(density, start, cov, starts=starts, support=support)
    certificate = certify_by_quadrature(density, start, cov, rng=rng, starts=starts, support=support, n_obs=n_obs)
    if certificate is None:
        certificate = certify(density, both(adapted, ridges), rng=rng)
    else:
        # importance sampling that leaves out nothing which quadrature found
        own_rng = rng.spawn(1)[0]
        covering = repaired(density, both(adapted, ridges), ridges, certificate.draws, certificate.log_evidence, rng=own_rng)
        sampled = certify(density, covering, rng=own_rng)
        doubtful = _at_a_limit(certificate, support) or _differ(certificate, sampled)
        certificate = sampled if sampled.reliable and doubtful else certificate
    if not certificate.reliable:
        return certificate, adapted
    return certificate, repaired(density, adapted, ridges, certificate.draws, certificate.log_evidence, rng=rng)


def _at_a_limit(quadrature: Certificate, support: Support | None) -> bool:
    """Whether the posterior reaches a limit of a parameter.

    Quadrature follows conditional maxima, and those that lie on a limit are hard to find: its two rules may err alike there.
    """
    if support is None:
        return False
    reached = [np.abs(quadrature.draws - limit) < _AT_LIMIT * quadrature.sd for limit in support]
    return bool(np.any(reached))


def _differ(quadrature: Certificate, sampled: Certificate) -> bool:
    """Whether quadrature and importance sampling, which share no nodes, give another evidence, mean or standard deviation.

    The two rules of quadrature may err alike, beside a limit or where a border between modes cuts one of them; then their difference shows nothing.
    """
    evidence = math.hypot(quadrature.u_log_evidence, sampled.u_log_evidence)
    means = np.hypot(quadrature.mcse_mean, sampled.mcse_mean) / sampled.sd
    sds = np.hypot(quadrature.mcse_sd, sampled.mcse_sd) / sampled.sd
    return bool(
        abs(quadrature.log_evidence - sampled.log_evidence) > _FAR * evidence + _CLOSE
        or np.any(np.abs(quadrature.mean - sampled.mean) / sampled.sd > _FAR * means + _CLOSE)
        or np.any(np.abs(quadrature.sd - sampled.sd) / sampled.sd > _FAR * sds + _CLOSE)
    )


def certify_by_quadrature(
    density: Density, start: FloatArray, cov: FloatArray, *, rng: np.random.Generator, starts: Sequence[FloatArray] = (),
    support: Support | None = None, n_obs: int = 1,
) -> Certificate | None:
    """The posterior by quadrature, each number with the difference of two rules as its error; None where that costs too much or does not settle."""
    if len(density.names) > MOST_DIMENSIONS:
        return None
    most = min(MOST_NODES, int(_POINTS / max(1, n_obs)))
    try:
        coarse, fine = (integrate(density, start, cov, rule=rule, starts=starts, support=support, most=most) for rule in (COARSE, FINE))
    except TooManyNodesError:
        return None
    if fine.open or not np.all(fine.sd > 0.0):
        return None
    error_mean, error_sd = np.abs(fine.mean - coarse.mean), np.abs(fine.sd - coarse.sd)
    if not np.all(np.maximum(error_mean, error_sd) <= _SETTLED * fine.sd):
        return None
    return _certificate(density.names, fine, coarse, rng)


def _certificate(names: tuple[str, ...], fine: Nodes, coarse: Nodes, rng: np.random.Generator) -> Certificate:
    least = _LEAST_ERROR * fine.sd
    quantiles = {p: fine.quantile(p) for p in PROBABILITIES}
    errors = {p: np.maximum(np.abs(fine.below(coarse.quantile(p)) - p), _LEAST_SHARE) for p in PROBABILITIES}
    resampled = fine.points[rng.permutation(systematic(fine.masses, _N_RESAMPLED, rng))]
    resampled.flags.writeable = False
    return Certificate(
        names=names, method=QUADRATURE, k_hat=np.nan, n_draw=fine.masses.size, ess=np.nan,
        log_evidence=fine.log_evidence, u_log_evidence=max(abs(fine.log_evidence - coarse.log_evidence), _LEAST_ERROR),
        mean=fine.mean, sd=fine.sd,
        mcse_mean=np.maximum(np.abs(fine.mean - coarse.mean), least), mcse_sd=np.maximum(np.abs(fine.sd - coarse.sd), least),
        quantiles=MappingProxyType(quantiles), mcse_shares=MappingProxyType(errors), draws=resampled,
    )
