"""A proposal built along the profile paths of a posterior, without a draw: it reaches long tails
and bent ridges.

From each mode every parameter in turn is moved both ways, and all others are re-optimised (as for a
profile likelihood, by continuation), until the marginal density, in Laplace's approximation, has
fallen by e^-10 or a bound is met.  Each point of a path becomes a component of a mixture of
Student-t distributions: as wide as the density is across the path, and as the spacing of the points
along it.  The weights are tempered, so that long tails are drawn often.

The mixture is independent of the adaptive proposal (`estim.sampling.proposal`), and either misses
what the other may find.  Importance weights against the mixture of both (the balance heuristic;
Owen and Zhou, J. Am. Stat. Assoc. 95 (2000) 135) stay bounded where one of them has mass.

All paths advance together, by Newton steps with derivatives by finite differences: few calls of the
density, each with many points.  A path that goes wrong makes the proposal less efficient, and no
result wrong.
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

_DEPTH = 10.0  # of a path, in log marginal density
# target decrease of the log marginal density in a step at the mode; 1 more for each unit of depth
_FALL = 1.5
# standard deviations; a path whose steps collapse ends before a jump of the density
_MIN_STEP = 1e-2
_MAX_STEPS = 60  # of a path, rejected steps included
_TEMPER = 0.4  # exponent of the marginal density in the weights
_OVERLAP = 0.6  # standard deviation of a component along its path, over the spacing of the points
_NEGLIGIBLE = 16.0  # modes lower by more than this, in log density, are left out
_ROUNDS = 4  # of the iteration for the covariance at a mode
_DIFFERENCE = 0.1  # step of the finite differences, in standard deviations
_FRACTIONS = (1.0, 0.3, 0.05)  # of a Newton step, tried in the line search, the longest first
_LONGEST = 4.0  # Newton step, in standard deviations
_NEAR = 0.4  # standard deviations: after a shorter Newton step the curvatures are used again
_LEAST_CURVATURE = 0.02  # of the whitened log density, for its curvatures to be positive


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Local coordinates about n points: the parameters in an order in which the profiled one, which
    may be held, comes first.

    order : (n, n_par) indices of the parameters.
    factor : (n, n_par, n_par) lower Cholesky factors of a covariance there, along whose columns
        finite differences are taken.
    low, high : (n, n_par) bounds, infinite where there are none.  Points (n, n_par) are in this
        order too.
    """

    density: Density
    order: IndexArray
    factor: FloatArray
    low: FloatArray
    high: FloatArray

    def rows(self, which: IndexArray) -> Coordinates:
        """The same for some of the n points."""
        return Coordinates(
            self.density, self.order[which], self.factor[which], self.low[which], self.high[which]
        )

    def original(self, points: FloatArray) -> FloatArray:
        """(n, n_move, n_par) the same points with the parameters in the density's own order."""
        reordered = np.empty_like(points)
        np.put_along_axis(
            reordered, np.broadcast_to(self.order[:, None], points.shape), points, axis=2
        )
        return reordered

    def log_densities(self, points: FloatArray) -> FloatArray:
        """(n, n_move) log density at points (n, n_move, n_par), n_move about each point; -inf
        beyond the bounds.
        """
        inside = np.all((points >= self.low[:, None]) & (points <= self.high[:, None]), axis=2)
        values = np.full(inside.shape, -np.inf)
        if np.any(inside):
            # far from the mode a curve may overflow: no density there
            with np.errstate(all="ignore"):
                values[inside] = log_density_in_batches(self.density, self.original(points)[inside])
        return values


@dataclass(frozen=True, eq=False)
class Expansions:
    """Second-order expansions of the log density about points (n, n_par), in the parameters that
    are not held (n_free of them).

    log_densities : (n,).
    gradients : (n, n_free).  curvatures : (n, n_free, n_free) negative Hessians, made positive
        definite.
    at_bound : (n, n_free) active bounds: the parameter lies on one and the density rises beyond it.
    """

    points: FloatArray
    log_densities: FloatArray
    gradients: FloatArray
    curvatures: FloatArray
    at_bound: NDArray[np.bool_]

    def rows(self, which: IndexArray | NDArray[np.bool_]) -> Expansions:
        """The same for some of the n points."""
        return Expansions(*(part[which] for part in vars(self).values()))

    @property
    def precisions(self) -> FloatArray:
        """(n, n_free, n_free) of the normal distribution of the same width; at an active bound the
        density falls off exponentially.
        """
        steep = np.where(self.at_bound, self.gradients, 0.0)
        return np.asarray(self.curvatures + steep[:, :, None] ** 2 * np.eye(steep.shape[1]))

    @property
    def log_marginals(self) -> FloatArray:
        """(n,) log marginal density: the integral over the parameters that are not held, up to a
        constant (Laplace's approximation).
        """
        return np.asarray(self.log_densities - 0.5 * np.linalg.slogdet(self.precisions)[1])


def ridge_proposal(
    density: Density,
    start: FloatArray,
    cov: FloatArray,
    *,
    starts: Sequence[FloatArray] = (),
    support: Support | None = None,
) -> Proposal:
    """Student-t components along the profile paths of `density` from `start` (n_par,), a mode with
    covariance `cov`, and from further modes.

    Raises NumericalError where the density is not a number.
    """
    return path_proposal(*coordinates_at_modes(density, np.vstack([start, *starts]), cov, support))


def coordinates_at_modes(
    density: Density, modes: FloatArray, cov: FloatArray, support: Support | None
) -> tuple[Coordinates, FloatArray]:
    """Coordinates about those of the modes (n_mode, n_par) that are not negligible, one for each
    parameter in front, and their centres (n, n_par).
    """
    n_par = modes.shape[1]
    low, high = (
        support if support is not None else (np.full(n_par, -np.inf), np.full(n_par, np.inf))
    )
    modes = np.clip(modes, low, high)
    log_densities = log_density_in_batches(density, modes)
    finite = np.isfinite(log_densities)
    if np.any(finite):
        modes, log_densities = modes[finite], log_densities[finite]
        modes = modes[log_densities >= np.max(log_densities) - _NEGLIGIBLE]
    else:
        modes = modes[:1]
    n_mode = len(modes)
    same = Coordinates(
        density,
        np.tile(np.arange(n_par), (n_mode, 1)),
        np.tile(lower_factor(cov), (n_mode, 1, 1)),
        np.tile(low, (n_mode, 1)),
        np.tile(high, (n_mode, 1)),
    )
    for _ in range(_ROUNDS):
        expansions = conditional_maxima(same, modes, 0)
        modes = expansions.points
        before = same
        same = replace(same, factor=lower_factor(np.asarray(np.linalg.inv(expansions.precisions))))
        if np.allclose(
            np.linalg.norm(before.factor, axis=2), np.linalg.norm(same.factor, axis=2), rtol=0.1
        ):
            break
    orders = np.array([[axis, *(i for i in range(n_par) if i != axis)] for axis in range(n_par)])
    covs = same.factor @ np.swapaxes(same.factor, 1, 2)
    factors = lower_factor(
        covs[:, orders[:, :, None], orders[:, None, :]].reshape(-1, n_par, n_par)
    )
    order = np.tile(orders, (n_mode, 1))
    return Coordinates(density, order, factors, low[order], high[order]), modes[:, orders].reshape(
        -1, n_par
    )


def path_proposal(coordinates: Coordinates, centres: FloatArray) -> Proposal:
    """Components along the profile paths of the first parameter from centres (n, n_par)."""
    row, expansions, log_marginals = profile_paths(coordinates, centres)
    points, at = expansions.points, coordinates.rows(row)
    covariances = np.zeros(at.factor.shape)
    covariances[:, 1:, 1:] = np.linalg.inv(expansions.precisions)
    width = at.factor[:, 0, 0]
    spacing, tangents = width.copy(), at.factor[:, :, 0].copy()
    for path in np.split(np.arange(row.size), np.flatnonzero(np.diff(row)) + 1):
        if path.size > 1:
            spacing[path], tangents[path] = (
                np.gradient(points[path, 0]),
                np.gradient(points[path], axis=0),
            )
    covariances += _OVERLAP**2 * tangents[:, :, None] * tangents[:, None, :]
    # else half of the draws of a component on a bound would lie beyond it
    for i, (low, high) in enumerate(zip(at.low.T, at.high.T, strict=True)):
        margin = np.minimum(np.sqrt(covariances[:, i, i]), 0.25 * (high - low))
        shift = np.clip(points[:, i], low + margin, high - margin) - points[:, i]
        points = points + (shift / covariances[:, i, i])[:, None] * covariances[:, :, i]
    back = np.argsort(at.order, axis=1)
    factors = lower_factor(
        covariances[np.arange(len(back))[:, None, None], back[:, :, None], back[:, None, :]]
    )
    weights = _TEMPER * log_marginals + np.log(np.maximum(spacing, 1e-300) / width)
    return Proposal(
        np.exp(weights - log_sum_exp(weights)), at.original(points[:, None])[:, 0], factors
    )


def profile_paths(
    coordinates: Coordinates, centres: FloatArray
) -> tuple[IndexArray, Expansions, FloatArray]:
    """Points of the profile paths of the first parameter from centres (n, n_par), both ways at
    once.

    Returned: (n_point,) the index of the centre of each; the expansions there, path by path, from
    end to end; their log marginal densities (n_point,) less that at the centre.
    """
    at_mode = expanded(coordinates, centres, 1)
    centre, direction = np.repeat(np.arange(len(centres)), 2), np.tile([-1.0, 1.0], len(centres))
    bound = np.where(direction > 0.0, coordinates.high[centre, 0], coordinates.low[centre, 0])
    width = coordinates.factor[centre, 0, 0]
    here, depth, step = centres[centre], np.zeros(centre.size), width.copy()
    tangent = coordinates.factor[centre, :, 0] / width[:, None]  # how the others follow the first
    rows, batches, depths = [np.arange(len(centres))], [at_mode], [np.zeros(len(centres))]
    for _ in range(_MAX_STEPS):
        active = np.flatnonzero(
            (np.abs(bound - here[:, 0]) > 1e-12 * width)
            & (depth < _DEPTH)
            & (step > _MIN_STEP * width)
        )
        if active.size == 0:
            break
        there, before = coordinates.rows(centre[active]), here[active]
        advance = direction[active] * np.minimum(step[active], np.abs(bound[active] - before[:, 0]))
        guess = np.clip(before + tangent[active] * advance[:, None], there.low, there.high)
        expansions = conditional_maxima(there, guess, 1)
        new_depth = at_mode.log_marginals[centre[active]] - expansions.log_marginals
        decrease, allowed = new_depth - depth[active], _FALL + np.maximum(depth[active], 0.0)
        accepted = np.isfinite(decrease) & (decrease <= 1.5 * allowed)
        path, reached = active[accepted], expansions.rows(accepted)
        rows.append(centre[path])
        batches.append(reached)
        depths.append(new_depth[accepted])
        tangent[path] = (reached.points - before[accepted]) / (reached.points - before[accepted])[
            :, :1
        ]
        here[path], depth[path] = reached.points, new_depth[accepted]
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.sqrt(allowed / np.maximum(np.abs(decrease), 1e-3))
        step[active] *= np.where(
            accepted,
            np.clip(factor, 0.4, 2.0),
            np.where(np.isfinite(decrease), np.clip(0.8 * factor, 0.1, 0.5), 0.25),
        )
    row = np.concatenate(rows)
    expansions = Expansions(
        *(
            np.concatenate(parts)
            for parts in zip(*(vars(batch).values() for batch in batches), strict=True)
        )
    )
    order = np.lexsort((expansions.points[:, 0], row))
    return row[order], expansions.rows(order), -np.concatenate(depths)[order]


def conditional_maxima(coordinates: Coordinates, points: FloatArray, n_held: int) -> Expansions:
    """Conditional maxima near points (n, n_par), the first `n_held` parameters staying where they
    are.
    """
    begun = expanded(coordinates, points, n_held)
    points = _newton_step(coordinates, begun, n_held)
    maxima = expanded(coordinates, points, n_held, begun.curvatures)
    moved = (points - begun.points)[:, n_held:]
    far = np.flatnonzero(~(np.einsum("ni,nij,nj->n", moved, begun.curvatures, moved) < _NEAR**2))
    if far.size:
        subset = coordinates.rows(far)
        further = expanded(
            subset, _newton_step(subset, expanded(subset, points[far], n_held), n_held), n_held
        )
        for name, whole in vars(maxima).items():
            whole[far] = getattr(further, name)
    return maxima


def expanded(
    coordinates: Coordinates, points: FloatArray, n_held: int, curvatures: FloatArray | None = None
) -> Expansions:
    """Expansions about points (n, n_par) by finite differences, the first `n_held` parameters held.
    curvatures : where they are known.
    """
    n, n_par = points.shape
    free = slice(n_held, n_par)
    factor = coordinates.factor[:, free, free]
    low = coordinates.low[:, free]
    high = coordinates.high[:, free]
    margin = np.minimum(2.0 * _DIFFERENCE * np.sum(np.abs(factor), axis=2), 0.49 * (high - low))
    middle = points.copy()
    # no difference reaches beyond a bound from there
    middle[:, free] = np.clip(points[:, free], low + margin, high - margin)
    eye, (first, second) = np.eye(n_par - n_held), np.triu_indices(n_par - n_held, 1)
    moves = np.concatenate([eye, -eye])
    if curvatures is None:
        moves = np.concatenate(
            [moves, np.zeros((1, len(eye))), eye[first] + eye[second], -eye[first] - eye[second]]
        )
    stencil = np.repeat(middle[:, None], len(moves), axis=1)
    stencil[:, :, free] += _DIFFERENCE * np.einsum("mj,nij->nmi", moves, factor)
    values = coordinates.log_densities(np.concatenate([points[:, None], stencil], axis=1))
    log_densities, values = values[:, 0], values[:, 1:]
    finite = np.all(np.isfinite(values), axis=1)
    values = np.where(finite[:, None], values, 0.0)
    plus, minus = values[:, : len(eye)], values[:, len(eye) : 2 * len(eye)]
    inverse = np.asarray(np.linalg.inv(factor))
    if curvatures is None:
        centre, pairs = values[:, 2 * len(eye), None], values[:, 2 * len(eye) + 1 :]
        single = plus + minus - 2.0 * centre
        both = pairs[:, : first.size] + pairs[:, first.size :] - 2.0 * centre
        curved = np.zeros((n, *eye.shape))
        curved[:, first, second] = curved[:, second, first] = -(
            both - single[:, first] - single[:, second]
        ) / (2.0 * _DIFFERENCE**2)
        curved -= single[:, :, None] / _DIFFERENCE**2 * eye
        curved[~finite] = eye
        sizes, vectors = np.linalg.eigh(curved)
        positive = (
            vectors * np.maximum(np.abs(sizes), _LEAST_CURVATURE)[:, None, :]
        ) @ np.swapaxes(vectors, 1, 2)
        curvatures = np.swapaxes(inverse, 1, 2) @ positive @ inverse
    gradients = np.einsum("nji,nj->ni", inverse, plus - minus) / (2.0 * _DIFFERENCE)
    gradients -= np.einsum("nij,nj->ni", curvatures, (points - middle)[:, free])
    at_bound = ((points[:, free] <= low) & (gradients < 0.0)) | (
        (points[:, free] >= high) & (gradients > 0.0)
    )
    return Expansions(points, log_densities, gradients, np.array(curvatures), at_bound)


def _newton_step(coordinates: Coordinates, at: Expansions, n_held: int) -> FloatArray:
    """Points (n, n_par) after a Newton step with a line search, within the bounds; parameters at
    active bounds stay there.
    """
    eye = np.eye(at.gradients.shape[1])
    matrix = (
        np.where(at.at_bound[:, :, None] | at.at_bound[:, None, :], 0.0, at.curvatures)
        + at.at_bound[:, :, None] * eye
    )
    # singular by rounding where two parameters are tied to a dozen digits: each diagonal by its own
    # rounding, whatever the units
    rounding = np.finfo(float).eps * np.diagonal(matrix, axis1=1, axis2=2) + np.finfo(float).tiny
    step = np.linalg.solve(
        matrix + rounding[:, :, None] * eye, np.where(at.at_bound, 0.0, at.gradients)[:, :, None]
    )[:, :, 0]
    size = np.sqrt(np.maximum(np.einsum("ni,nij,nj->n", step, matrix, step), 1e-300))
    step *= np.minimum(1.0, _LONGEST / size)[:, None]
    trials = np.repeat(at.points[:, None], len(_FRACTIONS), axis=1)
    trials[:, :, n_held:] += np.array(_FRACTIONS)[:, None] * step[:, None]
    trials = np.clip(trials, coordinates.low[:, None], coordinates.high[:, None])
    better = coordinates.log_densities(trials) > at.log_densities[:, None]
    # the longest fraction that leads higher
    best = trials[np.arange(len(trials)), np.argmax(better, axis=1)]
    return np.asarray(np.where(np.any(better, axis=1)[:, None], best, at.points))
