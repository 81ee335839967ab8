"""The time z at which a clock t(z), a rising Chebyshev polynomial of each draw, shows a given time.

It is read off a table of the clock and its first two derivatives by polynomials of degree five,
which are tried half way between knots; where a draw is off by more than 1e-10 there, Newton steps
on the clock itself finish it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from estim.model.bracketed_newton import zero_between
from estim.model.chebyshev_series import evaluate

FloatArray = NDArray[Any]

# degree up to which the table of a clock has so many knots, and beyond
_FEW, _COARSE, _FINE = 64, 65, 385
TRIED = 4  # one interval of so many is tried
CLOSE = 1e-10  # of z: what a table may be off
_SETTLED = 1e-7  # of z, of a Newton step: the error left is of the order of its square


def invert(t: FloatArray, clock: FloatArray, pace: FloatArray, end: FloatArray) -> FloatArray:
    """z (n_draw, n_obs) at which the clock shows `t`, nan where that is not known or `end` (n_draw,
    1) is nan.

    t : (n_obs,) or (n_draw, n_obs).
    clock, pace : (n + 1, n_draw), (n, n_draw) coefficients of t and of dt/dz.
    """
    table = _tabulated(clock, pace, end.shape[0])
    t = np.broadcast_to(t, np.broadcast_shapes(end.shape, t.shape))
    z, low = table.at(t, _places(table.times, t))
    coarse = np.flatnonzero(~table.close())
    if coarse.size:
        z = z.copy()
        z[coarse] = _finished(
            t[coarse],
            table.inside(t, z, low, coarse),
            clock[:, coarse % clock.shape[1]],
            pace[:, coarse % clock.shape[1]],
        )
    return np.where(np.isfinite(end), z, np.nan)


def _finished(
    t: FloatArray,
    inside: tuple[FloatArray, FloatArray, FloatArray],
    clock: FloatArray,
    pace: FloatArray,
) -> FloatArray:
    """z by Newton steps from a guess inside a bracket, (n_draw, n_obs) each; nan where they do not
    settle.
    """
    z, moved = zero_between(
        lambda z: evaluate(z, clock) - t, lambda z: evaluate(z, pace), *inside, settled=_SETTLED
    )
    return np.where(moved < 10.0 * _SETTLED, z, np.nan)


@dataclass(frozen=True, eq=False)
class _Table:
    """Clocks at equidistant `knots` (n_knot,) of z.

    times, first, second : (n_draw, n_knot) t, dz/dt and d^2z/dt^2.
    halfway : (n_draw, n_half) t between some knots.
    """

    knots: FloatArray
    times: FloatArray
    first: FloatArray
    second: FloatArray
    halfway: FloatArray

    def at(self, t: FloatArray, place: NDArray[np.int64]) -> tuple[FloatArray, FloatArray]:
        """z (n_draw, n_obs) at times t, and the knot below it; each polynomial takes t, dz/dt and
        d^2z/dt^2 from both of its ends.

        place : (n_draw, n_obs) or (1, n_obs), the interval between knots that holds t.
        """
        at = place + self.knots.size * np.arange(len(self.times))[:, None]
        low = self.knots.take(place)
        width = self.knots[1] - self.knots[0]
        before = self.times.take(at)
        step = self.times.take(at + 1) - before
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            s = np.clip((t - before) / step, 0.0, 1.0)
            rise, fall = step * self.first.take(at), step * self.first.take(at + 1)
            square = step * step
            bend = 0.5 * square * self.second.take(at)
            bent = 0.5 * square * self.second.take(at + 1)
            rest, turn, twist = width - rise - bend, fall - rise - 2.0 * bend, bent - bend
            cubic, fifth = 10.0 * rest - 4.0 * turn + twist, 6.0 * rest - 3.0 * turn + twist
            z = low + s * (rise + s * (bend + s * (cubic + s * (rest - cubic - fifth + s * fifth))))
        return np.where((z >= low) & (z <= low + width), z, low + 0.5 * width), low

    def close(self) -> NDArray[np.bool_]:
        """(n_draw,) whether z read off between knots is right."""
        off = self.at(self.halfway, np.arange(0, self.knots.size - 1, TRIED)[None])[0] - _between(
            self.knots
        )
        return np.asarray(np.max(np.abs(off), axis=1) < CLOSE)

    def inside(
        self, t: FloatArray, z: FloatArray, low: FloatArray, rows: NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Ends of an interval that holds z, and z, of some draws."""
        outside = ((t <= self.times[:, :1]) | (t >= self.times[:, -1:]))[rows]
        below = low[rows]
        above = below + (self.knots[1] - self.knots[0])
        return (
            np.where(outside, -1.0, below - 1e-9),
            np.where(outside, 1.0, above + 1e-9),
            np.clip(z[rows], -1.0, 1.0),
        )


def _tabulated(clock: FloatArray, pace: FloatArray, n_draw: int) -> _Table:
    knots, polynomials, halfway = basis(clock.shape[0] - 1)
    change = derivative(pace)
    times = np.maximum.accumulate(clock.T @ polynomials, axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        first = 1.0 / (pace.T @ polynomials[: pace.shape[0]])
        second = -(change.T @ polynomials[: change.shape[0]]) * first * first * first
    shape = (n_draw, knots.size)
    times, first, second = (
        np.ascontiguousarray(np.broadcast_to(each, shape)) for each in (times, first, second)
    )
    return _Table(
        knots, times, first, second, np.broadcast_to(clock.T @ halfway, (n_draw, halfway.shape[1]))
    )


def derivative(coefficients: FloatArray) -> FloatArray:
    """Of Chebyshev series (n, n_draw), by  c'_{k-1} = c'_{k+1} + 2 k c_k."""
    n = coefficients.shape[0]
    weighted = 2.0 * np.arange(n)[:, None] * coefficients
    found = np.zeros((max(n - 1, 1), coefficients.shape[1]))
    for parity in (0, 1):
        own = weighted[1 + parity :: 2]
        found[parity::2][: len(own)] = np.cumsum(own[::-1], axis=0)[::-1]
    found[0] *= 0.5
    return found


def _places(table: FloatArray, t: FloatArray) -> NDArray[np.int64]:
    """(n_draw, n_obs) the interval of each draw's rising table (n_draw, n_knot) that holds its t:
    one search, the draws behind each other.
    """
    first, last = table[:, :1], table[:, -1:]
    if np.isnan(last).any():
        return _places(np.nan_to_num(table), t)
    lengths = last - first
    offset = (
        np.concatenate([np.zeros((1, 1)), np.cumsum(lengths + np.max(lengths) + 1.0, axis=0)[:-1]])
        - first
    )
    found = np.searchsorted(
        (table + offset).ravel(),
        (np.minimum(np.maximum(t, first), last) + offset).ravel(),
        side="right",
    ).reshape(t.shape)
    n_knot = table.shape[1]
    return np.minimum(
        np.maximum(found - (1 + n_knot * np.arange(len(table))[:, None]), 0), n_knot - 2
    )


@cache
def basis(degree: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Knots in [-1, 1], and the Chebyshev polynomials (degree + 1, n) there and between some of
    them.
    """
    knots = np.linspace(-1.0, 1.0, _COARSE if degree <= _FEW else _FINE)
    there, between = (
        np.ascontiguousarray(chebyshev.chebvander(at, degree).T) for at in (knots, _between(knots))
    )
    return knots, there, between


def _between(knots: FloatArray) -> FloatArray:
    """Where a table is tried."""
    return np.asarray(knots[:-1:TRIED] + 0.5 * (knots[1] - knots[0]))
