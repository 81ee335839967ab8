"""A deviation of unknown size and length beside the noise: a mixture of normal distributions that share a few diagonalisations.

    C_k = s^2 C0 + a^2 K_l,    k = (l, s, a)        C0: stated covariance of the readings, K_l: what a deviation of unit amplitude does to them

`diagonalise` makes the grid: with C0 = W W^T and W^-1 K_l W^-T = V Lambda V^T each length needs one decomposition, and every amplitude and
noise scale after that is a vector, s^2 + a^2 Lambda.  `estim.deviation.linearised` says how probable each is, `estim.deviation.mixture` keeps
what matters and evaluates draws.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from estim.arrays import FloatArray
from estim.common import InputError
from estim.deviation.grid import Grid


@dataclass(frozen=True, eq=False)
class Shape:
    """One kind and length of deviation, for unit amplitude, and its log prior probability.

    kind : a word for it ("force", "deviation", "time").  length : its correlation length, in the unit of its own axis.
    factor : (n_obs, n_cause) X, covariance X X^T in the observations: what independent causes of unit size do to them.
    """

    kind: str
    length: float
    factor: FloatArray
    log_prior: float

    @property
    def covariance(self) -> FloatArray:
        """(n_obs, n_obs)."""
        return np.asarray(self.factor @ self.factor.T)

    def times(self, scale: float) -> Shape:
        """The shape whose unit amplitude is `scale`."""
        return replace(self, factor=scale * self.factor)


@dataclass(frozen=True, eq=False)
class Family:
    """The components of one shape, diagonal in one basis of the whitened observations: variances scale^2 + amplitude^2 spectrum.

    basis : (n_obs, n_dir) orthonormal columns; outside them the variance is scale^2 alone.  spectrum : (n_dir,).
    amplitude, scale, log_prior : (n_component,).
    """

    kind: str
    length: float
    basis: FloatArray
    spectrum: FloatArray
    amplitude: FloatArray
    scale: FloatArray
    log_prior: FloatArray

    def variances(self) -> FloatArray:
        """(n_component, n_dir)."""
        return np.square(self.scale)[:, None] + np.square(self.amplitude)[:, None] * self.spectrum

    def chosen(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> Family:
        """The family with some of its components alone."""
        return Family(self.kind, self.length, self.basis, self.spectrum, self.amplitude[keep], self.scale[keep], self.log_prior[keep])


@dataclass(frozen=True, eq=False)
class Deviation:
    """The grid of components of one run, or of several that are stacked.

    whitener : (n_obs,) or (n_obs, n_obs), z = r * whitener or r @ whitener has unit covariance under C0, in the order of the observations.
    log_volume : log of the determinant of C0, halved.  families : one for each shape.
    """

    whitener: FloatArray
    log_volume: float
    families: tuple[Family, ...]

    @property
    def n_obs(self) -> int:
        return self.whitener.shape[0]

    @cached_property
    def _apart(self) -> tuple[slice, ...]:
        """Stretches of the observations that a whitener (n_obs, n_obs) does not mix: the runs, where several are stacked."""
        place, mixed = np.arange(self.n_obs), self.whitener != 0.0
        last = self.n_obs - 1 - np.argmax((mixed | mixed.T)[:, ::-1], axis=1)
        ends = np.flatnonzero(np.maximum.accumulate(np.maximum(last, place)) == place) + 1
        return tuple(slice(start, end) for start, end in zip([0, *ends[:-1].tolist()], ends.tolist(), strict=True))

    def whiten(self, rows: FloatArray) -> FloatArray:
        """Rows (..., n_obs) of observations in units of the stated noise, without its correlation."""
        if self.whitener.ndim == 1:
            return rows * self.whitener
        return np.concatenate([rows[..., part] @ self.whitener[part, part] for part in self._apart], axis=-1)

    def turned_back(self, rows: FloatArray) -> FloatArray:
        """Rows (..., n_obs) times W^-1: what is a slope in whitened observations as a slope in the observations."""
        return rows * self.whitener if self.whitener.ndim == 1 else rows @ self.whitener.T

    def unwhiten(self, covariance: FloatArray) -> FloatArray:
        """A whitened covariance (n_obs, n_obs) in the observations, W C W^T."""
        if self.whitener.ndim == 1:
            return np.asarray(covariance / self.whitener / self.whitener[:, None])
        half = solve_triangular(self.whitener.T, covariance, lower=True)
        return np.asarray(solve_triangular(self.whitener.T, half.T, lower=True))

    def column(self, name: str) -> FloatArray:
        """(n_component,) `amplitude`, `scale` or `log_prior` of all components in the order of the families."""
        return np.concatenate([getattr(family, name) for family in self.families])

    def lengths(self) -> FloatArray:
        """(n_component,) length of each component; nan where there is no deviation."""
        each = [np.where(f.amplitude > 0.0, f.length, np.nan) for f in self.families]
        return np.concatenate(each)


def diagonalise(base: FloatArray, shapes: tuple[Shape, ...], grid: Grid) -> Deviation:
    """The components for a stated covariance `base`, (n_obs,) variances or (n_obs, n_obs), both in the square of the unit of the readings.

    Components without a deviation are the same for every shape and stand in the first family alone.
    Raises InputError where `base` is not positive definite, or where there is no shape.
    """
    if not shapes:
        raise InputError("must name at least one shape of deviation", field="shapes")
    base = np.asarray(base, dtype=float)
    whitener, log_volume = _whitening(base)
    amplitude, scale = (values.ravel() for values in np.meshgrid(grid.amplitudes, grid.scales, indexing="ij"))
    log_prior = np.add.outer(grid.log_amplitudes, grid.log_scales).ravel()
    families = []
    for i, shape in enumerate(shapes):
        seen = shape.factor * whitener[:, None] if whitener.ndim == 1 else whitener.T @ shape.factor
        spectrum, basis = _principal(seen)
        held = Family(shape.kind, shape.length, basis, spectrum, amplitude, scale, log_prior + shape.log_prior * (amplitude > 0.0))
        families.append(held if i == 0 else held.chosen(amplitude > 0.0))
    return Deviation(whitener, log_volume, tuple(families))


def _whitening(base: FloatArray) -> tuple[FloatArray, float]:
    if base.ndim == 1:
        if not np.all(base > 0.0):
            raise InputError("must be > 0", field="variance", value=float(np.min(base)))
        return 1.0 / np.sqrt(base), 0.5 * float(np.sum(np.log(base)))
    try:
        lower = np.linalg.cholesky(base)
    except np.linalg.LinAlgError:
        raise InputError("must be positive definite", field="covariance") from None
    whitener = solve_triangular(lower, np.eye(base.shape[0]), lower=True).T
    return np.ascontiguousarray(whitener), float(np.sum(np.log(np.diag(lower))))


def _principal(factor: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (n_dir,) and eigenvectors (n_obs, n_dir) of X X^T, those of value 0 left out where X has fewer columns than rows."""
    if factor.shape[1] < factor.shape[0]:
        basis, root, _ = np.linalg.svd(factor, full_matrices=False)
        return np.square(root), basis
    spectrum, basis = np.linalg.eigh(factor @ factor.T)
    return np.maximum(spectrum, 0.0), basis
