"""Motion under forces that depend on the speed, or with any other force in time: by series in time,
vectorised over draws.

The state is the angle turned u and y = +-sqrt(q), the root of the kinetic energy in weights x R
(table in `estim.model.forces`):

    u' = w y,    y' = (w/2) dq/du,    w = sqrt(2 g/(R D))

Nothing is divided by y, so a start from rest and a turning point are points like any other.  The
time is cut into pieces; on each, u and y are Chebyshev series found by Picard's iteration, y <- y0
+ integral of y', u <- u0 + integral of u', until they settle.  Where they do not, or their last
coefficients still count, the piece is halved.  Where the body comes to rest a new piece begins,
with friction in the new direction.  Positions and speeds are good to 1e-9 m and m/s (tests).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

from estim.model.body import Body
from estim.model.forces import Forces, work

FloatArray = NDArray[Any]

_N_NODE = 16
_PIECE = 3.0  # of the time in which a state changes
_SMALLEST = 1e-4  # of the first length of a piece: then the draw is given up
_GROWTH = 1.4  # of a piece after one that was resolved, up to its first length
_MOST_PIECES, _MOST_ROUNDS, _MOST_NEWTON = 2000, 30, 60
_SETTLED, _NEGLIGIBLE = 1e-12, 1e-10
_SLOWEST = 0.5  # 1/s, of what sets the length of a piece
_FEW = 0.6  # of the crossings of a block: these are looked for alone
_BLOCK = 512  # draws at once: what they need fits in the cache

_NODES = -np.cos(np.pi * np.arange(_N_NODE) / (_N_NODE - 1))
# values at nodes @ this = coefficients
_TO_SERIES = np.linalg.inv(chebyshev.chebvander(_NODES, _N_NODE - 1)).T
_DERIVATIVE = np.array([np.append(chebyshev.chebder(row), 0.0) for row in np.eye(_N_NODE)])
_INTEGRAL = _TO_SERIES @ np.array(
    [chebyshev.chebval(_NODES, chebyshev.chebint(row, lbnd=-1.0)) for row in np.eye(_N_NODE)]
)


class _Draws:
    """Parameters of draws as columns (n_draw, 1), and the right side of the equation of motion."""

    def __init__(self, values: list[FloatArray]):
        self.values = values
        (
            self.radius,
            self.gamma,
            self.inertia,
            self.phi,
            self.theta0,
            self.resistance,
            self.g,
            self.moment,
            self.load,
            viscous,
            quadratic,
            self.c1,
            self.s1,
            self.c2,
            self.s2,
            self.phi_slope,
        ) = values
        self.bend = self.phi_slope * self.radius
        self.scale = 2.0 * self.g / self.radius
        self.viscous = viscous * np.sqrt(2.0 * self.radius / self.g)
        self.quadratic = 2.0 * quadratic * self.radius
        self.turning, self.loaded = bool(np.any(values[11:15])), bool(np.any(self.load))
        self.bent = bool(np.any(self.bend))

    def taken(self, chosen: Any) -> _Draws:
        return _Draws([value[chosen] for value in self.values])

    def rates(
        self, u: FloatArray, y: FloatArray, sense: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(w, y') for friction that acts against `sense`, +1 or -1."""
        push, friction, square, pace = self.forces(u)
        pull = (
            push
            - sense * friction
            - self.viscous * y * np.sqrt(square)
            - sense * self.quadratic * y * y * square
        )
        if self.loaded:
            pull = self._loaded(pull, u, y, sense, square)
        return pace, 0.5 * pace * pull

    def forces(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Force that does not depend on the direction, friction of a body at rest, 1/D and w."""
        sine, cosine = sine_and_cosine(self.theta0 + u)
        climb, level = sine_and_cosine(self.phi + self.bend * u if self.bent else self.phi)
        push = self.gamma * sine - climb
        if self.turning:
            push = (
                push
                - self.c1 * cosine
                - self.s1 * sine
                - self.c2 * (1.0 - 2.0 * sine * sine)
                - self.s2 * 2.0 * sine * cosine
            )
        square = 1.0 / (self.inertia + 2.0 * self.gamma * (cosine * level - sine * climb))
        return (
            push,
            (self.resistance + self.load) * level + self.moment,
            square,
            np.sqrt(self.scale * square),
        )

    def _loaded(
        self, pull: FloatArray, u: FloatArray, y: FloatArray, sense: FloatArray, square: FloatArray
    ) -> FloatArray:
        """dq/du with the part of the load that comes from the motion: q' = (q/D)' D + q D'/D solved
        for q'.
        """
        sine, cosine = sine_and_cosine(self.theta0 + u + self.phi + self.bend * u)
        ratio, change = y * y * square, -2.0 * self.gamma * sine * (1.0 + self.bend)
        load = sense * self.load
        lever = load * self.gamma * sine * square
        return (
            pull
            + load * ratio * (2.0 * self.gamma * cosine - 2.0 * self.bend)
            - lever * ratio * change
        ) / (1.0 - lever)

    def direction(self, u: FloatArray) -> FloatArray:
        """Where a body at rest starts to: +1, -1, or 0 where friction holds it."""
        push, friction, _, _ = self.forces(u)
        return np.where(push > friction, 1.0, np.where(push < -friction, -1.0, 0.0))

    def fastest(self, fall: FloatArray, energy: FloatArray) -> FloatArray:
        """About the largest rate (1/s): of the motion with `energy` at release and `fall` of
        height/R, and of the swing about the lowest point.
        """
        smallest = np.maximum(self.inertia - 2.0 * np.abs(self.gamma), 1e-3)
        gain = (
            np.abs(energy)
            + fall
            + 2.0 * np.abs(self.gamma)
            + sum(np.abs(v) for v in self.values[11:15])
        )
        return np.maximum(np.sqrt(self.scale * gain / smallest), _SLOWEST)

    def piece(
        self, u: FloatArray, y: FloatArray, sense: FloatArray, h: FloatArray
    ) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        """u and y at the nodes (n_draw, n_node) of pieces of length h (s) that begin at u, y; and
        which of them are resolved.
        """
        pace, rate = self.rates(u, y, sense)
        since, half = 0.5 * (_NODES + 1.0) * h, 0.5 * h
        at, root = u + pace * (y * since + 0.5 * rate * since * since), y + rate * since
        # too long a piece: what grows without bounds has not settled
        with np.errstate(all="ignore"):
            for _ in range(_MOST_ROUNDS):
                pace, rate = self.rates(at, root, sense)
                root_next = y + half * (rate @ _INTEGRAL)
                at_next = u + half * ((pace * root_next) @ _INTEGRAL)
                moved = np.max(np.abs(at_next - at) + np.abs(root_next - root), axis=1)
                at, root = at_next, root_next
                if np.max(moved) < _SETTLED:
                    break
            tail = np.max(
                np.abs(at @ _TO_SERIES[:, -2:]) + np.abs(root @ _TO_SERIES[:, -2:]), axis=1
            )
        return at, root, (moved < _NEGLIGIBLE) & (tail < _NEGLIGIBLE)


def sine_and_cosine(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """By t = tan(angle/2), which is many times faster."""
    t = np.tan(0.5 * angle)
    cosine_1 = 2.0 / (1.0 + t * t)
    return t * cosine_1, cosine_1 - 1.0


def _series(coefficients: FloatArray, z: FloatArray) -> FloatArray:
    """Chebyshev series (n_node, ...) each at its own z (...), by Clenshaw's recurrence."""
    twice, ahead, here = 2.0 * z, np.zeros(z.shape), coefficients[-1]
    for k in range(_N_NODE - 2, 0, -1):
        ahead, here = here, twice * here + (coefficients[k] - ahead)
    return z * here + (coefficients[0] - ahead)


def _crossing(
    coefficients: FloatArray,
    slope: FloatArray,
    level: FloatArray | float,
    low: FloatArray,
    high: FloatArray,
    z: FloatArray,
) -> FloatArray:
    """z at which rising series reach `level`, by Newton steps from `z` inside a bracket."""
    shape, rows = z.shape, (coefficients.reshape(_N_NODE, -1), slope.reshape(_N_NODE, -1))
    end = z.ravel().copy()
    z, low, high = end, low.ravel(), high.ravel()
    levels, left = np.broadcast_to(level, shape).ravel(), np.arange(end.size)
    for _ in range(_MOST_NEWTON):
        ahead = _series(rows[0], z) - levels
        low, high = np.where(ahead <= 0.0, z, low), np.where(ahead >= 0.0, z, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = z - ahead / _series(rows[1], z)
        following = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        moving = np.abs(following - z) >= _NEGLIGIBLE
        end[left] = z = following
        n_moving = np.count_nonzero(moving)
        if not n_moving:
            break
        if n_moving < _FEW * z.size:  # most are there: go on with the others
            z, low, high, levels, left = (v[moving] for v in (z, low, high, levels, left))
            rows = (rows[0][:, moving], rows[1][:, moving])
    return end.reshape(shape)


@dataclass(frozen=True, eq=False)
class _Path:
    """The pieces of all draws, one after the other; those of length 0 belong to draws that needed
    fewer.

    begin, length : (n_piece, n_draw) s, in time.
    cut : the share of a piece that was run through.
    u, y : (n_piece, n_draw, n_node) values at the nodes.
    reached : (n_piece, n_draw) rad, u at the end of each.
    stopped : (n_draw,) rad where it first comes to rest; inf where it does not.
    held : (n_draw,) whether it ends at rest for good.
    """

    begin: FloatArray
    length: FloatArray
    cut: FloatArray
    u: FloatArray
    y: FloatArray
    reached: FloatArray
    stopped: FloatArray
    held: NDArray[np.bool_]


def _follow(
    draws: _Draws,
    u: FloatArray,
    y: FloatArray,
    sense: FloatArray,
    h: FloatArray,
    *,
    last: float = np.inf,
    far: float = np.inf,
    back: bool,
) -> _Path:
    """The motion from a state (columns) until the time `last` (s), the angle `far` (rad), or rest.
    back : whether it starts again.
    """
    n = u.size
    u, y, sense, h = u.copy(), y.copy(), sense.copy(), h.copy()
    time, stopped, longest = np.zeros(n), np.full(n, np.inf), h.copy()
    parts: list[tuple[FloatArray, ...]] = []
    for _ in range(_MOST_PIECES):
        going = np.flatnonzero(
            (time < last) & ((u < far) & (sense != 0.0) & (h > _SMALLEST * longest))[:, 0]
        )
        if not going.size:
            break
        at, root, good = draws.taken(going).piece(u[going], y[going], sense[going], h[going])
        h[going[~good]] *= 0.5
        going, at, root = going[good], at[good], root[good]
        begin, length, cut = time.copy(), np.zeros(n), np.ones(n)
        values = np.zeros((2, n, _N_NODE))
        values[:, going] = at, root
        length[going] = h[going, 0]
        u[going], y[going] = at[:, -1:], root[:, -1:]
        over = root * sense[going] < 0.0
        over[:, 0] = False
        turns = np.flatnonzero(np.any(over, axis=1))
        if turns.size:
            rows, node = going[turns], np.argmax(over[turns], axis=1)
            falling = (-sense[rows] * root[turns] @ _TO_SERIES).T
            low, high = _NODES[node - 1], _NODES[node]
            z = _crossing(falling, _DERIVATIVE.T @ falling, 0.0, low, high, 0.5 * (low + high))
            cut[rows] = 0.5 * (z + 1.0)
            u[rows, 0], y[rows] = _series((at[turns] @ _TO_SERIES).T, z), 0.0
            stopped[rows] = np.where(np.isinf(stopped[rows]), u[rows, 0], stopped[rows])
            sense[rows] = draws.taken(rows).direction(u[rows]) if back else 0.0
        time[going] += length[going] * cut[going]
        h[going] = np.minimum(_GROWTH * h[going], longest[going])
        parts.append((begin, length, cut, *values, u[:, 0].copy()))
    if not parts:
        parts = [(time, np.zeros(n), np.ones(n), *np.zeros((2, n, _N_NODE)), u[:, 0])]
    begins, lengths, cuts, us, ys, reached = (np.array(part) for part in zip(*parts, strict=True))
    return _Path(begins, lengths, cuts, us, ys, reached, stopped, sense[:, 0] == 0.0)


def _blocks(
    wanted: ArrayLike,
    body: Body,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike,
    g: ArrayLike,
    forces: Forces,
    start: ArrayLike,
) -> list[tuple[FloatArray, _Draws, FloatArray]]:
    """`wanted` (n_draw, n_obs), the parameters and `start`, column by column, in blocks of
    draws.
    """
    wanted = np.atleast_2d(np.asarray(wanted, dtype=float))
    given = [
        body.radius,
        body.gamma,
        1.0 + np.asarray(body.inertia_ratio),
        phi,
        theta0,
        rolling_resistance,
        g,
        *forces.values(),
        start,
    ]
    columns = np.broadcast_arrays(
        np.zeros((wanted.shape[0], 1)), *(np.asarray(value, dtype=float) for value in given)
    )[1:]
    wanted = np.broadcast_to(wanted, (columns[0].shape[0], wanted.shape[1]))
    rows = [slice(first, first + _BLOCK) for first in range(0, wanted.shape[0], _BLOCK)]
    return [
        (wanted[some], _Draws([column[some] for column in columns[:-1]]), columns[-1][some])
        for some in rows
    ]


def _gathered(values: FloatArray, place: NDArray[Any]) -> FloatArray:
    """(n_node, n_draw, n_obs) series of the pieces `place` (n_draw, n_obs)."""
    column = np.arange(place.shape[0])[:, None]
    return np.array([row[place, column] for row in np.moveaxis(values @ _TO_SERIES, -1, 0)])


def _placed(ends: FloatArray, wanted: FloatArray) -> NDArray[Any]:
    """The first piece (n_draw, n_obs) whose end is not before what is wanted."""
    return np.array(
        [
            np.searchsorted(row, values)
            for row, values in zip(np.maximum.accumulate(ends).T, wanted, strict=True)
        ]
    )


def driven_motion(
    t: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike,
    release_speed: ArrayLike = 0.0,
    forces: Forces,
) -> tuple[FloatArray, FloatArray]:
    """Position (m) and velocity (m/s) at times `t` after release, (n_draw, n_obs) each, back and
    forth.

    t : (n_obs,) or (n_draw, n_obs) s; at rest at 0 before 0, whatever the speed at release.
    release_speed : m/s, either sign.  Released at rest where theta would not increase it stays, as
        in `back_and_forth`.  nan where the series do not resolve it.
    """
    blocks = _blocks(t, body, phi, theta0, rolling_resistance, g, forces, release_speed)
    states = [_block_motion(*block) for block in blocks]
    if not states:
        return np.zeros(np.shape(t)), np.zeros(np.shape(t))
    return np.concatenate([x for x, _ in states]), np.concatenate([v for _, v in states])


def _block_motion(t: FloatArray, draws: _Draws, v0: FloatArray) -> tuple[FloatArray, FloatArray]:
    u = np.zeros(v0.shape)
    y = v0 / (draws.radius * draws.forces(u)[3])
    last = max(float(np.max(t, where=np.isfinite(t), initial=0.0)), 1e-9)
    sense = np.where(v0 != 0.0, np.sign(v0), np.maximum(draws.direction(u), 0.0))
    path = _follow(draws, u, y, sense, _PIECE / draws.fastest(u, y * y), last=last, back=True)
    ends = path.begin + path.cut * path.length
    place = _placed(ends, t)
    beyond = place == path.begin.shape[0]
    place = np.minimum(place, path.begin.shape[0] - 1)
    column = np.arange(v0.size)[:, None]
    length = path.length[place, column]
    z = 2.0 * (t - path.begin[place, column]) / np.where(length > 0.0, length, 1.0) - 1.0
    z = np.clip(z, -1.0, 1.0)
    angle = np.where(beyond, path.reached[-1][:, None], _series(_gathered(path.u, place), z))
    root = np.where(beyond, 0.0, _series(_gathered(path.y, place), z))
    lost = np.isnan(t) | (beyond & ~path.held[:, None] & (t > 0.0))
    position, velocity = draws.radius * angle, draws.radius * draws.forces(angle)[3] * root
    return tuple(
        np.where(lost, np.nan, np.where(t > 0.0, value, 0.0)) for value in (position, velocity)
    )  # type: ignore[return-value]


def driven_energy(
    angle: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike,
    release_energy: ArrayLike = 0.0,
    forces: Forces,
) -> tuple[FloatArray, FloatArray]:
    """Kinetic energy q (weights x R) after a turn by `angle`, (n_draw, n_obs), and the angle
    (n_draw, 1) where it first rests.

    angle : (n_obs,) or (n_draw, n_obs) rad, theta increasing.  q is 0 where the body never gets,
        nan where the series do not resolve it.
    release_energy : negative where the body starts from rest at the first angle at which q would be
        positive.
    """
    blocks = _blocks(angle, body, phi, theta0, rolling_resistance, g, forces, release_energy)
    found = [_block_energy(*block) for block in blocks]
    if not found:
        return np.zeros(np.shape(angle)), np.zeros((0, 1))
    return np.concatenate([q for q, _ in found]), np.concatenate([stop for _, stop in found])


def _block_energy(
    angle: FloatArray, draws: _Draws, energy: FloatArray
) -> tuple[FloatArray, FloatArray]:
    far = max(float(np.max(angle, where=np.isfinite(angle), initial=0.0)), 1e-9)
    start = _first_rest(draws, energy)
    u, y = np.nan_to_num(start), np.sqrt(np.maximum(energy, 0.0))
    sense = np.where(
        energy > 0.0, 1.0, np.where(np.isfinite(start), np.maximum(draws.direction(u), 0.0), 0.0)
    )
    path = _follow(
        draws, u, y, sense, _PIECE / draws.fastest(np.zeros(u.shape), energy), far=far, back=False
    )
    reached = path.reached[-1][:, None]
    place = np.minimum(_placed(path.reached, angle), path.begin.shape[0] - 1)
    at = place, np.arange(u.size)[:, None]
    series, low, high = (
        _gathered(path.u, place),
        np.full(angle.shape, -1.0),
        2.0 * path.cut[at] - 1.0,
    )
    first, last = path.y[..., 0][at], path.y[..., -1][at]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (angle - path.u[..., 0][at]) / (path.u[..., -1] - path.u[..., 0])[at]
        there = np.square(first) + share * (np.square(last) - np.square(first))
        # as under a constant force
        begin = 2.0 * share * (first + last) / (first + np.sqrt(there)) - 1.0
    slope = np.tensordot(_DERIVATIVE.T, series, 1)
    z = _crossing(series, slope, angle, low, high, np.clip(begin, low, high))
    q = np.square(_series(_gathered(path.y, place), z))
    there = (angle >= u) & (angle <= reached)
    known = path.held[:, None] | (reached >= far)
    q = np.where(np.isnan(angle), np.nan, np.where(there & (sense > 0.0), q, 0.0))
    stop = np.where(sense > 0.0, path.stopped[:, None], 0.0)
    return np.where(known, q, np.nan), np.where(known, stop, np.nan)


def _first_rest(draws: _Draws, energy: FloatArray) -> FloatArray:
    """Angle (rad) at which a body that lacks energy at release comes to move: E0 + W = 0 by Newton
    steps; nan if there is none.
    """
    u, lacking = np.zeros(energy.shape), energy < 0.0
    if not np.any(lacking):
        return u
    body = Body(radius=draws.radius, gamma=draws.gamma, kappa=0.0)
    forces = Forces(
        draws.moment, 0.0, 0.0, 0.0, draws.c1, draws.s1, draws.c2, draws.s2, draws.phi_slope
    )
    place = {
        "phi": draws.phi,
        "theta0": draws.theta0,
        "rolling_resistance": draws.resistance + draws.load,
    }
    for _ in range(_MOST_NEWTON):
        push, friction, _, _ = draws.forces(u)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(
                lacking, -(energy + work(u, body, **place, forces=forces)) / (push - friction), 0.0
            )
        u = u + np.clip(step, -0.3, 0.3)
        if np.nanmax(np.abs(step)) < 1e-14:
            break
    return np.where(~lacking | ((u >= 0.0) & (np.abs(step) < 1e-9)), u, np.nan)
