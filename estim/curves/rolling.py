"""The motion of a rolling body as curves to fit: speed against position, and position against time.

Arguments of both are the quantities of a campaign; with `angular` positions are angles turned since
release, in rad.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import Notation, later, phrase
from estim.curves.differences import with_gradient
from estim.model import (
    Body,
    ContactForces,
    back_and_forth,
    contact_forces,
    energy,
    needed_friction,
    phase,
    positions_at,
)
from estim.problem import CommonError, Curve, Derived, Footing, LocalCurve, Prior, Wording

_BODY = ("radius", "gamma", "kappa", "rho", "trailing_fraction", "particle_gyration")
_ZEROED = ("phi", "theta0")  # angles that an instrument may read with a common zero error
# argument of a campaign -> error
_IN_COMMON = {
    "scale_t": ("clock", 0.01, "1"),
    "scale_x": ("length", 0.01, "1"),
    "sag": ("sag", 1e-3, "m"),
}
_TAKEN_AS_EXACT = {  # argument -> an error of it: of angles in rad, else as a share
    "radius": 0.01,
    "g": 1e-3,
    "gamma": 0.01,
    "kappa": 0.01,
    "phi": float(np.radians(0.1)),
    "theta0": float(np.radians(1.0)),
}
FIRST_TURNING = later(
    "first turning point, measured from the release, on the scale of the positions"
)
_N_FOOTING = 96  # places along the way
_MOTION = ("phi", "theta0", "rolling_resistance", "g")


def body_of(arguments: Mapping[str, ArrayLike]) -> tuple[Body, dict[str, Any]]:
    """The body, and the keywords that say how it moves; zero errors of the angles are added to
    them.
    """
    motion: dict[str, Any] = {name: arguments[name] for name in _MOTION}
    for angle in _ZEROED:
        motion[angle] = np.add(motion[angle], arguments.get(f"{angle}_zero", 0.0))
    return Body(**{name: arguments[name] for name in _BODY}), motion


def from_release(x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
    """Positions counted from the release: (n_obs,), or (n_draw, n_obs) where the zero of the
    positions is unknown.
    """
    return x - np.asarray(arguments["offset"]) if "offset" in arguments else x


def derived_of(body: Body, motion: Mapping[str, Any], mass: float | None) -> dict[str, Derived]:
    """What follows from a body and how it moves whatever was measured; `mass` in kg, or None."""
    phi, resistance = np.asarray(motion["phi"]), np.asarray(motion["rolling_resistance"])
    derived = {
        "inertia_ratio": Derived(
            "1",
            np.atleast_2d(body.inertia_ratio),
            phrase("moment of inertia of all rotating parts / (M R²)"),
            Notation("j"),
        ),
        "slope": Derived(
            "1",
            np.atleast_2d(phase.effective_slope(phi, resistance)),
            phrase("effective slope sin φ + c_rr cos φ"),
            Notation("s"),
        ),
    }
    if mass is not None:
        moment = resistance * mass * np.asarray(motion["g"]) * body.radius * np.cos(phi)
        meaning = phrase("moment of rolling resistance, c_rr M g R cos φ")
        derived["resisting_moment"] = Derived(
            "N m", np.atleast_2d(moment), meaning, Notation("Q_rr")
        )
    return derived


def footing_of(along: FloatArray, contact: ContactForces) -> Footing:
    """A footing that ends where the motion first does: behind a turning point the energy may be
    positive again.
    """
    along, normal, needed = np.broadcast_arrays(
        along, np.atleast_2d(contact.normal), np.atleast_2d(needed_friction(contact))
    )
    there = np.isfinite(normal)
    over = np.logical_or.accumulate(np.logical_or.accumulate(there, axis=1) & ~there, axis=1)
    return Footing(along, np.where(over, np.nan, normal), np.where(over, np.nan, needed))


@dataclass(frozen=True, eq=False)
class PhaseCurve:
    """The phase curve of a rolling body as a curve to fit: v(x) in m/s, or omega(theta - theta0) in
    rad/s.

    angular : positions are angles turned since release.

    An argument `offset`, if there is one, is the reading of the position at release: the motion is
    that at x - offset.
    """

    angular: bool

    def value(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        body, motion = body_of(arguments)
        return (phase.angular_rate if self.angular else phase.speed)(
            from_release(x, arguments), body, **motion
        )

    def local(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        square = self.local_square(x, arguments)
        return LocalCurve(
            *phase.root_derivatives(square.value, square.slope, dict(square.gradient))
        )

    def square(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        body, motion = body_of(arguments)
        g, since = np.asarray(motion.pop("g")), from_release(x, arguments)
        ratio = phase.energy_ratio(
            since if self.angular else since / np.asarray(body.radius), body, **motion
        )
        return np.atleast_2d(
            2.0
            * g
            * (ratio / np.asarray(body.radius) if self.angular else ratio * np.asarray(body.radius))
        )

    def local_square(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        body, motion = body_of(arguments)
        value, slope, gradient = (
            phase.squared_rate_derivatives if self.angular else phase.squared_speed_derivatives
        )(from_release(x, arguments), body, **motion)
        zeros = {f"{angle}_zero": gradient[angle] for angle in _ZEROED} | {
            "offset": -np.asarray(slope)
        }
        return LocalCurve(np.atleast_2d(value), np.atleast_2d(slope), {**gradient, **zeros})

    def position(self, since: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        """(n_draw, n_obs) position at times `since` release (s), back and forth."""
        body, motion = body_of(arguments)
        phi, theta0, resistance, g = (motion[name] for name in _MOTION)
        x = positions_at(since, body, phi=phi, theta0=theta0, rolling_resistance=resistance, g=g)
        return np.atleast_2d(x) / (np.asarray(body.radius) if self.angular else 1.0)

    def time_derivative(
        self, x: FloatArray, arguments: Mapping[str, ArrayLike], order: int
    ) -> FloatArray:
        body, motion = body_of(arguments)
        g, radius = np.asarray(motion.pop("g")), np.asarray(body.radius)
        since = from_release(x, arguments)
        ratios = phase.energy_ratio_derivatives(
            since if self.angular else since / radius, body, **motion, order=order
        )
        scale = 2.0 * g / radius if self.angular else 2.0 * g * radius
        step = 1.0 if self.angular else radius
        return np.atleast_2d(
            phase.time_derivative([scale * h / step**n for n, h in enumerate(ratios)], order)
        )


@dataclass(frozen=True, eq=False)
class MotionCurve:
    """Position against time, x(t) in m or theta - theta0 in rad, back and forth; release and zero
    are arguments too.

        x(t) = offset + X(t - release_time)        X: from rest at 0

    release_time : s, on the clock of the data.
    offset : reading of the position at release, m or rad.
    """

    angular: bool

    def value(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        body, motion = body_of(arguments)
        place = {name: motion[name] for name in _MOTION}
        position = positions_at(x - np.asarray(arguments["release_time"]), body, **place)
        return np.asarray(
            position / (np.asarray(body.radius) if self.angular else 1.0)
            + np.asarray(arguments["offset"])
        )

    def local(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        """The gradient is by central differences of a position that is exact to about 1e-12."""
        (position, velocity), gradient = with_gradient(
            lambda columns: self.state(x, columns), arguments, step=1e-5
        )
        return LocalCurve(position, velocity, gradient)

    def state(
        self, t: FloatArray, arguments: Mapping[str, ArrayLike]
    ) -> tuple[FloatArray, FloatArray]:
        """Position and velocity at times t (n_obs,) s of the data's clock, in the run's unit."""
        body, motion = body_of(arguments)
        since = t - np.asarray(arguments["release_time"])
        phi, theta0, resistance, g = (motion[name] for name in _MOTION)
        x, v = back_and_forth(
            since, body, phi=phi, theta0=theta0, rolling_resistance=resistance, g=g
        )
        length = np.asarray(body.radius) if self.angular else 1.0
        return x / length + np.asarray(arguments["offset"]), v / length


@dataclass(frozen=True, eq=False)
class RollingMotion:
    """What is known of a rolling body beside its curve.

    angular : positions are angles turned since release.
    mass : kg, or None where the campaign does not say.
    in_time : whether positions were measured against time, so that the abscissa is a time, which
        has no end.
    grip : coefficient of static friction as stated.
    full : the curve with everything that a campaign may state beside; None where nobody asks for
        it.
    ramp_length : m, of the ramp that may sag in that curve.
    """

    angular: bool
    mass: float | None = None
    in_time: bool = False
    grip: Prior | float | None = field(default=None, kw_only=True)
    full: Curve | None = field(default=None, kw_only=True)
    ramp_length: float | None = field(default=None, kw_only=True)

    end_notation = Notation("x_t")
    instrument_readings = ("phi", "theta0")

    def metres(self, arguments: Mapping[str, ArrayLike]) -> ArrayLike:
        return arguments["radius"] if self.angular else 1.0

    def gravity(self, arguments: Mapping[str, ArrayLike]) -> ArrayLike:
        return arguments["g"]

    def upright(self, arguments: Mapping[str, ArrayLike]) -> ArrayLike:
        return np.cos(body_of(arguments)[1]["phi"])

    def radian(self, arguments: Mapping[str, ArrayLike]) -> ArrayLike:
        return 1.0 if self.angular else arguments["radius"]

    def footing(self, farthest: float, arguments: Mapping[str, ArrayLike]) -> Footing:
        body, motion = body_of(arguments)
        along, way = self._way(farthest, arguments)
        contact = contact_forces(
            way if self.angular else way / np.asarray(body.radius), body, **motion
        )
        return footing_of(along, contact)

    def _way(
        self, farthest: float, arguments: Mapping[str, ArrayLike]
    ) -> tuple[FloatArray, FloatArray]:
        """Readings from the release to `farthest`, and how far they are from the release, (n_draw,
        n) each.
        """
        zero = np.atleast_2d(np.asarray(arguments.get("offset", 0.0), dtype=float))
        way = np.maximum(farthest - zero, 0.0) * np.linspace(0.0, 1.0, _N_FOOTING)
        return zero + way, way

    def energies(
        self, x: FloatArray, v: FloatArray, arguments: Mapping[str, ArrayLike]
    ) -> tuple[FloatArray, FloatArray]:
        body, motion = body_of(arguments)
        length = body.radius if self.angular else 1.0
        place: dict[str, Any] = {"phi": motion["phi"], "theta0": motion["theta0"]}
        x = from_release(x, arguments)
        kinetic = energy.kinetic_energy(length * x, length * v, body, **place)
        return kinetic, energy.potential_energy(length * x, body, **place, g=motion["g"])

    def derived(self, arguments: Mapping[str, ArrayLike]) -> Mapping[str, Derived]:
        quantities = derived_of(*body_of(arguments), self.mass)
        if self.in_time:
            unit = "rad" if self.angular else "m"
            quantities["turning_point"] = Derived(
                unit, np.atleast_2d(self._stop(arguments)), phrase(FIRST_TURNING), self.end_notation
            )
        return quantities

    def errors_in_common(
        self, curve: Curve, arguments: Mapping[str, str | float]
    ) -> tuple[CommonError, ...]:
        """Angles of an encoder have no scale.  What is inferred is no such error."""
        errors = []
        for argument, (name, size, unit) in _IN_COMMON.items():
            stated = arguments.get(argument, 0.0)
            if (
                self.full is not None
                and not isinstance(stated, str)
                and not (self.angular and argument == "scale_x")
            ):
                along = self.ramp_length if argument == "sag" else None
                errors.append(
                    CommonError(name, size, unit, self.full, {argument: stated + size}, along)
                )
        for name, size in _TAKEN_AS_EXACT.items():
            value = arguments[name]
            if not isinstance(value, str) and value != 0.0:
                change, unit = (size, "rad") if name in _ZEROED else (size * value, "1")
                errors.append(CommonError(name, size, unit, curve, {name: value - change}))
        return tuple(errors)

    def end(self, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        if self.in_time:
            return np.full((1, 1), np.inf)
        return np.atleast_2d(self._stop(arguments) + np.asarray(arguments.get("offset", 0.0)))

    def _stop(self, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        body, motion = body_of(arguments)
        motion.pop("g")
        return np.asarray(
            (phase.turning_angle if self.angular else phase.turning_point)(body, **motion)
        )

    def words(self) -> Wording:
        """How the measured numbers are called."""
        what = (
            (later("positions"), later("angles"))
            if self.in_time
            else (later("speeds"), later("angular rates"))
        )[self.angular]
        return Wording(
            what,
            later("angle") if self.angular else later("position"),
            later("a new point"),
            later("frames"),
            True,
        )
