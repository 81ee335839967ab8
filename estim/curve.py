"""What estim asks of a curve y = f(x; arguments): its value, its slope and its gradient, vectorised over draws.

The phase curve of a rolling body is one such curve; anything else that keeps to this protocol can be fit in its place.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LocalCurve:
    """A curve with its first derivatives at the same points.

    value : (n_draw, n_obs) f.  slope : (n_draw, n_obs) df/dx.
    gradient : argument name -> array that broadcasts to (n_draw, n_obs), df/dargument at fixed x.
    """

    value: FloatArray
    slope: FloatArray
    gradient: Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class Derived:
    """A quantity computed from the parameters: unit, (n_draw, 1) values, and what it is."""

    unit: str
    values: FloatArray
    meaning: str


class Curve(Protocol):
    """A curve; arguments are scalars or shaped (n_draw, 1), x is (n_obs,), results are (n_draw, n_obs)."""

    def value(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        """f(x; arguments)."""

    def local(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        """f with its slope in x and its gradient in the arguments."""

    def time_derivative(self, x: FloatArray, arguments: Mapping[str, ArrayLike], order: int) -> FloatArray:
        """d^order f/dt^order along the motion dx/dt = f(x), for even `order`: what a derivative by differences adds to its mean."""

    def metres(self, arguments: Mapping[str, ArrayLike]) -> ArrayLike:
        """Metres that one unit of x is worth."""

    @property
    def mass(self) -> float | None:
        """Mass (kg) of what moves, None where it is unknown or has no meaning."""

    def energies(self, x: FloatArray, v: FloatArray, arguments: Mapping[str, ArrayLike]) -> tuple[FloatArray, FloatArray]:
        """Kinetic and potential energy per unit mass (J/kg) at measured x and v; NaN where the curve is no motion."""

    def derived(self, arguments: Mapping[str, ArrayLike]) -> Mapping[str, Derived]:
        """Quantities that follow from the arguments and mean something to a reader, by name."""

    def end(self, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        """Position behind which the motion does not go, (n_draw, 1) or (1, 1); inf where it never ends."""


class PlainCurve:
    """The part of `Curve` that only a motion has, for curves that are none."""

    @property
    def mass(self) -> float | None:
        return None

    def metres(self, arguments: Mapping[str, ArrayLike]) -> ArrayLike:
        return 1.0

    def energies(self, x: FloatArray, v: FloatArray, arguments: Mapping[str, ArrayLike]) -> tuple[FloatArray, FloatArray]:
        return np.full(np.shape(v), np.nan), np.full(np.shape(v), np.nan)

    def derived(self, arguments: Mapping[str, ArrayLike]) -> Mapping[str, Derived]:
        return {}

    def end(self, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        return np.array([[np.inf]])
