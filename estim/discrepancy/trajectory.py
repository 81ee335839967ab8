"""What a force along the track does to the points of one run, at given values of the parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import eye_array

from estim.arrays import FloatArray
from estim.discrepancy.bad_frame_search import Frames
from estim.discrepancy.force import ForceTrack, Response, speed_response, track
from estim.discrepancy.grid import START_SD
from estim.discrepancy.in_time import Moving, response_in_time
from estim.discrepancy.smoothing import smoothed_positions
from estim.problem import Motion, Named, Noise, Observations, Points, PositionCurve, Rows

_STEP = 2e-3  # rad, over which inertia and height of a body are smooth


@dataclass(frozen=True, eq=False)
class TrackResponse:
    """The track of a run and the responses of its points.

    push : (n_obs,) what one sd of the energy at release does to them.

    radian : of a turn, in the unit of position.  upright : normal force over the weight, at rest.
    """

    track: ForceTrack
    response: Response
    push: FloatArray
    radian: float
    upright: float


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A motion that was measured.  rows : of the readings; None where bad ones are not
    searched for.
    """

    motion: Motion
    rows: Rows | None = None

    @classmethod
    def of(cls, run: Observations) -> Trajectory:
        return cls(run.body, run.rows)

    def speed(self, points: Points, named: Named, noise: Noise) -> FloatArray | None:
        """(n_obs,) speeds of the curve at the points, where the readings have little of their
        errors; None for positions.
        """
        evaluated = _Here(self.motion, points, points.bind(named))
        if isinstance(points.curve, PositionCurve):
            return None
        return evaluated.speed(self._places(evaluated, noise, named))

    def along(
        self, points: Points, named: Named, noise: Noise, *, about: FloatArray | None
    ) -> TrackResponse:
        """The responses at `named`.

        about : (n_obs,) the speeds of `Residuals` for points that are speeds, None for positions.
        Raises InputError where the body (positions in time) does not move at all.
        """
        evaluated = _Here(self.motion, points, points.bind(named))
        if isinstance(points.curve, PositionCurve):
            along, response = _in_time(evaluated, points.curve)
        else:
            assert about is not None, "known of points that are speeds"
            x = self._places(evaluated, noise, named)
            along = track(float(np.max(points.x)), start=evaluated.start)
            response = speed_response(
                along, x, about, evaluated.inertia(x), acceleration=evaluated.acceleration
            )
        push = START_SD * evaluated.scalar(self.motion.radian) * response.start
        return TrackResponse(
            along,
            response,
            push,
            evaluated.scalar(self.motion.radian),
            evaluated.scalar(self.motion.upright),
        )

    def _places(self, evaluated: _Here, noise: Noise, named: Named) -> FloatArray:
        """(n_obs,) positions of points that are speeds, with little of the errors of the readings
        that these speeds are made of.
        """
        if self.rows is None or self.rows.positions is None or not noise.made_of_positions:
            return evaluated.points.x
        shift = self._smoothed(evaluated, noise, named) - self.rows.positions
        return evaluated.points.x + shift[self.rows.kept]

    def _smoothed(self, evaluated: _Here, noise: Noise, named: Named) -> FloatArray:
        """(n_row,) the readings, for evaluations of the curve that must not depend on their
        errors.
        """
        assert self.rows is not None, "called where speeds are made of positions"
        positions = self.rows.positions
        assert positions is not None, "called where speeds are made of positions"
        return smoothed_positions(
            self.rows.t, positions, evaluated.speed(positions), _reading(noise, named)
        )

    def frames(self, points: Points, named: Named, noise: Noise) -> Frames | None:
        """The readings of which some may be bad, and what each does to the points; None where they
        are not known.
        """
        if self.rows is None:
            return None
        evaluated = _Here(self.motion, points, points.bind(named))
        matrix, reading = noise.of_positions(points, named), _reading(noise, named)
        t, lines = self.rows.t, self.rows.lines
        positions = self.rows.positions
        if matrix is not None and positions is not None:
            slope = points.slope(named)
            velocity = evaluated.speed(self._smoothed(evaluated, noise, named))
            return Frames(
                matrix, velocity, reading, True, t, positions, lines, self.rows.kept, slope
            )
        sd = float(
            np.hypot(
                reading * np.median(noise.reading_gain()), np.ravel(noise.size.scatter.at(named))[0]
            )
        )
        alone = eye_array(points.x.size, format="csr")
        if isinstance(points.curve, PositionCurve):
            velocity = np.ravel(points.curve.state(points.x, evaluated.arguments)[1])
            return Frames(alone, velocity, sd, True, t, points.y, lines)
        still = np.zeros(points.x.size)
        return Frames(alone, still, sd, False, t, points.x, lines)


def _reading(noise: Noise, named: Named) -> float:
    """Standard deviation of one reading."""
    return float(np.sqrt(np.ravel(noise.size.reading_variance(named))[0]))


@dataclass(frozen=True, eq=False)
class _Here:
    """The curve of a run and its motion at one set of values."""

    motion: Motion
    points: Points
    arguments: Named

    def scalar(self, of: Callable[[Named], float | FloatArray]) -> float:
        return float(np.ravel(of(self.arguments))[0])

    @property
    def acceleration(self) -> float:
        return self.scalar(self.motion.gravity) / self.scalar(self.motion.metres)

    @property
    def start(self) -> float:
        return float(np.ravel(self.arguments.get("offset", 0.0))[0])

    def speed(self, x: FloatArray) -> FloatArray:
        return np.ravel(self.points.curve.value(x, self.arguments))

    def inertia(self, x: FloatArray) -> FloatArray:
        kinetic = self.motion.energies(x, np.ones(x.size), self.arguments)[0]
        return np.ravel(2.0 * kinetic / self.scalar(self.motion.metres) ** 2)

    def potential(self, x: FloatArray) -> FloatArray:
        potential = self.motion.energies(x, np.zeros(x.size), self.arguments)[1]
        return np.ravel(potential / self.scalar(self.motion.metres) ** 2)


def _in_time(evaluated: _Here, curve: PositionCurve) -> tuple[ForceTrack, Response]:
    """Of positions at known times, on every way."""

    def state(t: FloatArray) -> tuple[FloatArray, FloatArray]:
        x, v = curve.state(t, evaluated.arguments)
        return np.ravel(x), np.ravel(v)

    t, release = evaluated.points.x, float(np.ravel(evaluated.arguments["release_time"])[0])
    step = _STEP * evaluated.scalar(evaluated.motion.radian)
    moving = Moving(
        state,
        release,
        float(np.max(t)),
        evaluated.inertia,
        evaluated.potential,
        evaluated.acceleration,
        step,
    )
    return response_in_time(moving, t)
