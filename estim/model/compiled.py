"""What `estim.model.time_integration` finds of a body that rolls back and forth without further
forces, in machine code, draw by draw: numba, the extra `fast`.

The time of a way from rest is t = integral of dx/v, singular at the release and at a turning point.
Two substitutions remove it:

    a turning point after a turn R    angle = R sin^2(pi (z + 1)/4),  z in [-1, 1]
    no turning point in reach         angle = R ((z + 1)/2)^2         (R: beyond what is asked for)

The pace dt/dz is smooth: it is interpolated at Chebyshev points and integrated in closed form.  The
place at a time is read off a table of that clock and its first two derivatives at equidistant
knots, by polynomials of degree five.  The way back from theta_t at tilt phi is, seen in a mirror, a
release at -theta_t with tilt -phi.

All that is linear in the pace at the Chebyshev points (clock, pace and its slope at the knots, the
clock half way between some of them, the last Chebyshev coefficients) is one matrix.  Draws that
this does not settle are left to `estim.model.time_integration`: a series that has not died away, a
table that is off half way, more than 16 ways, numbers that are not finite.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from numba import config, njit
from numpy.polynomial.chebyshev import chebder, chebint, chebval
from numpy.typing import NDArray

from estim.model.body import Body

if config.DISABLE_JIT:  # NUMBA_DISABLE_JIT=1: NumPy is many times faster than this as plain Python
    raise ImportError("numba compiles nothing")

FloatArray = NDArray[Any]

# division by 0 is no error; products and sums are rounded once
_compile = njit(cache=True, error_model="numpy", fastmath={"contract"})
_inline = njit(inline="always", error_model="numpy")
_PLACE = ("phi", "theta0", "rolling_resistance", "g")
_NODES, _TAIL, _KNOTS, _WAYS = 48, 6, 65, 16
_TRIED = 4  # one interval between knots of so many is tried
_CLOSE = 1e-10  # of z: what the table may be off
_NEGLIGIBLE = 1e-11  # of the mean pace
_MOST_STEPS, _SETTLED = 80, 1e-14
_SINE, _COSINE = (
    tuple((-1.0) ** n / math.factorial(2 * n + odd) for n in reversed(range(11))) for odd in (1, 0)
)


def states(
    t: FloatArray, body: Body, place: Mapping[str, Any], n_draw: int
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Positions (m) and velocities (m/s), both (n_draw, n_obs), at times `t`, and which draws are
    settled, (n_draw,).

    t : (n_obs,) or (n_draw, n_obs) s.
    place : phi, theta0, rolling_resistance, g.  A draw that is not settled means nothing.
    """
    t, draws = np.ascontiguousarray(np.atleast_2d(t)), np.empty((n_draw, 7))
    for i, column in enumerate(
        (body.radius, body.gamma, body.inertia_ratio, *(place[name] for name in _PLACE))
    ):
        draws[:, i : i + 1] = column
    shape = n_draw, t.shape[1]
    x = np.zeros(shape)
    v = np.zeros(shape)
    settled = np.zeros(n_draw, dtype=np.bool_)
    _states(t, draws, *_scheme(), x, v, settled)
    return x, v, settled


@cache
def _scheme() -> tuple[FloatArray, FloatArray, FloatArray]:
    """Knots, (n_knot,); what is known of the Chebyshev points, (3, n): the angle turned, that still
    to turn and its rate in z, of all there is to turn; and the matrix (n, n_column).
    """
    angle = np.pi * (np.arange(_NODES) + 0.5) / _NODES
    quarter = 0.25 * np.pi * (np.cos(angle) + 1.0)
    # coefficients of the polynomial that is 1 at one of the points
    pace = 2.0 / _NODES * np.cos(np.outer(np.arange(_NODES), angle))
    pace[0] *= 0.5
    clock, knots = chebint(pace, lbnd=-1.0), np.linspace(-1.0, 1.0, _KNOTS)
    halfway = knots[:-1:_TRIED] + 0.5 * (knots[1] - knots[0])
    columns = [
        chebval(knots, clock),
        chebval(knots, pace),
        chebval(knots, chebder(pace)),
        chebval(halfway, clock),
        pace[-_TAIL:].T,
    ]
    points = np.array(
        [
            np.square(np.sin(quarter)),
            np.square(np.cos(quarter)),
            0.25 * np.pi * np.sin(2.0 * quarter),
        ]
    )
    return knots, points, np.ascontiguousarray(np.concatenate(columns, axis=1))


@_inline
def _sine(y):  # type: ignore[no-untyped-def]
    """Of y in [0, pi/2], by its series."""
    square, total = y * y, 0.0
    for c in _SINE:
        total = total * square + c
    return total * y


@_inline
def _cosine(y):  # type: ignore[no-untyped-def]
    """Of y in [0, pi/2], by its series."""
    square, total = y * y, 0.0
    for c in _COSINE:
        total = total * square + c
    return total


@_inline
def _ratio(away, zero, gamma, slope, inertia):  # type: ignore[no-untyped-def]
    """W/D at an angle `away`, of at most pi, from a zero of W: W without cancellation."""
    sign, sine, cosine, across, along = zero
    q, c = _sine(0.5 * away), _cosine(0.5 * away)
    work = sign * (2.0 * gamma * q * (sine * c + cosine * q) - away * slope)
    return work / (inertia + 2.0 * gamma * (across * (1.0 - 2.0 * q * q) - 2.0 * along * q * c))


@_inline
def _work(away, theta0, gamma, slope):  # type: ignore[no-untyped-def]
    """W however far the body has turned."""
    return 2.0 * gamma * math.sin(theta0 + 0.5 * away) * math.sin(0.5 * away) - away * slope


@_inline
def _ratio_on(away, theta0, phi, gamma, slope, inertia):  # type: ignore[no-untyped-def]
    """W/D however far the body has turned."""
    work = _work(away, theta0, gamma, slope)
    return work / (inertia + 2.0 * gamma * math.cos(theta0 + away + phi))


@_inline
def _zero(theta, sign, phi):  # type: ignore[no-untyped-def]
    """What `_ratio` asks of a zero of W, left in the direction `sign`."""
    return (
        sign,
        math.sin(theta),
        sign * math.cos(theta),
        math.cos(theta + phi),
        sign * math.sin(theta + phi),
    )


@_compile
def _turning_angle(gamma, slope, theta0):  # type: ignore[no-untyped-def]
    """`phase.turning_angle`: 0 where the body does not start, inf where it never stops."""
    if not gamma * math.sin(theta0) > slope:
        return 0.0
    if abs(slope) >= gamma:
        return math.inf
    lowest = math.asin(slope / gamma)
    start = lowest + (theta0 - lowest) % (2.0 * math.pi)
    sine, cosine = math.sin(start), math.cos(start)
    high, low = lowest + 2.0 * math.pi - start, math.pi - lowest - start
    highest, deepest = _work(low, start, gamma, slope), _work(high, start, gamma, slope)
    if deepest > 0.0:
        return math.inf
    angle = low + (high - low) / math.pi * math.acos(
        min(max(-(highest + deepest) / (highest - deepest), -1.0), 1.0)
    )
    for _ in range(_MOST_STEPS):
        q, c = math.sin(0.5 * angle), math.cos(0.5 * angle)
        work = 2.0 * gamma * q * (sine * c + cosine * q) - angle * slope
        rise = gamma * (sine * (1.0 - 2.0 * q * q) + 2.0 * cosine * q * c) - slope
        if work > 0.0:
            low = angle
        else:
            high = angle
        following = angle - work / rise if rise != 0.0 else math.nan
        if not low - _SETTLED <= following <= high + _SETTLED:
            following = 0.5 * (low + high)
        moved = abs(following - angle)
        angle = following
        if moved < _SETTLED:
            break
    return angle


@_inline
def _read(t, k, width, times, first, second):  # type: ignore[no-untyped-def]
    """z beyond the knot k: by a polynomial that takes t, dz/dt and d^2z/dt^2 from both ends."""
    step = times[k + 1] - times[k]
    s = min(max((t - times[k]) / step, 0.0), 1.0)
    rise = step * first[k]
    fall = step * first[k + 1]
    bend = 0.5 * step * step * second[k]
    bent = 0.5 * step * step * second[k + 1]
    rest, turn, twist = width - rise - bend, fall - rise - 2.0 * bend, bent - bend
    cubic, fifth = 10.0 * rest - 4.0 * turn + twist, 6.0 * rest - 3.0 * turn + twist
    return s * (rise + s * (bend + s * (cubic + s * (rest - cubic - fifth + s * fifth))))


@_compile
def _tabulate(pace, matrix, width, table, times, first, second, halfway, tail):  # type: ignore[no-untyped-def]
    """Fills `table`, of which the others are parts; whether it is right."""
    table[:] = 0.0
    for k in range(0, pace.size, 4):  # four at a time: half as many reads
        for c in range(table.size):
            table[c] += (
                pace[k] * matrix[k, c]
                + pace[k + 1] * matrix[k + 1, c]
                + pace[k + 2] * matrix[k + 2, c]
                + pace[k + 3] * matrix[k + 3, c]
            )
    times[0] = 0.0
    for k in range(times.size):
        first[k] = 1.0 / first[k]
        second[k] *= -(first[k] ** 3)
    wrong, negligible = 0, _NEGLIGIBLE * np.mean(pace)
    for coefficient in tail:
        wrong += not abs(coefficient) < negligible  # nan is wrong, too
    for k in range(halfway.size):
        wrong += (
            not abs(_read(halfway[k], k * _TRIED, width, times, first, second) - 0.5 * width)
            < _CLOSE
        )
    return wrong == 0


@_compile
def _states(t, draws, knots, points, matrix, x, v, settled):  # type: ignore[no-untyped-def]
    n_draw, n_obs = x.shape
    n_node, n_knot, width = len(matrix), knots.size, knots[1] - knots[0]
    half = n_node // 2  # the points before it are nearer to the turning point
    pace, left, table = np.empty(n_node), np.empty(n_obs), np.empty(matrix.shape[1])
    times = table[:n_knot]
    first = table[n_knot : 2 * n_knot]
    second = table[2 * n_knot : 3 * n_knot]
    halfway, tail = table[3 * n_knot : -_TAIL], table[-_TAIL:]
    for i in range(n_draw):
        radius, gamma, inertia_ratio, phi, theta0, resistance, g = draws[i]
        left[:] = t[min(i, len(t) - 1)]  # of the times: what lies behind the end of the last way
        inertia = 1.0 + inertia_ratio
        scale = 2.0 * g / radius
        start = 0.0
        sign = 1.0
        latest = np.max(left)
        for _ in range(_WAYS):
            slope = math.sin(phi) + resistance * math.cos(phi)
            stop = _turning_angle(gamma, slope, theta0)
            if stop == 0.0 or not latest > 0.0:
                for q in range(n_obs):
                    if left[q] > 0.0:
                        x[i, q] = start
                settled[i] = math.isfinite(latest + slope + gamma * theta0 + inertia + scale)
                break
            turns, reach = stop < math.inf, stop
            there = _zero(theta0, 1.0, phi)
            back = _zero(theta0 + stop if turns else theta0, -1.0, phi)
            if turns:
                for k in range(half):
                    pace[k] = (
                        reach
                        * points[2, k]
                        / math.sqrt(
                            scale * _ratio(reach * points[1, k], back, gamma, slope, inertia)
                        )
                    )
                for k in range(half, n_node):
                    pace[k] = (
                        reach
                        * points[2, k]
                        / math.sqrt(
                            scale * _ratio(reach * points[0, k], there, gamma, slope, inertia)
                        )
                    )
            else:
                growth = scale / max(inertia - 2.0 * abs(gamma), 1e-6)
                # an angle that it cannot have turned by the last time: v^2 = 2 g R W/D with W <= 2
                # |gamma| - angle s and D >= 1 + j - 2 |gamma| grows like that of a falling body
                reach = (
                    math.sqrt(2.0 * growth * abs(gamma)) * latest
                    + 0.25 * growth * max(-slope, 0.0) * latest**2
                    + 1e-9
                )
                for k in range(n_node):
                    way = math.cos(math.pi * (k + 0.5) / n_node) * 0.5 + 0.5
                    pace[k] = (
                        reach
                        * way
                        / math.sqrt(
                            scale * _ratio_on(reach * way * way, theta0, phi, gamma, slope, inertia)
                        )
                    )
            if not _tabulate(pace, matrix, width, table, times, first, second, halfway, tail):
                break
            end, latest, k = times[-1] if turns else math.inf, 0.0, 0
            for q in range(n_obs):
                now = left[q]
                left[q] = max(now - end, 0.0)
                latest = max(latest, left[q])
                if now > 0.0 and now <= end:
                    while k < n_knot - 2 and now >= times[k + 1]:
                        k += 1
                    while k > 0 and now < times[k]:
                        k -= 1
                    z = k * width + _read(now, k, width, times, first, second)  # beyond -1
                    angle = reach * (_sine(0.25 * math.pi * z) if turns else 0.5 * z) ** 2
                    x[i, q] = start + sign * radius * angle
                    if not turns:
                        ratio = _ratio_on(angle, theta0, phi, gamma, slope, inertia)
                    elif angle <= 0.5 * reach:
                        ratio = _ratio(angle, there, gamma, slope, inertia)
                    else:
                        ratio = _ratio(
                            reach * _cosine(0.25 * math.pi * z) ** 2, back, gamma, slope, inertia
                        )
                    v[i, q] = sign * radius * math.sqrt(max(scale * ratio, 0.0))
            if not latest > 0.0:
                settled[i] = True
                break
            start += sign * radius * stop
            theta0, phi, sign = -(theta0 + stop), -phi, -sign
