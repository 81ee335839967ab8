"""Tools of importance sampling: Pareto-smoothed weights, what weights are worth, draws of equal
weight.

Log weights of draws outside the support are -inf throughout; they count as draws of no weight.

Sources: Vehtari, Simpson, Gelman, Yao, Gabry, JMLR 25 (2024) 72 (Pareto smoothing, k-hat; tests
hold them against arviz-stats); Zhang, Stephens, Technometrics 51 (2009) 316 (fit of the tail);
Kish, Survey Sampling (1965) 8.2.
"""

from __future__ import annotations

import math

import numpy as np

from estim.arrays import FloatArray, IntArray, all_finite, log_sum_exp

K_HAT_LIMIT = 0.7  # above it importance weights cannot be trusted (Vehtari et al. 2024)
_LEAST_TAIL = 5  # draws


def pareto_smoothed(log_ratio: FloatArray) -> tuple[FloatArray, float, float]:
    """Pareto-smoothed log weights (n_draw,) whose exponentials sum to 1, their k-hat, and the log
    of the mean weight before normalisation.

    log_ratio : (n_draw,) log density minus log proposal.  Where no tail can be fitted the weights
        are left alone: with k-hat = inf where fewer draws have any weight than the tail needs, with
        -inf where all weights are the same.
    """
    n = log_ratio.size
    total = float(log_sum_exp(log_ratio))
    if total == -math.inf:
        return np.full(n, -np.inf), math.inf, -math.inf
    unsmoothed, log_mean = log_ratio - total, total - math.log(n)
    order = np.argsort(log_ratio)
    highest, n_tail = float(log_ratio[order[-1]]), min(n // 5, int(3.0 * math.sqrt(n)))
    if n_tail < _LEAST_TAIL or not np.isfinite(log_ratio[order[-n_tail - 1]]):
        return unsmoothed, math.inf, log_mean
    if highest - log_ratio[order[-n_tail - 1]] < 1e-9:
        return unsmoothed, -math.inf, log_mean
    tail, log_weights = order[-n_tail:], log_ratio - highest
    cutoff = math.exp(log_weights[order[-n_tail - 1]])
    # where one draw outweighs all others the fit divides by zero, and finds no tail
    with np.errstate(all="ignore"):
        k_hat, scale = _tail_shape(np.exp(log_weights[tail]) - cutoff)
        quantiles = np.log1p(-(np.arange(n_tail) + 0.5) / n_tail)
        excess = (
            scale * np.expm1(-k_hat * quantiles) / k_hat if k_hat != 0.0 else -scale * quantiles
        )
        smooth = np.minimum(np.log(cutoff + excess), 0.0)
        log_weights[tail] = smooth
    if not (np.isfinite(k_hat) and scale > 0.0 and np.isfinite(smooth[-1])):
        return unsmoothed, math.inf, log_mean
    total = float(log_sum_exp(log_weights))
    return log_weights - total, k_hat, total + highest - math.log(n)


def _tail_shape(excess: FloatArray) -> tuple[float, float]:
    """Shape and scale of a generalised Pareto distribution fitted to `excess` (n,) in order; the
    shape shrunk towards 1/2 with the weight of ten further values (Vehtari et al. 2024).
    """
    n = excess.size
    n_grid = 30 + int(math.sqrt(n))
    grid = (1.0 - np.sqrt(n_grid / (np.arange(n_grid) + 0.5))) / (
        3.0 * excess[int(0.25 * n + 0.5) - 1]
    ) + 1.0 / excess[-1]
    shapes = np.mean(np.log1p(-grid[:, None] * excess), axis=1)
    profile = n * (np.log(-grid / shapes) - shapes - 1.0)
    weights = np.exp(profile - log_sum_exp(profile))
    weights[weights < 10.0 * np.finfo(float).eps] = 0.0
    mean = float(np.sum(grid * weights) / np.sum(weights))
    shape = float(np.mean(np.log1p(-mean * excess)))
    return (n * shape + 5.0) / (n + 10.0), -shape / mean


def kish_ess(log_weights: FloatArray) -> float:
    """Effective size of weighted draws, (sum w)^2/(sum w^2); 0 where every weight is."""
    if not np.any(np.isfinite(log_weights)):
        return 0.0
    return float(np.exp(2.0 * log_sum_exp(log_weights) - log_sum_exp(2.0 * log_weights)))


def log_mean_uncertainty(log_weights: FloatArray) -> float:
    """Monte-Carlo standard error of log mean w, which is a log evidence where w =
    density/proposal.
    """
    size = kish_ess(log_weights)
    return math.sqrt(max(1.0 / size - 1.0 / log_weights.size, 0.0)) if size else math.inf


def tempered(log_weights: FloatArray, least: float) -> FloatArray:
    """(n_draw,) normalised weights w^b, tempered by the largest b <= 1 that leaves an effective
    size of `least`: a far start is approached in steps.
    """
    finite = np.isfinite(log_weights)
    shifted = np.where(finite, log_weights, 0.0) - np.max(log_weights)

    def powered(power: float) -> FloatArray:
        return np.where(finite, power * shifted, -np.inf)

    low, high = 0.0, 1.0
    if kish_ess(powered(1.0)) < least:
        for _ in range(20):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if kish_ess(powered(middle)) >= least else (low, middle)
        high = max(low, 1e-6)
    weights = np.exp(powered(high))
    return weights / np.sum(weights)


def systematic(weights: FloatArray, n: int, rng: np.random.Generator) -> IntArray:
    """(n,) indices, each draw in proportion to its weight, to within one."""
    edges = np.cumsum(weights)
    positions = (rng.random() + np.arange(n)) / n * edges[-1]
    return np.minimum(np.searchsorted(edges, positions), weights.size - 1)


def spread(values: FloatArray, log_weights: FloatArray) -> float:
    """Standard deviation of values (n,) under weights; inf where one that counts is not finite."""
    if not np.any(np.isfinite(log_weights)):
        return math.inf
    weights = np.exp(log_weights - np.max(log_weights))
    counting = weights > 1e-6
    if not all_finite(values[counting]):
        return math.inf
    weights, values = weights[counting] / np.sum(weights[counting]), values[counting]
    return float(np.sqrt(weights @ (values - weights @ values) ** 2))


def difference(
    shared: FloatArray, log_marginal: FloatArray, log_all: FloatArray
) -> tuple[float, float]:
    """Largest difference of a mean or a standard deviation by two sets of weights of the same
    draws, in standard deviations, and its Monte-Carlo error.
    """
    if kish_ess(log_marginal) < 2.0 or kish_ess(log_all) < 2.0:
        return math.inf, math.inf
    a, b = np.exp(log_marginal - log_sum_exp(log_marginal)), np.exp(log_all)
    mean = a @ shared
    z = (shared - mean) / np.sqrt(a @ (shared - mean) ** 2)
    # a larger standard deviation is a larger mean of z^2/2
    z = np.hstack([z, 0.5 * z**2])
    mean_a, mean_b = a @ z, b @ z
    # both means come from the same draws: only what differs between the weights scatters
    u = np.sqrt(np.sum((a[:, None] * (z - mean_a) - b[:, None] * (z - mean_b)) ** 2, axis=0))
    worst = int(np.argmax(np.abs(mean_b - mean_a)))
    return float(abs(mean_b - mean_a)[worst]), float(u[worst])
