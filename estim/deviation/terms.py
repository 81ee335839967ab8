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
        """(n_draw,) w^2 - 1."""
        return np.asarray(np.square(self.ratio) - 1.0)


@dataclass(frozen=True, eq=False)
class Terms:
    """Constants of a family: log density = [(basis z)^2, |z|^2, 1] gain + |explained|^2/2.

    gain : (n_component, n_dir + 2).
    cross, cross_white : (n_column, n_component, n_dir), (n_column, n_component, n_column), of the
        part of z that H explains, cross (basis z) + cross_white (H z), in units of its own standard
        deviation.
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
        """(n_component, n_draw) for |z|^2 (n_draw,), basis z (n_dir, n_draw) and H z (n_column,
        n_draw); weight : where it is not that of the fit.
        """
        density = self.gain @ np.vstack([np.square(seen), square, np.ones_like(square)])
        explained = self.cross @ seen + self.cross_white @ along
        for part in explained:
            density += 0.5 * np.square(part)
        if weight is not None:
            if along.shape[0] and weight.n_start:
                density += self._starts(explained, weight)
            forced = self.amplitude[:, None] > 0.0
            narrowed = np.square(self.amplitude / weight.scale)[:, None]
            density += np.where(forced, np.log(weight.ratio) - 0.5 * weight.excess * narrowed, 0.0)
        return density

    def _starts(self, explained: FloatArray, weight: Weight) -> FloatArray:
        """What N(b | 0, 1/w^2) in place of N(b | 0, 1) does for the energies b at release, whose
        estimates and variances the data give.
        """
        product, total = np.ones_like(explained[0]), np.zeros_like(explained[0])
        for block in self.root[:, : weight.n_start].transpose(1, 2, 0):
            estimate = np.einsum("qk,qkn->kn", block, explained)
            narrowed = 1.0 + weight.excess * np.sum(block**2, axis=0)[:, None]
            total += np.square(estimate, out=estimate) / narrowed
            product *= narrowed
        lost = np.log(product, out=product) + weight.excess * total
        return np.asarray(weight.n_start * np.log(weight.ratio) - 0.5 * lost)


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
    return Terms(
        np.column_stack([-0.5 * gain, -0.5 * inverse, log_norm]),
        np.einsum("km,mi,kij->jkm", gain, turned, root),
        np.einsum("k,kij->jki", inverse, root),
        root,
        family.amplitude,
    )
