"""What a force along the track does to the points of one run, at given values of the parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.deviation.force import Response, Track, position_response, speed_response, track
from estim.deviation.grid import START_SD
from estim.problem import Motion, Named, Noise, Points

_MOST_OFF = 1.5  # how far a measured speed may be from that of the curve, as a factor, and still be its speed with errors
_SLOW = 0.05  # of the mean speed: at a point that is slower a force counts as if it were this fast


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
class Course:
    """A motion that was measured.  positions : (n_row,) all that were read, where the points are made of them; else None."""

    motion: Motion
    positions: FloatArray | None

    def along(self, points: Points, named: Named, noise: Noise) -> Along:
        """The responses, linear about the curve at `named`.

        Raises InputError where the body hardly moves somewhere along the track.
        """
        arguments = points.bind(named)
        metres, radian = (float(np.ravel(of(arguments))[0]) for of in (self.motion.metres, self.motion.radian))
        acceleration = float(np.ravel(self.motion.gravity(arguments))[0]) / metres
        start = float(np.ravel(arguments.get("offset", 0.0))[0])
        matrix = noise.of_positions(points, named)
        read = points.x if matrix is None or self.positions is None else self.positions

        def speed(x: FloatArray) -> FloatArray:
            return np.ravel(np.broadcast_to(points.curve.value(x, arguments), (1, x.size)))

        def inertia(x: FloatArray) -> FloatArray:
            kinetic = self.motion.energies(x, np.ones(x.size), arguments)[0]
            return np.ravel(np.broadcast_to(2.0 * kinetic / metres**2, (1, x.size)))

        if matrix is None:
            along = track(float(np.max(read)), start=start, first=float(np.min(read)))
            here = speed(points.x)
            response = speed_response(
                along, points.x, here, inertia(points.x), acceleration=acceleration, floor=_SLOW * float(np.mean(here))
            )
        else:
            used = np.any(matrix != 0.0, axis=0)
            along = track(float(np.max(read[used])), start=start, first=float(np.min(read[used])))
            fine = _moving_on(points, along.fine, speed(along.fine))
            moved = position_response(along, read[used], fine, inertia(along.fine), acceleration=acceleration)
            there = np.interp(read[used], along.fine, fine)
            response = _by_differences(moved, matrix[:, used], read[used], there, points, speed(points.x))
        return Along(along, response, START_SD * radian * response.start, radian, float(np.ravel(self.motion.upright(arguments))[0]))


def _by_differences(response: Response, matrix: FloatArray, read: FloatArray, speed: FloatArray, points: Points, here: FloatArray) -> Response:
    """What speeds by differences answer, from the response of the positions `read` (n_row,) that they are made of.

    With delta x = v tau and the stencil S:  delta y_i = sum_j S_ij v_j (tau_j - tau_i) v_i/y_i.  A delay tau that all share moves nothing: so
    the truncation of S, which comes back at the shifted place, drops out.  And S x = y has the errors of the readings: with them left in, a
    large constant force could take up the noise.

    speed : (n_row,) of the fit at `read`.  here : (n_obs,) of the curve at the points.
    """
    rows = np.array([int(np.argmin(np.abs(read - x))) for x in points.x])
    across = matrix @ speed
    ratio = np.clip(np.divide(here, points.y, out=np.ones_like(here), where=points.y > 0.0), 1.0 / _MOST_OFF, _MOST_OFF)
    own = across / np.maximum(speed[rows], _SLOW * float(np.mean(speed)))
    force = ratio[:, None] * (matrix @ response.force - own[:, None] * response.force[rows])
    return Response(force, ratio * (matrix @ response.start - own * response.start[rows]))


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
