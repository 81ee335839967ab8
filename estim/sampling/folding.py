"""Draws folded back at hard edges, and the density that they then have.

A distribution that leaks over an edge is reflected there.  Reflected is not the parameter alone, which would throw a draw off a ridge that runs
into the edge, but the parameter with all others following their regression on it: in coordinates z = L^-1 (x - mean), L the lower Cholesky factor
with the parameters that have edges in front, one after the other,

    z_k -> z_k + 2 (edge - x_k)/L_kk     where x_k lies beyond the edge.

Such a step mirrors one coordinate given those before it, so volumes stay, and the density of a folded draw is the sum over its images: over all
choices, for each of the parameters, of z_k itself and of what would have been reflected to it.  Inside the edges it is nowhere below that of the
distribution which is not folded, so that weights density/proposal are nowhere larger.

A draw that lies beyond the other edge after that stays there, outside the support, where the sum over images means nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from estim.arrays import FloatArray
from estim.sampling.factors import lower_factor

_REACH = 3.0  # scales from the mean: farther edges are left alone
_MOST_FOLDS = 5  # of one component: the number of images doubles with each edge, and triples where both edges are in reach
_NARROW = 1e8  # sum of squares of inverse scales, in those of all components together, of which polynomials keep but eight digits
_BLOCK = 96_000  # numbers of one kind that are computed together: they stay in the cache
_LIGHT = 0.01  # share of the draws: a hundred such components fold as well at one edge each, and have a fourth of the images


@dataclass(frozen=True, eq=False)
class Folding:
    """How components fold.

    order : (n_par,) parameters, those that fold in front.  means (n_component, n_par), factors, inverses (n_component, n_par, n_par) : in that order.
    edges : for each component those of its folds: (place in `order`, lower edge, upper edge), infinite where it does not fold.
    """

    order: NDArray[np.int64]
    means: FloatArray
    factors: FloatArray
    inverses: FloatArray
    edges: tuple[tuple[tuple[int, float, float], ...], ...]

    def points(self, normal: FloatArray, which: NDArray[np.int64]) -> FloatArray:
        """(n_draw, n_par) draws of components `which` (n_draw,) from z = `normal` (n_draw, n_par), folded."""
        z, found, kinds = normal.T.copy(), np.empty_like(normal), self._kinds[which]
        for kind, own in enumerate(self.alike):
            some = np.flatnonzero(kinds == kind)
            k = which[some]
            for i, (place, *_) in enumerate(self.edges[own[0]]):
                low, high = self._sides[k, i].T
                x = self.means[k, place] + np.einsum("nj,jn->n", self.factors[k, place, : place + 1], z[: place + 1, some])
                beyond = np.where(x < low, low - x, np.where(x > high, high - x, 0.0))
                z[place, some] += 2.0 / self.factors[k, place, place] * beyond
        found[:, self.order] = self.means[which] + np.einsum("nij,jn->ni", self.factors[which], z)
        return found

    @cached_property
    def alike(self) -> tuple[NDArray[np.int64], ...]:
        """Components that fold at the same sides of the same parameters, together, the narrow ones apart."""
        kinds: dict[tuple[object, ...], list[int]] = {}
        for k, edges in enumerate(self.edges):
            sides = ((place, math.isfinite(low), math.isfinite(high)) for place, low, high in edges)
            kinds.setdefault((bool(self._forms.narrow[k]), *sides), []).append(k)
        return tuple(np.array(own) for own in kinds.values())

    @cached_property
    def _kinds(self) -> NDArray[np.int64]:
        """(n_component,) to which of `alike` each belongs."""
        found = np.empty(len(self.edges), dtype=np.int64)
        for kind, own in enumerate(self.alike):
            found[own] = kind
        return found

    def n_image(self, k: int) -> int:
        """Of each draw, in component k."""
        return math.prod(1 + math.isfinite(low) + math.isfinite(high) for _, low, high in self.edges[k])

    def summed(self, columns: FloatArray, which: NDArray[np.int64], heights: FloatArray, dof: int) -> FloatArray:
        """(n_draw,) sum of heights (1 + distance/dof)^(-(dof + n_par)/2) over all images of draws (n_par, n_draw), parameters in `order`.

        which, heights : (n_which,) components that are `alike`.
        """
        found, power, n_image = np.empty(columns.shape[1]), dof + len(columns), self.n_image(int(which[0]))
        scaled = np.tile(heights * dof ** (0.5 * power), n_image)
        rows = max(16, _BLOCK // scaled.size)
        for first in range(0, found.size, rows):
            falls = self.distances(columns[:, first : first + rows], which)
            falls += dof
            found[first : first + rows] = scaled[: falls.shape[0] * which.size] @ half_power(falls, power).reshape(-1, falls.shape[2])
        return found

    def distances(self, columns: FloatArray, which: NDArray[np.int64]) -> FloatArray:
        """(n_image, n_which, n_draw) squared distances of all images of draws (n_par, n_draw), parameters in `order`, in units of scales.

        which : (n_which,) components that are `alike`.
        """
        forms = self._forms
        if forms.narrow[which[0]]:
            return self._distances_one_by_one(columns, which)
        images = forms.whole[which][None]
        for i in range(len(self.edges[which[0]])):
            sides = forms.sides[which, i]
            images = np.concatenate([images, *(images + sides[:, side] for side in (0, 1) if np.isfinite(self._sides[which[0], i, side]))])
        return (images.reshape(-1, images.shape[-1]) @ forms.products(columns)).reshape(*images.shape[:2], columns.shape[1])

    def _distances_one_by_one(self, columns: FloatArray, which: NDArray[np.int64]) -> FloatArray:
        """The same from z, where products of parameters would lose too many digits."""
        z = self.inverses[which] @ (columns - self.means[which][:, :, None])
        found, n = np.empty((self.n_image(int(which[0])), which.size, columns.shape[1])), 1
        np.einsum("kin,kin->kn", z, z, out=found[0])
        for i, (place, *_) in enumerate(self.edges[which[0]]):
            by, here = (2.0 / self.factors[which, place, place])[:, None], z[:, place]
            sides, images = self._sides[which, i].T, n
            for side in sides[np.isfinite(sides[:, 0])]:
                step = by * (side[:, None] - columns[place])
                np.add(found[:n], step * (step + 2.0 * here), out=found[images : images + n])
                images += n
            n = images
        return np.maximum(found, 0.0, out=found)

    @cached_property
    def _places(self) -> NDArray[np.int64]:
        """(n_component, n_edge) place in `order` of each fold, 0 where a component has fewer."""
        found = np.zeros(self._sides.shape[:2], dtype=np.int64)
        for own, edges in zip(found, self.edges, strict=True):
            own[: len(edges)] = [place for place, *_ in edges]
        return found

    @cached_property
    def _sides(self) -> FloatArray:
        """(n_component, n_edge, 2) lower and upper edge of each fold, nan where a component has fewer."""
        found = np.full((len(self.edges), max(map(len, self.edges)), 2), np.nan)
        for own, edges in zip(found, self.edges, strict=True):
            own[: len(edges)] = np.array([edge[1:] for edge in edges]).reshape(-1, 2)
        return found

    @cached_property
    def _forms(self) -> Forms:
        """The squared distances as polynomials."""
        centre = np.mean(self.means, axis=0)
        away = self.means - centre
        wide = lower_factor((np.einsum("kij,klj->il", self.factors, self.factors) + away.T @ away) / len(away))
        z = np.concatenate([-self.inverses @ away[:, :, None], self.inverses @ wide], axis=2)  # of 1 and of u
        whole = np.swapaxes(z, 1, 2) @ z
        narrow = ~(np.trace(whole, axis1=1, axis2=2) < _NARROW)
        # an image adds step (step + 2 z_place), step = 2 (edge - x_place)/L
        each = np.arange(len(self.edges))[:, None]
        here = -np.concatenate([centre[:, None], wide], axis=1)[self._places]
        step = np.stack([here, here], axis=2)
        step[..., 0] += np.where(np.isfinite(self._sides), self._sides, 0.0)
        step *= 2.0 / self.factors[each, self._places, self._places][:, :, None, None]
        sides = step[..., :, None] * (step + 2.0 * z[each, self._places][:, :, None])[..., None, :]
        return Forms(narrow, centre, np.asarray(np.linalg.inv(wide)), _polynomial(whole), _polynomial(sides))


@dataclass(frozen=True, eq=False)
class Forms:
    """Squared distances of components as polynomials of u = inverse (x - centre).

    narrow : (n_component,) which are so narrow beside all of them that polynomials lose too many digits.
    centre (n_par,), inverse (n_par, n_par).  whole (n_component, n_product), of draws as they are; sides (n_component, n_edge, 2, n_product), what
    a fold at an edge adds.
    """

    narrow: NDArray[np.bool_]
    centre: FloatArray
    inverse: FloatArray
    whole: FloatArray
    sides: FloatArray

    def products(self, columns: FloatArray) -> FloatArray:
        """(n_product, n_draw) products of two of 1 and u, at draws (n_par, n_draw)."""
        u = np.ones((len(columns) + 1, columns.shape[1]))
        np.matmul(self.inverse, columns - self.centre[:, None], out=u[1:])
        found, first = np.empty((self.whole.shape[1], columns.shape[1])), 0
        for i, one in enumerate(u):
            np.multiply(one, u[i:], out=found[first : first + len(u) - i])
            first += len(u) - i
        return found


def _polynomial(forms: FloatArray) -> FloatArray:
    """(..., n_product) coefficients of v^T form v, forms (..., n, n), in the order of `Forms.products`."""
    both = forms + np.swapaxes(forms, -1, -2)
    first, second = np.triu_indices(forms.shape[-1])
    return np.asarray(np.where(first == second, 0.5, 1.0) * both[..., first, second])


def folding(weights: FloatArray, means: FloatArray, factors: FloatArray, low: FloatArray, high: FloatArray) -> Folding | None:
    """Folds of components at the limits that are within their reach, of light ones (`weights`, (n_component,)) at the nearest; None where none is.

    means, low, high : (n_component, n_par).  factors : (n_component, n_par, n_par) lower Cholesky factors of their scales.
    """
    scales = np.sqrt(np.sum(factors**2, axis=2))
    to_low, to_high = (means - low) / scales, (high - means) / scales
    rank = np.argsort(np.argsort(np.minimum(to_low, to_high), axis=1, kind="stable"), axis=1, kind="stable")
    most = np.where(weights < _LIGHT, 1, _MOST_FOLDS)[:, None]
    at_low, at_high = ((distance < _REACH) & (rank < most) for distance in (to_low, to_high))
    folds = at_low | at_high
    if not np.any(folds):
        return None
    order = np.argsort(-np.sum(folds, axis=0), kind="stable")
    # R of the QR decomposition of the transposed factor is the factor in another order
    lower = np.swapaxes(np.asarray(np.linalg.qr(np.swapaxes(factors[:, order], 1, 2), mode="r")), 1, 2)
    lower = lower * np.sign(np.diagonal(lower, axis1=1, axis2=2))[:, None, :]
    bottom, top = np.where(at_low, low, -np.inf), np.where(at_high, high, np.inf)
    edges = tuple(
        tuple((place, float(bottom[k, i]), float(top[k, i])) for place, i in enumerate(order) if folds[k, i]) for k in range(len(means))
    )
    return Folding(order, means[:, order], lower, np.linalg.inv(lower), edges)


def unfolded(mean: FloatArray, factor: FloatArray, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (n_par,) and lower factor (n_par, n_par) of what folds to a distribution that has the given ones and ends at limits (n_par,).

    The mean square of the distance from an edge is the same before and after.  The mean distance of a folded normal distribution is no less than
    sqrt(2/pi) of the root of that; it says how far from the edge the centre was.  The other parameters follow by their regression.
    """
    known, mean, scale = (mean, factor), mean.copy(), factor @ factor.T
    folds = False
    for i in range(mean.size):
        sd = math.sqrt(scale[i, i])
        near = [float(edge) for edge in (low[i], high[i]) if abs(mean[i] - edge) < _REACH * sd]
        if len(near) != 1:  # between two edges it is wide already
            continue
        folds = True
        distance = float(mean[i]) - near[0]
        root = math.hypot(distance, sd)
        centre = float(np.interp(abs(distance) / root, *_folded_means()))
        wide = root / math.hypot(1.0, centre)
        slope = scale[:, i] / scale[i, i]
        mean += slope * (math.copysign(centre * wide, distance) - distance)
        scale += np.outer(slope, slope) * (wide**2 - sd**2)
    return (mean, lower_factor(scale)) if folds else known


def half_power(values: FloatArray, halves: int) -> FloatArray:
    """values^(-halves/2) by products, many times faster than the power of a number; `values` is used up."""
    with np.errstate(over="ignore"):
        found, left = np.sqrt(values) if halves % 2 else np.ones_like(values), halves // 2
        while left:
            if left % 2:
                found *= values
            left //= 2
            if left:
                values *= values
        return np.divide(1.0, found, out=found)


@cache
def _folded_means() -> tuple[FloatArray, FloatArray]:
    """Mean distance over its root mean square, of a normal distribution folded at 0, and the mean before in standard deviations."""
    at = np.linspace(0.0, 5.0, 101)
    means = math.sqrt(2.0 / math.pi) * np.exp(-0.5 * at**2) + at * (1.0 - 2.0 * ndtr(-at))
    return means / np.hypot(1.0, at), at
