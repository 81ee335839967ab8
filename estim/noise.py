"""How measured speeds scatter about the curve.  Which model to choose:

- `Differentiated`: the speeds are differences of measured positions (a video, an encoder).  Say the standard deviation
  of one *position*; the speeds then have exactly known, correlated errors.  The default wherever times and positions
  are known.
- `Independent`: the speeds were measured by themselves (light gates, a radar), each with its own standard deviation.

`sigma` is the standard deviation of one reading (a position for `Differentiated`, a speed for `Independent`), given or
inferred.  `scatter` is a further independent error of every speed, for what the instrument does not explain (dust, a
ramp that is not flat); infer it when unsure, and distrust the model when it comes out far above the instrument's share.
`encoder_step` is the resolution of a digital position reading: it adds step^2/12 to the variance of a position.

Every covariance here has the form  C = (sigma^2 + step^2/12) C0 + scatter^2 I  with C0 known once the curve is known
approximately, so one diagonalisation of C0 serves every draw (see `Whitening`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.curve import Curve
from estim.derivative import Derivative

FloatArray = NDArray[np.float64]


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
    """Speeds with independent errors of standard deviation sigma * relative, plus scatter.

    relative : (n_obs,) 1 where sigma is common to all; the stated standard deviations with sigma = 1 otherwise.
    """

    sigma: Scale
    scatter: Scale
    relative: FloatArray

    model = "independent"
    quantisation_variance = 0.0

    def whitening(self, curve: Curve, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> Whitening:
        """The errors do not depend on the curve."""
        return Whitening(basis=np.eye(x.size), spectrum=np.square(self.relative), offset=np.zeros(x.size), kernel=np.diag(np.square(self.relative)))

    def reading_gain(self) -> FloatArray:
        """(n_obs,) standard deviation of each speed for a unit sigma."""
        return self.relative

    def describe(self, *, position_unit: str, speed_unit: str) -> str:
        """The noise in words."""
        if self.sigma.parameter is not None:
            size = f"their standard deviation {self.sigma.parameter} inferred"
        elif np.ptp(self.relative) > 0.0:
            size = "standard deviations as stated row by row"
        else:
            size = f"standard deviation {self.sigma.value * self.relative[0]:.4g} {speed_unit}"
        return f"independent errors of the speeds; {size}{_scatter_words(self.scatter, speed_unit)}"


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

    @property
    def quantisation_variance(self) -> float:
        return self.encoder_step**2 / 12.0

    def whitening(self, curve: Curve, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> Whitening:
        """Covariance and truncation with the slope of the curve at `arguments`."""
        stencil, interval = self.derivative.stencil, self.derivative.interval
        matrix = self.derivative.matrix[self.kept].copy()
        rows = self.derivative.rows[self.kept]
        matrix[np.arange(rows.size), rows] -= curve.local(x, arguments).slope[0]
        kernel = matrix @ matrix.T
        spectrum, basis = np.linalg.eigh(kernel)
        bent = curve.time_derivative(x, arguments, stencil.order)[0]
        offset = stencil.truncation * interval**stencil.order * bent
        return Whitening(basis=basis, spectrum=np.maximum(spectrum, 0.0), offset=offset, kernel=kernel)

    def reading_gain(self) -> FloatArray:
        """(n_obs,) standard deviation of each speed for a unit error of the positions."""
        return np.full(self.kept.size, self.derivative.stencil.noise_gain / self.derivative.interval)

    def describe(self, *, position_unit: str, speed_unit: str) -> str:
        """The noise in words."""
        readings = []
        if self.encoder_step:
            readings.append(f"an encoder step of {self.encoder_step:.4g} {position_unit}")
        if self.sigma.parameter is not None:
            readings.append(f"an inferred standard deviation {self.sigma.parameter}")
        elif self.sigma.value:
            readings.append(f"a standard deviation of {self.sigma.value:.4g} {position_unit}")
        return (
            f"speeds by the {self.derivative.stencil.name} derivative of positions, with its exact covariance; position readings with "
            + " and ".join(readings) + _scatter_words(self.scatter, speed_unit)
        )


def _scatter_words(scatter: Scale, unit: str) -> str:
    if scatter.parameter is not None:
        return "; a further independent scatter of the speeds inferred"
    return f"; a further independent scatter of {scatter.value:.4g} {unit}" if scatter.value else ""


Noise = Independent | Differentiated


@dataclass(frozen=True, eq=False)
class Whitening:
    """C0 = basis diag(spectrum) basis^T, and the mean shift of the speeds, for one curve.

    basis : (n_obs, n_obs) orthonormal columns.  spectrum : (n_obs,).  offset : (n_obs,) unit of speed.
    kernel : (n_obs, n_obs) C0 itself.
    """

    basis: FloatArray
    spectrum: FloatArray
    offset: FloatArray
    kernel: FloatArray


def variances(noise: Noise, whitening: Whitening, values: Mapping[str, ArrayLike]) -> FloatArray:
    """Eigenvalues of C, (n_draw, n_obs) or (1, n_obs), for noise parameters as scalars or (n_draw, 1)."""
    reading = np.square(noise.sigma.at(values)) + noise.quantisation_variance
    return np.asarray(reading * whitening.spectrum + np.square(noise.scatter.at(values)))


def covariance(noise: Noise, whitening: Whitening, values: Mapping[str, ArrayLike]) -> FloatArray:
    """C (n_obs, n_obs) itself, in the order of the observations."""
    reading = np.square(noise.sigma.at(values)) + noise.quantisation_variance
    return np.asarray(reading * whitening.kernel + np.square(noise.scatter.at(values)) * np.eye(whitening.offset.size))


def reading_sd(noise: Noise, values: Mapping[str, ArrayLike]) -> FloatArray:
    """Standard deviation of each speed from the instrument alone, without scatter: broadcasts to (n_draw, n_obs)."""
    return np.asarray(np.sqrt(np.square(noise.sigma.at(values)) + noise.quantisation_variance) * noise.reading_gain())
