"""The direction of motion of a track: positions along it and across it, and its tilt against the
horizontal of the axes.

- `fit` (default): the principal axis of the points, the straight line of least squared
  perpendicular distances; it points in the direction in which the motion starts.  Use it when the
  axes were left as the camera saw them.
- `x`, `y`, `-x`, `-y`: an axis, when it was laid along the ramp in Tracker.
- a number of degrees: a stated direction, counter-clockwise from the x axis.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, Quantity, phrase, read_number
from estim.reading.tracker.track import Track

_AXES = {"x": 0.0, "y": 90.0, "-x": 180.0, "-y": -90.0}


@dataclass(frozen=True, eq=False)
class Ramp:
    """A track along one direction.

    along, across : (n,) m; across is None where only one coordinate is known.  Their zero is the
        origin of the axes.
    direction : how it was chosen, in words.
    tilt : rad, of the fitted line against the x axis, positive uphill, with its uncertainty from
        the scatter alone (not from a camera or axes that hang askew); None where only one
        coordinate is known.
    scatter : m, standard deviation of the points about the fitted line; NaN where only one
        coordinate is known.
    """

    along: FloatArray
    across: FloatArray | None
    direction: str
    tilt: Quantity | None
    scatter: float


def run_along(track: Track, direction: str | float = "fit") -> Ramp:
    """The positions of `track` along `direction`.  Raises InputError where it does not move or the
    direction makes no sense.
    """
    stated = _stated(direction)
    known = {
        name: column for name, column in (("x", track.x), ("y", track.y)) if column is not None
    }
    x, y = (known.get(name, np.zeros_like(track.t)) for name in ("x", "y"))
    dx, dy = _initial_displacement(track, x, y)
    fitted, u, scatter = _principal_axis(x, y)
    if math.cos(fitted) * dx + math.sin(fitted) * dy < 0.0:
        fitted += math.pi
    angle = fitted if stated is None else stated
    cos, sin = math.cos(angle), math.sin(angle)
    along, across = x * cos + y * sin, y * cos - x * sin
    if len(known) == 1:
        (name,) = known
        if abs(abs(math.cos(angle - fitted)) - 1.0) > 1e-9:
            raise InputError(
                f"must be fit, {name} or -{name}: the file holds no other coordinate",
                field="along",
                value=f"{math.degrees(angle):g}",
            )
        axis = name if cos + sin > 0.0 else f"-{name}"
        words = phrase("along {name}, the only coordinate in the file", name=axis)
        return Ramp(_fixed(along), None, words, None, math.nan)
    if stated is None:
        words = phrase(
            "fitted to the points: {angle:.3f} deg from the x axis, standard uncertainty "
            "{u:.3f} deg from their scatter",
            angle=_degrees(angle),
            u=math.degrees(u),
        )
    else:
        words = phrase("as stated: {angle:g} deg from the x axis", angle=_degrees(angle))
    tilt = Quantity(math.atan2(math.sin(fitted), abs(math.cos(fitted))), u)
    return Ramp(_fixed(along), _fixed(across), words, tilt, scatter)


def _stated(direction: str | float) -> float | None:
    """The stated angle in rad; None for `fit`."""
    if isinstance(direction, str) and direction == "fit":
        return None
    if isinstance(direction, str) and direction in _AXES:
        return math.radians(_AXES[direction])
    try:
        degrees = read_number(direction) if isinstance(direction, str) else float(direction)
    except ValueError:
        degrees = math.nan
    if not abs(degrees) <= 360.0:
        raise InputError(
            "must be fit, x, y, -x, -y or an angle in degrees", field="along", value=direction
        )
    return math.radians(degrees)


def _initial_displacement(track: Track, x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Displacement at the first point that is half as far from the start as any: the direction in
    which the motion starts.  Raises InputError where there is none.
    """
    distance = np.hypot(x - x[0], y - y[0])
    reach = float(np.max(distance))
    if not reach > 1e-9:
        raise InputError("does not move", field=f"track {track.name}", value=f"{reach:g} m")
    first = int(np.argmax(distance >= 0.5 * reach))
    return float(x[first] - x[0]), float(y[first] - y[0])


def _principal_axis(x: FloatArray, y: FloatArray) -> tuple[float, float, float]:
    """Angle (rad) of the line of least perpendicular distances, its standard uncertainty, and the
    scatter about it (m).

    angle = atan2(2 S_xy, S_xx - S_yy)/2;  u = s/sqrt(sum of squares along the line), to first order
    in s, the standard deviation across it (n - 2 degrees of freedom) of equal, independent errors.
    """
    x, y = x - np.mean(x), y - np.mean(y)
    angle = 0.5 * math.atan2(2.0 * float(x @ y), float(x @ x - y @ y))
    along = x * math.cos(angle) + y * math.sin(angle)
    across = y * math.cos(angle) - x * math.sin(angle)
    scatter = math.sqrt(float(across @ across) / (x.size - 2))
    return angle, scatter / math.sqrt(float(along @ along)), scatter


def _degrees(angle: float) -> float:
    """In degrees within -180 to 180."""
    return math.degrees(math.atan2(math.sin(angle), math.cos(angle)))


def _fixed(array: FloatArray) -> FloatArray:
    array.setflags(write=False)
    return array
