"""The motion of a rolling body as curves to fit: speed against position, and position against time.

Arguments are the quantities of a campaign; with `angular` positions are angles turned since
release, in rad.  Beside weight and plain rolling resistance they may state more: a start with a
push, drag, moments, a ramp that is not straight (`estim.model.forces`), errors of the length scale,
the clock and the image (`estim.model.readings`).  What they do not state costs nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, Named
from estim.common import Notation, PhraseTable, later, phrase
from estim.curves.differences import with_gradient
from estim.model import (
    Body,
    ContactForces,
    Forces,
    Readings,
    back_and_forth,
    blurred_sigma,
    contact_forces,
    energy,
    moment_ratio,
    needed_friction,
    phase_curve,
    release_energy,
    release_speed,
    sagging,
    turn_amplitude,
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
_MOTION = ("phi", "theta0", "rolling_resistance", "g")
_FORCES = {  # argument -> field of Forces
    "load_resistance": "load_resistance",
    "viscous_drag": "viscous_drag",
    "quadratic_drag": "quadratic_drag",
    "moment_once_cos": "once_cos",
    "moment_once_sin": "once_sin",
    "moment_twice_cos": "twice_cos",
    "moment_twice_sin": "twice_sin",
    "phi_slope": "phi_slope",
}
# argument -> field of Readings
_READINGS = {"scale_x": "scale_x", "scale_t": "scale_t", "distortion": "bow"}
_DEGREES = float(np.degrees(1.0))
_SIZES = PhraseTable(
    {
        "once": "amplitude of the moment once per turn / (M g R)",
        "twice": "amplitude of the moment twice per turn / (M g R)",
    }
)
_PHASES = PhraseTable(
    {
        "once": "phase of the moment once per turn, largest at θ",
        "twice": "phase of the moment twice per turn, largest at 2 θ",
    }
)


def body_of(arguments: Named) -> tuple[Body, dict[str, Any]]:
    """The body, and the keywords that describe its motion; zero errors of the angles are added to
    them.
    """
    motion: dict[str, Any] = {name: arguments[name] for name in _MOTION}
    for angle in _ZEROED:
        motion[angle] = np.add(motion[angle], arguments.get(f"{angle}_zero", 0.0))
    return Body(**{name: arguments[name] for name in _BODY}), motion


def from_release(x: FloatArray, arguments: Named) -> FloatArray:
    """Positions counted from the release: (n_obs,), or (n_draw, n_obs) where the zero of the
    positions is unknown.
    """
    return x - arguments["offset"] if "offset" in arguments else x


def derived_of(body: Body, motion: Mapping[str, Any], mass: float | None) -> dict[str, Derived]:
    """What follows from a body and how it moves whatever was measured; `mass` in kg, or None."""
    phi, resistance = motion["phi"], motion["rolling_resistance"]
    slope = phase_curve.effective_slope(phi, resistance)
    of_parts = phrase("moment of inertia of all rotating parts / (M R²)")
    of_ramp = phrase("effective slope sin φ + c_rr cos φ")
    derived = {
        "inertia_ratio": _derived("1", body.inertia_ratio, of_parts, Notation("j")),
        "slope": _derived("1", slope, of_ramp, Notation("s")),
    }
    if mass is not None:
        moment = resistance * mass * motion["g"] * body.radius * np.cos(phi)
        meaning = phrase("moment of rolling resistance, c_rr M g R cos φ")
        derived["resisting_moment"] = _derived("N m", moment, meaning, Notation("Q_rr"))
    return derived


def footing_of(along: FloatArray, contact: ContactForces) -> Footing:
    """A footing that ends where the motion first does: behind a turning point the energy may be
    positive again.
    """
    along, normal, needed = np.broadcast_arrays(
        along, np.atleast_2d(contact.normal), np.atleast_2d(needed_friction(contact))
    )
    defined = np.isfinite(normal)
    over = np.logical_or.accumulate(np.logical_or.accumulate(defined, axis=1) & ~defined, axis=1)
    return Footing(along, np.where(over, np.nan, normal), np.where(over, np.nan, needed))


@dataclass(frozen=True)
class Place:
    """A length (m) and where on it the release is (m from the end of lower x)."""

    length: float = 1.0
    start: float = 0.0


@dataclass(frozen=True)
class Setting:
    """What is exact about a run beside its arguments.

    mass : kg, for a moment in N m.
    ramp : between its supports, for a ramp that sags.  picture : calibrated at both ends, for one
        that is distorted.
    """

    mass: float | None = None
    ramp: Place = Place()
    picture: Place = Place()


@dataclass(frozen=True, eq=False)
class _Known:
    """What the arguments state.  motion : phi (rad, at release), theta0, rolling_resistance, g.

    energy : at release, weights x R; speed : there, m/s; each None where the arguments hold
        neither.
    forces : None where there is none.
    """

    body: Body
    motion: dict[str, Any]
    energy: ArrayLike | None
    speed: ArrayLike | None
    forces: Forces | None
    readings: Readings

    @property
    def acting(self) -> dict[str, Any]:
        """Keywords of the functions of `estim.model.phase_curve`."""
        return {**self.motion, "release_energy": self.energy, "forces": self.forces}


def _known(arguments: Named, setting: Setting) -> _Known:
    body, motion = body_of(arguments)
    acting = {field: arguments[name] for name, field in _FORCES.items() if name in arguments}
    if "sag" in arguments:
        where = {"length": setting.ramp.length, "start": setting.ramp.start}
        motion["phi"], acting["phi_slope"] = sagging(
            motion["phi"], arguments["sag"], **where, phi_slope=acting.get("phi_slope", 0.0)
        )
    if "moment" in arguments and setting.mass is not None:
        acting["moment"] = moment_ratio(arguments["moment"], setting.mass, body.radius, motion["g"])
    read = {field: arguments[name] for name, field in _READINGS.items() if name in arguments}
    at_release = {name: motion[name] for name in ("phi", "theta0", "g")}
    energy_at_release, speed = arguments.get("release_energy"), arguments.get("release_speed")
    if energy_at_release is not None:
        speed = release_speed(energy_at_release, body, **at_release)
    elif speed is not None:
        energy_at_release = release_energy(speed, body, **at_release)
    return _Known(
        body,
        motion,
        energy_at_release,
        speed,
        Forces(**acting) if acting else None,
        Readings(**read, length=setting.picture.length, start=setting.picture.start),
    )


@dataclass(frozen=True, eq=False)
class PhaseCurve:
    """The phase curve of a rolling body as a curve to fit: v(x) in m/s, or omega(theta - theta0) in
    rad/s, as instruments read them.

        v_read^2 = 2 g R (E0 + W)/D (dx_read/dx)^2/(1 + scale_t)^2
            at x = true position of x_read - offset

    angular : positions are angles turned since release.

    An argument `offset`, if there is one, is the reading of the position at release.
    """

    angular: bool
    setting: Setting = Setting()

    def value(self, x: FloatArray, arguments: Named) -> FloatArray:
        return np.sqrt(np.maximum(self.square(x, arguments), 0.0))

    def local(self, x: FloatArray, arguments: Named) -> LocalCurve:
        square = self.local_square(x, arguments)
        return LocalCurve(
            *phase_curve.root_derivatives(square.value, square.slope, dict(square.gradient))
        )

    def local_square(self, x: FloatArray, arguments: Named) -> LocalCurve:
        """The gradient is by central differences."""
        (square,), gradient = with_gradient(lambda columns: (self.square(x, columns),), arguments)
        return LocalCurve(square, self._slope_of_square(x, arguments), gradient)

    def _slope_of_square(self, x: FloatArray, arguments: Named) -> FloatArray:
        """Along the position that is read: of F (dx_read/dx)^2."""
        known = _known(arguments, self.setting)
        read, true = known.readings, known.readings.true_position(from_release(x, arguments))
        square, slope = self._squares(true, known, 1)
        slope = slope * read.stretch(true) - 4.0 * read.parabola()[1] * square
        return np.atleast_2d(slope / np.square(1.0 + np.asarray(read.scale_t)))

    def position(self, since: FloatArray, arguments: Named) -> FloatArray:
        """(n_draw, n_obs) position that is read at times `since` release (s on the clock of the
        data), back and forth.
        """
        return _state(since, _known(arguments, self.setting), self.angular)[0]

    def time_derivative(self, x: FloatArray, arguments: Named, order: int) -> FloatArray:
        known = _known(arguments, self.setting)
        true = known.readings.true_position(from_release(x, arguments))
        squares = self._squares(true, known, order)
        derivative = phase_curve.time_derivative(squares, order)
        return np.atleast_2d(_as_read(derivative, squares, order, known.readings, true))

    def square(self, x: FloatArray, arguments: Named) -> FloatArray:
        known = _known(arguments, self.setting)
        true = known.readings.true_position(from_release(x, arguments))
        radius, g = known.body.radius, known.motion["g"]
        scale = 2.0 * g / radius if self.angular else 2.0 * g * radius
        ratio = phase_curve.energy_ratio(
            true if self.angular else true / radius, known.body, **known.acting
        )
        return np.atleast_2d(scale * ratio * known.readings.speed(1.0, true) ** 2)

    def _squares(self, true: FloatArray, known: _Known, order: int) -> list[FloatArray]:
        """Square of the true speed and its derivatives along the way."""
        radius, g = known.body.radius, known.motion["g"]
        ratios = phase_curve.energy_ratio_derivatives(
            true if self.angular else true / radius, known.body, **known.acting, order=order
        )
        scale, step = (2.0 * g / radius, 1.0) if self.angular else (2.0 * g * radius, radius)
        return [np.atleast_2d(scale * h / step**n) for n, h in enumerate(ratios)]


def _as_read(
    derivative: FloatArray, squares: list[FloatArray], order: int, readings: Readings, x: FloatArray
) -> FloatArray:
    """Time derivative of order 2 or 4 of the speed that is read, from that of the true speed
    (`derivative`), by Leibniz of x_read = a x - k x^2.
    """
    v, a = np.sqrt(np.maximum(squares[0], 0.0)), [0.5 * f for f in squares[1:]]
    if order == 2:
        rest = 6.0 * v * a[0]
    else:  # the derivatives of x are v, a, a' v, a'' v^2 + a a'
        rest = 10.0 * v * (a[2] * v**2 + a[0] * a[1]) + 20.0 * a[0] * a[1] * v
    return (derivative * readings.stretch(x) - readings.parabola()[1] * rest) / (
        1.0 + np.asarray(readings.scale_t)
    ) ** (order + 1)


def _state(since: FloatArray, known: _Known, angular: bool) -> tuple[FloatArray, FloatArray]:
    """Position and velocity that are read at times since release (s on the clock of the data), from
    the reading at release.
    """
    x, v = back_and_forth(
        known.readings.true_time(since),
        known.body,
        **known.motion,
        release_speed=known.speed,
        forces=known.forces,
    )
    length = known.body.radius if angular else 1.0
    x, v = np.atleast_2d(x) / length, np.atleast_2d(v) / length
    return known.readings.position(x), v * known.readings.speed(1.0, x)


@dataclass(frozen=True, eq=False)
class MotionCurve:
    """Position against time, x(t) in m or theta - theta0 in rad, back and forth, as instruments
    read them; release and zero are arguments too.

        x(t) = offset + X(t - release_time)        X: from 0

    release_time : s, on the clock of the data.
    offset : reading of the position at release, m or rad.
    """

    angular: bool
    setting: Setting = Setting()

    def value(self, x: FloatArray, arguments: Named) -> FloatArray:
        return self.state(x, arguments)[0]

    def local(self, x: FloatArray, arguments: Named) -> LocalCurve:
        """The gradient is by central differences."""
        (position, velocity), gradient = with_gradient(
            lambda columns: self.state(x, columns), arguments
        )
        return LocalCurve(position, velocity, gradient)

    def state(self, t: FloatArray, arguments: Named) -> tuple[FloatArray, FloatArray]:
        """Position and velocity that are read at times t (n_obs,) s of the data's clock, in the
        run's unit.
        """
        position, velocity = _state(
            t - arguments["release_time"], _known(arguments, self.setting), self.angular
        )
        return position + arguments["offset"], velocity


@dataclass(frozen=True, eq=False)
class RollingMotion:
    """What is known of a rolling body beside its curve.

    angular : positions are angles turned since release.
    mass : kg, or None where the campaign does not state it.
    in_time : whether positions were measured against time, so that the abscissa is a time, which
        has no end.
    setting : what is exact.  reach : how far the body was seen, in the unit of its positions; its
        end under forces is looked for up to twice that.
    grip : coefficient of static friction as stated.
    full : the curve with everything that a campaign may state beside; None where nobody needs
        it.
    ramp_length : m, of the ramp that may sag in that curve.
    """

    angular: bool
    mass: float | None = None
    in_time: bool = False
    setting: Setting = Setting()
    reach: float = 1.0
    grip: Prior | float | None = field(default=None, kw_only=True)
    full: Curve | None = field(default=None, kw_only=True)
    ramp_length: float | None = field(default=None, kw_only=True)

    end_notation = Notation("x_t")
    instrument_readings = ("phi", "theta0")

    def metres(self, arguments: Named) -> float | FloatArray:
        return arguments["radius"] if self.angular else 1.0

    def gravity(self, arguments: Named) -> float | FloatArray:
        return arguments["g"]

    def upright(self, arguments: Named) -> float | FloatArray:
        return np.cos(body_of(arguments)[1]["phi"])

    def radian(self, arguments: Named) -> float | FloatArray:
        return 1.0 if self.angular else arguments["radius"]

    def footing(self, farthest: float, arguments: Named) -> Footing:
        known = _known(arguments, self.setting)
        along, distance = self._distances(farthest, arguments)
        true = known.readings.true_position(distance)
        contact = contact_forces(
            true if self.angular else true / known.body.radius, known.body, **known.acting
        )
        return footing_of(along, contact)

    def _distances(self, farthest: float, arguments: Named) -> tuple[FloatArray, FloatArray]:
        """Readings from the release to `farthest`, and how far they are from the release, (n_draw,
        n) each.
        """
        zero = np.atleast_2d(arguments.get("offset", 0.0))
        distance = np.maximum(farthest - zero, 0.0) * np.linspace(0.0, 1.0, 96)
        return zero + distance, distance

    def energies(
        self, x: FloatArray, v: FloatArray, arguments: Named
    ) -> tuple[FloatArray, FloatArray]:
        known = _known(arguments, self.setting)
        length = known.body.radius if self.angular else 1.0
        surroundings: dict[str, Any] = {
            "phi": known.motion["phi"],
            "theta0": known.motion["theta0"],
            "forces": known.forces,
        }
        true = known.readings.true_position(from_release(x, arguments))
        kinetic = energy.kinetic_energy(
            length * true, length * v / known.readings.speed(1.0, true), known.body, **surroundings
        )
        return kinetic, energy.potential_energy(
            length * true, known.body, **surroundings, g=known.motion["g"]
        )

    def derived(self, arguments: Named) -> Mapping[str, Derived]:
        known = _known(arguments, self.setting)
        quantities = derived_of(known.body, known.motion, self.mass)
        if known.forces is not None:
            quantities |= _of_forces(known, arguments, quantities.get("resisting_moment"))
        if "release_energy" in arguments:
            quantities["speed_at_release"] = _derived(
                "m/s",
                known.speed,
                phrase("speed at release, from the energy at release"),
                Notation("v_0"),
            )
        elif "release_speed" in arguments:
            quantities["energy_at_release"] = _derived(
                "1", known.energy, phrase("kinetic energy at release / (M g R)"), Notation("E_0")
            )
        if self.in_time:
            unit = "rad" if self.angular else "m"
            quantities["turning_point"] = _derived(
                unit, self.stop(arguments), phrase(FIRST_TURNING), self.end_notation
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

    def end(self, arguments: Named) -> FloatArray:
        if self.in_time:
            return np.full((1, 1), np.inf)
        return np.atleast_2d(self.stop(arguments) + arguments.get("offset", 0.0))

    def stop(self, arguments: Named) -> FloatArray:
        known = _known(arguments, self.setting)
        acting, radius = known.acting, known.body.radius
        if self.in_time and known.energy is not None:
            # pushed back it comes by again about as fast
            acting["release_energy"] = np.abs(known.energy)
        far = 2.0 * self.reach / (1.0 if self.angular else float(np.min(radius))) + np.pi
        angle = phase_curve.turning_angle(known.body, **acting, far=far)
        true = angle if self.angular else radius * angle
        stops = np.isfinite(true)
        return np.where(stops, known.readings.position(np.where(stops, true, 0.0)), true)

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


def _derived(unit: str, values: ArrayLike | None, meaning: str, notation: Notation) -> Derived:
    return Derived(unit, np.atleast_2d(np.asarray(values, dtype=float)), meaning, notation)


def _of_forces(known: _Known, arguments: Named, rolling: Derived | None) -> dict[str, Derived]:
    quantities: dict[str, Derived] = {}
    forces = known.forces or Forces()
    if "moment" in arguments:
        slope = phase_curve.effective_slope(
            known.motion["phi"], known.motion["rolling_resistance"]
        ) + np.asarray(forces.moment)
        quantities["slope"] = _derived(
            "1", slope, phrase("effective slope sin φ + c_rr cos φ + Q/(M g R)"), Notation("s")
        )
        if rolling is not None:
            total = rolling.values + arguments["moment"]
            quantities["resisting_moment"] = _derived(
                "N m",
                total,
                phrase("total resisting moment, c_rr M g R cos φ + Q"),
                Notation("Q_all"),
            )
    for k, (_, cosine, sine) in zip(("once", "twice"), forces.turning, strict=True):
        if f"moment_{k}_cos" in arguments or f"moment_{k}_sin" in arguments:
            size, angle = turn_amplitude(cosine, sine)
            quantities[f"moment_{k}"] = _derived("1", size, _SIZES[k], Notation(f"a_{k}"))
            quantities[f"moment_{k}_phase"] = _derived(
                "rad", angle, _PHASES[k], Notation(f"p_{k}", "°", _DEGREES)
            )
    return quantities


def energy_of_speed(arguments: Named) -> float:
    """Energy at release (weights x R) of the argument `release_speed`."""
    known = _known(arguments, Setting())
    return float(np.squeeze(np.asarray(known.energy)))


def size_with_blur(size: FloatArray, speed: FloatArray, exposure: float) -> FloatArray:
    """Standard deviation of readings of a body that moves while a picture is exposed (s), all in
    units of the position.
    """
    return blurred_sigma(size, speed, exposure=exposure)
