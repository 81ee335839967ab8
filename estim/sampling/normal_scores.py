"""Draws by their ranks: what makes diagnostics of chains hold where a posterior has heavy tails or none of its moments."""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray


def in_halves(draws: FloatArray) -> FloatArray:
    """Draws (n_chain, n_draw) without the one in the middle of an odd number, so that each chain has two halves."""
    half = draws.shape[1] // 2
    return draws if draws.shape[1] == 2 * half else np.hstack([draws[:, :half], draws[:, -half:]])


def folded(draws: FloatArray) -> FloatArray:
    """Distances (n_chain, n_draw) from the median of all draws: their ranks tell chains of different widths apart."""
    return np.asarray(np.abs(draws - np.median(draws)))


def normal_scores(draws: FloatArray) -> FloatArray:
    """z = Phi^-1((r - 3/8)/(n + 1/4)), (n_chain, n_draw), r the rank of a draw among all n, the mean of their ranks for equal ones.

    Vehtari, Gelman, Simpson, Carpenter, Buerkner, Bayesian Analysis 16 (2021) 667, Eq. 14; as arviz-stats, which takes scipy.stats for it.
    """
    from scipy.special import ndtri

    _, place, counts = np.unique(draws.ravel(), return_inverse=True, return_counts=True)
    ranks = (np.cumsum(counts) - 0.5 * (counts - 1))[place.reshape(draws.shape)]
    return np.asarray(ndtri((ranks - 0.375) / (draws.size + 0.25)), dtype=np.float64)
