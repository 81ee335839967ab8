"""How residuals of a curve that lacks something are formed: as y - f, or for speeds as energies, in which a force along the track is linear.

    rho = y - v/2 - f^2/(2 v),    v: what the speeds are, as far as the data tell

A force and an energy at release add to the square of the speed whatever the parameters are, so their response in rho is the same at all draws: also
beside a turning point, where that of the speed diverges, and beyond the place where the curve without them ends (f^2 < 0).  Errors of the readings
stay as they are.  With the true speed u, rho = (u^2 - f^2)/(2 v) - (u - v)^2/(2 v) + error: v must be near u, not f.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.deviation.terms import Weight
from estim.problem import Motion, Named, Points, Root, StackedPoints

LEAST_SPEED = 1.5  # standard deviations of a reading: slower than this a point counts as so fast

AnyPoints = Points | StackedPoints


@dataclass(frozen=True, eq=False)
class Inertia:
    """Inertia of a body over its weight at a few places x (n,), against `at_fit` (n,)."""

    motion: Motion
    x: FloatArray
    at_fit: FloatArray

    @classmethod
    def of(cls, motion: Motion, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> Inertia:
        places = np.quantile(x, (0.0, 0.5, 1.0))
        return cls(motion, places, _inertias(motion, places, arguments)[0])

    def ratio(self, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        """(n_draw,) on average over the places."""
        return np.asarray(np.mean(_inertias(self.motion, self.x, arguments) / self.at_fit, axis=1))


def _inertias(motion: Motion, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
    kinetic = motion.energies(x, np.ones(x.size), arguments)[0]
    return np.atleast_2d(kinetic / np.asarray(motion.gravity(arguments)))


@dataclass(frozen=True, eq=False)
class Residuals:
    """shift : (n_obs,) mean of the errors of the readings, unit of y.

    speed : (n_obs,) v where they are energies; None where they are y - f.
    inertias : of each run, where they are energies of bodies with a force.  scale : of the prior of the force.
    """

    shift: FloatArray
    speed: FloatArray | None = None
    inertias: tuple[Inertia, ...] = ()
    scale: float = 1.0

    @classmethod
    def of_speeds(cls, shift: FloatArray, speed: FloatArray, root: Root, inertia: Inertia, *, scale: float) -> Residuals:
        """About the speeds (n_obs,) of a fit; root : of the covariance of the readings."""
        return cls(shift, np.maximum(speed, LEAST_SPEED * np.sqrt(root.variances)), (inertia,), scale)

    def weight(self, points: AnyPoints, named: Named) -> Weight | None:
        """How a force counts at draws, against how it counts at the fit; None where it counts alike."""
        if not self.inertias:
            return None
        runs = points.runs if isinstance(points, StackedPoints) else (points,)
        ratios = [inertia.ratio(run.bind(named)) for inertia, run in zip(self.inertias, runs, strict=True)]
        return Weight(np.mean(np.broadcast_arrays(*ratios), axis=0), self.scale, len(runs))

    def at(self, points: AnyPoints, named: Named) -> FloatArray:
        """(n_draw, n_obs)."""
        y = points.y - self.shift
        if self.speed is None:
            return np.atleast_2d(y - points.value(named))
        return np.atleast_2d(y - 0.5 * self.speed - points.square(named) / (2.0 * self.speed))

    def gradient(self, points: AnyPoints, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_obs, n) minus their derivatives in the parameters `names`, for single values: those of the curve, where they are y - f."""
        if self.speed is None:
            return points.gradient(named, names)
        return points.square_gradient(named, names) / (2.0 * self.speed[:, None])

    def readings(self, points: AnyPoints, named: Named, residuals: FloatArray) -> FloatArray:
        """(n_draw, n_obs) the ordinates that have these residuals."""
        if self.speed is None:
            return np.asarray(points.value(named) + self.shift + residuals)
        return np.asarray(residuals + self.shift + 0.5 * self.speed + points.square(named) / (2.0 * self.speed))


def stacked(each: Sequence[Residuals]) -> Residuals:
    """Of runs below each other, all of speeds or none."""
    shift = np.concatenate([one.shift for one in each])
    speeds = [one.speed for one in each if one.speed is not None]
    if len(speeds) < len(each):
        return Residuals(shift)
    return Residuals(shift, np.concatenate(speeds), tuple(inertia for one in each for inertia in one.inertias), each[0].scale)
