"""What the density of a draw needs of each family of components, made once for all draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.deviation.components import Family


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
        """(n_draw, 1) w^2 - 1."""
        return np.asarray(np.square(self.ratio)[:, None] - 1.0)


@dataclass(frozen=True, eq=False)
class Terms:
    """Constants of a family: log density = [(z basis)^2, |z|^2, 1] gain + |explained|^2/2.

    gain : (n_dir + 2, n_component).
    cross, cross_white : (n_dir, n_component * n_column), (n_column, n_component * n_column), with
        (z basis) cross + (z H) cross_white the part of z that H explains, in units of its own
        standard deviation.
    root : (n_component, n_column, n_column) R, with R^T x that part the estimate of the
        coefficients of H, of covariance R R^T.
    amplitude : (n_component,).
    """

    gain: FloatArray
    cross: FloatArray
    cross_white: FloatArray
    root: FloatArray
    amplitude: FloatArray

    def log_density(
        self, square: FloatArray, seen: FloatArray, along: FloatArray, weight: Weight | None = None
    ) -> FloatArray:
        """(n_draw, n_component) for |z|^2 (n_draw,), z basis (n_draw, n_dir) and z H (n_draw,
        n_column); weight : where it is not that of the fit.
        """
        columns = np.empty((square.size, len(self.gain)))
        np.square(seen, out=columns[:, :-2])
        columns[:, -2], columns[:, -1] = square, 1.0
        density = columns @ self.gain
        if along.shape[1]:
            explained = (seen @ self.cross + along @ self.cross_white).reshape(
                square.size, -1, along.shape[1]
            )
            density += 0.5 * np.einsum("ikq,ikq->ik", explained, explained)
            if weight is not None and weight.n_start:
                density += self._starts(explained, weight)
        if weight is not None:
            forced = np.log(weight.ratio)[:, None] - 0.5 * weight.excess * np.square(
                self.amplitude / weight.scale
            )
            density += np.where(self.amplitude > 0.0, forced, 0.0)
        return density

    def _starts(self, explained: FloatArray, weight: Weight) -> FloatArray:
        """What N(b | 0, 1/w^2) in place of N(b | 0, 1) does for the energies b at release, whose
        estimates and variances the data give.
        """
        block = self.root[:, : weight.n_start]
        estimate = np.matmul(explained.transpose(1, 0, 2), block.transpose(0, 2, 1)).transpose(
            1, 0, 2
        )
        narrowed = 1.0 + weight.excess[:, :, None] * np.einsum("kjq,kjq->kj", block, block)
        lost = np.log(np.prod(narrowed, axis=2))
        np.divide(np.square(estimate, out=estimate), narrowed, out=estimate)
        lost += weight.excess * np.sum(estimate, axis=2)
        return np.asarray(weight.n_start * np.log(weight.ratio)[:, None] - 0.5 * lost)


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
    cross = np.einsum("km,mi,kij->mkj", gain, turned, root).reshape(n_dir, inverse.size * n_column)
    cross_white = np.einsum("k,kij->ikj", inverse, root).reshape(n_column, inverse.size * n_column)
    return Terms(
        np.vstack([-0.5 * gain.T, -0.5 * inverse, log_norm]),
        cross,
        cross_white,
        root,
        family.amplitude,
    )
