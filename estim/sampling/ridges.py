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

from estim.arrays import BoolArray, FloatArray, IntArray, log_sum_exp, squared_rows
from estim.sampling.cholesky import lower_factor
from estim.sampling.log_density import Density, Support, log_density_in_batches
from estim.sampling.proposal import Proposal

_DEPTH = 10.0  # of a path, in log marginal density
# standard deviations; a path whose steps collapse ends before a jump of the density
_MIN_STEP = 1e-2
_DIFFERENCE = 0.1  # step of the finite differences, in standard deviations


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Local coordinates about n points, in each of which one parameter may be held.

    held : (n,) which; -1 for none.
    factor : (n, n_par, n_par) lower Cholesky factors of a covariance there given that parameter,
        along whose columns finite differences are taken; its own is its standard deviation.
    slope : (n, n_par) how all parameters follow it.
    low, high : (n_par,) bounds, infinite where there are none.
    """

    density: Density
    held: IntArray
    factor: FloatArray
    slope: FloatArray
    low: FloatArray
    high: FloatArray

    def rows(self, which: IntArray) -> Coordinates:
        """The same for some of the n points."""
        return replace(
            self, held=self.held[which], factor=self.factor[which], slope=self.slope[which]
        )

    @property
    def mask(self) -> BoolArray:
        """(n, n_par) True for the parameter that is held."""
        return np.arange(self.low.size) == self.held[:, None]

    @property
    def width(self) -> FloatArray:
        """(n,) standard deviation of the parameter that is held."""
        return self.factor[np.arange(self.held.size), self.held, self.held]

    def place(self, points: FloatArray) -> FloatArray:
        """(n,) value of the parameter that is held, of points (n, n_par)."""
        return points[np.arange(self.held.size), self.held]

    def log_densities(self, points: FloatArray) -> FloatArray:
        """(n, n_move) log density at points (n, n_move, n_par), n_move about each point; -inf
        beyond the bounds.
        """
        inside = np.all((points >= self.low) & (points <= self.high), axis=2)
        values = np.full(inside.shape, -np.inf)
        if np.any(inside):
            # far from the mode a curve may overflow: no density there
            with np.errstate(all="ignore"):
                values[inside] = log_density_in_batches(self.density, points[inside])
        return values


@dataclass(frozen=True, eq=False)
class Expansions:
    """Second-order expansions of the log density about points (n, n_par), in the parameters that
    are not held.

    log_densities : (n,).
    gradients : (n, n_par), 0 for a held parameter.  curvatures : (n, n_par, n_par) negative
        Hessians, made positive definite; a held parameter has its standard deviation.
    at_bound : (n, n_par) active bounds: the parameter lies on one and the density rises beyond it.
    """

    points: FloatArray
    log_densities: FloatArray
    gradients: FloatArray
    curvatures: FloatArray
    at_bound: BoolArray

    def rows(self, which: IntArray | BoolArray) -> Expansions:
        """The same for some of the n points."""
        return Expansions(*(part[which] for part in vars(self).values()))

    @property
    def precisions(self) -> FloatArray:
        """(n, n_par, n_par) of the normal distribution of the same width; at an active bound the
        density falls off exponentially.
        """
        steep = np.where(self.at_bound, self.gradients, 0.0)
        return self.curvatures + steep[:, :, None] ** 2 * np.eye(steep.shape[1])

    @property
    def log_marginals(self) -> FloatArray:
        """(n,) log marginal density: the integral over the parameters that are not held, up to a
        constant (Laplace's approximation).
        """
        return self.log_densities - 0.5 * np.linalg.slogdet(self.precisions)[1]


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
    parameter that is held, and their centres (n, n_par).
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
        # modes lower by more are left out
        modes = modes[log_densities >= np.max(log_densities) - 16.0]
    else:
        modes = modes[:1]
    n_mode = len(modes)
    factor = np.tile(lower_factor(cov), (n_mode, 1, 1))
    for _ in range(4):
        free = Coordinates(density, np.full(n_mode, -1), factor, np.zeros_like(modes), low, high)
        expansions = conditional_maxima(free, modes)
        modes = expansions.points
        factor = lower_factor(np.asarray(np.linalg.inv(expansions.precisions)))
        if np.allclose(
            np.linalg.norm(free.factor, axis=2), np.linalg.norm(factor, axis=2), rtol=0.1
        ):
            break
    eye = np.eye(n_par)
    covs = np.repeat(factor @ np.swapaxes(factor, 1, 2), n_par, axis=0)
    held = np.tile(np.arange(n_par), n_mode)
    own = covs[np.arange(held.size), held, held]
    slope = covs[np.arange(held.size), held] / own[:, None]
    given = covs - own[:, None, None] * squared_rows(slope)
    one = eye[held]
    factors = lower_factor(squared_rows(1.0 - one) * given + own[:, None, None] * squared_rows(one))
    return Coordinates(density, held, factors, slope, low, high), np.repeat(modes, n_par, axis=0)


def path_proposal(coordinates: Coordinates, centres: FloatArray) -> Proposal:
    """Components along the profile paths of the held parameter from centres (n, n_par)."""
    row, expansions, log_marginals = profile_paths(coordinates, centres)
    points, at = expansions.points, coordinates.rows(row)
    covariances: FloatArray = np.asarray(np.linalg.inv(expansions.precisions), dtype=np.float64)
    covariances[np.arange(row.size), at.held, at.held] = 0.0
    spacing, tangents = at.width.copy(), at.width[:, None] * at.slope
    for path in np.split(np.arange(row.size), np.flatnonzero(np.diff(row)) + 1):
        if path.size > 1:
            tangents[path] = np.gradient(points[path], axis=0)
            spacing[path] = tangents[path, at.held[path]]
    # standard deviation of a component along its path, over the spacing of the points
    covariances += 0.6**2 * squared_rows(tangents)
    # else half of the draws of a component on a bound would lie beyond it
    for i, (low, high) in enumerate(zip(at.low, at.high, strict=True)):
        margin = np.minimum(np.sqrt(covariances[:, i, i]), 0.25 * (high - low))
        shift = np.clip(points[:, i], low + margin, high - margin) - points[:, i]
        points = points + (shift / covariances[:, i, i])[:, None] * covariances[:, :, i]
    # exponent of the marginal density in the weights
    weights = 0.4 * log_marginals + np.log(np.maximum(spacing, 1e-300) / at.width)
    return Proposal(np.exp(weights - log_sum_exp(weights)), points, lower_factor(covariances))


def profile_paths(
    coordinates: Coordinates, centres: FloatArray
) -> tuple[IntArray, Expansions, FloatArray]:
    """Points of the profile paths of the held parameter from centres (n, n_par), both ways at once.

    Returned: (n_point,) the index of the centre of each; the expansions there, path by path, from
    end to end; their log marginal densities (n_point,) less that at the centre.
    """
    at_mode = expanded(coordinates, centres)
    centre, direction = np.repeat(np.arange(len(centres)), 2), np.tile([-1.0, 1.0], len(centres))
    sides = coordinates.rows(centre)
    bound = np.where(direction > 0.0, sides.high[sides.held], sides.low[sides.held])
    here, depth, step = centres[centre], np.zeros(centre.size), sides.width.copy()
    tangent = sides.slope.copy()  # how the others follow the held one
    rows, batches, depths = [np.arange(len(centres))], [at_mode], [np.zeros(len(centres))]
    for _ in range(60):
        room = np.abs(bound - sides.place(here))
        active = np.flatnonzero(
            (room > 1e-12 * sides.width) & (depth < _DEPTH) & (step > _MIN_STEP * sides.width)
        )
        if active.size == 0:
            break
        there, before = sides.rows(active), here[active]
        advance = direction[active] * np.minimum(step[active], room[active])
        guess = np.clip(before + tangent[active] * advance[:, None], there.low, there.high)
        expansions = conditional_maxima(there, guess)
        new_depth = at_mode.log_marginals[centre[active]] - expansions.log_marginals
        # target decrease of the log marginal density in a step at the mode; 1 more for each unit of
        # depth
        decrease, allowed = new_depth - depth[active], 1.5 + np.maximum(depth[active], 0.0)
        accepted = np.isfinite(decrease) & (decrease <= 1.5 * allowed)
        path, reached = active[accepted], expansions.rows(accepted)
        rows.append(centre[path])
        batches.append(reached)
        depths.append(new_depth[accepted])
        moved = reached.points - before[accepted]
        tangent[path] = moved / sides.rows(path).place(moved)[:, None]
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
    order = np.lexsort((coordinates.rows(row).place(expansions.points), row))
    return row[order], expansions.rows(order), -np.concatenate(depths)[order]


def conditional_maxima(coordinates: Coordinates, points: FloatArray) -> Expansions:
    """Conditional maxima near points (n, n_par); what is held stays where it is."""
    begun = expanded(coordinates, points)
    points = _newton_step(coordinates, begun)
    maxima = expanded(coordinates, points, begun.curvatures)
    moved = points - begun.points
    # after a shorter Newton step the curvatures are used again
    far = np.flatnonzero(~(np.einsum("ni,nij,nj->n", moved, begun.curvatures, moved) < 0.4**2))
    if far.size:
        subset = coordinates.rows(far)
        further = expanded(subset, _newton_step(subset, expanded(subset, points[far])))
        for name, whole in vars(maxima).items():
            whole[far] = getattr(further, name)
    return maxima


def expanded(
    coordinates: Coordinates, points: FloatArray, curvatures: FloatArray | None = None
) -> Expansions:
    """Expansions about points (n, n_par) by finite differences.  curvatures : where they are
    known.
    """
    low, high, held = coordinates.low, coordinates.high, coordinates.mask
    steps = _DIFFERENCE * np.where(held[:, None, :], 0.0, coordinates.factor)
    margin = np.minimum(2.0 * np.sum(np.abs(steps), axis=2), 0.49 * (high - low))
    # no difference reaches beyond a bound from there
    middle = np.clip(points, low + margin, high - margin)
    eye, (first, second) = np.eye(low.size), np.triu_indices(low.size, 1)
    moves = np.concatenate([eye, -eye])
    if curvatures is None:
        moves = np.concatenate(
            [moves, np.zeros((1, len(eye))), eye[first] + eye[second], -eye[first] - eye[second]]
        )
    stencil = middle[:, None] + np.einsum("mj,nij->nmi", moves, steps)
    values = coordinates.log_densities(np.concatenate([points[:, None], stencil], axis=1))
    log_densities, values = values[:, 0], values[:, 1:]
    finite = np.all(np.isfinite(values), axis=1)
    values = np.where(finite[:, None], values, 0.0)
    plus, minus = values[:, : len(eye)], values[:, len(eye) : 2 * len(eye)]
    inverse = np.linalg.inv(coordinates.factor)
    if curvatures is None:
        centre, pairs = values[:, 2 * len(eye), None], values[:, 2 * len(eye) + 1 :]
        single = plus + minus - 2.0 * centre
        both = pairs[:, : first.size] + pairs[:, first.size :] - 2.0 * centre
        curved = (held - single / _DIFFERENCE**2)[:, :, None] * eye
        curved[:, first, second] = curved[:, second, first] = -(
            both - single[:, first] - single[:, second]
        ) / (2.0 * _DIFFERENCE**2)
        curved[~finite] = eye
        sizes, vectors = np.linalg.eigh(curved)
        # for the curvatures to be positive
        positive = (vectors * np.maximum(np.abs(sizes), 0.02)[:, None, :]) @ np.swapaxes(
            vectors, 1, 2
        )
        curvatures = np.swapaxes(inverse, 1, 2) @ positive @ inverse
    gradients = np.einsum("nji,nj->ni", inverse, plus - minus) / (2.0 * _DIFFERENCE)
    gradients -= np.einsum("nij,nj->ni", curvatures, points - middle)
    at_bound = ((points <= low) & (gradients < 0.0)) | ((points >= high) & (gradients > 0.0))
    return Expansions(points, log_densities, gradients, np.array(curvatures), at_bound)


def _newton_step(coordinates: Coordinates, at: Expansions) -> FloatArray:
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
    step *= np.minimum(1.0, 4.0 / size)[:, None]
    # of a Newton step, the longest first
    trials = np.clip(
        at.points[:, None] + np.array((1.0, 0.3, 0.05))[:, None] * step[:, None],
        coordinates.low,
        coordinates.high,
    )
    better = coordinates.log_densities(trials) > at.log_densities[:, None]
    # the longest fraction that leads higher
    best = trials[np.arange(len(trials)), np.argmax(better, axis=1)]
    return np.where(np.any(better, axis=1)[:, None], best, at.points)
