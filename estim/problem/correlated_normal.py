"""The likelihood of normal errors with a covariance C = (sigma^2 + step^2/12) C0 + scatter^2 I
(`estim.problem.noise_variance`).

With a linear map T of the points, made once, T C T^T is diagonal for all values of the noise
parameters: one likelihood serves all forms of C0.

- `Diagonal`: independent points; T is the identity.
- `Turned`: any other C0; T are its eigenvectors.
- `Rooted`: C is known but for a factor, by its triangular root (`estim.problem.roots`: dense, in
  bands, with a few causes beside); T is its inverse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array

from estim.arrays import FloatArray, Named
from estim.distributions import normal_log_density
from estim.problem.differences import covariance_in_bands, used_columns
from estim.problem.likelihood import Ends, Likelihood, Points
from estim.problem.noise_variance import NoiseVariance, Scale
from estim.problem.roots import DENSE, BandedFactor, Dense, Root
from estim.problem.whitened_residuals import Linear

KNOWN = NoiseVariance(Scale(1.0))


@dataclass(frozen=True, eq=False)
class Diagonal:
    """Independent points.  spectrum : (n_obs,) V for a unit sigma without scatter.

    log_volume : minus the logarithm of the determinant of T.
    """

    spectrum: FloatArray
    log_volume = 0.0

    def turned(self, rows: FloatArray) -> FloatArray:
        """T r of each row r."""
        return rows

    def turned_back(self, rows: FloatArray) -> FloatArray:
        """T^T r of each row r."""
        return rows

    def variances(self, diagonal: FloatArray) -> FloatArray:
        """(n_obs,) the diagonal of C for V (n_obs,)."""
        return diagonal

    def precisions(self, diagonal: FloatArray) -> FloatArray:
        """(n, n_obs) the diagonal of C^-1 for V (n, n_obs)."""
        return 1.0 / diagonal

    def root(self, diagonal: FloatArray) -> Root:
        """The triangular root of C for V (n_obs,)."""
        return BandedFactor.of(diagonal[None, :])


@dataclass(frozen=True, eq=False)
class Turned:
    """C0 = basis diag(spectrum) basis^T; basis : (n_obs, n_obs) orthonormal columns."""

    basis: FloatArray
    spectrum: FloatArray
    log_volume = 0.0

    @classmethod
    def of(cls, covariance: FloatArray) -> Turned:
        """Of C0.  No eigenvalue is known better than rounding: where one is huge, others come out
        below 0.
        """
        spectrum, basis = np.linalg.eigh(covariance)
        return cls(basis, np.maximum(spectrum, np.finfo(float).eps * spectrum.size * spectrum[-1]))

    def turned(self, rows: FloatArray) -> FloatArray:
        return rows @ self.basis

    def turned_back(self, rows: FloatArray) -> FloatArray:
        return rows @ self.basis.T

    def variances(self, diagonal: FloatArray) -> FloatArray:
        return np.square(self.basis) @ diagonal

    def precisions(self, diagonal: FloatArray) -> FloatArray:
        return (1.0 / diagonal) @ np.square(self.basis).T

    def root(self, diagonal: FloatArray) -> Root:
        """L^T is the triangle R of diag(V)^(1/2) basis^T = Q R."""
        upper: FloatArray = np.asarray(
            np.linalg.qr(np.sqrt(diagonal)[:, None] * self.basis.T, mode="r")
        )
        return Dense((upper * np.where(np.diag(upper) < 0.0, -1.0, 1.0)[:, None]).T)


@dataclass(frozen=True, eq=False)
class Rooted:
    """C0 = L L^T for the root L, and no scatter beside it: V is the same for all."""

    triangle: Root

    @property
    def spectrum(self) -> FloatArray:
        return np.ones(self.triangle.n_obs)

    @property
    def log_volume(self) -> float:
        return self.triangle.log_volume

    def turned(self, rows: FloatArray) -> FloatArray:
        return self.triangle.whiten(rows)

    def turned_back(self, rows: FloatArray) -> FloatArray:
        return self.triangle.turned_back(rows)

    def variances(self, diagonal: FloatArray) -> FloatArray:
        return self.triangle.variances * diagonal

    def precisions(self, diagonal: FloatArray) -> FloatArray:
        return self.triangle.precisions / diagonal

    def root(self, diagonal: FloatArray) -> Root:
        return self.triangle.times(float(np.sqrt(diagonal[0])))


Form = Diagonal | Turned | Rooted
"""C0 and its map T, rows are (..., n_obs); V : (..., n_obs) the diagonal of T C T^T."""


@dataclass(frozen=True, eq=False)
class GaussianErrors(Likelihood):
    """Points with normal errors of mean `shift` (n_obs,) and of a size and form of covariance."""

    points: Points
    size: NoiseVariance
    form: Form
    shift: FloatArray

    @classmethod
    def rooted(cls, points: Points, root: Root, shift: FloatArray) -> GaussianErrors:
        """Of a covariance that is known."""
        return cls(points, KNOWN, Rooted(root), shift)

    @classmethod
    def of_readings(
        cls,
        points: Points,
        size: NoiseVariance,
        matrix: csr_array,
        shift: FloatArray,
        *,
        correlation: float = 0.0,
    ) -> GaussianErrors:
        """Of errors A e of the points, corr(e_i, e_j) = R_ij = correlation^|i - j|, C0 = A R A^T:
        of many points in bands, never as a whole.
        """
        if points.x.size > DENSE and in_bands(size):
            return cls.in_bands(points, size, covariance_in_bands(matrix, correlation), shift)
        used = used_columns(matrix)
        lever = matrix[:, used].toarray()
        middle = (
            correlation ** np.abs(np.subtract.outer(used, used)) @ lever.T
            if correlation
            else lever.T
        )
        return cls(points, size, Turned.of(lever @ middle), shift)

    @classmethod
    def in_bands(
        cls, points: Points, size: NoiseVariance, bands: FloatArray, shift: FloatArray
    ) -> GaussianErrors:
        """Of C0 in bands (n_band + 1, n_obs), where a covariance of this size is `in_bands`."""
        if size.parameters:
            return cls(points, size, Rooted(BandedFactor.of(bands)), shift)
        total = float(size.reading_variance({})) * bands
        total[0] += np.square(size.scatter.at({}))
        return cls.rooted(points, BandedFactor.of(total), shift)

    @cached_property
    def y(self) -> FloatArray:
        return self.points.y - self.shift

    @property
    def normal(self) -> GaussianErrors:
        return self

    def log_likelihood(self, named: Named) -> FloatArray:
        z, variance = self.residuals(named), self._diagonal(named)
        return (
            -0.5 * np.einsum("ij,ij->i", z, z)
            - 0.5 * np.sum(np.log(2.0 * np.pi * variance), axis=1)
            - self.form.log_volume
        )

    def pointwise(self, named: Named) -> FloatArray:
        """Normal with mean y_i - [C^-1 r]_i/[C^-1]_ii and variance 1/[C^-1]_ii.

        Buerkner, Gabry, Vehtari, Comput. Stat. 36 (2020) 1243, eq. 8.
        """
        variance = self._diagonal(named)
        inverse = self.form.precisions(variance)
        deviation = self.form.turned_back(self._turned(named) / variance) / np.sqrt(inverse)
        return normal_log_density(deviation) + 0.5 * np.log(inverse)

    def residuals(self, named: Named) -> FloatArray:
        return self._turned(named) / self._sd(named)

    def information_root(self, named: Named, names: Sequence[str]) -> FloatArray:
        return -(self.form.turned(self.points.gradient(named, names).T) / self._sd(named)).T

    def information(self, named: Named, names: Sequence[str], ends: Ends) -> FloatArray:
        root = self.information_root(named, names)
        return root.T @ root + self.size.information(self.form.spectrum, named, names)

    def whitened(self, named: Named, names: Sequence[str]) -> Linear:
        """In the order of the points."""
        root = self.root(named)
        raw = self.y - self.points.value(named)[0]
        return Linear(root.whiten(raw), root.whiten(self.points.gradient(named, names).T).T)

    def sd(self, named: Named) -> FloatArray:
        return np.sqrt(self.form.variances(self._diagonal(named)[0]))

    def squared_size(self, vector: FloatArray, named: Named) -> float:
        return float(np.sum(self.form.turned(vector) ** 2 / self._diagonal(named)[0]))

    def root(self, named: Named) -> Root:
        """The triangular root of C, in the order of the points."""
        return self.form.root(self._diagonal(named)[0])

    def log_variances(self, named: Named) -> FloatArray:
        """(n, n_obs) logarithms of the squared units of `residuals`, n the number of draws or 1;
        their sum is the logarithm of the determinant of C up to a constant.
        """
        return np.log(self._diagonal(named))

    def _diagonal(self, named: Named) -> FloatArray:
        """(n, n_obs) V, n the number of draws or 1."""
        return self.size.variance(self.form.spectrum, named)

    def _sd(self, named: Named) -> FloatArray:
        """(n, n_obs) square roots of V."""
        return np.sqrt(self._diagonal(named)) if self.size.parameters else self._known_sd

    @cached_property
    def _known_sd(self) -> FloatArray:
        """(1, n_obs) those of noise without unknowns."""
        return np.sqrt(self._diagonal({}))

    def _turned(self, named: Named) -> FloatArray:
        """(n, n_obs) T (y - f)."""
        return self.form.turned(self.y - self.points.value(named))


def in_bands(size: NoiseVariance) -> bool:
    """Whether a covariance of this size stays the same but for a factor."""
    return not size.parameters or (size.scatter.parameter is None and size.scatter.value == 0.0)
