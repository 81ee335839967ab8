"""What a force along the track does to the points of one run, at given values of the parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.arrays import FloatArray
from estim.deviation.force import Response, Track, position_response, speed_response, track
from estim.deviation.grid import START_SD
from estim.deviation.in_time import Moving, response_in_time
from estim.deviation.jumps import Frames
from estim.deviation.settled import settled
from estim.problem import Differences, Motion, Named, Noise, Points, PositionCurve

_MOST_OFF = 1.5  # how far a measured speed may be from that of the curve, as a factor, and still be its speed with errors
_SLOW = 0.05  # of the mean speed: at a point that is slower a force counts as if it were this fast
_STEP = 2e-3  # rad, over which inertia and height of a body are smooth


@dataclass(frozen=True, eq=False)
class Along:
    """The track of a run and the responses of its points.

    push : (n_obs,) what one sd of the energy at release does to them.

    radian : of a turn, in the unit of position.  upright : normal force over the weight, at rest.
    """

    track: Track
    response: Response
    push: FloatArray
    radian: float
    upright: float


@dataclass(frozen=True, eq=False)
class Rows:
    """Where the readings of a run stand: t (n_row,) s, nan where unknown, and lines (n_row,) of the file.  kept : (n_obs,) those of the points."""

    t: FloatArray
    lines: NDArray[np.int64]
    kept: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Course:
    """A motion that was measured.

    positions : (n_row,) all that were read, where the points are speeds made of them; else None, and the points are what was read.
    rows : of the readings, known wherever `positions` are; else None where nobody asks which of them are bad.
    """

    motion: Motion
    positions: FloatArray | None
    rows: Rows | None = None

    def along(self, points: Points, named: Named, noise: Noise) -> Along:
        """The responses, linear about the curve at `named`.

        Raises InputError where the body hardly moves somewhere along the track, or (positions in time) does not move at all.
        """
        here = _Here(self.motion, points, points.bind(named))
        matrix = noise.of_positions(points, named)
        if isinstance(points.curve, PositionCurve):
            along, response = _in_time(here, points.curve)
        elif matrix is None or self.positions is None:
            along, response = _speeds(here)
        else:
            along, response = _differences(here, self._settled(here, noise, named), matrix)
        push = START_SD * here.scalar(self.motion.radian) * response.start
        return Along(along, response, push, here.scalar(self.motion.radian), here.scalar(self.motion.upright))

    def _settled(self, here: _Here, noise: Noise, named: Named) -> _Settled:
        """The readings for every place at which something is asked of the curve that must not know their errors."""
        assert self.positions is not None, "asked where speeds are made of positions"
        assert self.rows is not None, "known where positions are"
        speed = here.speed(self.positions)
        speed = np.maximum(speed, _SLOW * float(np.mean(speed)))
        x = settled(self.rows.t, self.positions, speed, _reading(noise, named))
        return _Settled(x, x - self.positions, self.rows.kept)

    def frames(self, points: Points, named: Named, noise: Noise) -> Frames | None:
        """The readings of which some may be bad, and what each does to the points; None where they are not known."""
        if self.rows is None:
            return None
        here = _Here(self.motion, points, points.bind(named))
        matrix, reading = noise.of_positions(points, named), _reading(noise, named)
        if matrix is not None and self.positions is not None:
            slope = here.row(points.curve.local(points.x, here.arguments).slope, points.x.size)
            velocity = here.speed(self._settled(here, noise, named).x)
            return Frames(self.rows.t, self.positions, self.rows.lines, matrix, velocity, reading, True, self.rows.kept, slope)
        sd = float(np.hypot(reading * np.median(noise.reading_gain()), np.ravel(noise.size.scatter.at(named))[0]))
        alone = Differences.of_single(points.x.size)
        if isinstance(points.curve, PositionCurve):
            velocity = here.row(points.curve.state(points.x, here.arguments)[1], points.x.size)
            return Frames(self.rows.t, points.y, self.rows.lines, alone, velocity, sd, True)
        return Frames(self.rows.t, points.x, self.rows.lines, alone, np.zeros(points.x.size), sd, False)


@dataclass(frozen=True, eq=False)
class _Settled:
    """x : (n_row,) readings without most of their errors.  moved : (n_row,) how far they were moved for that.  kept : (n_obs,) rows of the points."""

    x: FloatArray
    moved: FloatArray
    kept: NDArray[np.int64]


def _reading(noise: Noise, named: Named) -> float:
    """Standard deviation of one reading."""
    return float(np.sqrt(np.ravel(noise.size.reading_variance(named))[0]))


@dataclass(frozen=True, eq=False)
class _Here:
    """The curve of a run and its motion at one set of values."""

    motion: Motion
    points: Points
    arguments: Mapping[str, ArrayLike]

    def scalar(self, of: Callable[[Mapping[str, ArrayLike]], ArrayLike]) -> float:
        return float(np.ravel(of(self.arguments))[0])

    @property
    def acceleration(self) -> float:
        return self.scalar(self.motion.gravity) / self.scalar(self.motion.metres)

    @property
    def start(self) -> float:
        return float(np.ravel(self.arguments.get("offset", 0.0))[0])

    def row(self, values: FloatArray, n: int) -> FloatArray:
        return np.ravel(np.broadcast_to(values, (1, n)))

    def speed(self, x: FloatArray) -> FloatArray:
        return self.row(self.points.curve.value(x, self.arguments), x.size)

    def inertia(self, x: FloatArray) -> FloatArray:
        kinetic = self.motion.energies(x, np.ones(x.size), self.arguments)[0]
        return self.row(2.0 * kinetic / self.scalar(self.motion.metres) ** 2, x.size)

    def potential(self, x: FloatArray) -> FloatArray:
        return self.row(self.motion.energies(x, np.zeros(x.size), self.arguments)[1] / self.scalar(self.motion.metres) ** 2, x.size)


def _speeds(here: _Here) -> tuple[Track, Response]:
    """Of speeds at positions that were measured."""
    x = here.points.x
    along = track(float(np.max(x)), start=here.start, first=float(np.min(x)))
    speed = here.speed(x)
    floor = _SLOW * float(np.mean(speed))
    return along, speed_response(along, x, speed, here.inertia(x), acceleration=here.acceleration, floor=floor)


def _differences(here: _Here, readings: _Settled, matrix: Differences) -> tuple[Track, Response]:
    """Of speeds made of `readings`, of which `matrix` (n_obs, n_row) says what their shifts do."""
    used, points = matrix.used, here.points
    read, moved = readings.x[used], readings.moved[readings.kept]
    slope = here.row(points.curve.local(points.x, here.arguments).slope, points.x.size)
    points = replace(points, x=points.x + moved, y=points.y + matrix @ readings.moved + slope * moved)
    along = track(float(np.max(read)), start=here.start, first=float(np.min(read)))
    fine = _moving_on(points, along.fine, here.speed(along.fine))
    response = position_response(along, np.append(read, points.x), fine, here.inertia(along.fine), acceleration=here.acceleration)
    there = np.interp(np.append(read, points.x), along.fine, fine)
    return along, _by_differences(response, matrix.among(used), there, points.y, here.speed(points.x))


def _in_time(here: _Here, curve: PositionCurve) -> tuple[Track, Response]:
    """Of positions at known times, on every way."""

    def state(t: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, v = curve.state(t, here.arguments)
        return here.row(x, t.size), here.row(v, t.size)

    t, release = here.points.x, float(np.ravel(here.arguments["release_time"])[0])
    step = _STEP * here.scalar(here.motion.radian)
    moving = Moving(state, release, float(np.max(t)), here.inertia, here.potential, here.acceleration, step)
    return response_in_time(moving, t)


def _by_differences(response: Response, matrix: Differences, speed: FloatArray, y: FloatArray, here: FloatArray) -> Response:
    """What speeds by differences answer, from the response of the positions that they are made of (n_row), then of those of the points (n_obs).

    With delta x = v tau and the stencil S:  delta y_i = sum_j S_ij v_j (tau_j - tau_i) v_i/y_i.  A delay tau that all share moves nothing: so
    the truncation of S, which comes back at the shifted place, drops out.  And S x = y has the errors of the readings: with them left in, a
    large constant force could take up the noise.

    speed : (n_row + n_obs,) of the fit there.  y : (n_obs,) speeds made of the same positions.  here : (n_obs,) of the curve at the points.
    """
    n_row = matrix.n_row
    ratio = np.clip(np.divide(here, y, out=np.ones_like(here), where=y > 0.0), 1.0 / _MOST_OFF, _MOST_OFF)
    own = (matrix @ speed[:n_row]) / np.maximum(speed[n_row:], _SLOW * float(np.mean(speed[:n_row])))
    force = ratio[:, None] * (matrix @ response.force[:n_row] - own[:, None] * response.force[n_row:])
    return Response(force, ratio * (matrix @ response.start[:n_row] - own * response.start[n_row:]))


def _moving_on(points: Points, x: FloatArray, speed: FloatArray) -> FloatArray:
    """The speed (n_fine,) of the curve at x, and where it slows down no less than half of the least that was measured there.

    The curve of a body that was pushed comes to rest before the body does.
    """
    fastest = int(np.argmax(speed))
    beyond = points.y[points.x >= x[fastest]]
    least = 0.5 * float(np.min(np.abs(beyond), initial=np.inf))
    if not np.isfinite(least):
        return speed
    return np.where(np.arange(x.size) > fastest, np.maximum(speed, least), speed)
