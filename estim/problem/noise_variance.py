"""How large errors are: the one formula of all noise of readings, with its derivatives.

Every covariance has the form  C = (sigma^2 + step^2/12) C0 + scatter^2 I  with C0 known once the
curve is known approximately, so one diagonalisation of C0 serves every draw: with w an eigenvalue
of C0 (of independent points: the variance of one for a unit sigma), that of C is

    V = (sigma^2 + step^2/12) w + scatter^2
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estim.arrays import FloatArray, Named


@dataclass(frozen=True, eq=False)
class Scale:
    """A standard deviation: a fixed value, or the name of the parameter that is inferred in its
    place.
    """

    value: float = 0.0
    parameter: str | None = None

    def at(self, values: Named) -> float | FloatArray:
        """The standard deviation for parameter values (scalars or (n_draw, 1))."""
        return self.value if self.parameter is None else values[self.parameter]


@dataclass(frozen=True, eq=False)
class NoiseVariance:
    """sigma of a reading, further scatter, and the resolution of a digital reading."""

    sigma: Scale
    scatter: Scale = Scale()
    step: float = 0.0

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the unknowns."""
        return tuple(
            scale.parameter for scale in (self.sigma, self.scatter) if scale.parameter is not None
        )

    @property
    def quantisation_variance(self) -> float:
        """Of a reading, unit of y squared."""
        return self.step**2 / 12.0

    def reading_variance(self, named: Named) -> FloatArray:
        """() or (n_draw, 1) variance of a reading, without scatter."""
        return np.square(self.sigma.at(named)) + self.quantisation_variance

    def rounded(self, reading: FloatArray) -> FloatArray:
        """Readings as the instrument shows them, in multiples of `step` if it has one."""
        return self.step * np.rint(reading / self.step) if self.step else reading

    def variance(self, weight: FloatArray, named: Named) -> FloatArray:
        """(n, n_obs) V for weights w (n_obs,), n the number of draws or 1."""
        return np.atleast_2d(
            self.reading_variance(named) * weight + np.square(self.scatter.at(named))
        )

    def slopes(self, weight: FloatArray, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_obs, n) derivatives of V in the parameters `names`, for single values."""
        slopes = np.zeros((weight.size, len(names)))
        for scale, square in ((self.sigma, weight), (self.scatter, np.ones(weight.size))):
            if scale.parameter in names:
                slopes[:, names.index(str(scale.parameter))] += (
                    2.0 * named[str(scale.parameter)] * square
                )
        return slopes

    def information(self, weight: FloatArray, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_par, n_par) of the scales, if errors are normal: sum dV_a dV_b/(2 V^2)."""
        relative = self.slopes(weight, named, names) / self.variance(weight, named).T
        return 0.5 * relative.T @ relative
