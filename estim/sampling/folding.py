"""Draws folded back at hard edges, and the density that they then have.

A distribution that leaks over an edge is reflected there.  Reflected is not the parameter alone, which would throw the draw off a ridge that runs
into the edge, but the parameter with all others following their regression on it: in coordinates z = L^-1 (x - mean), L the lower Cholesky factor
with the parameters that have edges in front, one after the other,

    z_k -> z_k + 2 (edge - x_k)/L_kk     where x_k lies beyond the edge.

Such a step shifts and mirrors one coordinate given those before it, so volumes stay, and the density of a folded draw is the sum over its images:
over all choices, for each of the parameters, of z_k itself and of what would have been reflected to it.  Inside the edges it is nowhere below that of
the distribution which is not folded, so that weights density/proposal are nowhere larger.

A draw that lies beyond again after one reflection stays there, outside the support.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray

_REACH = 3.0  # scales from the mean: farther edges are left alone
_MOST_FOLDS = 5  # of one component: the number of images doubles with each


@dataclass(frozen=True, eq=False)
class Folding:
    """How components fold.

    order : (n_par,) parameters, those that fold in front.  factors, inverses : (n_component, n_par, n_par) lower Cholesky factors in that order.
    edges : for each component, those of its folds: (place in `order`, lower edge, upper edge), infinite where it does not fold.
    """

    order: NDArray[np.int64]
    means: FloatArray
    factors: FloatArray
    inverses: FloatArray
    edges: tuple[tuple[tuple[int, float, float], ...], ...]

    def points(self, normal: FloatArray, which: NDArray[np.int64]) -> FloatArray:
        """(n_draw, n_par) draws from components `which` (n_draw,) at z = `normal` (n_draw, n_par), folded."""
        found = np.empty_like(normal)
        for k in np.unique(which):
            own = np.flatnonzero(which == k)
            z, mean, factor = normal[own].T.copy(), self.means[k], self.factors[k]
            for place, low, high in self.edges[k]:
                x = mean[place] + factor[place, : place + 1] @ z[: place + 1]
                beyond = np.where(x < low, low - x, np.where(x > high, high - x, 0.0))
                z[place] += 2.0 / factor[place, place] * beyond
            found[own[:, None], self.order] = mean + (factor @ z).T
        return found

    def distances(self, columns: FloatArray, k: int) -> FloatArray:
        """(n_image, n_draw) squared distances of all images of draws (n_par, n_draw), parameters in `order`, in units of the scale of component k."""
        z = self.inverses[k] @ (columns - self.means[k][:, None])
        found = np.sum(np.square(z), axis=0)[None]
        for place, low, high in self.edges[k]:
            height = self.factors[k][place, place]
            changes = [np.square(z[place] + 2.0 / height * (edge - columns[place])) - np.square(z[place]) for edge in (low, high) if math.isfinite(edge)]
            found = np.concatenate([found, *(found + change for change in changes)])
        return np.maximum(found, 0.0)


def folding(means: FloatArray, factors: FloatArray, low: FloatArray, high: FloatArray) -> Folding:
    """Folds of components at limits (n_par,) that are within their reach.

    means : (n_component, n_par).  factors : (n_component, n_par, n_par) lower Cholesky factors of their scales.
    """
    scales = np.sqrt(np.sum(factors**2, axis=2))
    near_low, near_high = means - low < _REACH * scales, high - means < _REACH * scales
    # the nearest edges of each component, where there are too many
    nearness = np.minimum(np.where(near_low, (means - low) / scales, np.inf), np.where(near_high, (high - means) / scales, np.inf))
    rank = np.argsort(np.argsort(nearness, axis=1, kind="stable"), axis=1, kind="stable")
    near_low, near_high = near_low & (rank < _MOST_FOLDS), near_high & (rank < _MOST_FOLDS)
    count = np.sum(near_low | near_high, axis=0)
    order = np.argsort(-count, kind="stable")
    lower = np.linalg.qr(np.swapaxes(factors[:, order], 1, 2), mode="r").swapaxes(1, 2)
    lower = lower * np.sign(np.diagonal(lower, axis1=1, axis2=2))[:, None, :]
    edges = tuple(
        tuple(
            (place, float(low[i]) if near_low[k, i] else -math.inf, float(high[i]) if near_high[k, i] else math.inf)
            for place, i in enumerate(order) if near_low[k, i] or near_high[k, i]
        )
        for k in range(len(means))
    )
    return Folding(order, means[:, order], lower, np.linalg.inv(lower), edges)


def unfolded(mean: FloatArray, factor: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (n_par,) and lower factor (n_par, n_par) of what folds to a distribution that has the given ones and ends at limits (n_par,).

    The square of the distance from an edge is the same before and after folding, which leaves one number, the mean distance, to match; that of a
    normal distribution cannot be below sqrt(2/pi) of the root of the square.  The other parameters follow by their regression.
    """
    mean, scale = mean.copy(), factor @ factor.T
    for i in range(mean.size):
        sd = math.sqrt(scale[i, i])
        near = [edge for edge in (low[i], high[i]) if abs(mean[i] - edge) < _REACH * sd]
        if len(near) != 1:
            continue
        distance = abs(mean[i] - near[0])
        square = distance**2 + sd**2 * C
        at = float(np.interp(distance / math.sqrt(square), _RATIOS, _CENTRES))  # mean over standard deviation before folding
        wide = math.sqrt(square / (1.0 + at**2)/C)
        slope = scale[:, i] / scale[i, i]
        mean += slope * (math.copysign(at * wide*math.sqrt(C), mean[i] - near[0]) + near[0] - mean[i])
        scale += np.outer(slope, slope) * (wide**2 - sd**2)
    return mean, np.asarray(np.linalg.cholesky(scale))
C=1.0
_CENTRES = np.linspace(0.0, 5.0, 101)
def _r(a):
    from math import erf
    return np.array([(math.sqrt(2/math.pi)*math.exp(-0.5*x*x)+x*erf(x/math.sqrt(2)))/math.sqrt(1+x*x) for x in a])
_RATIOS = _r(_CENTRES)
