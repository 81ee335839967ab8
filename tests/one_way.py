"""What a force does to positions at given times of a body that does not turn round, by an integral
of its own.
"""

from __future__ import annotations

import numpy as np

from estim.discrepancy.force import ForceTrack, Response, work_along


def fine_places(along: ForceTrack, first: float) -> np.ndarray:
    """Places from the first observation to the end, denser towards the release, at which the motion
    along it is asked for.
    """
    return (
        along.start
        + np.linspace(np.sqrt(first - along.start), np.sqrt(along.end - along.start), 800) ** 2
    )


def through(response: Response, matrix: np.ndarray) -> Response:
    """The response of linear combinations matrix @ observations, such as A of speeds by
    differences.
    """
    return Response(matrix @ response.force, matrix @ response.start)


def position_response(
    along: ForceTrack,
    fine: np.ndarray,
    x: np.ndarray,
    speed: np.ndarray,
    inertia: np.ndarray,
    *,
    acceleration: float,
) -> Response:
    """Of positions measured at given times; x (n_obs,) those of the fit, speed and inertia
    (n_fine,) of the fit at `fine`.

    Answers at places before `fine[0]` are those there.

    With q = sqrt(x) and m = x^(3/2)/(D v^3), smooth also at the release, int F/(D v^3) dx = -2 F
    m/q + int (2/q) d(F m).

    Raises InputError where the fit does not move somewhere between the first observation and the
    end of the track.
    """
    assert np.all(speed[1:] > 0.0)
    since = fine - along.start
    q = np.sqrt(since)
    smooth = np.divide(since**1.5, inertia * speed**3, out=np.zeros_like(since), where=speed > 0.0)
    if not speed[0] > 0.0:  # released from rest
        smooth[0] = smooth[1]
    work = np.column_stack([work_along(along, fine), np.ones(since.size)])
    weighted = work * smooth[:, None]
    middle = 0.5 * (q[1:] + q[:-1])
    rest = np.vstack(
        [
            np.zeros(work.shape[1]),
            np.cumsum(2.0 * np.diff(weighted, axis=0) / middle[:, None], axis=0),
        ]
    )
    edge = np.divide(
        2.0 * weighted, q[:, None], out=np.zeros_like(weighted), where=q[:, None] > 0.0
    )
    moved = acceleration * speed[:, None] * (rest - edge)
    if q[0] == 0.0:
        moved[0, -1] = moved[1, -1]  # finite at the release, where v -> 0
    q_of_x = np.sqrt(np.clip(x - along.start, 0.0, along.length))
    response = np.array([np.interp(q_of_x, q, column) for column in moved.T]).T
    return Response(np.ascontiguousarray(response[:, :-1]), response[:, -1])
