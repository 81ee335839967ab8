"""Draws of a release posterior: where to start, and importance sampling."""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.line.release_likelihood import ReleasePosterior, rough_gamma
from estim.sampling import Certificate, adapt_proposal, certify

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


def weigh(posterior: ReleasePosterior, *, rng: np.random.Generator) -> Certificate:
    """The posterior by importance sampling alone: some tenths of a second; `reliable` says whether
    to believe it.
    """
    mean, cov = rough_start(posterior, rng)
    return certify(posterior, adapt_proposal(posterior, mean, cov, rng=rng), rng=rng)
