"""Where else a posterior may have mass: a proposal that follows its ridges, made without a draw.

Each parameter in turn is led both ways from the mode, all others re-optimised, until the density has fallen by e^-10 or a limit is met.  Each point
of the way becomes a Student-t component as wide as the density is there and as the step to its neighbours; the faint ones get a power of
their share, so that long tails are drawn often.  It shares nothing with a proposal that was adapted to draws of itself (`estim.sampling.proposal`),
and misses what that one finds and the reverse: weights of one over the mixture of both (the balance heuristic; Owen and Zhou, J. Am. Stat. Assoc.
95 (2000) 135) are right where either is.

All ways advance together, by Newton steps whose derivatives are finite differences: each needs few calls of the density, of many points.  Where they
lead decides how wide a proposal is, and nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.sampling.factors import lower_factor
from estim.sampling.importance import log_sum_exp
from estim.sampling.proposal import Proposal
from estim.sampling.protocol import Density, Support, log_density_in_batches

IndexArray = NDArray[np.int64]

_DEPTH = 10.0  # in log density, to which a way is followed
_FALL = 1.5  # of the first step; more by 1 for each unit of depth
_LEAST_STEP = 1e-2  # standard deviations below which a way ends: before a jump
_MOST_STEPS = 60  # of a way, those taken back included
_POWER = 0.4  # of the share that a point of a ridge has
_OVERLAP = 0.6  # of the distance between neighbours, standard deviation along the ridge
_WITHIN_REACH = 16.0  # in log density: lower modes hold nothing
_ROUNDS = 4  # in which the widths about a mode settle
_DIFFERENCE = 0.1  # step of the finite differences, in standard deviations
_SHARES = (1.0, 0.3, 0.05)  # of a Newton step, the longest first
_LONGEST, _NEAR = 4.0, 0.4  # Newton steps, in standard deviations: one is no longer; after a shorter one the curvature is as before
_LEAST_CURVATURE = 0.02  # in standard deviations


@dataclass(frozen=True, eq=False)
class Frames:
    """Coordinates of n points in which a density is explored; in each one parameter, which may be held, stands in front.

    order : (n, n_par) which parameters these are.  factor : (n, n_par, n_par) lower Cholesky factors of a covariance there, which say along which
    directions to differentiate.  low, high : (n, n_par) limits, infinite where there are none.  Points (n, n_par) are in this order too.
    """

    density: Density
    order: IndexArray
    factor: FloatArray
    low: FloatArray
    high: FloatArray

    def rows(self, which: IndexArray) -> Frames:
        """These of them."""
        return Frames(self.density, self.order[which], self.factor[which], self.low[which], self.high[which])

    def original(self, points: FloatArray) -> FloatArray:
        """(n, n_move, n_par) the same points with the parameters in the density's own order."""
        found = np.empty_like(points)
        np.put_along_axis(found, np.broadcast_to(self.order[:, None], points.shape), points, axis=2)
        return found

    def heights(self, points: FloatArray) -> FloatArray:
        """(n, n_move) log density at points (n, n_move, n_par), n_move of each frame; -inf beyond the limits."""
        inside = np.all((points >= self.low[:, None]) & (points <= self.high[:, None]), axis=2)
        values = np.full(inside.shape, -np.inf)
        if np.any(inside):
            with np.errstate(all="ignore"):  # far from the mode a curve may overflow: no density there
                values[inside] = log_density_in_batches(self.density, self.original(points)[inside])
        return values


@dataclass(frozen=True, eq=False)
class Places:
    """Points (n, n_par), and the density about them in those parameters that are not held (n_free of them).

    heights : (n,) log density.  slopes : (n, n_free) its derivatives.  curvatures : (n, n_free, n_free) minus the second ones, made positive.
    pressed : (n, n_free) whether a parameter lies on a limit and would go beyond.
    """

    points: FloatArray
    heights: FloatArray
    slopes: FloatArray
    curvatures: FloatArray
    pressed: NDArray[np.bool_]

    def rows(self, which: IndexArray | NDArray[np.bool_]) -> Places:
        """These of them."""
        return Places(*(part[which] for part in vars(self).values()))

    @property
    def precisions(self) -> FloatArray:
        """(n, n_free, n_free) of a normal distribution as wide as the density is; at a limit it falls like an exponential one."""
        steep = np.where(self.pressed, self.slopes, 0.0)
        return np.asarray(self.curvatures + steep[:, :, None] ** 2 * np.eye(steep.shape[1]))

    @property
    def log_masses(self) -> FloatArray:
        """(n,) log of the integral over the parameters that are not held, but for a constant (Laplace's approximation)."""
        return np.asarray(self.heights - 0.5 * np.linalg.slogdet(self.precisions)[1])


def ridge_proposal(
    density: Density, start: FloatArray, cov: FloatArray, *, starts: Sequence[FloatArray] = (), support: Support | None = None
) -> Proposal:
    """Student-t components along the ridges of `density` through `start` (n_par,), a mode with covariance `cov`, and through further modes.

    Raises NumericalError where the density is not a number.
    """
    return along_ridges(*ridges(density, np.vstack([start, *starts]), cov, support))


def ridges(density: Density, modes: FloatArray, cov: FloatArray, support: Support | None) -> tuple[Frames, FloatArray]:
    """Frames around those of the modes (n_mode, n_par) that matter, one with each parameter in front, and the points (n, n_par) that they are."""
    n_par = modes.shape[1]
    low, high = support if support is not None else (np.full(n_par, -np.inf), np.full(n_par, np.inf))
    modes = np.clip(modes, low, high)
    heights = log_density_in_batches(density, modes)
    modes = modes[heights > np.max(heights) - _WITHIN_REACH] if np.any(np.isfinite(heights)) else modes[:1]
    n_mode = len(modes)
    same = Frames(
        density, np.tile(np.arange(n_par), (n_mode, 1)), np.tile(lower_factor(cov), (n_mode, 1, 1)), np.tile(low, (n_mode, 1)),
        np.tile(high, (n_mode, 1)),
    )
    for _ in range(_ROUNDS):
        places = climb(same, modes, 0)
        modes = places.points
        before, same = same, replace(same, factor=lower_factor(np.asarray(np.linalg.inv(places.precisions))))
        if np.allclose(np.linalg.norm(before.factor, axis=2), np.linalg.norm(same.factor, axis=2), rtol=0.1):
            break
    orders = np.array([[axis, *(i for i in range(n_par) if i != axis)] for axis in range(n_par)])
    covs = same.factor @ np.swapaxes(same.factor, 1, 2)
    factors = lower_factor(covs[:, orders[:, :, None], orders[:, None, :]].reshape(-1, n_par, n_par))
    order = np.tile(orders, (n_mode, 1))
    return Frames(density, order, factors, low[order], high[order]), modes[:, orders].reshape(-1, n_par)


def along_ridges(frames: Frames, centres: FloatArray) -> Proposal:
    """Components along the ridges of the first parameter through centres (n, n_par), all followed at once."""
    row, places, log_masses = followed(frames, centres)
    points, at = places.points, frames.rows(row)
    scales = np.zeros(at.factor.shape)
    scales[:, 1:, 1:] = np.linalg.inv(places.precisions)
    first = at.factor[:, 0, 0]
    gaps, slopes = first.copy(), at.factor[:, :, 0].copy()
    for ridge in np.split(np.arange(row.size), np.flatnonzero(np.diff(row)) + 1):
        if ridge.size > 1:
            gaps[ridge], slopes[ridge] = np.gradient(points[ridge, 0]), np.gradient(points[ridge], axis=0)
    scales += _OVERLAP**2 * slopes[:, :, None] * slopes[:, None, :]
    for i, (low, high) in enumerate(zip(at.low.T, at.high.T, strict=True)):  # what lies on a limit has half of its draws beyond
        margin = np.minimum(np.sqrt(scales[:, i, i]), 0.25 * (high - low))
        off = np.clip(points[:, i], low + margin, high - margin) - points[:, i]
        points = points + (off / scales[:, i, i])[:, None] * scales[:, :, i]
    back = np.argsort(at.order, axis=1)
    factors = lower_factor(scales[np.arange(len(back))[:, None, None], back[:, :, None], back[:, None, :]])
    weights = _POWER * log_masses + np.log(np.maximum(gaps, 1e-300) / first)
    return Proposal(np.exp(weights - log_sum_exp(weights)), at.original(points[:, None])[:, 0], factors)


def followed(frames: Frames, centres: FloatArray) -> tuple[IndexArray, Places, FloatArray]:
    """Points of the ridges along the first parameter through centres (n, n_par), both ways at once.

    Returned: (n_point,) the frame of each; the places there, frame by frame, from end to end; their log masses (n_point,) less that of the centre.
    """
    top = measured(frames, centres, 1)
    whose, sense = np.repeat(np.arange(len(centres)), 2), np.tile([-1.0, 1.0], len(centres))
    edge, first = np.where(sense > 0.0, frames.high[whose, 0], frames.low[whose, 0]), frames.factor[whose, 0, 0]
    here, depth, step = centres[whose], np.zeros(whose.size), first.copy()
    slope = frames.factor[whose, :, 0] / first[:, None]  # how the others follow the first
    rows, found, depths = [np.arange(len(centres))], [top], [np.zeros(len(centres))]
    for _ in range(_MOST_STEPS):
        active = np.flatnonzero((np.abs(edge - here[:, 0]) > 1e-12 * first) & (depth < _DEPTH) & (step > _LEAST_STEP * first))
        if active.size == 0:
            break
        own, before = frames.rows(whose[active]), here[active]
        way = sense[active] * np.minimum(step[active], np.abs(edge[active] - before[:, 0]))
        guess = np.clip(before + slope[active] * way[:, None], own.low, own.high)
        places = climb(own, guess, 1)
        deeper = top.log_masses[whose[active]] - places.log_masses
        fall, allowed = deeper - depth[active], _FALL + np.maximum(depth[active], 0.0)
        taken = np.isfinite(fall) & (fall <= 1.5 * allowed)
        where, kept = active[taken], places.rows(taken)
        rows.append(whose[where])
        found.append(kept)
        depths.append(deeper[taken])
        slope[where] = (kept.points - before[taken]) / (kept.points - before[taken])[:, :1]
        here[where], depth[where] = kept.points, deeper[taken]
        with np.errstate(divide="ignore", invalid="ignore"):
            better = np.sqrt(allowed / np.maximum(np.abs(fall), 1e-3))
        step[active] *= np.where(taken, np.clip(better, 0.4, 2.0), np.where(np.isfinite(fall), np.clip(0.8 * better, 0.1, 0.5), 0.25))
    row, places = np.concatenate(rows), Places(*(np.concatenate(parts) for parts in zip(*(vars(one).values() for one in found), strict=True)))
    order = np.lexsort((places.points[:, 0], row))
    return row[order], places.rows(order), -np.concatenate(depths)[order]


def climb(frames: Frames, points: FloatArray, n_held: int) -> Places:
    """Conditional maxima near points (n, n_par), the first `n_held` parameters staying where they are."""
    begun = measured(frames, points, n_held)
    points = _stepped(frames, begun, n_held)
    found = measured(frames, points, n_held, begun.curvatures)
    moved = (points - begun.points)[:, n_held:]
    far = np.flatnonzero(~(np.einsum("ni,nij,nj->n", moved, begun.curvatures, moved) < _NEAR**2))
    if far.size:
        own = frames.rows(far)
        further = measured(own, _stepped(own, measured(own, points[far], n_held), n_held), n_held)
        for name, whole in vars(found).items():
            whole[far] = getattr(further, name)
    return found


def measured(frames: Frames, points: FloatArray, n_held: int, curvatures: FloatArray | None = None) -> Places:
    """The density at points (n, n_par) and about them, the first `n_held` parameters held; curvatures : where they are known."""
    n, n_par = points.shape
    free = slice(n_held, n_par)
    factor, low, high = frames.factor[:, free, free], frames.low[:, free], frames.high[:, free]
    margin = np.minimum(2.0 * _DIFFERENCE * np.sum(np.abs(factor), axis=2), 0.49 * (high - low))
    middle = points.copy()
    middle[:, free] = np.clip(points[:, free], low + margin, high - margin)  # from there no difference goes beyond a limit
    eye, (first, second) = np.eye(n_par - n_held), np.triu_indices(n_par - n_held, 1)
    moves = np.concatenate([eye, -eye])
    if curvatures is None:
        moves = np.concatenate([moves, np.zeros((1, len(eye))), eye[first] + eye[second], -eye[first] - eye[second]])
    stencil = np.repeat(middle[:, None], len(moves), axis=1)
    stencil[:, :, free] += _DIFFERENCE * np.einsum("mj,nij->nmi", moves, factor)
    values = frames.heights(np.concatenate([points[:, None], stencil], axis=1))
    heights, values = values[:, 0], values[:, 1:]
    finite = np.all(np.isfinite(values), axis=1)
    values = np.where(finite[:, None], values, 0.0)
    plus, minus = values[:, : len(eye)], values[:, len(eye) : 2 * len(eye)]
    inverse = np.asarray(np.linalg.inv(factor))
    if curvatures is None:
        centre, pairs = values[:, 2 * len(eye), None], values[:, 2 * len(eye) + 1 :]
        single, both = plus + minus - 2.0 * centre, pairs[:, : first.size] + pairs[:, first.size :] - 2.0 * centre
        curved = np.zeros((n, *eye.shape))
        curved[:, first, second] = curved[:, second, first] = -(both - single[:, first] - single[:, second]) / (2.0 * _DIFFERENCE**2)
        curved -= single[:, :, None] / _DIFFERENCE**2 * eye
        curved[~finite] = eye
        sizes, vectors = np.linalg.eigh(curved)
        positive = (vectors * np.maximum(np.abs(sizes), _LEAST_CURVATURE)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        curvatures = np.swapaxes(inverse, 1, 2) @ positive @ inverse
    slopes = np.einsum("nji,nj->ni", inverse, plus - minus) / (2.0 * _DIFFERENCE)
    slopes -= np.einsum("nij,nj->ni", curvatures, (points - middle)[:, free])
    pressed = ((points[:, free] <= low) & (slopes < 0.0)) | ((points[:, free] >= high) & (slopes > 0.0))
    return Places(points, heights, slopes, np.array(curvatures), pressed)


def _stepped(frames: Frames, at: Places, n_held: int) -> FloatArray:
    """Points (n, n_par) a Newton step higher and within the limits; what is pressed against one stays there."""
    eye = np.eye(at.slopes.shape[1])
    matrix = np.where(at.pressed[:, :, None] | at.pressed[:, None, :], 0.0, at.curvatures) + at.pressed[:, :, None] * eye
    # singular by rounding where two parameters are tied to a dozen digits: each diagonal by its own rounding, whatever the units
    rounding = np.finfo(float).eps * np.diagonal(matrix, axis1=1, axis2=2) + np.finfo(float).tiny
    step = np.linalg.solve(matrix + rounding[:, :, None] * eye, np.where(at.pressed, 0.0, at.slopes)[:, :, None])[:, :, 0]
    size = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", step, matrix, step), 1e-300))
    step *= np.minimum(1.0, _LONGEST / size)[:, None]
    trials = np.repeat(at.points[:, None], len(_SHARES), axis=1)
    trials[:, :, n_held:] += np.array(_SHARES)[:, None] * step[:, None]
    trials = np.clip(trials, frames.low[:, None], frames.high[:, None])
    better = frames.heights(trials) > at.heights[:, None]
    best = trials[np.arange(len(trials)), np.argmax(better, axis=1)]  # the longest way that leads higher
    return np.asarray(np.where(np.any(better, axis=1)[:, None], best, at.points))
