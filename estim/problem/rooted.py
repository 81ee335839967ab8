"""The likelihood of normal errors whose covariance is known but for a factor, C = variance L L^T, by a triangular root: many points in bands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.problem.besides import DENSE as DENSE
from estim.problem.besides import beside as beside
from estim.problem.besides import with_columns as with_columns
from estim.problem.differences import Differences as Differences
from estim.problem.likelihood import Ends, NormalErrors, Points, n_draws
from estim.problem.roots import Band as Band
from estim.problem.roots import Root as Root
from estim.problem.roots import covariance_of as covariance_of
from estim.problem.roots import root_of as root_of
from estim.problem.roots import stacked_root as stacked_root
from estim.problem.size import Named, Scale, Size
from estim.problem.tails import GAUSSIAN
from estim.problem.whitened import Linear

KNOWN = Size(Scale(1.0))


def in_bands(size: Size) -> bool:
    """Whether a covariance of this size stays the same but for a factor."""
    return not size.parameters or (size.scatter.parameter is None and size.scatter.value == 0.0)


@dataclass(frozen=True, eq=False)
class RootErrors:
    """Points with C = (sigma^2 + step^2/12) L L^T, L the root `triangle`.  shift : (n_obs,) mean of the errors, unit of y."""

    points: Points
    size: Size
    triangle: Root
    shift: FloatArray

    creeps = False

    @classmethod
    def of_bands(cls, points: Points, size: Size, bands: FloatArray, shift: FloatArray) -> RootErrors:
        """Of C = (sigma^2 + step^2/12) C0 + scatter^2 I for C0 in bands, where `in_bands`."""
        if size.parameters:
            return cls(points, size, Band.of(bands), shift)
        whole = float(size.reading_variance({})) * bands
        whole[0] += np.square(np.asarray(size.scatter.at({})))
        return cls(points, KNOWN, Band.of(whole), shift)

    @property
    def y(self) -> FloatArray:
        return np.asarray(self.points.y - self.shift)

    @property
    def normal(self) -> NormalErrors:
        return self

    def root(self, named: Named) -> Root:
        return self.triangle.times(self._scale(named))

    def log_likelihood(self, named: Named) -> FloatArray:
        z, n = self.standardised(named), self.shift.size
        whole = np.log(np.sqrt(2.0 * np.pi) * np.sqrt(self.size.reading_variance(named)))
        logs = -0.5 * np.einsum("ij,ij->i", z, z) - self.triangle.log_volume - n * np.ravel(whole)
        return np.asarray(logs)

    def pointwise(self, named: Named) -> FloatArray:
        """As `CorrelatedErrors.pointwise`."""
        variance = self.size.reading_variance(named)
        inverse = self.triangle.precisions / variance
        deviation = self.triangle.turned_back(self._white(named)) / variance / np.sqrt(inverse)
        return np.asarray(GAUSSIAN.log_density(deviation, named) + 0.5 * np.log(inverse))

    def standardised(self, named: Named) -> FloatArray:
        return np.asarray(self._white(named) / np.sqrt(self.size.reading_variance(named)))

    def residuals(self, named: Named) -> FloatArray:
        return self.standardised(named)

    def size_residuals(self, named: Named) -> FloatArray:
        return self.standardised(named)

    def outlier_probability(self, named: Named) -> FloatArray:
        return np.zeros((n_draws(named), self.shift.size))

    def jacobian(self, named: Named, names: Sequence[str]) -> FloatArray:
        return np.asarray(-self.triangle.whiten(self.points.gradient(named, names).T).T / self._scale(named))

    def scoring(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        return self.jacobian(named, names), self.standardised(named)[0]

    def information_root(self, named: Named, names: Sequence[str]) -> FloatArray:
        return self.jacobian(named, names)

    def information(self, named: Named, names: Sequence[str], ends: Ends) -> FloatArray:
        root = self.jacobian(named, names)
        return np.asarray(root.T @ root + self.size.information(np.ones(self.shift.size), named, names))

    def whitened(self, named: Named, names: Sequence[str]) -> Linear:
        return Linear(self.standardised(named)[0], -self.jacobian(named, names))

    def sd(self, named: Named) -> FloatArray:
        return np.asarray(self._scale(named) * np.sqrt(self.triangle.variances))

    def squared_size(self, vector: FloatArray, named: Named) -> float:
        return float(np.sum(self.triangle.whiten(vector) ** 2)) / self._scale(named) ** 2

    def opened(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """In the basis of L, in which C is variance times the identity; the eigenvalues are those of variance (det L)^(2/n)."""
        n_draw, n = n_draws(named), self.shift.size
        local = self.points.curve.local(self.points.x, self.points.bind(named))
        sd = np.sqrt(np.broadcast_to(self.size.reading_variance(named), (n_draw, 1)))
        jacobian = self.points.gradients(local, names, n_draw)
        for k in range(len(names)):
            jacobian[:, :, k] = self.triangle.whiten(jacobian[:, :, k]) / sd
        variance = np.broadcast_to(sd**2 * np.exp(2.0 * self.triangle.log_volume / n), (n_draw, n))
        spread = self.size.slopes(np.ones(n), named, names, n_draw) / (sd**2)[:, :, None]
        return self.triangle.whiten(np.broadcast_to(self.y - local.value, (n_draw, n))) / sd, variance, jacobian, spread

    def _scale(self, named: Named) -> float:
        return float(np.sqrt(np.ravel(self.size.reading_variance(named))[0]))

    def _white(self, named: Named) -> FloatArray:
        return np.atleast_2d(self.triangle.whiten(np.atleast_2d(self.y - self.points.value(named))))
