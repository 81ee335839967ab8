"""Motion in time from rest: travel time, position and speed at given times, without an ODE solver.

The time is t = integral of dx/v, singular at the release and at a turning point.  Two substitutions
remove it:

    a turning point at theta_t      theta = m - h cos u,  u in [0, pi]
                                    (m, h: middle and half-width of the range)
    no turning point in reach       theta = theta0 + L w^2,  w in [0, 1]
                                    (L: as far as is asked for)

dt/du (dt/dw) is smooth, so it is interpolated at Chebyshev points and integrated in closed form;
the inverse t -> x is read off a table of that polynomial and its derivatives.  Everything is
vectorised over draws: parameters as scalars or (n_draw, 1).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.model.body import Body
from estim.model.chebyshev_series import cosine_transform, evaluate, integral
from estim.model.driven import driven_motion, sine_and_cosine
from estim.model.forces import Forces
from estim.model.inversion import invert
from estim.model.phase_curve import STANDARD_GRAVITY, effective_slope, energy_ratio, turning_angle

FloatArray = NDArray[Any]

_FEWEST_NODES = 48
_BLOCK = 11_000  # points of the draws that are computed together: they stay in the cache
_MOST_NODES = 4096
_NEGLIGIBLE = 1e-11  # of the largest coefficient
_UNRESOLVED = 1e-8
_ROUND_OFF = 1e-15  # smaller coefficients change no digit


def _clock(
    body: Body,
    *,
    reach: FloatArray,
    turns: NDArray[np.bool_],
    phi: FloatArray,
    theta0: FloatArray,
    rolling_resistance: FloatArray,
    g: FloatArray,
    n_node: int | None,
    fewest: int = _FEWEST_NODES,
    apart: bool = False,
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Chebyshev coefficients of the time t (s) as a function of z in [-1, 1], t(-1) = 0, and of
    dt/dz: (n + 1, n_draw) and (n, n_draw).

    reach : (n_draw, 1) rad, the angle turned at z = 1.
    turns : whether that is a turning point.
    n_node : Chebyshev points; None doubles them, from `fewest`, until the last coefficients no
        longer count.  Draws that are still not resolved by the largest number (the body all but
        stops on its way) are nan.
    apart : returns as soon as some draws are resolved.  The third answer, (n_draw,), says which are
        not, and need another call.
    """
    fixed = n_node is not None
    n = n_node or fewest
    while True:
        z = np.cos(np.pi * (np.arange(n) + 0.5) / n)
        angle, remainder = _substitution(z, reach, turns)
        rate = reach * np.where(
            turns, 0.25 * np.pi * np.sin(0.5 * np.pi * (z + 1.0)), 0.5 * (z + 1.0)
        )
        ratio = _ratio(
            angle, remainder, body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            pace = rate / np.sqrt(2.0 * g / np.asarray(body.radius) * ratio)  # dt/dz, s
        coefficients = 2.0 / n * cosine_transform(pace).T
        coefficients[0] *= 0.5
        size = np.abs(coefficients) / np.max(np.abs(coefficients), axis=0)
        tail = np.max(size[-n // 8 :], axis=0)
        open_ends = ~(tail < _NEGLIGIBLE) & (reach[:, 0] > 0.0)
        if fixed or n >= _MOST_NODES or not np.any(open_ends):
            open_ends = np.zeros_like(open_ends)
            break
        if apart and not np.all(open_ends):
            return integral(coefficients), coefficients, open_ends
        n *= 2
    if not fixed:
        coefficients[:, ~(tail < _UNRESOLVED)] = np.nan
        counting = np.flatnonzero(np.any(size > _ROUND_OFF, axis=1))
        coefficients = coefficients[: 1 + int(np.max(counting, initial=1))]
    return integral(coefficients), coefficients, open_ends


def _substitution(
    z: FloatArray, reach: FloatArray, turns: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray]:
    """Angle (rad) turned at z in [-1, 1], and that still to turn before the turning point, without
    cancellation; inf where there is none.
    """
    square = np.square(np.tan(0.25 * np.pi * (z + 1.0)))
    inverse = 1.0 / (1.0 + square)  # cos^2
    if np.all(turns):
        return reach * (square * inverse), reach * inverse
    return np.where(
        turns, reach * (square * inverse), reach * np.square(0.5 * (z + 1.0))
    ), np.where(turns, reach * inverse, np.inf)


def _ratio(
    angle: FloatArray,
    remainder: FloatArray,
    body: Body,
    *,
    phi: FloatArray,
    theta0: FloatArray,
    rolling_resistance: FloatArray,
) -> FloatArray:
    """W/D, with W taken from the nearer of its two zeros: W = r s - 2 gamma sin(theta_t - r/2)
    sin(r/2), r to the turning point.
    """
    near = remainder < angle
    ends = np.any(near, axis=0), np.any(~near, axis=0)
    # the same columns of all draws: each needs one of the two
    if near.ndim == 2 and not np.any(ends[0] & ends[1]):
        found = np.empty(near.shape)
        place: dict[str, Any] = {
            "phi": phi,
            "theta0": theta0,
            "rolling_resistance": rolling_resistance,
        }
        found[:, ends[1]] = energy_ratio(angle[:, ends[1]], body, **place)
        found[:, ends[0]] = _from_turning_point(
            angle[:, ends[0]], remainder[:, ends[0]], body, **place
        )
        return found
    from_release = energy_ratio(
        angle, body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance
    )
    r = np.where(near, remainder, 0.0)
    return np.where(
        near,
        _from_turning_point(
            angle, r, body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance
        ),
        from_release,
    )


def _from_turning_point(
    angle: FloatArray,
    r: FloatArray,
    body: Body,
    *,
    phi: FloatArray,
    theta0: FloatArray,
    rolling_resistance: FloatArray,
) -> FloatArray:
    """W/D by the angle r (rad) still to turn."""
    theta = theta0 + angle
    inertia = 1.0 + body.inertia_ratio + 2.0 * body.gamma * sine_and_cosine(theta + phi)[1]
    work = (
        r * effective_slope(phi, rolling_resistance)
        - 2.0 * body.gamma * sine_and_cosine(theta + 0.5 * r)[0] * sine_and_cosine(0.5 * r)[0]
    )
    return np.asarray(work / inertia)


def _columns(
    body: Body, phi: ArrayLike, theta0: ArrayLike, rolling_resistance: ArrayLike, g: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """The parameters as columns (n_draw, 1) and the angle (n_draw, 1) turned when the body
    stops.
    """
    stop = turning_angle(body, phi=phi, theta0=theta0, rolling_resistance=rolling_resistance)
    column = np.zeros(
        np.broadcast_shapes(
            stop.shape, np.shape(g), np.shape(body.radius), np.shape(body.inertia_ratio), (1, 1)
        )
    )
    phi, theta0, resistance, g = (
        np.asarray(p, dtype=float) + column for p in (phi, theta0, rolling_resistance, g)
    )
    return phi, theta0, resistance, g, stop + column


def travel_time(
    x: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike = STANDARD_GRAVITY,
    n_node: int | None = None,
) -> FloatArray:
    """Time from release until the axle is first at `x`, s, shaped (n_draw, n_obs); nan where it
    never gets there.

    body, phi, theta0 (rad), rolling_resistance, g : as in `speed`.
    x : (n_obs,) m.
    Parameters scalars or (n_draw, 1).  n_node : Chebyshev points; None takes as many as are needed
        (16 give 1e-9 s at the turning point of a paper-like run).

    >>> from estim.model import Body, travel_time
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> travel_time([0.1, 0.2], body, phi=0.07, theta0=1.0).round(3).tolist()
    [[0.586, 0.795]]
    """
    angle = np.atleast_1d(np.asarray(x, dtype=float)) / np.asarray(body.radius)
    phi, theta0, resistance, g, stop = _columns(body, phi, theta0, rolling_resistance, g)
    turns = np.isfinite(stop)
    reach = np.where(turns, stop, max(float(np.max(angle)), 1e-12))
    keywords: dict[str, Any] = {
        "phi": phi,
        "theta0": theta0,
        "rolling_resistance": resistance,
        "g": g,
    }
    clock, _, _ = _clock(body, reach=reach, turns=turns, **keywords, n_node=n_node)
    share = np.clip(angle / np.where(reach > 0, reach, 1.0), 0.0, 1.0)
    z = np.where(turns, 4.0 / np.pi * np.arcsin(np.sqrt(share)), 2.0 * np.sqrt(share)) - 1.0
    # the turning point itself, rounded, included
    possible = (angle >= 0.0) & (angle <= reach * (1.0 + 1e-12)) & (reach > 0.0)
    return np.where(possible, evaluate(z, clock), np.nan)


def trajectory(
    t: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike = STANDARD_GRAVITY,
    n_node: int | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Position (m) and speed (m/s) at times `t` after release, each (n_draw, n_obs).

    At rest at 0 before release; nan after the turning point (the way back is another motion:
    resistance changes sign); nan for every t > 0 where the body does not start.

    phi, theta0 : rad.  rolling_resistance, g : as in `speed`.  n_node : as in `travel_time`.
    t : (n_obs,) s.  Parameters scalars or (n_draw, 1).

    >>> from estim.model import Body, trajectory
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> x, v = trajectory([0.5, 1.0], body, phi=0.07, theta0=1.0)
    >>> x.shape
    (1, 2)
    """
    t = np.atleast_1d(np.asarray(t, dtype=float))
    x, v, end, _ = _leg(
        t,
        body,
        phi=phi,
        theta0=theta0,
        rolling_resistance=rolling_resistance,
        g=g,
        n_node=n_node,
        speeds=True,
    )
    known = (t <= 0.0) | (t <= end * (1.0 + 1e-12))
    return np.where(known, x, np.nan), np.where(known, v, np.nan)


def back_and_forth(
    t: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike = STANDARD_GRAVITY,
    n_leg: int = 16,
    n_node: int | None = None,
    release_speed: ArrayLike | None = None,
    forces: Forces | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Position (m) and velocity (m/s, negative on the way back) at times `t` after release, each
    (n_draw, n_obs).

    At rest at 0 before release.  Where the body stops it starts back, unless rolling resistance
    holds it: then it stays.  The way back from theta_t at tilt phi is, seen in a mirror, a release
    at -theta_t with tilt -phi.  nan where a leg is too long to be resolved (hundreds of turns).

    phi, theta0 : rad.  rolling_resistance, g : as in `speed`.  n_node : as in `travel_time`.
    t : (n_obs,) or (n_draw, n_obs) s.
    Parameters scalars or (n_draw, 1).  n_leg : nan after so many legs.
    release_speed : m/s at t = 0, either sign.
    forces : what else acts.  With either, by series to 1e-9 m (`model.driven`).

    >>> from estim.model import Body, back_and_forth
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> x, v = back_and_forth([0.5, 3.0], body, phi=0.07, theta0=1.0)
    >>> x.shape, bool(v[0, 0] > 0.0)
    ((1, 2), True)
    """
    return _states(
        t,
        body,
        phi=phi,
        theta0=theta0,
        rolling_resistance=rolling_resistance,
        g=g,
        n_leg=n_leg,
        n_node=n_node,
        release_speed=release_speed,
        forces=forces,
        speeds=True,
    )


def positions_at(
    t: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike = 0.0,
    g: ArrayLike = STANDARD_GRAVITY,
) -> FloatArray:
    """The positions (m) of `back_and_forth` at times `t` alone, (n_draw, n_obs), in less time.

    Arguments as in `back_and_forth`.

    >>> from estim.model import Body, positions_at
    >>> body = Body(radius=0.15, gamma=0.19, kappa=0.45)
    >>> positions_at([0.5, 1.0], body, phi=0.07, theta0=1.0).round(3).tolist()
    [[0.07, 0.324]]
    """
    return _states(
        t,
        body,
        phi=phi,
        theta0=theta0,
        rolling_resistance=rolling_resistance,
        g=g,
        n_leg=16,
        n_node=None,
        release_speed=None,
        forces=None,
        speeds=False,
    )[0]


def _states(
    t: ArrayLike,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike,
    g: ArrayLike,
    n_leg: int,
    n_node: int | None,
    release_speed: ArrayLike | None,
    forces: Forces | None,
    speeds: bool,
) -> tuple[FloatArray, FloatArray]:
    """`back_and_forth`; velocities mean nothing unless `speeds`."""
    place: dict[str, Any] = {
        "phi": phi,
        "theta0": theta0,
        "rolling_resistance": rolling_resistance,
        "g": g,
    }
    if release_speed is not None or forces is not None:
        v0 = 0.0 if release_speed is None else release_speed
        return driven_motion(t, body, **place, release_speed=v0, forces=forces or Forces())
    t = np.atleast_1d(np.asarray(t, dtype=float))
    if t.size == 0:
        return np.zeros(t.shape), np.zeros(t.shape)
    columns = [*place.values(), *vars(body).values(), *([t] if t.ndim == 2 else [])]
    n_draw = max((np.shape(column)[0] for column in columns if np.ndim(column) == 2), default=1)
    compiled = _compiled() if n_node is None else None
    if compiled is None:
        return _in_blocks(t, body, place, n_draw, n_leg=n_leg, n_node=n_node, speeds=speeds)
    x, v, settled = compiled(t, body, place, n_draw, n_leg=n_leg, speeds=speeds)
    rest = np.flatnonzero(~settled)
    if rest.size:
        x[rest], velocities = _in_blocks(
            _of(t, rest),
            *_part(body, place, rest),
            rest.size,
            n_leg=n_leg,
            n_node=n_node,
            speeds=speeds,
        )
        if speeds:
            v[rest] = velocities
    return x, v


@cache
def _compiled() -> Callable[..., tuple[FloatArray, FloatArray, NDArray[np.bool_]]] | None:
    """`model.compiled.states`, where numba is there and has a place to keep what it compiles."""
    try:
        from estim.model.compiled import states
    except (ImportError, RuntimeError):
        return None
    return states


def _in_blocks(
    t: FloatArray,
    body: Body,
    place: dict[str, Any],
    n_draw: int,
    *,
    n_leg: int,
    n_node: int | None,
    speeds: bool,
) -> tuple[FloatArray, FloatArray]:
    """`_legs` of so many draws at a time that they stay in the cache."""
    rows = max(1, _BLOCK // t.shape[-1])
    if n_draw <= rows:
        return _legs(t, body, place, n_leg=n_leg, n_node=n_node, speeds=speeds)
    blocks = [slice(first, first + rows) for first in range(0, n_draw, rows)]
    parts = [
        _legs(_of(t, some), *_part(body, place, some), n_leg=n_leg, n_node=n_node, speeds=speeds)
        for some in blocks
    ]
    return np.concatenate([x for x, _ in parts]), np.concatenate([v for _, v in parts])


def _part(
    body: Body, place: dict[str, Any], some: slice | NDArray[Any]
) -> tuple[Body, dict[str, Any]]:
    """Body and place of some draws."""
    own = replace(body, **{name: _of(value, some) for name, value in vars(body).items()})
    return own, {name: _of(value, some) for name, value in place.items()}


def _of(value: Any, some: slice | NDArray[Any]) -> Any:
    """The part of a column (n_draw, n) that belongs to some draws; what all draws have in common as
    it is.
    """
    return value[some] if np.ndim(value) == 2 and np.shape(value)[0] > 1 else value


def _legs(
    t: FloatArray,
    body: Body,
    place: dict[str, Any],
    *,
    n_leg: int,
    n_node: int | None,
    speeds: bool,
) -> tuple[FloatArray, FloatArray]:
    """`_states` of a few draws, each way from where the one before it ended."""
    phi, theta0 = np.asarray(place["phi"], dtype=float), np.asarray(place["theta0"], dtype=float)
    x = v = start = np.zeros((1, 1))
    # times and draws that are not over
    late, rows = np.ones(t.shape[-1], dtype=bool), np.zeros(0, dtype=np.int64)
    sign = 1.0
    for leg in range(n_leg):
        now = t[rows[:, None], late] if leg else t
        dx, rate, end, reach = _leg(
            now, body, **{**place, "phi": phi, "theta0": theta0}, n_node=n_node, speeds=speeds
        )
        inside = (now <= 0.0) | (now <= end)
        rest = np.where(np.isnan(end), np.nan, 0.0)
        stop = np.where(np.isinf(end), 0.0, reach + rest)
        stopped = start + sign * np.asarray(body.radius) * stop
        here = np.where(inside, start + sign * dx, stopped)
        there = np.where(inside, sign * rate, rest)
        if leg:
            at = rows[:, None], late
            x[at], v[at] = np.where(now > 0.0, here, x[at]), np.where(now > 0.0, there, v[at])
        else:
            x, v = here, there
        after = np.where((reach > 0.0) & np.isfinite(end), np.maximum(now - end, 0.0), 0.0)
        going, on = np.any(after > 0.0, axis=0), np.any(after > 0.0, axis=1)
        if not going.any():
            return x, v
        if not leg:
            rows, t = np.arange(len(x)), np.zeros(x.shape)
        t[rows[:, None], late] = after
        late = late.copy()
        late[late] = going
        rows, start = rows[on], _of(stopped, on)
        body, place = _part(body, place, on)
        theta0, phi, sign = _of(-(theta0 + stop), on), _of(-phi, on), -sign
    return np.where(t > 0.0, np.nan, x), np.where(t > 0.0, np.nan, v)


def _leg(
    t: FloatArray,
    body: Body,
    *,
    phi: ArrayLike,
    theta0: ArrayLike,
    rolling_resistance: ArrayLike,
    g: ArrayLike,
    n_node: int | None,
    speeds: bool,
    fewest: int = _FEWEST_NODES,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """One way from rest to rest: x (m) and v (m/s) at `t`, the time (s) it ends and the angle (rad)
    turned by then.

    Both ends are (n_draw, 1): inf where it never stops, 0 where it does not start, the first nan
    where the clock is not resolved.  At rest at 0 for t <= 0; x and v after the end have no
    meaning.  speeds : whether v is computed, nan where it moves else.
    fewest : Chebyshev points to begin with.  Draws that need more than others are computed by
        themselves.
    """
    radius = np.asarray(body.radius, dtype=float)
    phi, theta0, resistance, g, stop = _columns(body, phi, theta0, rolling_resistance, g)
    keywords = {"phi": phi, "theta0": theta0, "rolling_resistance": resistance, "g": g}
    turns = np.isfinite(stop)
    reach = np.where(turns, stop, _farthest(t, body, phi, resistance, g))
    clock, pace, hard = _clock(
        body, reach=reach, turns=turns, **keywords, n_node=n_node, fewest=fewest, apart=True
    )
    if np.any(hard):
        return _legs_apart(hard, t, body, **keywords, speeds=speeds, fewest=fewest)
    end = np.sum(clock, axis=0)[:, None]  # every Chebyshev polynomial is 1 at z = 1
    z = invert(t, clock, pace, end)
    angle, remainder = _substitution(z, reach, turns)
    v: FloatArray = np.full((1, 1), np.nan)
    if speeds:
        ratio = _ratio(
            angle, remainder, body, phi=phi, theta0=theta0, rolling_resistance=resistance
        )
        v = np.sqrt(np.maximum(2.0 * g * radius * ratio, 0.0))
    moving = (t > 0.0) & (reach > 0.0)
    still = np.where(reach > 0.0, 0.0, np.where(t > 0.0, np.nan, 0.0))
    return (
        np.where(moving, radius * angle, still),
        np.where(moving, v, still),
        np.where(turns, np.where(stop > 0.0, end, 0.0), np.inf),
        stop,
    )


def _legs_apart(
    hard: NDArray[np.bool_],
    t: FloatArray,
    body: Body,
    *,
    phi: FloatArray,
    theta0: FloatArray,
    rolling_resistance: FloatArray,
    g: FloatArray,
    speeds: bool,
    fewest: int,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """`_leg` of the easy draws, and of the hard ones (n_draw,) with twice the points."""
    place = {"phi": phi, "theta0": theta0, "rolling_resistance": rolling_resistance, "g": g}
    found: list[FloatArray] = []
    for rows, points in ((~hard, fewest), (hard, 2 * fewest)):
        own, where = _part(body, place, rows)
        parts = _leg(_of(t, rows), own, **where, n_node=None, speeds=speeds, fewest=points)
        found = found or [np.empty((hard.size, part.shape[1])) for part in parts]
        for whole, part in zip(found, parts, strict=True):
            whole[rows] = part
    return found[0], found[1], found[2], found[3]


def _farthest(
    t: FloatArray, body: Body, phi: FloatArray, rolling_resistance: FloatArray, g: FloatArray
) -> FloatArray:
    """An angle (rad) that the body cannot have turned by max(t): from rest at the largest
    acceleration there can be.

    theta'' = (g/R)(gamma sin theta - s)/D + ... is hard to bound tightly; v^2 = 2 g R W/D with W <=
    2 |gamma| - (theta - theta0) s and D >= 1 + j - 2 |gamma| gives theta' <= sqrt(a + b theta),
    whose solution grows like a falling body.
    """
    gamma, slope = np.abs(body.gamma), effective_slope(phi, rolling_resistance)
    smallest = np.maximum(1.0 + np.asarray(body.inertia_ratio) - 2.0 * gamma, 1e-6)
    scale = 2.0 * g / np.asarray(body.radius) / smallest
    a, b = scale * 2.0 * gamma, scale * np.maximum(-slope, 0.0)
    last = max(float(np.max(t)), 1e-9)
    return np.sqrt(a) * last + 0.25 * b * last**2 + 1e-9
