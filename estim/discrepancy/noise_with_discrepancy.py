"""Noise with what the curve lacks beside it: first a free start alone, then, made at the fit with
that, an unmodelled force.

Everything that concerns readings is delegated to the noise that was stated, `base`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from estim.arrays import FloatArray
from estim.common import phrase
from estim.discrepancy.bad_frame_search import NONE, BadFrames
from estim.discrepancy.likelihood import MixtureErrors
from estim.discrepancy.mixture_likelihood import Mixture
from estim.discrepancy.residuals import LEAST_SPEED, Inertia, Residuals, points_about
from estim.discrepancy.trajectory import Trajectory
from estim.problem import (
    GaussianErrors,
    Likelihood,
    Named,
    Noise,
    NoiseVariance,
    Points,
    Root,
    Wording,
    with_columns,
)

_REST = 1e-3  # of the largest speed: slower is at rest


@dataclass(frozen=True, eq=False)
class Stated(Noise):
    """Normal errors about exact abscissas; delegates to the noise that was stated, `base`."""

    base: Noise

    @property
    def size(self) -> NoiseVariance:
        return self.base.size

    @property
    def made_of_positions(self) -> bool:
        return self.base.made_of_positions

    def of_positions(self, points: Points, named: Named) -> csr_array | None:
        return self.base.of_positions(points, named)

    def read(
        self, true: FloatArray, gain: FloatArray, named: Named, rng: np.random.Generator
    ) -> FloatArray:
        return self.base.read(true, gain, named, rng)

    def carried(
        self, by_x: FloatArray, by_y: FloatArray, named: Named
    ) -> tuple[FloatArray, FloatArray]:
        return self.base.carried(by_x, by_y, named)

    def reading_gain(self) -> FloatArray:
        return self.base.reading_gain()

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        return self.base.describe(x_unit=x_unit, y_unit=y_unit, words=words)


@dataclass(frozen=True, eq=False)
class FreeStart(Stated):
    """Stated noise, and an energy at release that is not quite 0: one more term of rank one in the
    covariance, and one for each bad frame.

    bad : the frames.
    """

    trajectory: Trajectory
    bad: BadFrames

    def likelihood(self, points: Points, named: Named) -> GaussianErrors:
        points = self.bad.moved(points)
        stated = normal_covariance(self.base, points, named)
        about = formed_about(self.trajectory, self.base, points, named, scale=None)[0].speed
        columns = np.column_stack(
            [
                self.trajectory.along(points, named, self.base, about=about).push,
                self.bad.columns(points.x.size),
            ]
        )
        return GaussianErrors.rooted(points, with_columns(stated.root, columns), stated.shift)


@dataclass(frozen=True, eq=False)
class WithMixture(Stated):
    """Stated noise together with what the curve lacks, as a mixture that stays as it is.

    mixture, likely, formed : of `MixtureErrors`.
    lacking : what the curve may lack, any of these, in words for a reader.
    bad : frames that are shifted.
    sized : whether the size of the errors was stated.
    """

    mixture: Mixture
    likely: Root
    formed: Residuals
    lacking: tuple[str, ...] = ()
    bad: BadFrames = NONE
    sized: bool = True

    def likelihood(self, points: Points, named: Named) -> MixtureErrors:
        return MixtureErrors(self.bad.moved(points), self.mixture, self.likely, self.formed)

    def for_search(self) -> Noise:
        """The stated noise alone."""
        return self.base

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        stated = self.base.describe(x_unit=x_unit, y_unit=y_unit, words=words)
        if not self.sized:
            stated = phrase(
                "errors of {what}, marginalised over their size", what=phrase(words.what)
            )
        what = phrase(" or ").join(map(phrase, self.lacking))
        return phrase("{stated}; in addition, {what}", stated=stated, what=what) if what else stated


@dataclass(frozen=True, eq=False)
class ShiftedErrors:
    """root : of the covariance of normal errors.  shift : (n_obs,) their mean."""

    root: Root
    shift: FloatArray


def formed_about(
    trajectory: Trajectory,
    base: Noise,
    points: Points,
    named: Named,
    *,
    scale: float | None,
    speed: FloatArray | None = None,
) -> tuple[Residuals, ShiftedErrors]:
    """How residuals are formed for a fit with the values `named`, and the stated errors of such
    residuals.

    scale : of the prior of the force; None without one.
    speed : (n_obs,) where more is known of the speeds than by the curve.
    """
    curve_speed = trajectory.speed(points, named, base)
    if curve_speed is None:
        stated = normal_covariance(base, points, named)
        inertias, scale = _inertias(trajectory, points.y, points, named, scale)
        return Residuals(stated.shift, inertias=inertias, scale=scale), stated
    # the readings: of a body that stays where it is
    rest = _REST * (np.max(curve_speed) or np.max(np.abs(points.y)))
    slow = base.likelihood(points_about(points, np.maximum(curve_speed, rest)), named)
    known = curve_speed if speed is None else np.maximum(speed, 0.0)
    about = np.maximum(known, LEAST_SPEED * slow.sd(named))
    stated = normal_covariance(base, points_about(points, about), named)
    return Residuals(
        stated.shift, about, known, *_inertias(trajectory, points.x, points, named, scale)
    ), stated


def _inertias(
    trajectory: Trajectory, places: FloatArray, points: Points, named: Named, scale: float | None
) -> tuple[tuple[Inertia, ...], float]:
    """Those of a run with a force, and the scale of its prior."""
    if scale is None:
        return (), 1.0
    return (Inertia.of(trajectory.motion, places, points.bind(named)),), scale


def normal_covariance(base: Noise, points: Points, named: Named) -> ShiftedErrors:
    """The stated errors at the values `named`; they must be normal."""
    likelihood: Likelihood = base.likelihood(points, named)
    assert likelihood.normal is not None, "tested where a campaign is read"
    return ShiftedErrors(likelihood.normal.root(named), points.y - likelihood.y)
