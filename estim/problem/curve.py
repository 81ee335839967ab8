"""What estim needs of a curve y = f(x; arguments): its value, its slope and its gradient,
vectorised over draws.

The phase curve of a rolling body is one such curve; anything else that keeps to this protocol can
be fit in its place.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from estim.arrays import FloatArray, Named
from estim.common import Label, Notation, later
from estim.problem.priors import Prior

# relative error of derivatives that are exact but for rounding; a curve whose are not states so as
# `precision`
EXACT = 2.3e-16


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
    """A quantity computed from the parameters: unit, (n_draw, 1) values, what it is, and how it is
    written.
    """

    unit: str
    values: FloatArray
    meaning: str
    notation: Notation

    @property
    def label(self) -> Label:
        """How it is shown."""
        return self.notation.label(self.unit)


class DerivedQuantity(Protocol):
    """A quantity that a user wants to be computed from the parameters.

    text : how it follows.
    unit : of it.  others : names beside the arguments of the run's curve -> parameter, or an exact
        number.
    lacking : such names that nothing in this fit stands for, so that it cannot be computed.
    """

    @property
    def name(self) -> str: ...

    @property
    def text(self) -> str: ...

    @property
    def unit(self) -> str: ...

    @property
    def others(self) -> Mapping[str, str | float]: ...

    @property
    def lacking(self) -> tuple[str, ...]: ...

    def of(self, known: Named) -> Derived | None:
        """Its values, where `known` has scalars or (n_draw, 1) of every name that it needs; None
        where it lacks one.
        """


@dataclass(frozen=True, eq=False)
class Footing:
    """How a body presses on its ramp along the way from the release, all (n_draw, n).

    along : position, as it is read.
    normal : N over the weight.  needed : the coefficient of friction that rolling needs there,
        |F|/N; inf where the ramp would have to pull.  Both nan where a draw does not get.
    """

    along: FloatArray
    normal: FloatArray
    needed: FloatArray


@dataclass(frozen=True, eq=False)
class CommonError:
    """An error that all points of a run may have in common, which no residual shows, and how a fit
    accounts for it.

    name : of what is wrong ("clock").
    size : how large the error is taken, in `unit` ("1": a share).
    curve : of what is measured with the error.
    arguments : argument of that curve -> its value, in place of the run's or beside them.
    along : m, length of the ramp that a sag is about; None for other errors.
    """

    name: str
    size: float
    unit: str
    curve: Curve
    arguments: Mapping[str, float]
    along: float | None = None


class Curve(Protocol):
    """A curve; arguments are scalars or shaped (n_draw, 1), x is (n_obs,), results are (n_draw,
    n_obs), (1, n_obs) of scalars.
    """

    def value(self, x: FloatArray, arguments: Named) -> FloatArray:
        """f(x; arguments)."""

    def local(self, x: FloatArray, arguments: Named) -> LocalCurve:
        """f with its slope in x and its gradient in the arguments."""


@runtime_checkable
class SpeedCurve(Curve, Protocol):
    """A curve of speeds dx/dt = f(x), which speeds made by differences of positions need."""

    def time_derivative(self, x: FloatArray, arguments: Named, order: int) -> FloatArray:
        """d^order f/dt^order along the motion dx/dt = f(x), for even `order`: what a derivative by
        differences adds to its mean.
        """


@runtime_checkable
class SquaredCurve(Curve, Protocol):
    """A curve of speeds whose square is known also where it is negative: where the energy does not
    suffice.
    """

    def square(self, x: FloatArray, arguments: Named) -> FloatArray:
        """(n_draw, n_obs) f^2."""

    def local_square(self, x: FloatArray, arguments: Named) -> LocalCurve:
        """f^2 with its slope in x and its gradient in the arguments."""


@runtime_checkable
class PositionCurve(Curve, Protocol):
    """A curve of positions against time."""

    def state(self, t: FloatArray, arguments: Named) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities (n_draw, n_obs) at times t (n_obs,) s of the data's clock."""


class Motion(Protocol):
    """What is known of a body whose motion was measured, beside the curve that is fit; a plain
    curve has none.
    """

    @property
    def mass(self) -> float | None:
        """Mass (kg) of what moves, None where it is unknown."""

    @property
    def instrument_readings(self) -> tuple[str, ...]:
        """Arguments that an instrument reads, so that none of them is known exactly."""

    @property
    def end_notation(self) -> Notation:
        """How the abscissa of `end` is written."""

    @property
    def grip(self) -> Prior | float | None:
        """Coefficient of static friction as stated, None where it is not."""

    def footing(self, farthest: float, arguments: Named) -> Footing:
        """The force of the ramp from the release to the reading `farthest`, on the way there."""

    def metres(self, arguments: Named) -> float | FloatArray:
        """Metres that one unit of position is worth."""

    def gravity(self, arguments: Named) -> float | FloatArray:
        """Acceleration of free fall, m/s^2."""

    def upright(self, arguments: Named) -> float | FloatArray:
        """Normal force over the weight, at rest."""

    def radian(self, arguments: Named) -> float | FloatArray:
        """Positions passed while the body turns by one radian."""

    def energies(
        self, x: FloatArray, v: FloatArray, arguments: Named
    ) -> tuple[FloatArray, FloatArray]:
        """Kinetic and potential energy per unit mass (J/kg) at measured positions x and speeds
        v.
        """

    def errors_in_common(
        self, curve: Curve, arguments: Mapping[str, str | float]
    ) -> tuple[CommonError, ...]:
        """What clock, scale and ramp may suffer, and those arguments of `curve` that are taken as
        exact: a number in place of a parameter's name.
        """

    def derived(self, arguments: Named) -> Mapping[str, Derived]:
        """Quantities that follow from the arguments and mean something to a reader, by name."""

    def stop(self, arguments: Named) -> FloatArray:
        """How far it gets before it first turns, from the release, as it is read; 0 where it does
        not set off, inf where it rolls on.
        """

    def end(self, arguments: Named) -> FloatArray:
        """Abscissa behind which the motion does not go, (n_draw, 1) or (1, 1); inf where it never
        ends.
        """


@dataclass(frozen=True)
class Wording:
    """How the measured numbers of a run are named, and drawn.

    what : all of them.
    reading : one that the instrument gave.
    new : one more of them, for the legend of a predictive band, where {y} is the name of the
        ordinate.
    rows : what they are counted in.
    from_release : whether axes begin at 0, where the motion is released; else where the data begin.
    """

    what: str
    reading: str
    new: str
    rows: str
    from_release: bool


POINTS = Wording("points", "reading", later("a new point"), later("points"), False)


def plain_words() -> Wording:
    """Of points on a curve that is no motion."""
    return replace(POINTS, new=later("a new {y}"))
