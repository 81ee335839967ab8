"""Are ranks uniform?  Simultaneous bands for their distribution function, and a p-value.

Ranks 0 .. 99 of a true value among 99 posterior draws are uniform where the posterior tells the
truth.  The counts of ranks below each of the 99 inner edges are then binomial, and correlated.  The
statistic is the smallest of their two-sided binomial tail probabilities,

    s = min_i 2 min(P(K_i <= k_i), P(K_i >= k_i)),    K_i ~ Binomial(n, i/100)

and its distribution comes from simulated uniform ranks, ties and discreteness included (Saeilynoja,
Buerkner & Vehtari, Statistics and Computing 32 (2022) 32, section 2.2).  A band holds all counts
whose tail probability is not below the quantile of s.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from estim.arrays import FloatArray, IntArray

N_RANK = 99
EDGES: FloatArray = np.arange(1, N_RANK + 1) / (N_RANK + 1)
"""(n_rank,) the inner edges as shares of all ranks."""
_N_NULL = 40_000
_CHUNK = 4000
LEAST_P = 1.0 / (_N_NULL + 1)


def rank_counts(ranks: IntArray) -> IntArray:
    """(n_rank,) how many of ranks (n,) in 0 .. n_rank lie below the edges 1 .. n_rank."""
    return np.cumsum(np.bincount(ranks, minlength=N_RANK + 1))[:-1]


@lru_cache(maxsize=32)
def _tails(n: int) -> FloatArray:
    """(n + 1, n_rank) two-sided tail probability of each count at each edge."""
    from scipy.special import bdtr, bdtrc

    k, z = np.arange(n + 1)[:, None], EDGES
    return 2.0 * np.minimum(bdtr(k, n, z), np.where(k > 0, bdtrc(k - 1, n, z), 1.0))


@lru_cache(maxsize=32)
def _null(n: int) -> FloatArray:
    """(40000,) sorted statistics of uniform ranks."""
    rng = np.random.default_rng(20220301)
    table, columns = _tails(n), np.arange(N_RANK)
    smallest = []
    for _ in range(_N_NULL // _CHUNK):
        counts = np.cumsum(
            rng.multinomial(n, np.full(N_RANK + 1, 1.0 / (N_RANK + 1)), size=_CHUNK), axis=1
        )[:, :-1]
        smallest.append(np.min(table[counts, columns], axis=1))
    return np.sort(np.concatenate(smallest))


def uniformity_p_value(ranks: IntArray) -> float:
    """Probability that uniform ranks look as uneven as `ranks` (n,), or more; LEAST_P = 1/40001 at
    the least.
    """
    statistic = float(np.min(_tails(ranks.size)[rank_counts(ranks), np.arange(N_RANK)]))
    null = _null(ranks.size)
    return float(
        (1 + np.searchsorted(null, statistic * (1.0 + 1e-12), side="right")) / (null.size + 1)
    )


def uniformity_band(n: int) -> tuple[FloatArray, FloatArray]:
    """Lower and upper end (n_rank,) of the share of n uniform ranks below each edge; all of it
    inside with a probability of 95 % or more.
    """
    limit = float(np.quantile(_null(n), 0.05, method="lower"))
    inside = _tails(n) >= limit
    low = np.argmax(inside, axis=0)
    high = n - np.argmax(inside[::-1], axis=0)
    return low / n, high / n
