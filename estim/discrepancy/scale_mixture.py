"""A deviation of unknown size and length beside the noise: a mixture of normal distributions that
share a few diagonalisations.

    C_k = s^2 C0 + a^2 K_l,    k = (l, s, a)

    C0     stated covariance of the readings
    K_l    what a deviation of unit amplitude does to them

`diagonalise` makes the grid: with C0 = W W^T and W^-1 K_l W^-T = V Lambda V^T each length needs one
decomposition, and every amplitude and noise scale after that is a vector, s^2 + a^2 Lambda.
`estim.discrepancy.linearised` gives the probability of each, `estim.discrepancy.mixture_likelihood`
keeps what matters and evaluates draws.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estim.arrays import BoolArray, FloatArray, IntArray
from estim.discrepancy.grid import Grid
from estim.problem import Root


@dataclass(frozen=True, eq=False)
class Shape:
    """One kind and length of deviation, for unit amplitude, and its log prior probability.

    kind : a word for it ("force", "deviation", "time").
    length : its correlation length, in the unit of its own axis.
    factor : (n_obs, n_cause) X, covariance X X^T in the observations: what independent causes of
        unit size do to them.
    """

    kind: str
    length: float
    factor: FloatArray
    log_prior: float

    @property
    def covariance(self) -> FloatArray:
        """(n_obs, n_obs)."""
        return self.factor @ self.factor.T

    def times(self, scale: float) -> Shape:
        """The shape whose unit amplitude is `scale`."""
        return replace(self, factor=scale * self.factor)


@dataclass(frozen=True, eq=False)
class Family:
    """The components of one shape, diagonal in one basis of the whitened observations: variances
    scale^2 + amplitude^2 spectrum.

    basis : (n_obs, n_dir) orthonormal columns; outside them the variance is scale^2 alone.
    spectrum : (n_dir,).
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

    def chosen(self, keep: BoolArray | IntArray) -> Family:
        """The family with some of its components alone."""
        return replace(
            self,
            amplitude=self.amplitude[keep],
            scale=self.scale[keep],
            log_prior=self.log_prior[keep],
        )


@dataclass(frozen=True, eq=False)
class Deviation:
    """The grid of components of one run, or of several that are stacked.

    root : of C0; what it whitens has unit covariance under C0, in the order of the observations.
    families : one for each shape.
    """

    root: Root
    families: tuple[Family, ...]

    @property
    def n_obs(self) -> int:
        return self.root.n_obs

    def whiten(self, rows: FloatArray) -> FloatArray:
        """Rows (..., n_obs) of observations in units of the stated noise, without its
        correlation.
        """
        return self.root.whiten(rows)

    def turned_back(self, rows: FloatArray) -> FloatArray:
        """Rows (..., n_obs): what is a slope in whitened observations as a slope in the
        observations.
        """
        return self.root.turned_back(rows)

    def each(self, values: NDArray[Any]) -> Iterator[tuple[Family, NDArray[Any]]]:
        """Every family with its part of what all components have, `values` (n_component, ...)."""
        ends = np.cumsum([family.amplitude.size for family in self.families])
        return zip(self.families, np.split(values, ends[:-1]), strict=True)

    def column(self, name: str) -> FloatArray:
        """(n_component,) `amplitude`, `scale` or `log_prior` of all components in the order of the
        families.
        """
        return np.concatenate([getattr(family, name) for family in self.families])

    def lengths(self) -> FloatArray:
        """(n_component,) length of each component; nan where there is no deviation."""
        each = [np.where(f.amplitude > 0.0, f.length, np.nan) for f in self.families]
        return np.concatenate(each)


def diagonalise(root: Root, shapes: tuple[Shape, ...], grid: Grid) -> Deviation:
    """The components for the root of a stated covariance.

    Components without a deviation are the same for every shape and stand in the first family alone.
    """
    amplitude, scale = (
        values.ravel() for values in np.meshgrid(grid.amplitudes, grid.scales, indexing="ij")
    )
    log_prior = np.add.outer(grid.log_amplitudes, grid.log_scales).ravel()
    families = []
    for i, shape in enumerate(shapes):
        spectrum, basis = _principal(root.whiten(shape.factor.T).T)
        family = Family(
            shape.kind,
            shape.length,
            basis,
            spectrum,
            amplitude,
            scale,
            log_prior + shape.log_prior * (amplitude > 0.0),
        )
        families.append(family if i == 0 else family.chosen(amplitude > 0.0))
    return Deviation(root, tuple(families))


def _principal(factor: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues (n_dir,) and eigenvectors (n_obs, n_dir) of X X^T, those of value 0 left out
    where X has fewer columns than rows.
    """
    if factor.shape[1] < factor.shape[0]:
        basis, root, _ = np.linalg.svd(factor, full_matrices=False)
        return np.square(root), basis
    spectrum, basis = np.linalg.eigh(factor @ factor.T)
    return np.maximum(spectrum, 0.0), basis
