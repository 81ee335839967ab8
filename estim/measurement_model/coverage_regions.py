"""Coverage regions of two outputs (JCGM 102): ellipses and rectangles, by the GUM and by Monte
Carlo.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from estim.arrays import FloatArray, all_finite, sds_of
from estim.distributions import chi2_quantile, normal_quantile
from estim.propagation import LinearResult, MonteCarloResult

_DEPENDENT = 1.0 - 1e-9  # of |r|: one output is a function of the other


@dataclass(frozen=True, eq=False)
class Region:
    """Coverage regions of outputs number `pair`, for the probability of the results.

    value, covariance : (2,), (2, 2) linear.   mean, drawn : of the draws.
    k_ellipse : ellipses are (y - centre)^T covariance^-1 (y - centre) <= k^2, by the GUM; k_drawn :
        by Monte Carlo.
    k_rectangle : rectangles are centre -/+ k u, by the GUM (Bonferroni: holds whatever the
        correlation); k_rectangle_drawn : by Monte Carlo.
    coverage : share of the draws in the ellipse of the GUM.
    """

    pair: tuple[int, int]
    probability: float
    value: FloatArray
    covariance: FloatArray
    mean: FloatArray
    drawn: FloatArray
    k_ellipse: float
    k_drawn: float
    k_rectangle: float
    k_rectangle_drawn: float
    coverage: float

    @property
    def correlation(self) -> tuple[float, float]:
        """Of the two outputs: linear, and of the draws."""
        linear, drawn = (
            float(c[0, 1] / np.sqrt(c[0, 0] * c[1, 1])) for c in (self.covariance, self.drawn)
        )
        return linear, drawn


def regions(linear: LinearResult, sampled: MonteCarloResult) -> tuple[Region, ...]:
    """A region for each pair of outputs with finite, not fully dependent draws; outputs (n_out,),
    n_out > 1.

    Ellipse: k^2 = quantile of chi-squared with 2 degrees of freedom, and the quantile of the draws'
    own distances (JCGM 102, 6.5, 7.7).  Rectangle: k = normal quantile at 1 - (1 - p)/4, and the
    quantile of the larger standardised distance (JCGM 102, 6.5, 7.7).
    """
    results = []
    p = sampled.probability
    for i, j in combinations(range(linear.value.size), 2):
        pair = [i, j]
        covariance, draws = linear.covariance[np.ix_(pair, pair)], sampled.draws[:, pair]
        if np.any(sampled.undefined[pair] > 0.0) or not all_finite(sampled.u[pair]):
            continue
        drawn, mean = np.cov(draws, rowvar=False), draws.mean(axis=0)
        if any(c[0, 1] ** 2 >= _DEPENDENT * c[0, 0] * c[1, 1] for c in (covariance, drawn)):
            continue
        standardised = np.max(np.abs(draws - mean) / sds_of(drawn), axis=1)
        k2 = float(chi2_quantile(p, 2))
        results.append(
            Region(
                (i, j),
                p,
                linear.value[pair],
                covariance,
                mean,
                drawn,
                k2**0.5,
                float(np.quantile(_squares(draws, mean, drawn), p)) ** 0.5,
                float(normal_quantile(1.0 - 0.25 * (1.0 - p))),
                float(np.quantile(standardised, p)),
                float(np.mean(_squares(draws, linear.value[pair], covariance) <= k2)),
            )
        )
    return tuple(results)


def _squares(draws: FloatArray, centre: FloatArray, covariance: FloatArray) -> FloatArray:
    offset = draws - centre
    return np.sum(offset @ np.linalg.inv(covariance) * offset, axis=1)


def ellipse(centre: FloatArray, covariance: FloatArray, k: float) -> FloatArray:
    """(2, 200) points on the ellipse (y - centre)^T covariance^-1 (y - centre) = k^2."""
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return centre[:, None] + k * np.linalg.cholesky(covariance) @ circle
