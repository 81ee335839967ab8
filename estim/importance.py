"""Tools of importance sampling: a Student-t proposal, Pareto-smoothed weights, what weights are worth.

Log weights of draws outside the support are -inf throughout; they count as draws of no weight.

Sources: Vehtari, Simpson, Gelman, Yao, Gabry, JMLR 25 (2024) 72 (Pareto smoothing, k-hat; by arviz-stats); Kish, Survey Sampling (1965) 8.2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.conditional import log_sum_exp

FloatArray = NDArray[np.float64]
IndexArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class StudentT:
    """Multivariate Student-t density: mean (d,), lower root of its scale matrix (d, d), degrees of freedom."""

    mean: FloatArray
    root: FloatArray
    dof: float

    def draw(self, rng: np.random.Generator, n: int) -> FloatArray:
        z = rng.standard_normal((n, self.mean.size)) / np.sqrt(rng.chisquare(self.dof, (n, 1)) / self.dof)
        return np.asarray(self.mean + z @ self.root.T)

    def log_density(self, draws: FloatArray) -> FloatArray:
        d, dof = self.mean.size, self.dof
        z = np.linalg.solve(self.root, (draws - self.mean).T)
        norm = math.lgamma(0.5 * (dof + d)) - math.lgamma(0.5 * dof) - 0.5 * d * math.log(math.pi * dof)
        return np.asarray(norm - np.sum(np.log(np.diag(self.root))) - 0.5 * (dof + d) * np.log1p(np.sum(z**2, axis=0) / dof))


def lower_root(cov: FloatArray) -> FloatArray:
    """Lower triangular root of a covariance, on unit diagonal first so that units do not matter."""
    sd = np.sqrt(np.diag(cov))
    return np.asarray(sd[:, None] * np.linalg.cholesky(cov / np.outer(sd, sd) + 1e-10 * np.eye(sd.size)))


def smoothed(log_weights: FloatArray) -> tuple[FloatArray, float]:
    """Pareto-smoothed log weights (n,), normalised to sum 1, and k-hat; weights of zero stay zero.  k-hat is inf where fewer than 25 count."""
    from arviz_stats.base import array_stats

    smooth = np.full(log_weights.size, -np.inf)
    finite = np.flatnonzero(np.isfinite(log_weights))
    k_hat = math.inf
    if finite.size:
        smooth[finite] = log_weights[finite] - np.max(log_weights[finite])
    if finite.size >= 25 and np.ptp(log_weights[finite]) < 1e-9:
        k_hat = -math.inf  # equal weights: no tail at all
    elif finite.size >= 25:
        # arviz-stats takes the negative of the log weights, as for leave-one-out
        values, k = array_stats.psislw(-smooth[finite])
        smooth[finite], k_hat = np.asarray(values, dtype=float), float(k)
    return smooth - log_sum_exp(smooth) if finite.size else smooth, k_hat


def effective_size(log_weights: FloatArray) -> float:
    """(sum w)^2/sum w^2; 0 where every weight is."""
    if not np.any(np.isfinite(log_weights)):
        return 0.0
    return float(np.exp(2.0 * log_sum_exp(log_weights) - log_sum_exp(2.0 * log_weights)))


def u_log_evidence(raw: FloatArray) -> float:
    """Monte-Carlo standard error of log mean exp."""
    size = effective_size(raw)
    return math.sqrt(max(1.0 / size - 1.0 / raw.size, 0.0)) if size else math.inf


def flattening(log_weights: FloatArray, least: float) -> float:
    """The largest b <= 1 with an effective size of w^b of at least `least`."""

    def size(power: float) -> float:
        return effective_size(np.where(np.isfinite(log_weights), power * np.where(np.isfinite(log_weights), log_weights, 0.0), -np.inf))

    if size(1.0) >= least:
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if size(middle) >= least else (low, middle)
    return low


def systematic(weights: FloatArray, n: int, rng: np.random.Generator) -> IndexArray:
    """(n,) indices, each draw as often as its weight says to within one."""
    edges = np.cumsum(weights)
    places = (rng.random() + np.arange(n)) / n * edges[-1]
    return np.minimum(np.searchsorted(edges, places), weights.size - 1)


def spread(values: FloatArray, log_weights: FloatArray) -> float:
    """Standard deviation of values (n,) under weights; inf where one that counts is not finite."""
    if not np.any(np.isfinite(log_weights)):
        return math.inf
    weights = np.exp(log_weights - np.max(log_weights))
    counting = weights > 1e-6
    if not np.all(np.isfinite(values[counting])):
        return math.inf
    weights, values = weights[counting] / np.sum(weights[counting]), values[counting]
    return float(np.sqrt(weights @ (values - weights @ values) ** 2))


def difference(shared: FloatArray, log_marginal: FloatArray, log_all: FloatArray) -> tuple[float, float]:
    """Largest difference of a mean by two sets of weights of the same draws, in standard deviations, and its Monte-Carlo error."""
    if effective_size(log_marginal) < 2.0 or effective_size(log_all) < 2.0:
        return math.inf, math.inf
    a, b = np.exp(log_marginal - log_sum_exp(log_marginal)), np.exp(log_all)
    mean_a, mean_b = a @ shared, b @ shared
    sd = np.sqrt(a @ (shared - mean_a) ** 2)
    # both means come from the same draws: only what differs between the weights scatters
    u = np.sqrt(np.sum((a[:, None] * (shared - mean_a) - b[:, None] * (shared - mean_b)) ** 2, axis=0))
    worst = int(np.argmax(np.abs(mean_b - mean_a) / sd))
    return float(abs(mean_b - mean_a)[worst] / sd[worst]), float(u[worst] / sd[worst])
