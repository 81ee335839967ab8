"""The noise of readings y of a user's own curve: independent errors, or a full covariance matrix.

`Readings` says nothing new but words; `Correlated` takes the covariance of all readings as it was
stated.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, Named, sds_of
from estim.common import InputError, phrase
from estim.given_numbers import finite_numbers
from estim.problem.correlated_normal import GaussianErrors
from estim.problem.curve import Wording
from estim.problem.errors_in_x_quadrature import correlated_abscissas
from estim.problem.likelihood import Noise, Points
from estim.problem.noise import Independent, scatter_words
from estim.problem.noise_variance import NoiseVariance, Scale
from estim.problem.roots import root_of


@dataclass(frozen=True, eq=False)
class Readings(Independent):
    """Independent errors of readings; `what` is read ("temperature").  stated_as :
    how their size was stated, in words, where it is a share of y.
    """

    what: str = field(default="y", kw_only=True)
    stated_as: str = field(default="", kw_only=True)

    def of_size(self, sigma: Scale) -> Readings:
        return replace(self, sigma=sigma)

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        """The noise in words."""
        y_unit = "" if y_unit == "1" else y_unit
        if self.sigma.parameter is not None:
            size = phrase("their standard deviation {name} is inferred", name=self.sigma.parameter)
        elif self.stated_as:
            size = self.stated_as
        elif np.ptp(self.relative) > 0.0:
            size = phrase("standard deviations as stated row by row")
        else:
            size = phrase(
                "standard deviation {size:.4g} {unit}",
                size=self.sigma.value * self.relative[0],
                unit=y_unit,
            ).rstrip()
        further = f"; {shape}" if (shape := self.tails.describe()) else ""
        if self.relative_x is not None:
            further = _errors_of_x(self.relative_x, x_unit) + further
        return (
            phrase("independent errors of {what}; {size}", what=self.what, size=size)
            + scatter_words(self.scatter, self.what, y_unit)
            + further
        )


@dataclass(frozen=True, eq=False)
class Correlated(Noise):
    """Readings with a stated covariance matrix; `what` is read.

    cov : (n_obs, n_obs).  cov_x : the same of the errors of x, None where these are exact.

    With errors of x, the curve is taken as straight near the expected true abscissas: y is normal
    about it, and the remaining errors of x, times the slope, add to the covariance.  For a line
    this is exact (`estim.problem.errors_in_x_quadrature`: regression calibration).
    """

    cov: FloatArray
    what: str = "y"
    cov_x: FloatArray | None = None

    size = NoiseVariance(Scale(1.0))

    def likelihood(self, points: Points, named: Named) -> GaussianErrors:
        cov = self.cov
        if self.cov_x is not None:
            centre, spread, common = correlated_abscissas(points.x, self.cov_x)
            points = replace(points, x=centre)
            slope = points.slope(named)
            # at a start that is far off it may be anything
            # slope of a curve over the ranges of y and x, beyond which no fit ends
            steepest = 1e4 * (np.ptp(points.y) + np.sqrt(np.max(cov))) / np.ptp(points.x)
            slope = np.nan_to_num(np.clip(slope, -steepest, steepest))[:, None]
            cov = cov + slope * spread * slope.T + (slope * common) @ (slope * common).T
        return GaussianErrors.rooted(points, root_of(cov), np.zeros(points.x.size))

    @property
    def holds_slopes(self) -> bool:  # type: ignore[override]
        return self.cov_x is not None

    def for_search(self) -> Correlated:
        """Without its errors of x."""
        return self if self.cov_x is None else replace(self, cov_x=None)

    def x_gain(self) -> FloatArray:
        return sds_of(np.zeros_like(self.cov) if self.cov_x is None else self.cov_x)

    def reading_gain(self) -> FloatArray:
        return sds_of(self.cov)

    def read(
        self, true: FloatArray, gain: FloatArray, named: Named, rng: np.random.Generator
    ) -> FloatArray:
        """Of the points that the matrix is stated for; `gain` is in it."""
        return true + np.linalg.cholesky(self.cov) @ rng.standard_normal(true.size)

    def carried(
        self, by_x: FloatArray, by_y: FloatArray, named: Named
    ) -> tuple[FloatArray, FloatArray]:
        return by_y[:, None] * self.cov * by_y, np.diag(self.cov)

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        """The noise in words."""
        y_unit = "" if y_unit == "1" else y_unit
        size = phrase(
            "standard deviations about {size:.4g} {unit}",
            size=float(np.median(self.reading_gain())),
            unit=y_unit,
        ).strip()
        stated = phrase(
            "correlated errors of {what} with the stated covariance matrix; {size}",
            what=self.what,
            size=size,
        )
        return stated + ("" if self.cov_x is None else _errors_of_x(self.x_gain(), x_unit))


def _errors_of_x(sizes: FloatArray, unit: str) -> str:
    return phrase(
        "; errors of x with a standard deviation of about {size:.4g} {unit}",
        size=float(np.median(sizes)),
        unit="" if unit == "1" else unit,
    ).rstrip()


def check_covariance(
    cov: ArrayLike, n_obs: int, *, field: str, singular: bool = False
) -> FloatArray:
    """`cov` as a read-only (n_obs, n_obs) array.  singular : whether variances may be 0.

    Raises InputError naming `field` where it has another shape, is not finite or symmetric, or has
    a negative variance in some direction.
    """
    matrix = finite_numbers(cov, field)
    if matrix.shape != (n_obs, n_obs):
        raise InputError(f"must have the shape ({n_obs}, {n_obs})", field=field, value=matrix.shape)
    sds = np.sqrt(np.abs(np.diag(matrix)))
    sds[sds == 0.0] = 1.0
    unit = matrix / np.outer(sds, sds)
    if not np.allclose(unit, unit.T, rtol=0.0, atol=1e-9):
        raise InputError("must be symmetric", field=field)
    matrix = 0.5 * (matrix + matrix.T)
    if not np.linalg.eigvalsh(unit)[0] > (-1e-9 if singular else 1e-13):
        rule = (
            "must have no negative variance in any direction (is it a matrix of covariances, in "
            "the squares of units?)"
            if singular
            else "must be positive definite (a covariance matrix)"
        )
        raise InputError(rule, field=field)
    matrix.setflags(write=False)
    return matrix
