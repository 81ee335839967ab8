"""Motion under forces that depend on the speed, or with any other force in time: Runge-Kutta steps, vectorised over draws.

The state is the angle turned u and y = +-sqrt(q), the root of the kinetic energy in weights x R (table in `model.forces`):

    u' = w y,    y' = (w/2) dq/du,    w = sqrt(2 g/(R D))

Nothing is divided by y, so a start from rest and a turning point are points like any other.  Fourth-order steps of equal length,
a share of 1 / a bound on the rates, and cubic interpolation between them: 3e-7 m and m/s (tests).  Where the body comes to
rest the step is taken again up to that moment and the rest of it in the new direction, so that friction changes sign there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model.body import Body
from model.forces import Forces, work

FloatArray = NDArray[Any]

_STEP_OF_SPEED, _STEP_OF_POSITION = 0.08, 0.16  # of the time in which a state changes; an error of energy is a large one of a small speed
_COARSEST = 0.5
_OUTLYING = 6.0  # draws faster than so many times the median do not set the step
_MOST_STEPS = 4096
_SLOWEST = 0.5  # 1/s, of what sets a step
_BLOCK = 128  # draws at once: what they need fits in the cache
_POLISHING = 4
_MOST_NEWTON = 60


class _Draws:
    """Parameters of draws as arrays (n_draw,), and the right side of the equation of motion."""

    def __init__(self, values: list[FloatArray]):
        self.values = values
        (self.radius, self.gamma, self.inertia, self.phi, self.theta0, self.resistance, self.g, self.moment, self.load, viscous,
         quadratic, self.c1, self.s1, self.c2, self.s2, phi_slope) = values  # fmt: skip
        self.bend = phi_slope * self.radius
        self.scale = 2.0 * self.g / self.radius
        self.viscous = viscous * np.sqrt(2.0 * self.radius / self.g)
        self.quadratic = 2.0 * quadratic * self.radius
        self.turning, self.loaded = bool(np.any(values[11:15])), bool(np.any(self.load))

    def taken(self, chosen: NDArray[Any]) -> _Draws:
        return _Draws([value[chosen] for value in self.values])

    def rates(self, u: FloatArray, y: FloatArray, sense: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(u', y') for friction that acts against `sense`, +1 or -1; both 0 where it is 0."""
        push, friction, square, pace = self.forces(u, y)
        pull = push - sense * friction - self.viscous * y * np.sqrt(square) - self.quadratic * y * np.abs(y) * square
        if self.loaded:
            pull = self._loaded(pull, u, y, sense)
        held = sense == 0.0
        return np.where(held, 0.0, pace * y), np.where(held, 0.0, 0.5 * pace * pull)

    def forces(self, u: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Force that does not depend on the direction, friction of a body at rest, 1/D and w."""
        theta, ramp = self.theta0 + u, self.phi + self.bend * u
        sine, cosine = np.sin(theta), np.cos(theta)
        level = np.cos(ramp)
        push = self.gamma * sine - np.sin(ramp)
        if self.turning:
            push = push - self.c1 * cosine - self.s1 * sine - self.c2 * (1.0 - 2.0 * sine * sine) - self.s2 * 2.0 * sine * cosine
        square = 1.0 / (self.inertia + 2.0 * self.gamma * np.cos(theta + ramp))
        return push, (self.resistance + self.load) * level + self.moment, square, np.sqrt(self.scale * square)

    def _loaded(self, pull: FloatArray, u: FloatArray, y: FloatArray, sense: FloatArray) -> FloatArray:
        """dq/du with the part of the load that comes from the motion: q' = (q/D)' D + q D'/D solved for q'."""
        tilted = self.theta0 + u + self.phi + self.bend * u
        sine, cosine = np.sin(tilted), np.cos(tilted)
        d = self.inertia + 2.0 * self.gamma * cosine
        ratio, change = y * y / d, -2.0 * self.gamma * sine * (1.0 + self.bend)
        load = sense * self.load
        pull = pull + load * ratio * (2.0 * self.gamma * cosine - 2.0 * self.bend)
        lever = load * self.gamma * sine / d
        return (pull - lever * ratio * change) / (1.0 - lever)

    def step(
        self, u: FloatArray, y: FloatArray, sense: FloatArray, h: ArrayLike, a: tuple[FloatArray, FloatArray]
    ) -> tuple[FloatArray, FloatArray]:
        """The state after one classical Runge-Kutta step of length h (s); a: the rates at its beginning."""
        h = np.asarray(h)
        b = self.rates(u + 0.5 * h * a[0], y + 0.5 * h * a[1], sense)
        c = self.rates(u + 0.5 * h * b[0], y + 0.5 * h * b[1], sense)
        d = self.rates(u + h * c[0], y + h * c[1], sense)
        return u + h / 6.0 * (a[0] + 2.0 * (b[0] + c[0]) + d[0]), y + h / 6.0 * (a[1] + 2.0 * (b[1] + c[1]) + d[1])

    def direction(self, u: FloatArray) -> FloatArray:
        """Where a body at rest starts to: +1, -1, or 0 where friction holds it."""
        push, friction, _, _ = self.forces(u, np.zeros_like(u))
        return np.where(push > friction, 1.0, np.where(push < -friction, -1.0, 0.0))

    def fastest(self, fall: FloatArray, energy: FloatArray) -> FloatArray:
        """A bound (1/s) on rates: of the motion with `energy` at release and `fall` of height/R, and of the swing about the lowest point."""
        smallest = np.maximum(self.inertia - 2.0 * np.abs(self.gamma), 1e-3)
        gain = np.abs(energy) + fall + 2.0 * np.abs(self.gamma) + sum(np.abs(v) for v in self.values[11:15])
        return np.maximum(np.sqrt(self.scale * gain / smallest), _SLOWEST)


def _draws(body: Body, *, phi: ArrayLike, theta0: ArrayLike, rolling_resistance: ArrayLike, g: ArrayLike, forces: Forces, extra: ArrayLike) -> tuple[
    _Draws, FloatArray
]:
    """All parameters as (n_draw,), and `extra` with them."""
    given = [body.radius, body.gamma, 1.0 + np.asarray(body.inertia_ratio), phi, theta0, rolling_resistance, g, *forces.values(), extra]
    columns = np.broadcast_arrays(*(np.asarray(value, dtype=float) for value in given))
    flat = [np.array(column, dtype=float).reshape(-1) for column in columns]
    return _Draws(flat[:-1]), flat[-1]


@dataclass(frozen=True, eq=False)
class _Path:
    """States at the ends of the pieces between equidistant times; two pieces in a step in which the body comes to rest.

    length : (n_step, 2, n_draw) s.  begin, end : (n_step, 2, 4, n_draw) of u, y and their rates.
    h : s, of a step.  stopped : (n_draw,) rad, the angle turned where it first comes to rest; inf where it does not.
    """

    draws: _Draws
    h: float
    length: FloatArray
    begin: FloatArray
    end: FloatArray
    stopped: FloatArray


def _integrate(
    draws: _Draws, u: FloatArray, y: FloatArray, sense: FloatArray, *, h: float, n_step: int, far: float = np.inf, back: bool
) -> _Path:
    """Steps from a state until `n_step`, or until all have stopped or passed `far` (rad).  back : whether they start again."""
    n = u.size
    stopped = np.full(n, np.inf)
    lengths, begins, ends = [], [], []
    rates = draws.rates(u, y, sense)
    for _ in range(n_step):
        length = np.zeros((2, n))
        begin, end = np.zeros((2, 4, n)), np.zeros((2, 4, n))
        length[0], begin[0] = h, (u, y, *rates)
        u, y = draws.step(u, y, sense, h, rates)
        rates = draws.rates(u, y, sense)
        end[0] = u, y, *rates
        turned = np.flatnonzero(y * sense < 0.0)
        if turned.size:
            sub, way = draws.taken(turned), sense[turned]
            first = begin[0][:, turned]
            slopes = first[2], first[3]
            share = h * first[1] / (first[1] - y[turned])
            for _ in range(_POLISHING):
                at, rest = sub.step(first[0], first[1], way, share, slopes)
                share = np.clip(share - rest / sub.rates(at, rest, way)[1], 0.0, h)
            at, rest = sub.step(first[0], first[1], way, share, slopes)[0], np.zeros(turned.size)
            length[:, turned] = share, h - share
            end[0][:, turned] = at, rest, *sub.rates(at, rest, way)
            stopped[turned] = np.where(np.isinf(stopped[turned]), at, stopped[turned])
            sense = sense.copy()
            sense[turned] = way = sub.direction(at) if back else np.zeros(turned.size)
            slopes = sub.rates(at, rest, way)
            begin[1][:, turned] = at, rest, *slopes
            u[turned], y[turned] = sub.step(at, rest, way, h - share, slopes)
            rates = draws.rates(u, y, sense)
            end[1][:, turned] = u[turned], y[turned], rates[0][turned], rates[1][turned]
        lengths.append(length)
        begins.append(begin)
        ends.append(end)
        if np.all((sense == 0.0) | (u >= far)):
            break
    return _Path(draws, h, np.array(lengths), np.array(begins), np.array(ends), stopped)


def _between(share: FloatArray, length: FloatArray, begin: FloatArray, end: FloatArray, which: int) -> FloatArray:
    """Cubic through values and rates at both ends of a piece, at a share of it: of u (which 0) or y (which 1)."""
    rise = end[which] - begin[which]
    first, last = length * begin[2 + which], length * end[2 + which]
    return begin[which] + share * (first + share * (3.0 * rise - 2.0 * first - last + share * (first + last - 2.0 * rise)))


def _steps(fastest: FloatArray, last: float) -> tuple[int, NDArray[np.bool_]]:
    """Number of steps up to the time `last` (s), and which draws they resolve."""
    wanted = last * float(np.max(fastest, where=fastest <= _OUTLYING * np.median(fastest), initial=0.0)) / _STEP_OF_POSITION
    n_step = int(np.clip(np.ceil(wanted), 8, _MOST_STEPS))
    return n_step, fastest * last / n_step <= _COARSEST


def driven_motion(
    t: ArrayLike, body: Body, *, phi: ArrayLike, theta0: ArrayLike, rolling_resistance: ArrayLike = 0.0, g: ArrayLike, release_speed: ArrayLike = 0.0,
    forces: Forces, back: bool = True,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position (m) and velocity (m/s) at times `t` after release, (n_draw, n_obs) each, and the angle (n_draw, 1) where it first rests.

    t : (n_obs,) or (n_draw, n_obs) s; at rest at 0 before 0, whatever the speed at release.  release_speed : m/s, either sign.
    back : whether the body starts again where it comes to rest; else it stays.
    Released at rest where theta would not increase it stays, as in `back_and_forth`.  nan for draws too fast for the steps.
    """
    t = np.atleast_2d(np.asarray(t, dtype=float))
    draws, v0 = _draws(body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance, g=g, forces=forces, extra=release_speed)
    n = max(v0.size, t.shape[0])
    everything = [np.broadcast_to(value, n) for value in draws.values]
    v0, t = np.broadcast_to(v0, n), np.broadcast_to(t, (n, t.shape[1]))
    x, v, stop = np.empty(t.shape), np.empty(t.shape), np.empty((n, 1))
    for first in range(0, n, _BLOCK):
        rows = slice(first, first + _BLOCK)
        x[rows], v[rows], stop[rows, 0] = _block_motion(t[rows], _Draws([value[rows] for value in everything]), v0[rows], back)
    return x, v, stop


def _block_motion(t: FloatArray, draws: _Draws, v0: FloatArray, back: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    u, y = np.zeros(v0.size), v0 / (draws.radius * draws.forces(np.zeros(v0.size), v0)[3])
    last = max(float(np.max(t, initial=0.0)), 1e-6)
    span = draws.fastest(np.zeros(v0.size), y * y) * last + 0.5 * draws.scale * np.abs(np.sin(draws.phi)) * last**2 / draws.inertia
    span = np.where((draws.phi < 0.0) | (v0 < 0.0), span, np.minimum(span, 4.0 * np.pi))
    fastest = draws.fastest((np.abs(np.sin(draws.phi)) + np.abs(draws.bend) * span) * span, y * y)
    n_step, resolved = _steps(fastest, last)
    h = last / n_step
    path = _integrate(draws, u, y, np.where(v0 != 0.0, np.sign(v0), np.maximum(draws.direction(u), 0.0)), h=h, n_step=n_step, back=back)
    place = np.clip((t / h).astype(int), 0, path.length.shape[0] - 1)
    column = np.arange(v0.size)[:, None]
    since = np.maximum(t - h * place, 0.0)
    first = path.length[place, 0, column]
    piece = ((since >= first) & (path.length[place, 1, column] > 0.0)).astype(int)
    length = path.length[place, piece, column]
    share = np.clip((since - piece * first) / length, 0.0, 1.0)
    begin, end = (np.moveaxis(ends[place, piece, :, column], -1, 0) for ends in (path.begin, path.end))
    angle, root = (_between(share, length, begin, end, which) for which in (0, 1))
    theta = (draws.theta0 + draws.phi)[:, None] + (1.0 + draws.bend)[:, None] * angle
    pace = np.sqrt(draws.scale[:, None] / (draws.inertia[:, None] + 2.0 * draws.gamma[:, None] * np.cos(theta)))
    moving, known = t > 0.0, resolved[:, None]
    x, v = (np.where(moving, draws.radius[:, None] * value, 0.0) for value in (angle, pace * root))
    return np.where(known, x, np.nan), np.where(known, v, np.nan), path.stopped


def driven_energy(
    angle: ArrayLike, body: Body, *, phi: ArrayLike, theta0: ArrayLike, rolling_resistance: ArrayLike = 0.0, g: ArrayLike,
    release_energy: ArrayLike = 0.0, forces: Forces,
) -> tuple[FloatArray, FloatArray]:
    """Kinetic energy q (weights x R) after a turn by `angle`, (n_draw, n_obs), and the angle (n_draw, 1) where it first rests.

    angle : (n_obs,) or (n_draw, n_obs) rad, theta increasing.  q is 0 where the body never gets, nan for draws too fast for the steps.
    release_energy : negative where the body starts from rest at the first angle at which q would be positive.
    """
    angle = np.atleast_2d(np.asarray(angle, dtype=float))
    draws, energy = _draws(body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance, g=g, forces=forces, extra=release_energy)
    n = max(energy.size, angle.shape[0])
    everything = [np.broadcast_to(value, n) for value in draws.values]
    energy, angle = np.broadcast_to(energy, n), np.broadcast_to(angle, (n, angle.shape[1]))
    q, stop = np.empty(angle.shape), np.empty((n, 1))
    for first in range(0, n, _BLOCK):
        rows = slice(first, first + _BLOCK)
        q[rows], stop[rows, 0] = _block_energy(angle[rows], _Draws([value[rows] for value in everything]), energy[rows])
    return q, stop


def _block_energy(angle: FloatArray, draws: _Draws, energy: FloatArray) -> tuple[FloatArray, FloatArray]:
    far = max(float(np.max(angle)), 1e-9)
    u = _first_rest(draws, energy)
    y = np.where(energy > 0.0, np.sqrt(np.maximum(energy, 0.0)), 0.0)
    sense = np.where(energy > 0.0, 1.0, np.where(np.isfinite(u), np.maximum(draws.direction(np.nan_to_num(u)), 0.0), 0.0))
    u = np.nan_to_num(u)
    fastest = draws.fastest(np.maximum(-draws.phi, 0.0) * far + np.maximum(-draws.bend, 0.0) * far**2, energy)
    h = _STEP_OF_SPEED / float(np.max(fastest, where=fastest <= _OUTLYING * np.median(fastest), initial=0.0))
    path = _integrate(draws, u, y, sense, h=h, n_step=_MOST_STEPS, far=far, back=False)
    begin, end, length = path.begin[:, 0], path.end[:, 0], path.length[:, 0]
    reached = np.max(end[:, 0], axis=0)[:, None]
    place = np.array([
        np.searchsorted(knots, wanted, side="right") for knots, wanted in zip(np.maximum.accumulate(begin[1:, 0]).T, angle, strict=True)
    ]).reshape(angle.shape)
    column = np.arange(energy.size)[:, None]
    begin, end = (np.moveaxis(ends[place, :, column], -1, 0) for ends in (begin, end))
    length = length[place, column]
    low, high = np.zeros(angle.shape), np.ones(angle.shape)
    share = np.sqrt(np.clip((angle - begin[0]) / np.maximum(end[0] - begin[0], 1e-300), 0.0, 1.0))
    for _ in range(_MOST_NEWTON):
        ahead = _between(share, length, begin, end, 0) - angle
        low, high = np.where(ahead <= 0.0, share, low), np.where(ahead >= 0.0, share, high)
        rate = length * begin[2] + share * (2.0 * (3.0 * (end[0] - begin[0]) - length * (2.0 * begin[2] + end[2]))
                                            + 3.0 * share * (length * (begin[2] + end[2]) - 2.0 * (end[0] - begin[0])))  # fmt: skip
        with np.errstate(divide="ignore", invalid="ignore"):
            newton = share - ahead / rate
        following = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
        settled = np.max(np.abs(following - share)) < 1e-12
        share = following
        if settled:
            break
    q = np.square(np.maximum(_between(share, length, begin, end, 1), 0.0))
    there = (angle >= u[:, None]) & (angle <= reached)
    unfinished = np.isinf(path.stopped) & (reached[:, 0] < far) & (sense > 0.0)
    known = (h * fastest <= _COARSEST) & ~unfinished
    return np.where(known[:, None], np.where(there, q, 0.0), np.nan), np.where(known, np.where(sense > 0.0, path.stopped, 0.0), np.nan)


def _first_rest(draws: _Draws, energy: FloatArray) -> FloatArray:
    """Angle (rad) at which a body that lacks energy at release comes to move: E0 + W = 0 by Newton steps; nan if there is none."""
    u = np.zeros(energy.size)
    lacking = energy < 0.0
    if not np.any(lacking):
        return u
    radius = draws.radius
    body = Body(radius=radius, gamma=draws.gamma, kappa=0.0)
    forces = Forces(draws.moment, 0.0, 0.0, 0.0, draws.c1, draws.s1, draws.c2, draws.s2, draws.bend / radius)
    resistance = draws.resistance + draws.load
    for _ in range(_MOST_NEWTON):
        total = energy + work(u, body, phi=draws.phi, theta0=draws.theta0, rolling_resistance=resistance, forces=forces)
        push, friction, _, _ = draws.forces(u, np.zeros_like(u))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where(lacking, -total / (push - friction), 0.0)
        u = u + np.clip(step, -0.3, 0.3)
        if np.nanmax(np.abs(step)) < 1e-14:
            break
    found = ~lacking | ((u >= 0.0) & (np.abs(step) < 1e-9))
    return np.where(found, u, np.nan)
