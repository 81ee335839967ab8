"""The motion of a rolling body with all that a campaign may know beside weight and plain rolling
resistance.

A start with a push, drag, moments, a ramp that is not straight (`estim.model.forces`), errors of
the length scale, the clock and the image (`estim.model.readings`): each an argument of the curves
here.  Without any of them the curves of `estim.curves.rolling` are the ones to use: they are the
same to the last bits, and faster.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import Notation, later, phrase
from estim.curves.differences import with_gradient
from estim.curves.rolling import (
    FIRST_TURNING,
    PhaseCurve,
    RollingMotion,
    body_of,
    derived_of,
    footing_of,
    from_release,
)
from estim.model import (
    Body,
    Forces,
    Readings,
    back_and_forth,
    blurred_sigma,
    contact_forces,
    energy,
    moment_ratio,
    phase,
    release_energy,
    release_speed,
    sagging,
    turn_amplitude,
)
from estim.problem import Derived, Footing, LocalCurve

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
_BEYOND_SCALES = _FORCES.keys() | {"sag", "distortion", "moment", "release_energy", "release_speed"}
_STEP = 1e-4  # relative, of differences: motion under any force is good to 1e-10 or so
_DEGREES = float(np.degrees(1.0))
_SIZES = {
    "once": later("amplitude of the moment once per turn / (M g R)"),
    "twice": later("amplitude of the moment twice per turn / (M g R)"),
}
_PHASES = {
    "once": later("phase of the moment once per turn, largest at θ"),
    "twice": later("phase of the moment twice per turn, largest at 2 θ"),
}


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
class _Disturbed:
    """What the arguments say.  motion : phi (rad, at release), theta0, rolling_resistance, g.

    energy : at release, weights x R; speed : there, m/s; each None where the arguments hold
        neither.
    forces, readings : None where there is none.
    """

    body: Body
    motion: dict[str, Any]
    energy: ArrayLike | None
    speed: ArrayLike | None
    forces: Forces | None
    readings: Readings | None

    @property
    def acting(self) -> dict[str, Any]:
        """Keywords of the functions of `estim.model.phase`."""
        return {**self.motion, "release_energy": self.energy, "forces": self.forces}

    def true_position(self, reading: FloatArray) -> FloatArray:
        return reading if self.readings is None else self.readings.true_position(reading)

    def read_position(self, x: FloatArray) -> FloatArray:
        return x if self.readings is None else self.readings.position(x)

    def gain(self, x: FloatArray) -> FloatArray | float:
        """Speed that is read / true speed, at the true position x."""
        return 1.0 if self.readings is None else self.readings.speed(1.0, x)

    def true_time(self, reading: FloatArray) -> FloatArray:
        return reading if self.readings is None else self.readings.true_time(reading)


def _disturbed(arguments: Mapping[str, ArrayLike], setting: Setting) -> _Disturbed:
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
    energy_there, speed = arguments.get("release_energy"), arguments.get("release_speed")
    if energy_there is not None:
        speed = release_speed(energy_there, body, **at_release)
    elif speed is not None:
        energy_there = release_energy(speed, body, **at_release)
    return _Disturbed(
        body,
        motion,
        energy_there,
        speed,
        Forces(**acting) if acting else None,
        Readings(**read, length=setting.picture.length, start=setting.picture.start)
        if read
        else None,
    )


@dataclass(frozen=True, eq=False)
class DisturbedPhaseCurve:
    """`PhaseCurve` with disturbances: v(x) in m/s, or omega(theta - theta0) in rad/s, as
    instruments read them.

        v_read^2 = 2 g R (E0 + W)/D (dx_read/dx)^2/(1 + scale_t)^2        at x = true position of
        x_read - offset
    """

    angular: bool
    setting: Setting = Setting()

    def value(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        return np.sqrt(np.maximum(self.square(x, arguments), 0.0))

    def local(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        square = self.local_square(x, arguments)
        return LocalCurve(
            *phase.root_derivatives(square.value, square.slope, dict(square.gradient))
        )

    def local_square(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        """The gradient is by central differences; closed where only scales are added."""
        if not _BEYOND_SCALES & arguments.keys():
            return _scaled(PhaseCurve(self.angular), x, arguments)
        (square,), gradient = with_gradient(
            lambda columns: (self.square(x, columns),), arguments, step=_STEP
        )
        known = _disturbed(arguments, self.setting)
        true = known.true_position(from_release(x, arguments))
        squares = self._squares(true, known, 1)
        slope = squares[1]
        if (read := known.readings) is not None:  # of F (dx_read/dx)^2 along x_read
            slope = (
                slope * read.stretch(true) - 4.0 * read.parabola()[1] * squares[0]
            ) / np.square(1.0 + np.asarray(read.scale_t))
        return LocalCurve(square, np.atleast_2d(slope), gradient)

    def position(self, since: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        """(n_draw, n_obs) position that is read at times `since` release (s on the clock of the
        data), back and forth.
        """
        return _state(since, _disturbed(arguments, self.setting), self.angular)[0]

    def time_derivative(
        self, x: FloatArray, arguments: Mapping[str, ArrayLike], order: int
    ) -> FloatArray:
        known = _disturbed(arguments, self.setting)
        true = known.true_position(from_release(x, arguments))
        squares = self._squares(true, known, order)
        derivative = phase.time_derivative(squares, order)
        if known.readings is not None:
            derivative = _as_read(derivative, squares, order, known.readings, true)
        return np.atleast_2d(derivative)

    def square(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        known = _disturbed(arguments, self.setting)
        true = known.true_position(from_release(x, arguments))
        radius, g = np.asarray(known.body.radius), np.asarray(known.motion["g"])
        scale = 2.0 * g / radius if self.angular else 2.0 * g * radius
        ratio = phase.energy_ratio(
            true if self.angular else true / radius, known.body, **known.acting
        )
        return np.atleast_2d(scale * ratio * known.gain(true) ** 2)

    def _squares(self, true: FloatArray, known: _Disturbed, order: int) -> list[FloatArray]:
        """Square of the true speed and its derivatives along the way."""
        radius, g = np.asarray(known.body.radius), np.asarray(known.motion["g"])
        ratios = phase.energy_ratio_derivatives(
            true if self.angular else true / radius, known.body, **known.acting, order=order
        )
        scale, step = (2.0 * g / radius, 1.0) if self.angular else (2.0 * g * radius, radius)
        return [np.atleast_2d(scale * h / step**n) for n, h in enumerate(ratios)]


def _scaled(curve: PhaseCurve, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
    """What f^2 of a plain curve becomes with errors of scale a and clock b: k f^2(x/(1 + a)), k =
    ((1 + a)/(1 + b))^2, x counted from the release.
    """
    scale, clock = (
        1.0 + np.asarray(arguments.get(name, 0.0), dtype=float) for name in ("scale_x", "scale_t")
    )
    since = from_release(x, arguments)
    zero = np.asarray(arguments.get("offset", 0.0))
    k = np.square(scale / clock)
    inner = curve.local_square(zero + since / scale, arguments)
    value, slope = k * inner.value, k / scale * inner.slope
    partials = {
        "scale_x": (2.0 * value - since * slope) / scale,
        "scale_t": -2.0 * value / clock,
        "offset": -slope,
    }
    return LocalCurve(
        value, slope, {**{name: k * d for name, d in inner.gradient.items()}, **partials}
    )


def _as_read(
    found: FloatArray, squares: list[FloatArray], order: int, readings: Readings, x: FloatArray
) -> FloatArray:
    """Time derivative of order 2 or 4 of the speed that is read, from that of the true speed
    (`found`), by Leibniz of x_read = a x - k x^2.
    """
    v, a = np.sqrt(np.maximum(squares[0], 0.0)), [0.5 * f for f in squares[1:]]
    if order == 2:
        rest = 6.0 * v * a[0]
    else:  # the derivatives of x are v, a, a' v, a'' v^2 + a a'
        rest = 10.0 * v * (a[2] * v**2 + a[0] * a[1]) + 20.0 * a[0] * a[1] * v
    return np.asarray(
        (found * readings.stretch(x) - readings.parabola()[1] * rest)
        / (1.0 + np.asarray(readings.scale_t)) ** (order + 1)
    )


def _state(since: FloatArray, known: _Disturbed, angular: bool) -> tuple[FloatArray, FloatArray]:
    """Position and velocity that are read at times since release (s on the clock of the data), from
    the reading at release.
    """
    x, v = back_and_forth(
        known.true_time(since),
        known.body,
        **known.motion,
        release_speed=known.speed,
        forces=known.forces,
    )
    length = np.asarray(known.body.radius) if angular else 1.0
    x, v = np.atleast_2d(x) / length, np.atleast_2d(v) / length
    return known.read_position(x), v * known.gain(x)


@dataclass(frozen=True, eq=False)
class DisturbedMotionCurve:
    """`MotionCurve` with disturbances: the position that is read against the time that the clock
    shows.
    """

    angular: bool
    setting: Setting = Setting()

    def value(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        return self.state(x, arguments)[0]

    def local(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        (position, velocity), gradient = with_gradient(
            lambda columns: self.state(x, columns), arguments, step=_STEP
        )
        return LocalCurve(position, velocity, gradient)

    def state(
        self, t: FloatArray, arguments: Mapping[str, ArrayLike]
    ) -> tuple[FloatArray, FloatArray]:
        """Position and velocity that are read at times t (n_obs,) s of the data's clock, in the
        run's unit.
        """
        position, velocity = _state(
            t - np.asarray(arguments["release_time"]),
            _disturbed(arguments, self.setting),
            self.angular,
        )
        return position + np.asarray(arguments["offset"]), velocity


@dataclass(frozen=True, eq=False)
class DisturbedMotion(RollingMotion):
    """`RollingMotion` with disturbances.  reach : how far the body was seen, in the unit of its
    positions; its end is looked for up to twice that.
    """

    setting: Setting = Setting()
    reach: float = 1.0

    def footing(self, farthest: float, arguments: Mapping[str, ArrayLike]) -> Footing:
        known = _disturbed(arguments, self.setting)
        along, way = self._way(farthest, arguments)
        true = known.true_position(way)
        contact = contact_forces(
            true if self.angular else true / np.asarray(known.body.radius),
            known.body,
            **known.acting,
        )
        return footing_of(along, contact)

    def energies(
        self, x: FloatArray, v: FloatArray, arguments: Mapping[str, ArrayLike]
    ) -> tuple[FloatArray, FloatArray]:
        known = _disturbed(arguments, self.setting)
        length = known.body.radius if self.angular else 1.0
        place: dict[str, Any] = {
            "phi": known.motion["phi"],
            "theta0": known.motion["theta0"],
            "forces": known.forces,
        }
        true = known.true_position(from_release(x, arguments))
        kinetic = energy.kinetic_energy(
            length * true, length * v / known.gain(true), known.body, **place
        )
        return kinetic, energy.potential_energy(
            length * true, known.body, **place, g=known.motion["g"]
        )

    def derived(self, arguments: Mapping[str, ArrayLike]) -> Mapping[str, Derived]:
        known = _disturbed(arguments, self.setting)
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
                unit, self._stop(arguments), phrase(FIRST_TURNING), self.end_notation
            )
        return quantities

    def _stop(self, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        """As it is read."""
        known = _disturbed(arguments, self.setting)
        acting, radius = known.acting, np.asarray(known.body.radius)
        if self.in_time and known.energy is not None:
            # pushed back it comes by again about as fast
            acting["release_energy"] = np.abs(known.energy)
        far = 2.0 * self.reach / (1.0 if self.angular else float(np.min(radius))) + np.pi
        angle = phase.turning_angle(known.body, **acting, far=far)
        true = np.asarray(angle if self.angular else radius * angle)
        turns = np.isfinite(true)
        return np.where(turns, known.read_position(np.where(turns, true, 0.0)), true)


def _derived(unit: str, values: ArrayLike | None, meaning: str, notation: Notation) -> Derived:
    return Derived(unit, np.atleast_2d(np.asarray(values, dtype=float)), meaning, notation)


def _of_forces(
    known: _Disturbed, arguments: Mapping[str, ArrayLike], rolling: Derived | None
) -> dict[str, Derived]:
    quantities: dict[str, Derived] = {}
    forces = known.forces or Forces()
    if "moment" in arguments:
        slope = phase.effective_slope(
            known.motion["phi"], known.motion["rolling_resistance"]
        ) + np.asarray(forces.moment)
        quantities["slope"] = _derived(
            "1", slope, phrase("effective slope sin φ + c_rr cos φ + Q/(M g R)"), Notation("s")
        )
        if rolling is not None:
            whole = rolling.values + np.asarray(arguments["moment"])
            quantities["resisting_moment"] = _derived(
                "N m",
                whole,
                phrase("total resisting moment, c_rr M g R cos φ + Q"),
                Notation("Q_all"),
            )
    for k, (_, cosine, sine) in zip(("once", "twice"), forces.turning, strict=True):
        if f"moment_{k}_cos" in arguments or f"moment_{k}_sin" in arguments:
            size, angle = turn_amplitude(cosine, sine)
            quantities[f"moment_{k}"] = _derived("1", size, phrase(_SIZES[k]), Notation(f"a_{k}"))
            quantities[f"moment_{k}_phase"] = _derived(
                "rad", angle, phrase(_PHASES[k]), Notation(f"p_{k}", "°", _DEGREES)
            )
    return quantities


def energy_of_speed(arguments: Mapping[str, ArrayLike]) -> float:
    """Energy at release (weights x R) of the argument `release_speed`."""
    known = _disturbed(arguments, Setting())
    return float(np.squeeze(np.asarray(known.energy)))


def size_with_blur(size: FloatArray, speed: FloatArray, exposure: float) -> FloatArray:
    """Standard deviation of readings of a body that moves while a picture is exposed (s), all in
    units of the position.
    """
    return np.asarray(blurred_sigma(size, speed, exposure=exposure))
