"""The likelihood of independent points with exact abscissas and robust tails: a sum over points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, Named
from estim.problem.likelihood import Ends, Likelihood, Points
from estim.problem.noise_variance import NoiseVariance
from estim.problem.tails import Tails, score_information
from estim.problem.whitened_residuals import Linear


@dataclass(frozen=True, eq=False)
class RobustErrors(Likelihood):
    """Points with independent errors of variance (sigma^2 + step^2/12) weight + scatter^2; weight :
    (n_obs,).  tails : of y - f over its root.
    """

    points: Points
    size: NoiseVariance
    weight: FloatArray
    tails: Tails

    def pointwise(self, named: Named) -> FloatArray:
        log_variance = np.log(self.size.variance(self.weight, named))
        return self.tails.log_density(self.standardised(named), named) - 0.5 * log_variance

    def standardised(self, named: Named) -> FloatArray:
        return (self.y - self.points.value(named)) / np.sqrt(self.size.variance(self.weight, named))

    def size_residuals(self, named: Named) -> FloatArray:
        return self.standardised(named) if self.tails.robust else self.residuals(named)

    def residuals(self, named: Named) -> FloatArray:
        return self.tails.deviance_residual(self.standardised(named), named)[0]

    def outlier_probability(self, named: Named) -> FloatArray:
        return self.tails.outlier_probability(self.standardised(named), named)

    def scoring(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        residuals, slopes = self.tails.deviance_residual(self.standardised(named)[0], named)
        return slopes[:, None] * self._slopes(named, names), residuals

    def information_root(self, named: Named, names: Sequence[str]) -> FloatArray:
        return np.sqrt(self.tails.information(named)[0]) * self._slopes(named, names)

    def information(self, named: Named, names: Sequence[str], ends: Ends) -> FloatArray:
        root, about_scale = self.information_root(named, names), self.tails.information(named)[1]
        total = root.T @ root + 0.5 * about_scale * self.size.information(self.weight, named, names)
        for name in self.tails.parameters:
            if name in ends:
                total[names.index(name), names.index(name)] += self.y.size * score_information(
                    self.tails, named, ends[name]
                )
        return total

    def whitened(self, named: Named, names: Sequence[str]) -> Linear:
        z = self.standardised(named)[0]
        return Linear(self.tails.normal_score(z, named), -self._slopes(named, names))

    def sd(self, named: Named) -> FloatArray:
        return np.sqrt(self.size.variance(self.weight, named)[0])

    def _slopes(self, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_obs, n_par) derivatives of `standardised` in the parameters of the curve."""
        return -self.points.gradient(named, names) / self.sd(named)[:, None]
