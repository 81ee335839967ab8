"""The dark uncertainty tau: the standard deviation of errors that no stated uncertainty includes.

x_i ~ N(mu, u_i^2 + tau^2), independent.  Three estimates of it; w_i = 1/(u_i^2 + tau^2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import optimize

from estim.arrays import FloatArray
from estim.distributions import normal_below


def weighted(x: FloatArray, u: FloatArray, tau: float = 0.0) -> tuple[float, float, float]:
    """Weighted mean, its standard uncertainty 1/sqrt(sum w), and chi^2 = sum w (x - mean)^2."""
    w = 1.0 / (u**2 + tau**2)
    value = float(w @ x / w.sum())
    return value, float(w.sum() ** -0.5), float(w @ (x - value) ** 2)


def der_simonian_laird(x: FloatArray, u: FloatArray) -> float:
    """tau by moments: tau^2 = max(0, (chi^2 - (n - 1))/(sum w - sum w^2/sum w)), w = 1/u^2.
    Source: DerSimonian and Laird 1986, Controlled Clinical Trials 7, 177, eq. 8.
    """
    w = 1.0 / u**2
    excess = weighted(x, u)[2] - (x.size - 1)
    # sum w - sum w^2/sum w, of which a value far better than all others would leave nothing
    pairs = 2.0 * w[1:] @ np.cumsum(w)[:-1] / w.sum()
    return float(np.sqrt(max(excess, 0.0) / pairs))


def mandel_paule(x: FloatArray, u: FloatArray) -> float:
    """tau with chi^2(tau) = n - 1, or 0 where chi^2(0) is smaller.  Source: Paule and Mandel 1982,
    J. Res. NBS 87, 377.
    """

    def excess(tau: float) -> float:
        return weighted(x, u, tau)[2] - (x.size - 1)

    if excess(0.0) <= 0.0:
        return 0.0
    # sum (x - mean)^2/(n - 1) <= ptp^2, and chi^2(tau) is at most that over tau^2 times n - 1
    return float(optimize.brentq(excess, 0.0, float(np.ptp(x)), xtol=1e-12 * float(np.ptp(x))))


@dataclass(frozen=True, eq=False)
class Hierarchical:
    """The posterior as a mixture over tau: p (n,) sums to 1, mu given tau is N(mean, sd^2)."""

    tau: FloatArray
    p: FloatArray
    mean: FloatArray
    sd: FloatArray

    def quantile(self, probability: float) -> float:
        """Of mu."""

        def excess(mu: float) -> float:
            return float(self.p @ normal_below((mu - self.mean) / self.sd)) - probability

        far = float(np.abs(self.mean).max() + 10.0 * self.sd.max())
        return float(optimize.brentq(excess, -far, far, xtol=1e-10 * float(self.sd.min())))

    def tau_quantile(self, probability: float) -> float:
        below = np.cumsum(self.p) - 0.5 * self.p  # half of a step's share lies below its middle
        return float(np.interp(probability, below, self.tau))


def hierarchical(x: FloatArray, u: FloatArray) -> Hierarchical:
    """The random-effects posterior with the reference prior, flat in mu and
    p(tau) ~ tau sqrt(sum 1/(u_i^2 + tau^2)^2).

    The prior has no scale of its own; the posterior is proper for n >= 2, and mu has a standard
    deviation for n >= 4.  Source: Bodnar, Link, Arendacka, Possolo and Elster 2017, Statistics in
    Medicine 36, 378, section 2 (Jeffreys' prior of tau).
    """
    low, high = 1e-5 * u.min(), 1e6 * (np.ptp(x) + u.max())
    # evenly in log(tau): enough for a thousand values
    tau = np.exp(np.linspace(np.log(low), np.log(high), 2000))
    w = 1.0 / (u**2 + tau[:, None] ** 2)
    total = w.sum(axis=1)
    mean = w @ x / total
    chi2 = np.sum(w * (x - mean[:, None]) ** 2, axis=1)
    # the second term: the prior's tau, and that of steps in log(tau)
    log_prior = 0.5 * np.log(np.sum(w**2, axis=1)) + 2.0 * np.log(tau)
    log_p = log_prior + 0.5 * np.log(w).sum(axis=1) - 0.5 * np.log(total) - 0.5 * chi2
    p = np.exp(log_p - log_p.max())
    return Hierarchical(tau, p / p.sum(), mean, total**-0.5)
