"""A curve and a motion some arguments of which vary between runs:  a = mean + spread * shift.

The mean and the spread are common to the runs, the shift is one run's (standard normal beforehand).
Their names are those of the argument with ` spread` and ` shift` behind it; nobody further in knows
of them.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, Named
from estim.common import Notation
from estim.problem import (
    CommonError,
    Curve,
    Derived,
    Footing,
    LocalCurve,
    Motion,
    Prior,
    SpeedCurve,
    SquaredCurve,
)


def spread_of(argument: str) -> str:
    return f"{argument} spread"


def shift_of(argument: str) -> str:
    return f"{argument} shift"


def own_values(arguments: Named, varied: Collection[str]) -> dict[str, ArrayLike]:
    """The arguments of one run, each with its own value of those that are `varied`."""
    held = {spread_of(name) for name in varied} | {shift_of(name) for name in varied}
    values = {name: value for name, value in arguments.items() if name not in held}
    for name in varied:
        mean, spread, shift = (
            np.asarray(arguments[part]) for part in (name, spread_of(name), shift_of(name))
        )
        values[name] = mean + spread * shift
    return values


@dataclass(frozen=True, eq=False)
class VaryingCurve:
    """`curve` with arguments `varied`; with `time_derivative`, which positions in time have no use
    for.
    """

    curve: SpeedCurve
    varied: tuple[str, ...]

    def value(self, x: FloatArray, arguments: Named) -> FloatArray:
        return self.curve.value(x, own_values(arguments, self.varied))

    def square(self, x: FloatArray, arguments: Named) -> FloatArray:
        return cast(SquaredCurve, self.curve).square(x, own_values(arguments, self.varied))

    def local(self, x: FloatArray, arguments: Named) -> LocalCurve:
        return self._varied(self.curve.local(x, own_values(arguments, self.varied)), arguments)

    def local_square(self, x: FloatArray, arguments: Named) -> LocalCurve:
        return self._varied(
            cast(SquaredCurve, self.curve).local_square(x, own_values(arguments, self.varied)),
            arguments,
        )

    def _varied(self, local: LocalCurve, arguments: Named) -> LocalCurve:
        gradient = {}
        for name in self.varied:
            slope = local.gradient[name]
            gradient[spread_of(name)] = np.asarray(slope * np.asarray(arguments[shift_of(name)]))
            gradient[shift_of(name)] = np.asarray(slope * np.asarray(arguments[spread_of(name)]))
        return LocalCurve(local.value, local.slope, {**local.gradient, **gradient})

    def time_derivative(self, x: FloatArray, arguments: Named, order: int) -> FloatArray:
        return self.curve.time_derivative(x, own_values(arguments, self.varied), order)


@dataclass(frozen=True, eq=False)
class VaryingMotion:
    """What is known of a body, at the values that one run has."""

    motion: Motion
    varied: tuple[str, ...]

    @property
    def mass(self) -> float | None:
        return self.motion.mass

    @property
    def instrument_readings(self) -> tuple[str, ...]:
        return self.motion.instrument_readings

    @property
    def end_notation(self) -> Notation:
        return self.motion.end_notation

    @property
    def grip(self) -> Prior | float | None:
        return self.motion.grip

    def footing(self, farthest: float, arguments: Named) -> Footing:
        return self.motion.footing(farthest, own_values(arguments, self.varied))

    def metres(self, arguments: Named) -> ArrayLike:
        return self.motion.metres(own_values(arguments, self.varied))

    def gravity(self, arguments: Named) -> ArrayLike:
        return self.motion.gravity(own_values(arguments, self.varied))

    def upright(self, arguments: Named) -> ArrayLike:
        return self.motion.upright(own_values(arguments, self.varied))

    def radian(self, arguments: Named) -> ArrayLike:
        return self.motion.radian(own_values(arguments, self.varied))

    def energies(
        self, x: FloatArray, v: FloatArray, arguments: Named
    ) -> tuple[FloatArray, FloatArray]:
        return self.motion.energies(x, v, own_values(arguments, self.varied))

    def errors_in_common(
        self, curve: Curve, arguments: Mapping[str, str | float]
    ) -> tuple[CommonError, ...]:
        """Of a curve that varies."""
        assert isinstance(curve, VaryingCurve)
        errors = self.motion.errors_in_common(curve.curve, arguments)
        return tuple(
            replace(error, curve=VaryingCurve(cast(SpeedCurve, error.curve), self.varied))
            for error in errors
        )

    def derived(self, arguments: Named) -> Mapping[str, Derived]:
        return self.motion.derived(own_values(arguments, self.varied))

    def end(self, arguments: Named) -> FloatArray:
        return self.motion.end(own_values(arguments, self.varied))
