"""Conditional maxima of a density, many at once: where it is highest when some of its parameters are held.

Newton steps with derivatives from finite differences, all points in one call of the density.  The parameters come in an
order, and the first ones are held; `factor`, the lower Cholesky factor of a covariance in that order, says along which
directions to differentiate.  Limits of parameters are kept by holding what lies on one and is pressed against it.

What comes back is a guide (where to put nodes, how wide a proposal must be); nothing that uses it may rest on its accuracy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import erfcx, ndtr

from estim.arrays import FloatArray
from estim.sampling.factors import lower_factor
from estim.sampling.protocol import Density, Support, log_density_in_batches

Flags = NDArray[np.bool_]

_STEP = 0.1  # of the finite differences, in scales
_SHARES = (1.0, 0.3, 0.05)  # of a Newton step, the longest first
_LONGEST = 4.0  # Newton step, in scales
_LEAST_CURVATURE = 0.02  # in scales
_NEAR = 0.4  # of a first step, in scales
_WITHIN_REACH = 16.0  # in log density: lower modes hold nothing


@dataclass(frozen=True, eq=False)
class Frame:
    """Coordinates in which a density is explored: its parameters in another order, with a scale and limits.

    order : (n_par,) which parameter comes first.  centre : (n_par,) a mode.  factor : (n_par, n_par) lower Cholesky factor of a
    covariance.  low, high : (n_par,) limits, infinite where there are none.  All but `order` in the new order.

    Several frames of one density stacked have one more axis in front of each, and then every point of (n, n_par) has a frame of its own.
    """

    density: Density
    order: NDArray[np.int64]
    centre: FloatArray
    factor: FloatArray
    low: FloatArray
    high: FloatArray

    @property
    def n_par(self) -> int:
        return int(self.centre.shape[-1])

    @property
    def stacked(self) -> bool:
        return self.order.ndim > 1

    def rows(self, which: int | NDArray[np.int64]) -> Frame:
        """These of stacked frames (one of them, not stacked, for a number); a single frame, which serves all points, as it is."""
        if not self.stacked:
            return self
        return Frame(self.density, self.order[which], self.centre[which], self.factor[which], self.low[which], self.high[which])

    def original(self, points: FloatArray) -> FloatArray:
        """(n, n_par) the same points with the parameters in the density's own order."""
        points_there = np.empty_like(points)
        np.put_along_axis(points_there, np.broadcast_to(self.order, points.shape), points, axis=1)
        return points_there

    def heights(self, points: FloatArray) -> FloatArray:
        """(n,) log density at points (n, n_par); -inf beyond the limits."""
        inside = np.all((points >= self.low) & (points <= self.high), axis=1)
        values = np.full(len(points), -np.inf)
        if np.any(inside):
            with np.errstate(all="ignore"):  # far from the mode a curve may overflow: no density there
                values[inside] = log_density_in_batches(self.density, self.rows(np.flatnonzero(inside)).original(points[inside]))
        return values


@dataclass(frozen=True, eq=False)
class Summits:
    """Conditional maxima.

    points : (n, n_par).  heights : (n,) log density.  log_volumes : (n,) log of the integral over the parameters that were not
    held, relative to the height, by Laplace's approximation (exponential towards a limit).
    precisions : (n, n_free, n_free) minus the second derivatives in those parameters.
    """

    points: FloatArray
    heights: FloatArray
    log_volumes: FloatArray
    precisions: FloatArray

    @property
    def log_masses(self) -> FloatArray:
        return self.heights + self.log_volumes


def climb(
    frame: Frame, points: FloatArray, n_held: int, *, n_step: int = 2, otherwise: FloatArray | None = None, quick: bool = False
) -> Summits:
    """Conditional maxima from points (n, n_par), the first `n_held` parameters staying where they are.

    otherwise : (n, n_par) where the others begin where the density at `points` is zero or no number.
    quick : what the first step hardly moves is taken to be there, with the second derivatives of where it was: a third of the calls.

    Points with frames of their own do not know of each other: each has the maximum that it would have alone.
    """
    n_free = frame.n_par - n_held
    begun = points
    points, heights, scales, precision = _climbed(frame, points, n_held, 1 if quick else n_step, otherwise)
    if n_free == 0 or len(points) == 0:
        return Summits(points, heights, np.zeros(len(points)), np.zeros((len(points), n_free, n_free)))
    gradient, precision, _ = _derivatives(frame, points, n_held, scales, precision if quick else None)
    _, pressed = _bounded_step(frame, points[:, n_held:], gradient, precision, n_held)
    found = Summits(points, heights, _log_volume(frame, points[:, n_held:], gradient, precision, pressed, n_held), precision)
    if quick:
        step = (points - begun)[:, n_held:]
        far = np.flatnonzero(~(np.einsum("ni,nij,nj->n", step, precision, step) < _NEAR**2))
        further = climb(frame.rows(far), points[far], n_held, n_step=n_step - 1)
        for name, whole in vars(found).items():
            whole[far] = getattr(further, name)
    return found


def _climbed(
    frame: Frame, points: FloatArray, n_held: int, n_step: int, otherwise: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Points and heights of `climb`, the scales (n, n_free) that suit the curvature there, and the precisions where the last step began."""
    n_free = frame.n_par - n_held
    points = np.array(points)
    heights = frame.heights(points)
    if otherwise is not None and not np.all(np.isfinite(heights)):
        nowhere = np.flatnonzero(~np.isfinite(heights))
        points[nowhere, n_held:] = otherwise[nowhere, n_held:]
        heights[nowhere] = frame.rows(nowhere).heights(points[nowhere])
    scales, precision = np.ones((len(points), n_free)), np.zeros((len(points), n_free, n_free))
    for _ in range(n_step if n_free and len(points) else 0):
        gradient, precision, scales = _derivatives(frame, points, n_held, scales)
        step, _ = _bounded_step(frame, points[:, n_held:], gradient, precision, n_held)
        low, high = frame.low[..., n_held:], frame.high[..., n_held:]
        moved = np.flatnonzero(np.any(step != 0.0, axis=1))
        trials = np.repeat(points[None, moved], len(_SHARES), axis=0)
        trials[:, :, n_held:] = [np.clip(points[:, n_held:] + share * step, low, high)[moved] for share in _SHARES]
        risen = frame.rows(np.tile(moved, len(_SHARES))).heights(trials.reshape(-1, frame.n_par)).reshape(len(_SHARES), -1)
        better = risen > heights[moved]
        which, some = np.argmax(better, axis=0), np.any(better, axis=0)  # the longest way that leads higher
        points[moved[some]], heights[moved[some]] = trials[which, np.arange(moved.size)][some], risen[which, np.arange(moved.size)][some]
    return points, heights, scales, precision


def framed(density: Density, start: FloatArray, cov: FloatArray, support: Support | None) -> Frame:
    """Coordinates around a mode `start` (n_par,) with covariance `cov`, those parameters first that the density is least normal in."""
    start = np.asarray(start, dtype=float)
    low, high = support if support is not None else (np.full(start.size, -np.inf), np.full(start.size, np.inf))
    same = Frame(density, np.arange(start.size), start, lower_factor(cov), low, high)
    scale = 1.0 / np.sqrt(np.diag(np.linalg.inv(same.factor @ same.factor.T)))
    t = np.array([0.0, -3.0, -2.0, -1.0, 1.0, 2.0, 3.0])
    bent = np.zeros(start.size)
    places = start + (scale[:, None, None] * t[:, None]) * np.eye(start.size)[:, None]
    for i, values in enumerate(same.heights(places.reshape(-1, start.size)).reshape(start.size, -1)):
        known = np.isfinite(values)
        if np.sum(known) < 4:
            bent[i] = np.inf
            continue
        coefficients = np.polynomial.polynomial.polyfit(t[known], values[known], 2)
        bent[i] = np.max(np.abs(np.polynomial.polynomial.polyval(t[known], coefficients) - values[known]))
    order = np.argsort(-np.where(bent < 1e-7, 0.0, bent), kind="stable")
    factor = lower_factor(cov[np.ix_(order, order)])
    return rescaled(Frame(density, order[None], start[None, order], factor[None], low[None, order], high[None, order])).rows(0)


def reordered(frame: Frame, modes: FloatArray) -> Frame:
    """Frames around modes (n_mode, n_par), stacked: for every mode one with each parameter in front, (n_mode n_par) in all."""
    orders = np.array([[axis, *(i for i in range(frame.n_par) if i != axis)] for axis in range(frame.n_par)])
    cov = frame.factor @ frame.factor.T
    factors = lower_factor(cov[orders[:, :, None], orders[:, None, :]])
    centres = modes[:, orders].reshape(-1, frame.n_par)
    order, n_mode = np.tile(orders, (len(modes), 1)), len(modes)
    factors = np.tile(factors, (n_mode, 1, 1))
    return rescaled(Frame(frame.density, frame.order[order], centres, factors, frame.low[order], frame.high[order]))


def separate_modes(frame: Frame, starts: Sequence[FloatArray]) -> FloatArray:
    """(n_mode, n_par) the centre and those of `starts` that are modes of their own and matter, in the order of the frame."""
    found = climb(frame, np.vstack([frame.centre, *(np.asarray(s)[frame.order] for s in starts)]), 0, n_step=6)
    inverse = np.linalg.inv(frame.factor)
    kept: list[int] = [0]
    for i in range(1, len(found.points)):
        matters = found.heights[i] > np.max(found.heights) - _WITHIN_REACH
        if matters and all(np.linalg.norm(inverse @ (found.points[i] - found.points[j])) > 1.0 for j in kept):
            kept.append(i)
    return found.points[kept]


def rescaled(frames: Frame) -> Frame:
    """Stacked frames with the second derivatives at their centres (the slope towards a limit that a centre lies on) in place of covariances."""
    centres, factors = frames.centre.copy(), frames.factor.copy()
    rough = np.arange(len(centres))
    for _ in range(4):
        here = replace(frames, centre=centres, factor=factors).rows(rough)
        here = replace(here, centre=_climbed(here, here.centre, 0, 2)[0])
        centres[rough] = here.centre
        gradient, precision, _ = _derivatives(here, here.centre, 0, np.ones_like(here.centre))
        _, pressed = _bounded_step(here, here.centre, gradient, precision, 0)
        steep = np.where(pressed, gradient, 0.0)[:, :, None] ** 2 * np.eye(frames.n_par)
        found = lower_factor(np.asarray(np.linalg.inv(precision + steep)))
        sds, sds_before = (np.diagonal(factor, axis1=1, axis2=2) for factor in (found, here.factor))
        changed = ~np.all(np.isclose(sds, sds_before, rtol=0.1), axis=1)
        rough = rough[changed]
        if rough.size == 0:
            break
        factors[rough] = found[changed]
    return replace(frames, centre=centres, factor=factors)


def _derivatives(
    frame: Frame, points: FloatArray, n_held: int, scales: FloatArray, known: FloatArray | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Gradient (n, n_free) and minus the second derivatives (n, n_free, n_free), made positive, and new scales (n, n_free).

    known : second derivatives that are taken as they are.
    """
    n, n_free = scales.shape
    base = frame.factor[..., n_held:, n_held:]
    directions = base * scales[:, None, :]  # (n, n_free, direction)
    margin = 2.0 * _STEP * np.sum(np.abs(directions), axis=2)
    low, high = frame.low[..., n_held:], frame.high[..., n_held:]
    margin = np.minimum(margin, 0.49 * (high - low))
    centre = points.copy()
    centre[:, n_held:] = np.clip(points[:, n_held:], low + margin, high - margin)
    first, second = np.triu_indices(n_free, 1)
    eye = np.eye(n_free)
    moves = np.concatenate([eye, -eye])
    if known is None:
        moves = np.concatenate([moves, np.zeros((1, n_free)), eye[first] + eye[second], -eye[first] - eye[second]])
    stencil = np.repeat(centre[:, None], len(moves), axis=1)
    stencil[:, :, n_held:] += _STEP * np.einsum("mj,nij->nmi", moves, directions)
    values = frame.rows(np.repeat(np.arange(n), len(moves))).heights(stencil.reshape(-1, frame.n_par)).reshape(n, -1)
    finite = np.all(np.isfinite(values), axis=1)
    values = np.where(finite[:, None], values, 0.0)
    plus, minus = values[:, :n_free], values[:, n_free : 2 * n_free]
    slope = (plus - minus) / (2.0 * _STEP)
    inverse = np.linalg.inv(base) / scales[:, :, None]  # of directions
    precision = known
    if precision is None:
        middle, pairs = values[:, 2 * n_free, None], values[:, 2 * n_free + 1 :]
        curvature = np.zeros((n, n_free, n_free))
        single = plus + minus - 2.0 * middle
        curvature[:, np.arange(n_free), np.arange(n_free)] = -single / _STEP**2
        both = pairs[:, : first.size] + pairs[:, first.size :]
        mixed = -(both - 2.0 * middle - single[:, first] - single[:, second]) / (2.0 * _STEP**2)
        curvature[:, first, second] = curvature[:, second, first] = mixed
        curvature[~finite] = eye
        eigenvalues, vectors = np.linalg.eigh(curvature)
        positive = (vectors * np.maximum(np.abs(eigenvalues), _LEAST_CURVATURE)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        precision = np.swapaxes(inverse, 1, 2) @ positive @ inverse
        scales = scales * np.clip(1.0 / np.sqrt(np.diagonal(positive, axis1=1, axis2=2)), 0.1, 4.0)
    gradient = np.einsum("nji,nj->ni", inverse, slope)
    # to the point itself, where the stencil had to be moved off a limit
    gradient -= np.einsum("nij,nj->ni", precision, (points - centre)[:, n_held:])
    return gradient, precision, scales


def _bounded_step(frame: Frame, at: FloatArray, gradient: FloatArray, precision: FloatArray, n_held: int) -> tuple[FloatArray, Flags]:
    """(n, n_free) Newton steps that stay within the limits, and (n, n_free) which parameters are pressed against one."""
    low, high = frame.low[..., n_held:], frame.high[..., n_held:]
    pressed = ((at <= low) & (gradient < 0.0)) | ((at >= high) & (gradient > 0.0))
    fixed = np.where(pressed, 0.0, np.nan)
    step = np.zeros_like(at)
    eye = np.eye(at.shape[1])
    for _ in range(at.shape[1]):
        held = ~np.isnan(fixed)
        moved = np.where(held, fixed, 0.0)
        right = np.where(held, moved, gradient - np.einsum("nij,nj->ni", precision, moved))
        matrix = np.where(held[:, :, None] | held[:, None, :], 0.0, precision) + held[:, :, None] * eye
        # singular by rounding where two parameters are tied to a dozen digits: each diagonal by its own rounding, whatever the units
        rounding = np.where(held, 0.0, np.finfo(float).eps * np.abs(np.diagonal(matrix, axis1=1, axis2=2)) + np.finfo(float).tiny)
        step = np.asarray(np.linalg.solve(matrix + rounding[:, :, None] * eye, right[:, :, None])[:, :, 0], dtype=np.float64)
        size = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", step, precision, step), 1e-300))
        step *= np.minimum(1.0, _LONGEST / size)[:, None]
        beyond = ~held & ((at + step < low) | (at + step > high))
        if not np.any(beyond):
            break
        fixed = np.where(beyond, np.clip(at + step, low, high) - at, fixed)
    return step, pressed


def _log_volume(frame: Frame, at: FloatArray, gradient: FloatArray, precision: FloatArray, pressed: Flags, n_held: int) -> FloatArray:
    """(n,) log of the integral of exp(-g.x - x P x/2) over the free parameters, within their limits one at a time.

    Exact for a normal density with one limit nearby, and so without a jump where a maximum comes to lie on its limit.
    """
    eye = np.eye(gradient.shape[1])
    matrix = np.where(pressed[:, :, None] | pressed[:, None, :], 0.0, precision) + pressed[:, :, None] * eye
    _, log_det = np.linalg.slogdet(matrix)
    covariance = np.linalg.inv(matrix)
    sd = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    inside = np.log(ndtr((frame.high[..., n_held:] - at) / sd) - ndtr((frame.low[..., n_held:] - at) / sd))
    # one pressed against a limit: its curvature with those that are not pressed re-optimised
    coupling = np.where(pressed[:, None, :], 0.0, precision)
    curvature = np.diagonal(precision, axis1=1, axis2=2) - np.einsum("nij,njk,nik->ni", coupling, covariance, coupling)
    curvature = np.maximum(curvature, np.finfo(float).tiny)
    edge = 0.5 * np.log(np.pi / (2.0 * curvature)) + np.log(erfcx(np.abs(gradient) / np.sqrt(2.0 * curvature)))
    free = np.sum(~pressed, axis=1)
    return np.asarray(0.5 * free * np.log(2.0 * np.pi) - 0.5 * log_det + np.sum(np.where(pressed, edge, inside), axis=1))
