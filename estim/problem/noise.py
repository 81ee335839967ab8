"""How measurements scatter about the curve.  Which model to choose:

- `Differentiated`: the speeds are differences of measured positions (a video, an encoder).  Say the standard deviation
  of one *position*; the speeds then have exactly known, correlated errors.  The default wherever times and positions
  are known.
- `Independent`: the speeds were measured by themselves (light gates, a radar), each with its own standard deviation;
  the positions are exact, or have a standard deviation `sigma_x` of their own.  Also for positions fit as they are
  (`positions` in a campaign): no differentiation, the most informative, and the place for robust `tails`.

`sigma` is the standard deviation of one reading (a position for `Differentiated`, a speed for `Independent`), given or
inferred.  `scatter` is a further independent error of every speed, for what the instrument does not explain (dust, a
ramp that is not flat); infer it when unsure, and distrust the model when it comes out far above the instrument's share.
`encoder_step` is the resolution of a digital position reading: it adds step^2/12 to the variance of a position.

Every covariance here has the form  C = (sigma^2 + step^2/12) C0 + scatter^2 I  with C0 known once the curve is known
approximately, so one diagonalisation of C0 serves every draw (see `Whitening`).

Errors of x: the true abscissas of independent points are integrated out one by one, under a distribution that is fitted to
the x (`estim.problem.abscissas`).  The tempting N(y | f, sigma_y^2 + f'^2 sigma_x^2) with its log-determinant is what remains of
true abscissas spread evenly over the whole axis; it is biased, and the more points the worse.  Without the log-determinant
(York's chi-square) it rewards ever steeper curves.  Here it serves as the size of a residual only (`covariance`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.arrays import FloatArray
from estim.common import InputError
from estim.problem.curve import Curve, SpeedCurve, Wording
from estim.problem.derivative import Derivative
from estim.problem.tails import GAUSSIAN, Tails


@dataclass(frozen=True, eq=False)
class Scale:
    """A standard deviation: a fixed value, or the name of the parameter that is inferred in its place."""

    value: float = 0.0
    parameter: str | None = None

    def at(self, values: Mapping[str, ArrayLike]) -> ArrayLike:
        """The standard deviation for parameter values (scalars or (n_draw, 1))."""
        return self.value if self.parameter is None else values[self.parameter]


@dataclass(frozen=True, eq=False)
class Independent:
    """Points with independent errors of variance (sigma * relative)^2 + encoder_step^2/12 + scatter^2 (+ f'^2 sigma_x^2).

    relative : (n_obs,) 1 where sigma is common to all; the stated standard deviations with sigma = 1 otherwise.
    sigma_x : of the abscissas, times relative_x (n_obs,); None where they are exact.  tails : the shape of the errors.
    positions : whether the points are positions at known times rather than speeds at known positions.
    """

    sigma: Scale
    scatter: Scale
    relative: FloatArray
    sigma_x: Scale | None = None
    relative_x: FloatArray | None = None
    encoder_step: float = 0.0
    tails: Tails = GAUSSIAN
    positions: bool = False

    @property
    def model(self) -> str:
        return "positions" if self.positions else "independent"

    @property
    def quantisation_variance(self) -> float:
        return self.encoder_step**2 / 12.0

    def whitening(self, curve: Curve, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> Whitening:
        """The errors depend on the curve only where x has errors."""
        square = np.square(self.relative)
        steepness = np.zeros(x.size) if self.sigma_x is None else self.steepness(curve, x, arguments)[0]
        return Whitening(basis=None, spectrum=square, offset=np.zeros(x.size), kernel=None, steepness=steepness)

    def sd_of_x(self, values: Mapping[str, ArrayLike], n_obs: int) -> FloatArray:
        """(n, n_obs) standard deviations of the errors of the abscissas, n the number of draws or 1; 0 where they are exact."""
        sigma = 0.0 if self.sigma_x is None else np.asarray(self.sigma_x.at(values))
        return np.atleast_2d(sigma * (np.ones(n_obs) if self.relative_x is None else self.relative_x))

    def steepness(self, curve: Curve, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        """(n_draw, n_obs) standard deviation of each point for a unit sigma_x: the slope of the curve times relative_x."""
        slope = np.atleast_2d(curve.local(x, arguments).slope)
        return slope if self.relative_x is None else slope * self.relative_x

    def reading_gain(self) -> FloatArray:
        """(n_obs,) standard deviation of each point for a unit sigma."""
        return self.relative

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        """The noise in words."""
        sizes = []
        if self.sigma.parameter is not None:
            sizes.append(f"their standard deviation {self.sigma.parameter} inferred")
        elif np.ptp(self.relative) > 0.0:
            sizes.append("standard deviations as stated row by row")
        elif self.sigma.value:
            sizes.append(f"standard deviation {self.sigma.value * self.relative[0]:.4g} {y_unit}")
        if self.encoder_step:
            sizes.append(f"an encoder step of {self.encoder_step:.4g} {y_unit}")
        if self.sigma_x is not None:
            size = "as stated row by row" if self.relative_x is not None else f"{self.sigma_x.value:.4g} {x_unit}"
            size = size if self.sigma_x.parameter is None else f"{self.sigma_x.parameter}, inferred"
            sizes.append(f"errors of the abscissas of standard deviation {size}")
        shape = self.tails.describe()
        further = _scatter_words(self.scatter, words.what, y_unit) + (f"; {shape}" if shape else "")
        return f"independent errors of the {words.what}; {' and '.join(sizes)}{further}"


@dataclass(frozen=True, eq=False)
class Differentiated:
    """Speeds v = S x of positions with independent errors of variance sigma^2 + encoder_step^2/12, plus scatter.

    The curve is evaluated at the measured positions, so the residual v - f(x) is A e to first order in the errors e:

        A = S - diag(f'(x)),    C0 = A A^T,    E[v] = f + truncation of the stencil
    """

    sigma: Scale
    scatter: Scale
    encoder_step: float
    derivative: Derivative
    kept: NDArray[np.int64]  # (n_obs,) which speeds of `derivative` are used

    model = "differentiated"
    positions = False
    sigma_x = None
    tails = GAUSSIAN

    @property
    def quantisation_variance(self) -> float:
        return self.encoder_step**2 / 12.0

    def whitening(self, curve: Curve, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> Whitening:
        """Covariance and truncation with the slope of the curve at `arguments`."""
        if not isinstance(curve, SpeedCurve):
            raise InputError("cannot be used with this curve: speeds made by differences need a curve of speeds dx/dt = f(x)", field="differentiated")
        stencil, interval = self.derivative.stencil, self.derivative.interval
        matrix = self.derivative.matrix[self.kept].copy()
        rows = self.derivative.rows[self.kept]
        matrix[np.arange(rows.size), rows] -= curve.local(x, arguments).slope[0]
        kernel = matrix @ matrix.T
        spectrum, basis = np.linalg.eigh(kernel)
        rounding = np.finfo(float).eps * spectrum.size * spectrum[-1]  # no eigenvalue is known better: where the slope is huge, some come out below 0
        bent = curve.time_derivative(x, arguments, stencil.order)[0]
        offset = stencil.truncation * interval**stencil.order * bent
        return Whitening(basis=basis, spectrum=np.maximum(spectrum, rounding), offset=offset, kernel=kernel, steepness=np.zeros(x.size))

    def reading_gain(self) -> FloatArray:
        """(n_obs,) standard deviation of each speed for a unit error of the positions."""
        return np.full(self.kept.size, self.derivative.stencil.noise_gain / self.derivative.interval)

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        """The noise in words."""
        readings = []
        if self.encoder_step:
            readings.append(f"an encoder step of {self.encoder_step:.4g} {x_unit}")
        if self.sigma.parameter is not None:
            readings.append(f"an inferred standard deviation {self.sigma.parameter}")
        elif self.sigma.value:
            readings.append(f"a standard deviation of {self.sigma.value:.4g} {x_unit}")
        return (
            f"{words.what} by the {self.derivative.stencil.name} derivative of {words.reading}s, with its exact covariance; "
            f"{words.reading} readings with "
            + " and ".join(readings) + _scatter_words(self.scatter, words.what, y_unit)
        )


def _scatter_words(scatter: Scale, what: str, unit: str) -> str:
    if scatter.parameter is not None:
        return f"; a further independent scatter of the {what} inferred"
    return f"; a further independent scatter of {scatter.value:.4g} {unit}" if scatter.value else ""


Noise = Independent | Differentiated


def noise_parameters(noise: Noise) -> tuple[str, ...]:
    """Names of the unknowns of the noise."""
    scales = [noise.sigma, noise.scatter] + ([] if noise.sigma_x is None else [noise.sigma_x])
    return tuple(scale.parameter for scale in scales if scale.parameter is not None) + tuple(noise.tails.parameters)


@dataclass(frozen=True, eq=False)
class Whitening:
    """C0 = basis diag(spectrum) basis^T, the mean shift of the points and the slope of the curve, for one curve.

    basis : (n_obs, n_obs) orthonormal columns; None for the identity.  spectrum : (n_obs,).
    offset : (n_obs,) unit of y.  kernel : (n_obs, n_obs) C0 itself; None where it is diagonal.
    steepness : (n_obs,) f' (times relative_x) where x has errors, otherwise 0.
    """

    basis: FloatArray | None
    spectrum: FloatArray
    offset: FloatArray
    kernel: FloatArray | None
    steepness: FloatArray

    def rotate(self, residuals: FloatArray) -> FloatArray:
        """Residuals (..., n_obs) in the basis in which C is diagonal."""
        return residuals if self.basis is None else residuals @ self.basis


def variances(noise: Noise, whitening: Whitening, values: Mapping[str, ArrayLike]) -> FloatArray:
    """Eigenvalues of C, (n_draw, n_obs) or (1, n_obs), for noise parameters as scalars or (n_draw, 1)."""
    reading = np.square(noise.sigma.at(values)) + noise.quantisation_variance
    total = np.asarray(reading * whitening.spectrum + np.square(noise.scatter.at(values)))
    if noise.sigma_x is None:
        return total
    return np.asarray(total + np.square(noise.sigma_x.at(values)) * whitening.steepness**2)


def covariance(noise: Noise, whitening: Whitening, values: Mapping[str, ArrayLike]) -> FloatArray:
    """C (n_obs, n_obs) itself, in the order of the observations."""
    if whitening.kernel is None:
        return np.diag(np.broadcast_to(variances(noise, whitening, values), (1, whitening.offset.size))[0])
    reading = np.square(noise.sigma.at(values)) + noise.quantisation_variance
    return np.asarray(reading * whitening.kernel + np.square(noise.scatter.at(values)) * np.eye(whitening.offset.size))


def reading_sd(noise: Noise, values: Mapping[str, ArrayLike]) -> FloatArray:
    """Standard deviation of each point from the instrument alone, without scatter: broadcasts to (n_draw, n_obs)."""
    return np.asarray(np.sqrt(np.square(noise.sigma.at(values)) + noise.quantisation_variance) * noise.reading_gain())
