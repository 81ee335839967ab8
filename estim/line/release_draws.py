"""Draws of a release posterior: where to start, importance sampling, and a chain with a second
computation beside it.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.line.release_likelihood import ReleasePosterior, rough_gamma
from estim.sampling import (
    MAX_PARAMETERS,
    Agreement,
    Certificate,
    Chain,
    Optima,
    Progress,
    Target,
    adapt_proposal,
    certified_chain,
    certify,
)

_N_ROUGH = 2000
_LOG_SD_GAMMA = 0.5  # of the first draws about a rough value
_LEAST_SIZE = 40.0  # effective draws that a rough covariance rests on


def rough_start(
    posterior: ReleasePosterior, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Mean (n_par,) and covariance (n_par, n_par) to start from: draws of the prior, of gamma about
    a rough value, weighted.

    The weights are flattened until 40 effective draws are left.
    """
    columns, log_proposal = [], np.zeros(_N_ROUGH)
    rough = rough_gamma(posterior.trials)
    for name in posterior.names:
        prior = posterior.priors[name]
        if name.startswith("gamma"):
            z = rng.standard_normal(_N_ROUGH)
            column = rough * np.exp(_LOG_SD_GAMMA * z)
            log_proposal += -0.5 * z**2 - np.log(column)
        else:
            column = prior.draw(rng, _N_ROUGH)
            log_proposal += prior.log_density(column)
        columns.append(column)
    draws = np.column_stack(columns)
    log_ratio = posterior.log_density(draws) - log_proposal
    log_ratio -= np.max(log_ratio)
    for power in 0.5 ** np.arange(12):
        weights = np.exp(power * log_ratio)
        weights /= weights.sum()
        if 1.0 / np.sum(weights**2) > _LEAST_SIZE:
            break
    mean = weights @ draws
    return mean, np.atleast_2d(np.cov(draws.T, aweights=weights, ddof=0))


def weigh(
    posterior: ReleasePosterior,
    *,
    rng: np.random.Generator,
    n_draw: int = 8000,
    least_ess: float = 4000.0,
) -> Certificate:
    """The posterior by importance sampling alone: some tenths of a second; `reliable` says whether
    to believe it.
    """
    mean, cov = rough_start(posterior, rng)
    return certify(
        posterior,
        adapt_proposal(posterior, mean, cov, rng=rng),
        rng=rng,
        n_draw=n_draw,
        least_ess=least_ess,
    )


def sample(
    posterior: ReleasePosterior,
    *,
    rng: np.random.Generator,
    seed: int,
    target: Target,
    progress: Progress | None,
) -> tuple[Chain, Agreement]:
    """A chain of the posterior, and how it compares with importance sampling.  rng : of the start.
    seed : of the draws.
    """
    optima = Optima(*rough_start(posterior, rng))
    certified = certified_chain(
        posterior,
        optima,
        target=target,
        seed=seed,
        most=MAX_PARAMETERS,
        support=posterior.support,
        progress=progress,
    )
    return certified.chain, certified.comparison
