"""What the density of a draw needs of each family of components, made once for all draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.discrepancy.scale_mixture import Family


@dataclass(frozen=True, eq=False)
class Weight:
    """How much more than at the fit a body resists in each draw, so that a force and an energy at
    release do less to its speed.

    ratio : (n_draw,) w, of inertia over weight to those of the fit.
    scale : of the half-normal prior of the amplitudes.
    n_start : energies at release, the first columns of H.  A prior of theirs is then one of what
        they do to the speed, narrower by w.
    """

    ratio: FloatArray
    scale: float
    n_start: int

    @property
    def excess(self) -> FloatArray:
        """(n_draw,) w^2 - 1."""
        return np.square(self.ratio) - 1.0


@dataclass(frozen=True, eq=False)
class Terms:
    """Constants of a family: log density = [(basis z)^2, |z|^2, 1] gain + |explained|^2/2.

    gain : (n_component, n_dir + 2).
    cross : (n_component, n_column, n_dir + n_column), of the part of z that H explains, cross
        [basis z, H z], in units of its own standard deviation.
    root : (n_component, n_column, n_column) R, with R x that part the estimate of the coefficients
        of H, of covariance R R^T.
    amplitude : (n_component,).
    """

    gain: FloatArray
    cross: FloatArray
    root: FloatArray
    amplitude: FloatArray

    def log_density(
        self, square: FloatArray, projected: FloatArray, along: FloatArray, weight: Weight | None
    ) -> FloatArray:
        """(n_component, n_draw) for |z|^2 (n_draw,), basis z (n_dir, n_draw) and H z (n_column,
        n_draw).  weight : of the draws, where it is not that of the fit.
        """
        of_basis, of_square, log_norm = np.split(self.gain, [-2, -1], axis=1)
        density = of_basis @ np.square(projected) + of_square * square + log_norm
        n_component, n_column = self.cross.shape[:2]
        rows = self.cross.reshape(n_component * n_column, self.cross.shape[2])
        explained = rows[:, : len(projected)] @ projected + rows[:, len(projected) :] @ along
        explained = explained.reshape(n_component, n_column, square.size)
        density += 0.5 * np.einsum("kqn,kqn->kn", explained, explained)
        if weight is None:
            return density
        n_start = min(weight.n_start, n_column)
        density -= 0.5 * np.outer(np.square(self.amplitude / weight.scale), weight.excess)
        density += np.outer((self.amplitude > 0.0) + n_start, np.log(weight.ratio))
        if n_start:
            density -= 0.5 * self._narrowed_starts(explained, weight.excess, n_start)
        return density

    def _narrowed_starts(
        self, explained: FloatArray, excess: FloatArray, n_start: int
    ) -> FloatArray:
        """Minus twice the logarithm of what N(b | 0, 1/w^2) in place of N(b | 0, 1) does for the
        energies b at release, but for w, whose estimates and variances the data give.
        """
        root = self.root[:, :n_start]
        narrowed = np.sum(root**2, axis=2)[:, :, None] * excess
        narrowed += 1.0
        estimate = root @ explained
        total = np.sum(np.divide(np.square(estimate, out=estimate), narrowed, out=estimate), axis=1)
        return np.log(np.prod(narrowed, axis=1)) + excess * total


def terms_of(family: Family, columns: FloatArray) -> Terms:
    """Of a family beside the columns H (n_obs, n_column), whitened."""
    n_dir, n_column = family.spectrum.size, columns.shape[1]
    inverse = 1.0 / np.square(family.scale)
    variance = family.variances()
    gain = 1.0 / variance - inverse[:, None]
    log_norm = (
        family.log_prior
        - 0.5 * np.sum(np.log(variance), axis=1)
        + 0.5 * (columns.shape[0] - n_dir) * np.log(inverse)
    )
    turned = family.basis.T @ columns
    information = (
        np.eye(n_column)
        + inverse[:, None, None] * (columns.T @ columns)
        + np.einsum("mi,km,mj->kij", turned, gain, turned)
    )
    lower = np.linalg.cholesky(information)
    log_norm -= np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
    # (n_component, n_column, n_column), b root has unit covariance
    root = np.linalg.inv(lower).transpose(0, 2, 1)
    cross = np.concatenate(
        [np.einsum("km,mi,kij->kjm", gain, turned, root), np.einsum("k,kij->kji", inverse, root)],
        axis=2,
    )
    return Terms(
        np.column_stack([-0.5 * gain, -0.5 * inverse, log_norm]), cross, root, family.amplitude
    )
