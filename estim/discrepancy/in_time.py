"""What a force along the track does to positions at known times, to first order, on every way of a
motion that turns round.

The equation of motion, linear about the fit, with the momentum p = D v per unit mass, V the
potential energy per unit mass and metre^2, A the acceleration of `estim.discrepancy.force`, f in
units of the weight:

    d delta_x/dt = (delta_p - D' v delta_x)/D
    d delta_p/dt = (D'' v^2/2 - V'') delta_x + (D' v/D)(delta_p - D' v delta_x) + A f(x)

Nothing is divided by the speed, so the release from rest and a turning point are times like any
other.  There friction changes its direction: the body turns a moment earlier or later, and delta_p
is multiplied by the ratio of the accelerations after and before.

An energy E0 at release is a start from rest somewhere else, or a faster one: D (v delta_v - v'
delta_x) = A E0 there.  A shift of time is left free, delta_x = v dt: the curve must have the time
of release among its parameters.  Before the release nothing moves.

Friction that depends on the speed (drag) is left out, and so are moments that turn with the body:
they change the response by their own share.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError
from estim.discrepancy.force import ForceTrack, Response, track_with_ways

_N_STEP, _LEAST_STEPS = 1200, 60  # of the whole motion, and of one way
_N_LOOK = 600  # times at which a change of direction is looked for
# shares of the duration
_AFTER = 1e-3  # over which an acceleration is taken
_WITHIN = 0.05  # beside the release: what a start there weighs in place and speed
_JUST = 1e-9  # after the release, when a body that was pushed moves

State = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
Place = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, eq=False)
class Moving:
    """A motion in time, at given values of its parameters.

    state : times (n,) s -> positions and velocities (n,), in the unit of positions.
    release, last : s.
    inertia : positions -> D.
    potential : positions -> V, in 1/s^2 times the unit of positions squared.
    acceleration : A.
    step : a small distance over which both are smooth.
    """

    state: State
    release: float
    last: float
    inertia: Place
    potential: Place
    acceleration: float
    step: float

    @property
    def duration(self) -> float:
        return self.last - self.release


@dataclass(frozen=True, eq=False)
class _TimedMotion:
    """The motion on a grid of times and between: t, x, v (2 n + 1,), the even ones are the ends of
    the steps.

    turns : (n,) factor of delta_p at the end of each step: 1 but at a turning point.
    """

    t: FloatArray
    x: FloatArray
    v: FloatArray
    turns: FloatArray


def response_in_time(moving: Moving, t: FloatArray) -> tuple[ForceTrack, Response]:
    """The track that was covered, and the responses of the positions at times t (n_obs,) s, one
    column for each node and way of the track.

    Raises InputError where the body does not move after its release, or starts with neither speed
    nor acceleration.
    """
    from scipy.integrate import cumulative_trapezoid

    path = _follow(moving)
    along = track_with_ways(path.x[::2], path.v[1::2])
    solutions, gain = _solutions(moving, path)
    caused = _caused(along, path, moving.acceleration)  # (n + 1, n_cause) momentum per unit of time
    # z(t) = Phi(t) int Phi^-1 (0, A f) ds;  Phi^-1 (0, 1) = (-Phi_12, Phi_11)/det, by the
    # trapezoidal rule
    inverse = np.column_stack([-solutions[:, 0, 1], solutions[:, 0, 0]]) / gain[:, None]
    part = inverse[:, :, None] * caused[:, None, :]
    drawn = cumulative_trapezoid(part, path.t[::2], axis=0, initial=0.0)
    start = _start(moving, path)
    place = np.clip(np.searchsorted(path.t[::2], t, side="right") - 1, 0, path.turns.size - 1)
    share = np.clip((t - path.t[::2][place]) / np.diff(path.t[::2])[place], 0.0, 1.0)
    force, pushed = np.zeros((t.size, caused.shape[1])), np.zeros(t.size)
    for ends, weight in ((place, 1.0 - share), (place + 1, share)):
        force += weight[:, None] * np.einsum("ij,ijk->ik", solutions[ends, 0], drawn[ends])
        pushed += weight * (solutions[ends, 0] @ start)
    moves = t > moving.release
    return along, Response(np.where(moves[:, None], force, 0.0), np.where(moves, pushed, 0.0))


def _follow(moving: Moving) -> _TimedMotion:
    """The motion on every way, each with steps of its own length; what is at rest for good is left
    out.
    """
    look = np.linspace(moving.release, moving.last, _N_LOOK)
    sense = np.sign(moving.state(look)[1])
    moves = np.flatnonzero(sense[1:] != 0.0) + 1
    if not moves.size or not moving.duration > 0.0:
        raise InputError(
            "must move between the release and the last observation",
            field="body",
            value=moving.duration,
        )
    first, final = moves[0], moves[-1]
    changes = [i for i in range(first, final) if sense[i] * sense[i + 1] < 0.0]
    turning = [_turning(moving, look[i], look[i + 1]) for i in changes]
    rests = final < look.size - 1
    ends = np.array(
        [
            moving.release + _JUST * moving.duration,
            *turning,
            _turning(moving, look[final], look[final + 1]) if rests else moving.last,
        ]
    )
    parts: list[FloatArray] = []
    factors: list[FloatArray] = []
    for begin, end in pairwise(ends):
        n = max(_LEAST_STEPS, round(_N_STEP * (end - begin) / moving.duration))
        parts.append(np.linspace(begin, end, 2 * n + 1)[len(parts) > 0 :])
        factors.append(np.append(np.ones(n - 1), 1.0 if end == ends[-1] else _bent(moving, end)))
    t = np.concatenate(parts)
    x, v = moving.state(t)
    return _TimedMotion(t, x, v, np.concatenate(factors))


def _turning(moving: Moving, low: float, high: float) -> float:
    """The time between two others at which the body comes to rest."""
    for _ in range(2):
        t = np.linspace(low, high, 60)
        v = moving.state(t)[1]
        over = int(np.argmax(v[1:] * v[0] <= 0.0)) + 1
        low, high, ends = float(t[over - 1]), float(t[over]), v[over - 1 : over + 1]
    return low + (high - low) * float(ends[0] / (ends[0] - ends[1]))


def _bent(moving: Moving, t: float) -> float:
    """Acceleration after a turning point over that before."""
    before, after = _accelerations(moving, t)
    return after / before


def _accelerations(moving: Moving, t: float) -> tuple[float, float]:
    """Before and after a time, each by a parabola through three velocities."""
    h = _AFTER * moving.duration
    v = moving.state(t + h * np.array([-2.0, -1.0, 0.0, 1.0, 2.0]))[1] / (2.0 * h)
    return float(3.0 * v[2] - 4.0 * v[1] + v[0]), float(4.0 * v[3] - 3.0 * v[2] - v[4])


def _solutions(moving: Moving, path: _TimedMotion) -> tuple[FloatArray, FloatArray]:
    """Phi (n + 1, 2, 2), what a start (delta_x, delta_p) becomes without a force, and its
    determinant (n + 1,), by Runge and Kutta's rule.
    """
    matrix = _matrix(moving, path)
    h = np.diff(path.t[::2])[:, None, None]
    identity = np.eye(2)
    k1, middle, last = matrix[:-2:2], matrix[1::2], matrix[2::2]
    k2 = middle @ (identity + 0.5 * h * k1)
    k3 = middle @ (identity + 0.5 * h * k2)
    k4 = last @ (identity + h * k3)
    steps = identity + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    steps[:, 1, :] *= path.turns[:, None]
    solutions = np.empty((steps.shape[0] + 1, 2, 2))
    solutions[0] = identity
    for i, step in enumerate(steps):
        solutions[i + 1] = step @ solutions[i]
    return solutions, np.concatenate([[1.0], np.cumprod(path.turns)])


def _matrix(moving: Moving, path: _TimedMotion) -> FloatArray:
    """(n, 2, 2) of the linear equation of motion."""
    h, x, v = moving.step, path.x, path.v
    below, inertia, above = (moving.inertia(x + shift) for shift in (-h, 0.0, h))
    slope, bend = (above - below) / (2.0 * h), (above - 2.0 * inertia + below) / h**2
    low, potential, high = (moving.potential(x + shift) for shift in (-h, 0.0, h))
    curvature = (high - 2.0 * potential + low) / h**2
    drift = slope * v / inertia
    matrix = np.empty((x.size, 2, 2))
    matrix[:, 0, 0], matrix[:, 0, 1] = -drift, 1.0 / inertia
    matrix[:, 1, 0], matrix[:, 1, 1] = 0.5 * bend * v**2 - curvature - drift * slope * v, drift
    return matrix


def _caused(along: ForceTrack, path: _TimedMotion, acceleration: float) -> FloatArray:
    """(n + 1, n_cause) A f for a force that is 1 at one node on one way and falls to 0 at its
    neighbours.
    """
    x, nodes = path.x[::2], along.nodes
    place = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, nodes.size - 2)
    share = np.clip((x - nodes[place]) / (nodes[1] - nodes[0]), 0.0, 1.0)
    hats = np.zeros((x.size, nodes.size))
    rows = np.arange(x.size)
    hats[rows, place], hats[rows, place + 1] = 1.0 - share, share
    if along.n_way == 1:
        return acceleration * hats
    v = path.v[1::2]
    back = np.append(v < 0.0, v[-1] < 0.0)[:, None]
    return acceleration * np.hstack([np.where(back, 0.0, hats), np.where(back, hats, 0.0)])


def _start(moving: Moving, path: _TimedMotion) -> FloatArray:
    """(2,) delta_x and delta_p at release for E0 = 1, that change of the start which is no shift of
    time.
    """
    x, v, a = path.x[:1], float(path.v[0]), _accelerations(moving, float(path.t[0]))[1]
    inertia = float(moving.inertia(x)[0])
    slope = float((moving.inertia(x + moving.step) - moving.inertia(x - moving.step))[0]) / (
        2.0 * moving.step
    )
    turned = a * (_WITHIN * moving.duration) ** 2
    size = inertia * (v * v + a * turned)
    if not size > 0.0:
        raise InputError("must start with a speed or an acceleration", field="body", value=a)
    moved, faster = -turned * moving.acceleration / size, v * moving.acceleration / size
    return np.array([moved, inertia * faster + slope * v * moved])
