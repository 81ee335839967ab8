"""The laws of what is counted: how counts scatter about their expectation, which determines how
far.

- `PoissonLaw`: events in a bin or a fixed time; y is their number, m the number expected.
- `BinomialLaw`: y is the fraction of n trials that succeeded, m the probability of one.

Each is an exponential family in its mean m: with V the variance of y, d log p/dm = (y - m)/V, and
1/V is the Fisher information about m.  `size` (n_obs,) is the number of trials; a Poisson count has
none, and 1 is given.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import later


@dataclass(frozen=True)
class PoissonLaw:
    """Numbers of independent events.

    word, new, used : how y are called: they, one more of them, and those that are fit.
    ceiling : what no mean exceeds.
    """

    word, new, used = later("counts"), later("a new count"), later("counts used")
    ceiling = math.inf

    def log_density(self, y: FloatArray, mean: FloatArray, size: FloatArray) -> FloatArray:
        """log p(y | m), normalised."""
        from scipy.special import gammaln

        return _y_log(y, mean) - mean - gammaln(y + 1.0)

    def variance(self, mean: FloatArray, size: FloatArray) -> FloatArray:
        """V of y."""
        return mean + 0.0 * size

    def unseen(self, y: FloatArray, mean: FloatArray, size: FloatArray) -> FloatArray:
        """How many m expects of what was never observed; inf where all was."""
        return np.where(y > 0.0, np.inf, mean)

    def guess(self, y: FloatArray, size: FloatArray) -> FloatArray:
        """Standard deviation of y where the mean is not known: never 0."""
        return np.sqrt(y + 1.0)

    def draw(self, mean: FloatArray, size: FloatArray, rng: np.random.Generator) -> FloatArray:
        """y at random."""
        return rng.poisson(np.clip(mean, 0.0, 1e15)).astype(float)

    def quantile(self, probability: float, mean: FloatArray, size: FloatArray) -> FloatArray:
        """The least y with P(Y <= y) >= probability."""
        from scipy.stats import poisson

        return poisson.ppf(probability, mean)


@dataclass(frozen=True)
class BinomialLaw:
    """Fractions of independent trials."""

    word, new, used = later("fractions"), later("a new fraction"), later("fractions used")
    ceiling = 1.0

    def log_density(self, y: FloatArray, mean: FloatArray, size: FloatArray) -> FloatArray:
        from scipy.special import gammaln

        hits, misses = np.rint(size * y), np.rint(size * (1.0 - y))
        log_combinations = gammaln(size + 1.0) - gammaln(hits + 1.0) - gammaln(misses + 1.0)
        return log_combinations + _y_log(hits, mean) + _y_log(misses, 1.0 - mean)

    def variance(self, mean: FloatArray, size: FloatArray) -> FloatArray:
        return mean * (1.0 - mean) / size

    def unseen(self, y: FloatArray, mean: FloatArray, size: FloatArray) -> FloatArray:
        return size * np.where(y == 0.0, mean, np.where(y == 1.0, 1.0 - mean, np.inf))

    def guess(self, y: FloatArray, size: FloatArray) -> FloatArray:
        share = (size * y + 1.0) / (size + 2.0)
        return np.sqrt(share * (1.0 - share) / size)

    def draw(self, mean: FloatArray, size: FloatArray, rng: np.random.Generator) -> FloatArray:
        return rng.binomial(size.astype(np.int64), np.clip(mean, 0.0, 1.0)) / size

    def quantile(self, probability: float, mean: FloatArray, size: FloatArray) -> FloatArray:
        from scipy.stats import binom

        return binom.ppf(probability, size, mean) / size


Law = PoissonLaw | BinomialLaw
"""Functions of y and m, which broadcast with `size`; nan where m is no mean, and the density of
what cannot be is -inf.
"""
POISSON, BINOMIAL = PoissonLaw(), BinomialLaw()


@dataclass(frozen=True, eq=False)
class Counted:
    """How the y of a run were counted.

    trials : (n_obs,), 1 where the law has none.  seen : (n_obs,) y as it was observed.
    what : is counted.
    bins : (n_obs, 2) edges of the bins, None where a count belongs to one x.
    single : whether the likelihood uses the time of every event, and y are for figures and tests.
    """

    law: Law
    trials: FloatArray
    seen: FloatArray
    what: str = "y"
    bins: FloatArray | None = None

    single = False


def deviance_residual(law: Law, y: FloatArray, mean: FloatArray, size: FloatArray) -> FloatArray:
    """r with r^2/2 = log p(y | y) - log p(y | m), signed as y - m: least squares on it are the
    maximum of the likelihood.
    """
    with np.errstate(all="ignore"):
        variance = law.variance(mean, size)
        close = (y - mean) ** 2 / variance
        # there the difference of two logarithms is rounding
        small = np.abs(y - mean) < 1e-5 * variance * size
        best = np.clip(y, 0.0, law.ceiling)  # y may be beyond it by rounding
        deviance = 2.0 * (law.log_density(y, best, size) - law.log_density(y, mean, size))
        return np.sign(y - mean) * np.sqrt(np.where(small, close, np.maximum(deviance, 0.0)))


def _y_log(y: FloatArray, mean: FloatArray) -> FloatArray:
    """y log(m), 0 for y = 0; nan for m < 0."""
    with np.errstate(all="ignore"):
        return np.where(mean < 0.0, np.nan, np.where(y > 0.0, y * np.log(mean), 0.0))
