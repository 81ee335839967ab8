"""Narrow ridges that bend in many directions, made straight: each parameter less what products of two before it explain.

    z = L^-1 (x - mean),    u_i = z_i - sum_{a <= b < i} c_iab (z_a z_b - [a = b])        z of unit covariance, cut at 3 in the products

Each parameter moves by a function of those before it, so volumes stay: the density of a draw is that of its u.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray

_FAR = 3.0  # standard deviations beyond which no product is known
_SURE = 4.0  # standard errors of a product that counts: there are some two thousand of 22 parameters

Terms = tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]


@dataclass(frozen=True, eq=False)
class Curving:
    """mean : (n_par,).  factor, inverse : (n_par, n_par) L and L^-1.  terms : for each parameter a, b and c of its products."""

    mean: FloatArray
    factor: FloatArray
    inverse: FloatArray
    terms: tuple[Terms, ...]

    @property
    def moves(self) -> NDArray[np.bool_]:
        """(n_par,) which parameters are moved at all."""
        return np.any(self.factor[:, [c.size > 0 for *_, c in self.terms]] != 0.0, axis=1)

    def straight(self, points: FloatArray) -> FloatArray:
        """(n, n_par) u of points x, as mean + L u."""
        z = self.inverse @ (points - self.mean).T
        return np.asarray(self.mean + (self.factor @ (z - [_explained(z, *own) for own in self.terms])).T)

    def bent(self, points: FloatArray) -> FloatArray:
        """(n, n_par) x of points mean + L u."""
        z = self.inverse @ (points - self.mean).T
        for row, own in zip(z, self.terms, strict=True):
            row += _explained(z, *own)
        return np.asarray(self.mean + (self.factor @ z).T)


def curving_of(draws: FloatArray, weights: FloatArray, mean: FloatArray, factor: FloatArray) -> Curving:
    """The products that weighted draws (n_draw, n_par) of about this mean and covariance (its Cholesky factor) surely show.

    weights : (n_draw,) sum 1.
    """
    inverse = np.asarray(np.linalg.inv(factor))
    z = inverse @ (draws - mean).T
    cut, error = np.clip(z, -_FAR, _FAR), float(np.sqrt(np.sum(weights**2)))
    terms = []
    for i in range(len(z)):
        a, b = np.triu_indices(i)
        products = cut[a] * cut[b] - (a == b)[:, None]
        products -= (products @ weights)[:, None]
        follows = (products @ (weights * z[i])) / np.sqrt(np.maximum(np.square(products) @ weights, 1e-300))
        chosen = np.flatnonzero(np.abs(follows) > _SURE * error)
        known = products[chosen]
        size = (known * weights) @ known.T
        terms.append((a[chosen], b[chosen], np.linalg.lstsq(size, known @ (weights * z[i]), rcond=1e-6)[0]))
    return Curving(mean, factor, inverse, tuple(terms))


def _explained(z: FloatArray, a: NDArray[np.int64], b: NDArray[np.int64], c: FloatArray) -> FloatArray:
    """(n,) of z (n_par, n)."""
    if not c.size:
        return np.zeros(z.shape[1])
    products = np.clip(z[a], -_FAR, _FAR) * np.clip(z[b], -_FAR, _FAR)
    return np.asarray(c @ (products - (a == b)[:, None]))
