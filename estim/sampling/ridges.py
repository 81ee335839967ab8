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

All paths from a mode advance together (`estim.levenberg_marquardt`), with derivatives by finite
differences: few calls of the density, each with many points.  A path that goes wrong makes the
proposal less efficient, and no result wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray, finite_or, sds_of, squared_rows
from estim.levenberg_marquardt import End, Start, Task, minima, run_descents
from estim.sampling.cholesky import lower_factor
from estim.sampling.log_density import Density, Support, log_density_in_batches
from estim.sampling.proposal import Proposal

_DEPTH = 10.0  # of a path, in log marginal density
_LOWER = 16.0  # of a mode below the highest, in log density: it is left out
# standard deviations; a path whose steps collapse ends before a jump of the density
_MIN_STEP = 1e-2
_MAX_STEPS = 10  # of the search for a point of a path
_DIFFERENCE = 0.01  # step of the finite differences, in standard deviations


@dataclass(frozen=True, eq=False)
class Ridges:
    """-2 log density as an `ObjectiveFunction`.

    cov : (n_par, n_par) a covariance, along whose principal directions it is differentiated.
    low, high : (n_par,) bounds, infinite where there are none.
    tolerance : predicted decrease at which the search for a point of a path ends.
    """

    density: Density
    cov: FloatArray
    low: FloatArray
    high: FloatArray
    tolerance: float = 1e-3

    quasi_newton: ClassVar[bool] = False
    fraction_to_bound: ClassVar[float] = 1.0

    def reach(self, points: FloatArray) -> FloatArray:
        return np.broadcast_to(5.0 * sds_of(self.cov), points.shape)

    def evaluate(self, points: FloatArray, which: IntArray) -> tuple[FloatArray, FloatArray]:
        return points, self.objectives(points)

    def objectives(self, points: FloatArray) -> FloatArray:
        """(n,) at points (n, n_par); inf beyond the bounds."""
        inside = np.all((points >= self.low) & (points <= self.high), axis=1)
        values = np.full(len(points), np.inf)
        # far from the mode a curve may overflow: no density there
        if np.any(inside):
            values[inside] = -2.0 * log_density_in_batches(self.density, points[inside])
        return values

    def derivatives(
        self, points: FloatArray, which: IntArray, curved: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """By finite differences; none where one of them meets no density."""
        factor, eye = lower_factor(self.cov), np.eye(self.low.size)
        first, second = np.triu_indices(self.low.size, 1)
        margin = np.minimum(
            2.0 * _DIFFERENCE * np.sum(np.abs(factor), axis=1), 0.49 * (self.high - self.low)
        )
        # no difference reaches beyond a bound from there
        middle = np.clip(points, self.low + margin, self.high - margin)
        moves = _DIFFERENCE * np.vstack([0.0 * eye[:1], eye, eye[first] + eye[second]]) @ factor.T
        rows = middle[:, None] + np.stack([moves, -moves])[:, None]
        above, below = self.objectives(rows.reshape(-1, len(eye))).reshape(rows.shape[:-1])
        own, both = np.split((above + below - 2.0 * above[:, :1])[:, 1:], [len(eye)], axis=1)
        curvatures = own[:, :, None] * eye
        curvatures[:, first, second] = curvatures[:, second, first] = 0.5 * (
            both - own[:, first] - own[:, second]
        )
        curvatures[~np.all(np.isfinite(curvatures), axis=(1, 2))] = 2.0 * _DIFFERENCE**2 * eye
        sizes, axes = np.linalg.eigh(curvatures / _DIFFERENCE**2)
        axes = np.linalg.inv(factor).T @ axes
        # for the curvatures to be positive
        hessians = (axes * np.maximum(np.abs(sizes), 0.04)[:, None, :]) @ np.swapaxes(axes, 1, 2)
        slopes = finite_or(above - below, 0.0)[:, 1 : 1 + len(eye)] / (2.0 * _DIFFERENCE)
        slopes = slopes @ np.linalg.inv(factor)
        return slopes + np.einsum("nij,nj->ni", hessians, points - middle), hessians

    def precision(self, at: End, fixed: int | None = None) -> FloatArray:
        """(n_par, n_par) of the normal distribution that is as wide as the density is at a point,
        one parameter fixed; at a bound beyond which it rises it falls off exponentially.
        """
        pressed = ((at.values <= self.low) & (at.gradient > 0.0)) | (
            (at.values >= self.high) & (at.gradient < 0.0)
        )
        precision = 0.5 * at.hessian + np.diag(np.where(pressed, 0.5 * at.gradient, 0.0) ** 2)
        if fixed is not None:
            precision[fixed], precision[:, fixed] = 0.0, 0.0
            precision[fixed, fixed] = 1.0
        return precision

    def log_marginal(self, at: End, fixed: int) -> float:
        """Log marginal density of one parameter, up to a constant: the integral over the others, in
        Laplace's approximation.
        """
        return -0.5 * (at.objective + float(np.linalg.slogdet(self.precision(at, fixed))[1]))

    def path(self, mode: End, fixed: int, sign: float) -> Task[list[End]]:
        """Conditional maxima from the mode on, one parameter moved away from it."""
        bound = self.high[fixed] if sign > 0.0 else self.low[fixed]
        width, top = float(np.sqrt(self.cov[fixed, fixed])), self.log_marginal(mode, fixed)
        # how the others follow
        tangent, points, depth, step = self.cov[fixed] / width**2, [mode], 0.0, width
        for _ in range(60):
            point = points[-1].values
            room = abs(float(bound - point[fixed]))
            if not (room > 1e-12 * width and depth < _DEPTH and step > _MIN_STEP * width):
                break
            advance = sign * min(step, room)
            end = yield Start(point + tangent * advance, (fixed,), tolerance=self.tolerance)
            deeper = top - self.log_marginal(end, fixed) if np.any(end.hessian) else np.inf
            # target decrease of the log marginal density in a step at the mode; 1 more for each
            # unit of depth
            decrease, allowed = deeper - depth, 1.5 + max(depth, 0.0)
            factor = float(np.sqrt(allowed / max(abs(decrease), 1e-3)))
            if -np.inf < decrease <= 1.5 * allowed:
                points.append(end)
                tangent, depth = (end.values - point) / advance, deeper
                step *= np.clip(factor, 0.4, 2.0)
            else:
                step *= np.clip(0.8 * factor, 0.1, 0.5)
        return points[1:]

    def proposal(self, mode: End) -> Proposal:
        """Components along the paths of all parameters from a mode, their weights relative to the
        density there.
        """
        sides = [(i, sign) for i in range(self.low.size) for sign in (-1.0, 1.0)]
        ends = run_descents(
            self, [self.path(mode, i, sign) for i, sign in sides], max_steps=_MAX_STEPS
        )
        parts = [
            self.components([*down[::-1], mode, *up], i, len(down))
            for i, (down, up) in enumerate(zip(ends[::2], ends[1::2], strict=True))
        ]
        weights, means, covariances = map(np.concatenate, zip(*parts, strict=True))
        # a width that underflows leaves no place beside a bound
        placed = np.all(np.isfinite(means), axis=1)
        return Proposal(weights[placed], means[placed], lower_factor(covariances[placed]))

    def components(
        self, path: Sequence[End], fixed: int, at_mode: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weights (n,), means (n, n_par) and covariances (n, n_par, n_par) of the components of a
        path.
        """
        points = np.array([end.values for end in path])
        covariances = np.array([np.linalg.inv(self.precision(end, fixed)) for end in path])
        covariances[:, fixed, fixed] = 0.0
        width = np.sqrt(self.cov[fixed, fixed])
        single = self.cov[fixed][None, :] / width
        tangents = np.gradient(points, axis=0) if len(path) > 1 else single
        # standard deviation of a component along its path, over the spacing of the points
        covariances += 0.6**2 * squared_rows(tangents)
        # else half of the draws of a component on a bound would lie beyond it
        for i, (low, high) in enumerate(zip(self.low, self.high, strict=True)):
            margin = np.minimum(np.sqrt(covariances[:, i, i]), 0.25 * (high - low))
            shift = np.clip(points[:, i], low + margin, high - margin) - points[:, i]
            points = points + (shift / covariances[:, i, i])[:, None] * covariances[:, :, i]
        heights = np.array([self.log_marginal(end, fixed) for end in path])
        # exponent of the marginal density in the weights
        tempered = np.exp(np.minimum(0.4 * (heights - heights[at_mode]), 300.0))
        return tempered * tangents[:, fixed] / width, points, covariances


def ridge_proposal(
    density: Density,
    start: FloatArray,
    cov: FloatArray,
    *,
    starts: Sequence[FloatArray] = (),
    support: Support | None = None,
) -> Proposal:
    """Student-t components along the profile paths of `density` from `start` (n_par,), a mode with
    covariance `cov`, and from those of further modes that are not negligible.

    Raises NumericalError where the density is not a number.
    """
    low, high = support or (np.full(start.size, -np.inf), np.full(start.size, np.inf))
    modes = np.clip(np.vstack([start, *starts]), low, high)
    heights = log_density_in_batches(density, modes)
    relevant = modes[np.isfinite(heights) & ~(heights < np.max(heights) - _LOWER)]
    parts = [
        ridges.proposal(mode)
        for ridges, mode in (about_mode(density, at, cov, (low, high)) for at in relevant)
    ]
    if not parts:
        return Proposal.single(start, cov)
    total = sum(float(np.sum(part.weights)) for part in parts)
    return Proposal(
        np.concatenate([part.weights for part in parts]) / total,
        np.vstack([part.means for part in parts]),
        np.concatenate([part.factors for part in parts]),
    )


def about_mode(
    density: Density, mode: FloatArray, cov: FloatArray, support: Support
) -> tuple[Ridges, End]:
    """The ridges from the mode near a point (n_par,), and that mode; its own covariance is found
    from `cov`.
    """
    for _ in range(4):
        ridges = Ridges(density, cov, *support)
        (end,) = minima(ridges, [Start(mode)])
        mode, cov = end.values, np.asarray(np.linalg.inv(ridges.precision(end)))
        if np.allclose(sds_of(cov), sds_of(ridges.cov), rtol=0.1):
            break
    return replace(ridges, cov=cov), end
