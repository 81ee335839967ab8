"""Motion under any forces: by series in time, vectorised over draws.

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

from estim.arrays import BoolArray, FloatArray, positive_or
from estim.model.body import Body
from estim.model.forces import Forces, work

_N_NODE = 28
_PIECE = 5.0  # of the time in which a state changes
_SMALLEST = 1e-4  # of the first length of a piece: then the draw is given up
_GROWTH = 1.4  # of a piece after one that was resolved, up to its first length
_MOST_PIECES, _MOST_ROUNDS, _MOST_NEWTON = 2000, 30, 60
_NEGLIGIBLE = 1e-10  # of u and y
_CLOSE = 1e-7  # of z, of a Newton step: the error left is of the order of its square
_SLOWEST = 0.5  # 1/s, of what sets the length of a piece
_BLOCK = 512  # draws at once: what they need fits in the cache
_ROUNDED = 1e-11  # of the way to a rest: an angle as close to it is that of the rest

_NODES = -np.cos(np.pi * np.arange(_N_NODE) / (_N_NODE - 1))
# values at nodes @ this = coefficients, of Chebyshev polynomials and of powers
_TO_SERIES = np.linalg.inv(chebyshev.chebvander(_NODES, _N_NODE - 1)).T
_TO_POWERS = np.array(
    [np.pad(p, (0, _N_NODE - p.size)) for p in map(chebyshev.cheb2poly, np.eye(_N_NODE))]
)
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
        self.rate, self.twice = np.sqrt(self.scale), 2.0 * self.gamma
        self.viscous = viscous / np.sqrt(0.5 * self.g / self.radius)
        self.quadratic = 2.0 * quadratic * self.radius
        self.turning, self.loaded = bool(np.any(values[11:15])), bool(np.any(self.load))
        self.ramp = sine_and_cosine(self.phi)
        self.bent = bool(np.any(self.bend))

    def taken(self, chosen: Any) -> _Draws:
        return _Draws([value[chosen] for value in self.values])

    def rates(
        self, u: FloatArray, y: FloatArray, sense: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """(w, y') for friction that acts against `sense`, +1 or -1."""
        push, friction, root = self.forces(u)
        speed = y * root  # of the axle, in units of sqrt(2 g R)
        pull = push - sense * friction - speed * (self.viscous + sense * self.quadratic * speed)
        if self.loaded:
            pull = self._loaded(pull, u, speed, sense, root)
        pace = self.rate * root
        return pace, 0.5 * pace * pull

    def forces(self, u: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Force that does not depend on the direction, friction of a body at rest, and
        1/sqrt(D).
        """
        sine, cosine = sine_and_cosine(self.theta0 + u)
        climb, level = sine_and_cosine(self.phi + self.bend * u) if self.bent else self.ramp
        push = self.gamma * sine - climb
        if self.turning:
            push = (
                push
                - self.c1 * cosine
                - self.s1 * sine
                - self.c2 * (1.0 - 2.0 * sine * sine)
                - self.s2 * 2.0 * sine * cosine
            )
        inertia = self.inertia + self.twice * level * cosine - self.twice * climb * sine
        friction = (self.resistance + self.load) * level + self.moment
        return push, friction, 1.0 / np.sqrt(inertia)

    def _loaded(
        self,
        pull: FloatArray,
        u: FloatArray,
        speed: FloatArray,
        sense: FloatArray,
        root: FloatArray,
    ) -> FloatArray:
        """dq/du with the part of the load that comes from the motion: q' = (q/D)' D + q D'/D solved
        for q'.
        """
        sine, cosine = sine_and_cosine(self.theta0 + u + self.phi + self.bend * u)
        ratio, change = speed * speed, -self.twice * sine * (1.0 + self.bend)
        load = sense * self.load
        lever = load * self.gamma * sine * root * root
        return (
            pull + load * ratio * (self.twice * cosine - 2.0 * self.bend) - lever * ratio * change
        ) / (1.0 - lever)

    def direction(self, u: FloatArray) -> FloatArray:
        """Where a body at rest starts to: +1, -1, or 0 where friction holds it."""
        push, friction, _ = self.forces(u)
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
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
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
                moved = np.abs(root_next - root)
                at, root = at_next, root_next
                if np.max(moved) < 0.1 * _NEGLIGIBLE:
                    break
            tail = np.abs(at @ _TO_SERIES[:, -2:]) + np.abs(root @ _TO_SERIES[:, -2:])
        return at, root, np.all(moved < _NEGLIGIBLE, axis=1) & np.all(tail < _NEGLIGIBLE, axis=1)


def sine_and_cosine(angle: FloatArray) -> tuple[FloatArray, FloatArray]:
    """By t = tan(angle/2), which is many times faster."""
    t = np.tan(0.5 * angle)
    cosine_1 = 2.0 / (1.0 + t * t)
    return t * cosine_1, cosine_1 - 1.0


def _powers(values: FloatArray) -> FloatArray:
    """Series in powers (n_node, n) of values at nodes (..., n_node): all that comes before is one
    axis.
    """
    return _TO_POWERS.T @ (_TO_SERIES.T @ values.reshape(-1, _N_NODE).T)


def _series(powers: FloatArray, which: NDArray[Any], z: FloatArray) -> FloatArray:
    """Of the series (n_power, n) those of the numbers `which`, each at its own z, by Horner's
    rule.
    """
    total = powers[-1].take(which)
    for row in powers[-2::-1]:
        total *= z
        total += row.take(which)
    return total


def _crossing(
    powers: FloatArray,
    which: NDArray[Any],
    level: FloatArray | float,
    low: FloatArray,
    high: FloatArray,
    z: FloatArray,
) -> FloatArray:
    """z at which rising series reach `level`, by Newton steps from `z` inside brackets, halvings
    where they leave them.
    """
    slopes = powers[1:] * np.arange(1.0, _N_NODE)[:, None]
    for _ in range(_MOST_NEWTON):
        ahead = _series(powers, which, z) - level
        low, high = np.where(ahead <= 0.0, z, low), np.where(ahead >= 0.0, z, high)
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = z - ahead / _series(slopes, which, z)
        # the last step may lie beyond an end by rounding
        inside = (newton >= low - 1e-14) & (newton <= high + 1e-14)
        before, z = z, np.where(inside, newton, 0.5 * (low + high))
        if not np.any(np.abs(z - before) >= _CLOSE):
            break
    return z


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
    held: BoolArray


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
        moving = draws if going.size == n else draws.taken(going)
        at, root, good = moving.piece(u[going], y[going], sense[going], h[going])
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
            low, high = _NODES[node - 1], _NODES[node]
            all_turns = np.arange(turns.size)
            falling = _powers(-sense[rows] * root[turns])
            z = _crossing(falling, all_turns, 0.0, low, high, 0.5 * (low + high))
            cut[rows] = 0.5 * (z + 1.0)
            u[rows, 0], y[rows] = _series(_powers(at[turns]), all_turns, z), 0.0
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
    wanted = np.array(wanted, dtype=float, ndmin=2)
    given = [
        body.radius,
        body.gamma,
        1.0 + body.inertia_ratio,
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


def _places(ends: FloatArray, wanted: FloatArray) -> NDArray[Any]:
    """The first of the rising `ends` (n_draw, n) that is not before what is `wanted` (n_draw,
    n_obs).
    """
    return np.array([np.searchsorted(*pair) for pair in zip(ends, wanted, strict=True)])


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
    back: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Position (m) and velocity (m/s) at times `t` after release, (n_draw, n_obs) each, back and
    forth.

    t : (n_obs,) or (n_draw, n_obs) s; at rest at 0 before 0, whatever the speed at release.
    release_speed : m/s, either sign.  Released at rest where theta would not increase it stays, as
        in `back_and_forth`.  nan where the series do not resolve it.
    back : whether it goes on from where it first comes to rest; else it is nan from there on.
    """
    blocks = _blocks(t, body, phi, theta0, rolling_resistance, g, forces, release_speed)
    states = [_block_motion(*block, back=back) for block in blocks]
    if not states:
        return np.zeros(np.shape(t)), np.zeros(np.shape(t))
    return np.concatenate([x for x, _ in states]), np.concatenate([v for _, v in states])


def _block_motion(
    t: FloatArray, draws: _Draws, v0: FloatArray, *, back: bool
) -> tuple[FloatArray, FloatArray]:
    u = np.zeros(v0.shape)
    y = v0 / (draws.radius * draws.rate * draws.forces(u)[2])
    last = max(float(np.max(t, where=np.isfinite(t), initial=0.0)), 1e-9)
    sense = np.where(v0 != 0.0, np.sign(v0), np.maximum(draws.direction(u), 0.0))
    path = _follow(draws, u, y, sense, _PIECE / draws.fastest(u, y * y), last=last, back=back)
    last_piece = path.begin.shape[0] - 1
    place = _places(np.maximum.accumulate(path.begin + path.cut * path.length).T, t)
    beyond = place > last_piece
    at = np.minimum(place, last_piece), np.arange(v0.size)[:, None]
    index = np.ravel_multi_index(at, path.begin.shape)
    length = path.length[at]
    z = 2.0 * (t - path.begin[at]) / positive_or(length, 1.0) - 1.0
    z = np.clip(z, -1.0, 1.0)
    reached = path.reached[-1][:, None]
    angle = np.where(beyond, reached, _series(_powers(path.u), index, z))
    root = np.where(beyond, 0.0, _series(_powers(path.y), index, z))
    lost = np.isnan(t) | (beyond & ~(path.held[:, None] & back) & (t > 0.0))
    position = draws.radius * angle
    velocity = draws.radius * draws.rate * draws.forces(angle)[2] * root
    return tuple(
        np.where(lost, np.nan, np.where(t > 0.0, value, 0.0)) for value in (position, velocity)
    )  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class Passage:
    """Of a body at given angles, (n_draw, n_obs); nan where the series do not resolve it.

    energy : q, in weights x R; 0 where it never gets.
    time : s since release; nan where it never gets.
    stop : (n_draw, 1) rad where it first rests, inf where it does not before the last angle.
    """

    energy: FloatArray
    time: FloatArray
    stop: FloatArray


def driven_passage(
    angle: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike,
    release_energy: ArrayLike = 0.0,
    forces: Forces,
) -> Passage:
    """When and with which energy the body has turned by `angle`, and where it first rests.

    angle : (n_obs,) or (n_draw, n_obs) rad, theta increasing.
    release_energy : negative where the body starts from rest at the first angle at which q would be
        positive.
    """
    blocks = _blocks(angle, body, phi, theta0, rolling_resistance, g, forces, release_energy)
    found = [_block_passage(*block) for block in blocks]
    if not found:
        return Passage(np.zeros(np.shape(angle)), np.zeros(np.shape(angle)), np.zeros((0, 1)))
    return Passage(*map(np.concatenate, zip(*found, strict=True)))


def _block_passage(
    angle: FloatArray, draws: _Draws, energy: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
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
    # all nodes of a draw one after the other, with the end of the motion for those beyond it
    share = 0.5 * (_NODES + 1.0)
    beyond = (share > path.cut[..., None]) | (path.length[..., None] == 0.0)
    nodes, roots, times = (
        np.moveaxis(np.where(beyond, end[..., None], values), 0, 1).reshape(u.size, -1)
        for end, values in (
            (path.reached, path.u),
            (np.zeros_like(path.cut), path.y),
            (path.cut, share),
        )
    )
    there = (angle >= u) & (angle < reached)
    level = np.where(there, angle, np.nan)
    place = np.clip(_places(np.maximum.accumulate(nodes, axis=1), level), 1, nodes.shape[1] - 1)
    place += place % _N_NODE == 0
    row = np.arange(u.size)[:, None]
    (low, first, begin), (high, last, end) = (
        [values[row, at] for values in (nodes, roots, times)] for at in (place - 1, place)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (level - low) / (high - low)
        energy = np.square(first) + share * (np.square(last) - np.square(first))
        # as under a constant force
        share = np.nan_to_num(share * (first + last) / (first + np.sqrt(energy)))
    low, high = 2.0 * begin - 1.0, 2.0 * end - 1.0
    piece = place // _N_NODE
    index = piece * u.size + row
    z = np.clip(low + share * (high - low), low, high)
    z = _crossing(_powers(path.u), index, level, low, high, z)
    q = np.square(_series(_powers(path.y), index, z))
    time = path.begin[piece, row] + 0.5 * (z + 1.0) * path.length[piece, row]
    time = np.where(angle > u, time, 0.0)  # a start from rest has no slope to find it by
    rest, over = path.stopped[:, None], path.begin[-1] + path.cut[-1] * path.length[-1]
    at_rest = np.isfinite(rest) & (np.abs(angle - rest) <= _ROUNDED * rest)
    time = np.where(at_rest, over[:, None], np.where(there, time, np.nan))
    known = path.held[:, None] | (reached >= far)
    q = np.where(np.isnan(angle), np.nan, np.where(there & (sense > 0.0), q, 0.0))
    stop = np.where(sense > 0.0, rest, 0.0)
    return (
        np.where(known, q, np.nan),
        np.where(known & (sense > 0.0), time, np.nan),
        np.where(known, stop, np.nan),
    )


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
        push, friction, _ = draws.forces(u)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(
                lacking, -(energy + work(u, body, **place, forces=forces)) / (push - friction), 0.0
            )
        u = u + np.clip(step, -0.3, 0.3)
        if np.nanmax(np.abs(step)) < 1e-14:
            break
    return np.where(~lacking | ((u >= 0.0) & (np.abs(step) < 1e-9)), u, np.nan)
