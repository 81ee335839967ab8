"""The likelihood of independent points with exact abscissas, normal or with heavy tails: a sum over points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.problem.likelihood import Ends, NormalErrors, Points, n_draws
from estim.problem.roots import Root, root_of
from estim.problem.size import Named, Size
from estim.problem.tails import Tails, score_information
from estim.problem.whitened import Linear


@dataclass(frozen=True, eq=False)
class PointErrors:
    """Points with independent errors of variance (sigma^2 + step^2/12) weight + scatter^2; weight : (n_obs,).  tails : of y - f over its root."""

    points: Points
    size: Size
    weight: FloatArray
    tails: Tails

    creeps = False

    @property
    def y(self) -> FloatArray:
        return self.points.y

    @property
    def normal(self) -> NormalErrors | None:
        return None if self.tails.robust else NormalPoints(self.points, self.size, self.weight)

    def log_likelihood(self, named: Named) -> FloatArray:
        return np.asarray(np.sum(self.pointwise(named), axis=1))

    def pointwise(self, named: Named) -> FloatArray:
        variance = self.size.variance(self.weight, named)
        z = (self.y - self.points.value(named)) / np.sqrt(variance)
        return np.asarray(self.tails.log_density(z, named) - 0.5 * np.log(variance))

    def standardised(self, named: Named) -> FloatArray:
        return np.asarray((self.y - self.points.value(named)) / np.sqrt(self.size.variance(self.weight, named)))

    def residuals(self, named: Named) -> FloatArray:
        return self.tails.deviance_residual(self.standardised(named), named)[0]

    def size_residuals(self, named: Named) -> FloatArray:
        return self.residuals(named)

    def outlier_probability(self, named: Named) -> FloatArray:
        return self.tails.outlier_probability(self.standardised(named), named)

    def jacobian(self, named: Named, names: Sequence[str]) -> FloatArray:
        slopes = self._slopes(named, names)
        if not self.tails.robust:  # the residuals are the standardised ones
            return slopes
        z = np.broadcast_to(self.standardised(named), (1, self.y.size))[0]
        return np.asarray(self.tails.deviance_residual(z, named)[1][:, None] * slopes)

    def scoring(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        return self.jacobian(named, names), np.broadcast_to(self.residuals(named), (1, self.y.size))[0]

    def information_root(self, named: Named, names: Sequence[str]) -> FloatArray:
        return np.asarray(np.sqrt(self.tails.information(named)[0]) * self._slopes(named, names))

    def information(self, named: Named, names: Sequence[str], ends: Ends) -> FloatArray:
        root, about_scale = self.information_root(named, names), self.tails.information(named)[1]
        total = root.T @ root + 0.5 * about_scale * self.size.information(self.weight, named, names)
        for name in self.tails.parameters:
            if name in ends:
                total[names.index(name), names.index(name)] += self.y.size * score_information(self.tails, named, ends[name])
        return np.asarray(total)

    def whitened(self, named: Named, names: Sequence[str]) -> Linear:
        z = np.broadcast_to(self.standardised(named), (1, self.y.size))[0]
        return Linear(self.tails.normal_score(z, named), -self._slopes(named, names))

    def sd(self, named: Named) -> FloatArray:
        return np.asarray(np.sqrt(np.broadcast_to(self.size.variance(self.weight, named), (1, self.y.size))[0]))

    def squared_size(self, vector: FloatArray, named: Named) -> float:
        return float(np.sum((vector / self.sd(named)) ** 2))

    def _slopes(self, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_obs, n_par) derivatives of `standardised` in the parameters of the curve."""
        return -self.points.gradient(named, names) / self.sd(named)[:, None]


@dataclass(frozen=True, eq=False)
class NormalPoints:
    """The same with normal errors: their covariance is diagonal as it is."""

    points: Points
    size: Size
    weight: FloatArray

    def root(self, named: Named) -> Root:
        return root_of(np.broadcast_to(self.size.variance(self.weight, named), (1, self.weight.size))[0])

    def opened(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        n_draw, local = n_draws(named), self.points.curve.local(self.points.x, self.points.bind(named))
        variance = np.broadcast_to(self.size.variance(self.weight, named), (n_draw, self.weight.size))
        sd = np.sqrt(variance)
        jacobian = self.points.gradients(local, names, n_draw) / sd[:, :, None]
        spread = self.size.slopes(self.weight, named, names, n_draw) / variance[:, :, None]
        return (self.points.y - local.value) / sd, variance, jacobian, spread
