"""How measurements scatter about the curve.  Which model to choose:

- `Differentiated`: the speeds are differences of measured positions (a video, an encoder).  Say the
  standard deviation of one *position*; the speeds then have exactly known, correlated errors.  The
  default wherever times and positions are known.
- `Independent`: the speeds were measured by themselves (light gates, a radar), each with its own
  standard deviation; the positions are exact, or have a standard deviation `sigma_x` of their own.
  Also for positions fit as they are (`positions` in a campaign): no differentiation, the most
  informative, and the place for robust `tails`.

`sigma` is the standard deviation of one reading (a position for `Differentiated`, a speed for
`Independent`), given or inferred.  `scatter` is a further independent error of every speed, for
what the instrument does not explain (dust, a ramp that is not flat); infer it when unsure, and
distrust the model when it comes out far above the instrument's share.  `encoder_step` is the
resolution of a digital position reading: it adds step^2/12 to the variance of a position.

Each is a record of what was assumed; what it makes of points and their curve is its `likelihood`
(`estim.problem.likelihood`).

Errors of x: the true abscissas of independent points are integrated out one by one, under a
distribution that is fitted to the x (`estim.problem.errors_in_x_quadrature`).  The tempting
N(y | f, sigma_y^2 + f'^2 sigma_x^2) with its log-determinant is what remains of true abscissas
spread evenly over the whole axis; it is biased, and the more points the worse.  Without the
log-determinant (York's chi-square) it rewards ever steeper curves.  Here it serves as the size of a
residual only (`LatentErrors.sd`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array

from estim.arrays import FloatArray, IntArray, Named
from estim.common import InputError, phrase
from estim.problem.correlated_normal import Diagonal, GaussianErrors
from estim.problem.curve import SpeedCurve, Wording
from estim.problem.differences import in_rows
from estim.problem.errors_in_x import LatentErrors
from estim.problem.errors_in_x_quadrature import true_abscissas
from estim.problem.finite_differences import Derivative
from estim.problem.likelihood import Likelihood, Noise, Points
from estim.problem.noise_variance import NoiseVariance, Scale
from estim.problem.robust_likelihood import RobustErrors
from estim.problem.tails import GAUSSIAN, Gaussian, Tails


@dataclass(frozen=True, eq=False)
class Independent(Noise):
    """Points with independent errors of variance (sigma * relative)^2 + encoder_step^2/12 +
    scatter^2 (+ f'^2 sigma_x^2), or (share * f)^2 + scatter^2.

    relative : (n_obs,) 1 where sigma is common to all; the stated standard deviations with sigma =
        1 otherwise.
    r_xy : (n_obs,) correlation of the two errors of a point, None for none; those stated alone.
    share : standard deviation of y over the curve f, 0 where `relative` says it; else this is what
        y themselves show of it, for searches and figures.
    sigma_x : of the abscissas, times relative_x (n_obs,); None where they are exact.
    tails : the shape of the errors.
    exposure : s, of pictures whose motion blur is part of `relative`.
    """

    sigma: Scale
    scatter: Scale
    relative: FloatArray
    sigma_x: Scale | None = None
    relative_x: FloatArray | None = None
    encoder_step: float = 0.0
    tails: Tails = GAUSSIAN
    exposure: float = 0.0
    share: float = 0.0
    r_xy: FloatArray | None = None

    @property
    def size(self) -> NoiseVariance:
        """Of the errors of y."""
        return NoiseVariance(self.sigma, self.scatter, self.encoder_step)

    @property
    def parameters(self) -> tuple[str, ...]:
        of_x = (
            ()
            if self.sigma_x is None or self.sigma_x.parameter is None
            else (self.sigma_x.parameter,)
        )
        return (*self.size.parameters, *of_x, *self.tails.parameters)

    @property
    def outlier_parameters(self) -> tuple[str, ...]:
        return tuple(self.tails.parameters)

    @property
    def sides(self) -> FloatArray | None:
        skew = self.tails.skew
        return None if skew is None else self.relative * np.array([1.0 / skew, skew])

    @property
    def robust(self) -> bool:
        return self.tails.robust

    def likelihood(self, points: Points, named: Named) -> Likelihood:
        weight, exact = np.square(self.relative), np.zeros(points.x.size)
        if self.share:
            of_x = (Scale(), exact) if self.sigma_x is None else (self.sigma_x, self.x_gain())
            return LatentErrors(points, self.size, exact, self.tails, *of_x, self.share)
        if self.sigma_x is None:
            if self.tails.robust or self.sides is not None:
                return RobustErrors(points, self.size, weight, self.tails)
            return GaussianErrors(points, self.size, Diagonal(weight), exact)
        u_x, lean = self.x_gain(), exact
        if self.r_xy is not None:
            lean = np.divide(self.r_xy * self.relative, u_x, out=exact, where=u_x > 0.0)
            weight = weight * (1.0 - np.square(self.r_xy * (u_x > 0.0)))
        return LatentErrors(points, self.size, weight, self.tails, self.sigma_x, u_x, lean=lean)

    def for_search(self) -> Independent:
        """Without its errors of x, and with known ones of y: there linear parameters can be solved
        for, and its optima are good starts.
        """
        if self.sigma_x is None and not self.share:
            return self
        return replace(self, sigma_x=None, relative_x=None, share=0.0, r_xy=None)

    def with_normal_errors(self, wider: FloatArray) -> Independent:
        if not self.tails.robust:
            return self
        unused = (self.scatter.parameter,) if self.scatter.parameter else ()
        return replace(
            self,
            tails=Gaussian((*self.tails.parameters, *unused)),
            scatter=Scale(),
            relative=wider * self.relative,
        )

    def outlier_share(self, named: Named) -> float:
        return self.tails.outlier_share(named)

    def reading_gain(self) -> FloatArray:
        return self.relative

    def x_gain(self) -> FloatArray:
        if self.sigma_x is None:
            return np.zeros(self.relative.size)
        return np.ones(self.relative.size) if self.relative_x is None else self.relative_x

    def true_x(
        self, x: FloatArray, gain: FloatArray, named: Named, rng: np.random.Generator
    ) -> FloatArray:
        """As far spread as the fitted distribution."""
        if self.sigma_x is None:
            return x
        known = true_abscissas(x, np.atleast_2d(self.sigma_x.at(named) * gain))
        return known.centre[0] + known.spread[0] * rng.standard_normal(x.size)

    def read_x(
        self, x: FloatArray, gain: FloatArray, named: Named, rng: np.random.Generator
    ) -> FloatArray:
        return (
            x
            if self.sigma_x is None
            else x + self.sigma_x.at(named) * gain * rng.standard_normal(x.size)
        )

    def read(
        self, true: FloatArray, gain: FloatArray, named: Named, rng: np.random.Generator
    ) -> FloatArray:
        gain = self.share * np.abs(true) if self.share else gain
        sd = np.hypot(self.sigma.at(named) * gain, self.scatter.at(named))
        return self.size.rounded(true + self.tails.draw(rng, true.size, named) * sd)

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        """The noise in words."""
        sizes = []
        if self.sigma.parameter is not None:
            sizes.append(
                phrase("their standard deviation {name} is inferred", name=self.sigma.parameter)
            )
        elif self.exposure:
            least = self.sigma.value * np.min(self.relative)
            blur = _blur_words(self.exposure)
            sizes.append(
                phrase(
                    "standard deviations of at least {least:.4g} {unit}, increased by {blur}",
                    least=least,
                    unit=y_unit,
                    blur=blur,
                )
            )
        elif np.ptp(self.relative) > 0.0:
            sizes.append(phrase("standard deviations as stated row by row"))
        elif self.sigma.value:
            sizes.append(
                phrase(
                    "standard deviation {size:.4g} {unit}",
                    size=self.sigma.value * self.relative[0],
                    unit=y_unit,
                )
            )
        if self.encoder_step:
            sizes.append(
                phrase("an encoder step of {size:.4g} {unit}", size=self.encoder_step, unit=y_unit)
            )
        if self.sigma_x is not None:
            size = (
                phrase("as stated row by row")
                if self.relative_x is not None
                else f"{self.sigma_x.value:.4g} {x_unit}"
            )
            size = (
                size
                if self.sigma_x.parameter is None
                else phrase("{name}, inferred", name=self.sigma_x.parameter)
            )
            sizes.append(
                phrase("errors of the abscissas with standard deviation {size}", size=size)
            )
        shape = self.tails.describe()
        further = scatter_words(self.scatter, words.what, y_unit) + (f"; {shape}" if shape else "")
        what, sizes_of = phrase(words.what), phrase(" and ").join(sizes)
        return (
            phrase("independent errors of the {what}; {sizes}", what=what, sizes=sizes_of) + further
        )


@dataclass(frozen=True, eq=False)
class Differentiated(Noise):
    """Speeds v = S x of positions with independent errors of variance sigma^2 + encoder_step^2/12,
    plus scatter.

    The curve is evaluated at the measured positions, so the residual v - f(x) is A e to first order
    in the errors e:

        A = S - diag(f'(x)),    C0 = A A^T,    E[v] = f + truncation of the stencil

    relative : (n_row,) standard deviation of each reading / sigma, None where all are equal: then
        C0 = A diag(relative^2) A^T.
    exposure : s, of pictures whose motion blur it is.
    """

    sigma: Scale
    scatter: Scale
    encoder_step: float
    derivative: Derivative
    kept: IntArray  # (n_obs,) which speeds of `derivative` are used
    relative: FloatArray | None = None
    exposure: float = 0.0

    made_of_positions = True

    @property
    def size(self) -> NoiseVariance:
        """Of the errors of the positions, and of the scatter of the speeds."""
        return NoiseVariance(self.sigma, self.scatter, self.encoder_step)

    def likelihood(self, points: Points, named: Named) -> GaussianErrors:
        """Covariance and truncation with the slope of the curve at `named`.  Raises InputError for
        a curve that is not one of speeds.
        """
        curve = points.curve
        if not isinstance(curve, SpeedCurve):
            raise InputError(
                "cannot be used with this curve: speeds made by differences need a curve "
                "of speeds dx/dt = f(x)",
                field="differentiated",
            )
        stencil = self.derivative.stencil
        interval = self.derivative.interval
        arguments = points.bind(named)
        matrix = self.of_positions(points, named)
        if self.relative is not None:
            matrix = matrix @ diags_array(self.relative)
        bent = curve.time_derivative(points.x, arguments, stencil.order)[0]
        shift = stencil.truncation * interval**stencil.order * bent
        return GaussianErrors.of_readings(points, self.size, matrix, shift)

    def of_positions(self, points: Points, named: Named) -> csr_array:
        """A = S - diag(f'(x))."""
        slope = points.curve.local(points.x, points.bind(named)).slope[0]
        return self._to_speed - self._at_points(slope)

    @cached_property
    def _to_speed(self) -> csr_array:
        """S (n_obs, n_row)."""
        return self.derivative.matrix[self.kept]

    def _at_points(self, factor: FloatArray) -> csr_array:
        """diag(factor (n_obs,)) in the columns of the readings where the points are."""
        rows = self.derivative.rows[self.kept]
        return in_rows(rows[:, None], factor[:, None], self._to_speed.shape[1])

    def reading_gain(self) -> FloatArray:
        gain = np.full(
            self.kept.size, self.derivative.stencil.noise_gain / self.derivative.interval
        )
        return (
            gain if self.relative is None else gain * self.relative[self.derivative.rows[self.kept]]
        )

    def read(
        self, true: FloatArray, gain: FloatArray, named: Named, rng: np.random.Generator
    ) -> FloatArray:
        """Positions; the scatter is one of the speeds."""
        return self.size.rounded(
            true + float(np.squeeze(self.sigma.at(named))) * gain * rng.standard_normal(true.size)
        )

    def carried(
        self, by_x: FloatArray, by_y: FloatArray, named: Named
    ) -> tuple[FloatArray, FloatArray]:
        """An error of a position moves x there, and the speeds on either side."""
        reading, scatter = self.size.reading_variance(named), np.square(self.scatter.at(named))
        to_speed = self._to_speed
        to_residuals = diags_array(by_y) @ to_speed + self._at_points(by_x)
        if self.relative is not None:
            scale = diags_array(self.relative)
            to_residuals, to_speed = to_residuals @ scale, to_speed @ scale
        cov = reading * (to_residuals @ to_residuals.T).toarray() + np.diag(by_y**2 * scatter)
        return cov, reading * to_speed.power(2).sum(axis=1) + scatter

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        """The noise in words."""
        readings = []
        if self.encoder_step:
            readings.append(
                phrase("an encoder step of {size:.4g} {unit}", size=self.encoder_step, unit=x_unit)
            )
        if self.sigma.parameter is not None:
            readings.append(
                phrase("an inferred standard deviation {name}", name=self.sigma.parameter)
            )
        elif self.sigma.value:
            readings.append(
                phrase(
                    "a standard deviation of {size:.4g} {unit}", size=self.sigma.value, unit=x_unit
                )
            )
        if self.exposure:
            readings.append(_blur_words(self.exposure))
        return phrase(
            "{what} by the {stencil} derivative of {reading}s, with its exact covariance; "
            "{reading} readings with {sizes}",
            what=phrase(words.what),
            stencil=phrase(self.derivative.stencil.name),
            reading=phrase(words.reading),
            sizes=phrase(" and ").join(readings),
        ) + scatter_words(self.scatter, words.what, y_unit)


def _blur_words(exposure: float) -> str:
    return phrase("the motion blur of an exposure of {exposure:.4g} s", exposure=exposure)


def scatter_words(scatter: Scale, what: str, unit: str) -> str:
    if scatter.parameter is not None:
        return phrase(
            "; an additional independent scatter of the {what} is inferred", what=phrase(what)
        )
    return (
        phrase(
            "; an additional independent scatter of {size:.4g} {unit}",
            size=scatter.value,
            unit=unit,
        )
        if scatter.value
        else ""
    )
