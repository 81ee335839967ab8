"""How residuals of a curve that lacks something are formed: as y - f, or for speeds as energies, in
which a force along the track is linear.

    rho = y - u + (u^2 - f^2)/(2 v)

    u    what the speeds are, as far as the data determine them
    v    u, where u is larger than errors of the readings

A force and an energy at release add to the square of the speed whatever the parameters are, so
their response in rho is the same at all draws: also beside a turning point, where that of the speed
diverges, and beyond the place where the curve without them ends (f^2 < 0).  Errors of the readings
stay as they are.  Where the true speed is u', rho = (u'^2 - f^2)/(2 v) - (u' - u)^2/(2 v) + error:
u must be near u', not f.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from estim.arrays import FloatArray
from estim.discrepancy.precomputed_terms import Weight
from estim.problem import (
    Curve,
    LocalCurve,
    Motion,
    Named,
    Points,
    SpeedCurve,
    SquaredCurve,
    StackedPoints,
)

LEAST_SPEED = 1.5  # standard deviations of a reading: slower than this a point counts as so fast

AnyPoints = Points | StackedPoints


@dataclass(frozen=True, eq=False)
class Inertia:
    """Inertia of a body over its weight at a few places x (n,), against `at_fit` (n,)."""

    motion: Motion
    x: FloatArray
    at_fit: FloatArray

    @classmethod
    def of(cls, motion: Motion, x: FloatArray, arguments: Named) -> Inertia:
        places = np.quantile(x, (0.0, 0.5, 1.0))
        return cls(motion, places, _inertias(motion, places, arguments)[0])

    def ratio(self, arguments: Named) -> FloatArray:
        """(n_draw,) on average over the places."""
        return np.mean(_inertias(self.motion, self.x, arguments) / self.at_fit, axis=1)


def _inertias(motion: Motion, x: FloatArray, arguments: Named) -> FloatArray:
    kinetic = motion.energies(x, np.ones(x.size), arguments)[0]
    return np.atleast_2d(kinetic / motion.gravity(arguments))


@dataclass(frozen=True, eq=False)
class _About:
    """A curve of speeds with the derivatives that its energies have about speeds (n_obs,): those of
    f^2/(2 v).
    """

    curve: Curve
    speed: FloatArray

    def value(self, x: FloatArray, arguments: Named) -> FloatArray:
        return self.curve.value(x, arguments)

    def local(self, x: FloatArray, arguments: Named) -> LocalCurve:
        square, double = cast(SquaredCurve, self.curve).local_square(x, arguments), 2.0 * self.speed
        return LocalCurve(
            self.curve.value(x, arguments),
            square.slope / double,
            {name: d / double for name, d in square.gradient.items()},
        )

    def time_derivative(self, x: FloatArray, arguments: Named, order: int) -> FloatArray:
        return cast(SpeedCurve, self.curve).time_derivative(x, arguments, order)


def points_about(points: Points, speed: FloatArray) -> Points:
    """Points that are speeds, whose errors in the position count as they do in energies about
    `speed` (n_obs,).
    """
    return replace(points, curve=_About(points.curve, speed))


@dataclass(frozen=True, eq=False)
class Residuals:
    """shift : (n_obs,) mean of the errors of the readings, unit of y.

    speed : (n_obs,) v where they are energies; None where they are y - f.
    known : (n_obs,) u.
    inertias : of each run of a body with a force.
    scale : of the prior of the force.
    """

    shift: FloatArray
    speed: FloatArray | None = None
    known: FloatArray | float = 0.0
    inertias: tuple[Inertia, ...] = ()
    scale: float = 1.0

    def weight(self, points: AnyPoints, named: Named) -> Weight | None:
        """How a force counts at draws, against how it counts at the fit; None where it counts
        equally.
        """
        if not self.inertias:
            return None
        ratios = [
            inertia.ratio(run.bind(named))
            for inertia, run in zip(self.inertias, points.runs, strict=True)
        ]
        return Weight(np.mean(np.broadcast_arrays(*ratios), axis=0), self.scale, len(points.runs))

    def at(self, points: AnyPoints, named: Named) -> FloatArray:
        """(n_draw, n_obs)."""
        y = points.y - self.shift
        if self.speed is None:
            return y - points.value(named)
        return y - self.known + (np.square(self.known) - points.square(named)) / (2.0 * self.speed)

    def gradient(self, points: AnyPoints, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_obs, n) minus their derivatives in the parameters `names`, for single values: those of
        the curve, where they are y - f.
        """
        if self.speed is None:
            return points.gradient(named, names)
        return points.square_gradient(named, names) / (2.0 * self.speed[:, None])

    def readings(self, points: AnyPoints, named: Named, residuals: FloatArray) -> FloatArray:
        """(n_draw, n_obs) the ordinates that have these residuals."""
        if self.speed is None:
            return points.value(named) + self.shift + residuals
        return (
            residuals
            + self.shift
            + self.known
            - (np.square(self.known) - points.square(named)) / (2.0 * self.speed)
        )


def stacked(each: Sequence[Residuals]) -> Residuals:
    """Of runs below each other, all of speeds or none."""
    shift = np.concatenate([residuals.shift for residuals in each])
    speeds = [residuals.speed for residuals in each if residuals.speed is not None]
    inertias = tuple(inertia for residuals in each for inertia in residuals.inertias)
    if len(speeds) < len(each):
        return Residuals(shift, inertias=inertias, scale=each[0].scale)
    known = np.concatenate(
        [np.broadcast_to(residuals.known, residuals.shift.shape) for residuals in each]
    )
    return Residuals(shift, np.concatenate(speeds), known, inertias, each[0].scale)
