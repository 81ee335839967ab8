"""The likelihood of normal errors with a covariance matrix C = (sigma^2 + step^2/12) C0 + scatter^2 I, by one diagonalisation of C0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.problem.likelihood import Ends, NormalErrors, Points, n_draws
from estim.problem.roots import Dense, Root
from estim.problem.size import Named, Size
from estim.problem.tails import GAUSSIAN
from estim.problem.whitened import Linear as Linear


@dataclass(frozen=True, eq=False)
class CorrelatedErrors:
    """Points whose C0 = basis diag(spectrum) basis^T.

    basis : (n_obs, n_obs) orthonormal columns.  spectrum : (n_obs,).  shift : (n_obs,) mean of the errors, unit of y.
    """

    points: Points
    size: Size
    basis: FloatArray
    spectrum: FloatArray
    shift: FloatArray

    creeps = False

    @property
    def y(self) -> FloatArray:
        return np.asarray(self.points.y - self.shift)

    @property
    def normal(self) -> NormalErrors:
        return self

    def log_likelihood(self, named: Named) -> FloatArray:
        variance = self.size.variance(self.spectrum, named)
        return np.asarray(np.sum(GAUSSIAN.log_density(self._rotated(named) / np.sqrt(variance), named) - 0.5 * np.log(variance), axis=1))

    def pointwise(self, named: Named) -> FloatArray:
        """Normal with mean y_i - [C^-1 r]_i/[C^-1]_ii and variance 1/[C^-1]_ii.

        Buerkner, Gabry, Vehtari, Comput. Stat. 36 (2020) 1243, eq. 8.
        """
        precise = 1.0 / self.size.variance(self.spectrum, named)
        rotated = self._rotated(named)
        inverse = np.broadcast_to(precise, rotated.shape) @ (self.basis**2).T  # diagonal of C^-1
        deviation = (rotated * precise) @ self.basis.T / np.sqrt(inverse)
        return np.asarray(GAUSSIAN.log_density(deviation, named) + 0.5 * np.log(inverse))

    def standardised(self, named: Named) -> FloatArray:
        return np.asarray(self._rotated(named) / np.sqrt(self.size.variance(self.spectrum, named)))

    def residuals(self, named: Named) -> FloatArray:
        return self.standardised(named)

    def size_residuals(self, named: Named) -> FloatArray:
        return self.standardised(named)

    def outlier_probability(self, named: Named) -> FloatArray:
        return np.zeros((n_draws(named), self.spectrum.size))

    def jacobian(self, named: Named, names: Sequence[str]) -> FloatArray:
        gradient = self.points.gradient(named, names)
        return -(gradient.T @ self.basis).T / np.sqrt(self._variance(named))[:, None]

    def scoring(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        return self.jacobian(named, names), np.broadcast_to(self.standardised(named), (1, self.spectrum.size))[0]

    def information_root(self, named: Named, names: Sequence[str]) -> FloatArray:
        return self.jacobian(named, names)

    def information(self, named: Named, names: Sequence[str], ends: Ends) -> FloatArray:
        root = self.jacobian(named, names)
        return np.asarray(root.T @ root + self.size.information(self.spectrum, named, names))

    def whitened(self, named: Named, names: Sequence[str]) -> Linear:
        """In the order of the points: L^-1 (y - f) with C = L L^T.  L^T is the triangle R of diag(V)^(1/2) basis^T = Q R."""
        from scipy.linalg import solve_triangular

        upper: FloatArray = np.asarray(np.linalg.qr(np.sqrt(self._variance(named))[:, None] * self.basis.T, mode="r"))
        upper = upper * np.where(np.diag(upper) < 0.0, -1.0, 1.0)[:, None]
        raw = self.y - np.broadcast_to(self.points.value(named), (1, self.spectrum.size))[0]
        both = solve_triangular(upper, np.column_stack([raw, self.points.gradient(named, names)]), trans="T")
        return Linear(both[:, 0], both[:, 1:])

    def sd(self, named: Named) -> FloatArray:
        return np.asarray(np.sqrt(np.einsum("ij,ij,j->i", self.basis, self.basis, self._variance(named))))

    def squared_size(self, vector: FloatArray, named: Named) -> float:
        return float(np.sum((vector @ self.basis) ** 2 / self._variance(named)))

    def root(self, named: Named) -> Root:
        variance = self._variance(named)
        whole = (self.basis * variance) @ self.basis.T
        try:
            return Dense.of(whole)
        except np.linalg.LinAlgError:  # no eigenvalue is known better
            return Dense.of(whole + 4.0 * np.finfo(float).eps * variance.size * np.max(variance) * np.eye(variance.size))

    def opened(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        n_draw, local = n_draws(named), self.points.curve.local(self.points.x, self.points.bind(named))
        variance = np.broadcast_to(self.size.variance(self.spectrum, named), (n_draw, self.spectrum.size))
        sd = np.sqrt(variance)
        jacobian = self.points.gradients(local, names, n_draw)
        for k in range(len(names)):
            jacobian[:, :, k] = (jacobian[:, :, k] @ self.basis) / sd
        spread = self.size.slopes(self.spectrum, named, names, n_draw) / variance[:, :, None]
        return ((self.y - local.value) @ self.basis) / sd, variance, jacobian, spread

    def _variance(self, named: Named) -> FloatArray:
        """(n_obs,) eigenvalues of C."""
        return np.asarray(np.broadcast_to(self.size.variance(self.spectrum, named), (1, self.spectrum.size))[0])

    def _rotated(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) residuals in the basis."""
        return np.asarray((self.y - self.points.value(named)) @ self.basis)
