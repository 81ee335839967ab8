"""One descent for all that goes down: many points at once, between limits, by Levenberg-Marquardt
steps.

What they go down is a `Hill`, which says how high points lie, and which slope and curvature it has
there: J^T r and J^T J of least squares, or those of the logarithm of a density.  Each question is
asked once for all points that are on their way.  A limit that a step would cross takes its
parameter out, and the others make the best of it.

`together` runs tasks that ask for one descent after the other (a walk, whose next point depends on
the last).  `Squares` is the hill of least squares, and leads many points down it.

Source: Marquardt, J. Soc. Ind. Appl. Math. 11 (1963) 431.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray

Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING, _FACTOR = 1e-3, 1e-9, 1e5, 10.0
_PATIENCE = 4  # steps, after which descents are compared

T = TypeVar("T")


class Hill(Protocol):
    """What descents go down.

    low, high : (n_par,) limits.
    lasting : whether a curvature, which costs more than a slope, is kept on the way, where it
        learns from every slope (BFGS), until it leads no further down.
    closing : share of the way to a limit that a parameter may go in one step; below 1 it comes near
        a limit, never onto it, where a height may be level (a width of 0).

    `which` (n,) says to which of the descents a point belongs.
    """

    @property
    def low(self) -> FloatArray: ...

    @property
    def high(self) -> FloatArray: ...

    @property
    def lasting(self) -> bool: ...

    @property
    def closing(self) -> float: ...

    def reach(self, points: FloatArray) -> FloatArray:
        """The longest step of each parameter at points (n, n_par)."""

    def looked_at(self, points: FloatArray, which: Indices) -> tuple[FloatArray, FloatArray]:
        """Points (n, n_par) with what follows from the other parameters put in, and their heights
        (n,), inf where there is none.
        """

    def shape(
        self, points: FloatArray, which: Indices, curved: Flags
    ) -> tuple[FloatArray, FloatArray]:
        """Slopes (n, n_par) at points, and curvatures (n, n_par, n_par), positive, of which those
        at `curved` (n,) are wanted.
        """


@dataclass(frozen=True, eq=False)
class Start:
    """Where a descent starts.

    values : (n_par,).
    held : parameters that stay.  near : an end whose curvature is known.
    instead : (n_par,) where to start if there is no height at `values`.
    settled : promised fall at which the descent ends.
    """

    values: FloatArray
    held: tuple[int, ...] = ()
    near: End | None = None
    instead: FloatArray | None = None
    settled: float = 1e-7


@dataclass(frozen=True, eq=False)
class End:
    """Where a descent ended.

    values : (n_par,).
    objective : the height there, inf where there is none.  settled : whether it is a minimum.
    slope, curvature : (n_par,), (n_par, n_par), as they were used last.
    """

    values: FloatArray
    objective: float
    settled: bool
    slope: FloatArray
    curvature: FloatArray


Task = Generator[Start, End, T]


def together(hill: Hill, tasks: Sequence[Task[T]]) -> list[T]:
    """What the tasks return, in their order; each is sent the end of the descent from every start
    that it yields.
    """
    results: dict[int, T] = {}
    on_their_way = _Descents(hill, len(tasks))

    def go_on(k: int, end: End | None) -> None:
        try:
            on_their_way.begin(k, next(tasks[k]) if end is None else tasks[k].send(end))
        except StopIteration as stop:
            results[k] = stop.value

    for k in range(len(tasks)):
        go_on(k, None)
    while np.any(on_their_way.going):
        before = on_their_way.going.copy()
        on_their_way.advance()
        for done in np.flatnonzero(before & ~on_their_way.going).tolist():
            go_on(done, on_their_way.end(done))
    return [results[k] for k in range(len(tasks))]


def minima(hill: Hill, starts: Sequence[Start]) -> list[End]:
    """The lowest point near each of `starts`, over the parameters that are not held."""

    def one(start: Start) -> Task[End]:
        return (yield start)

    return together(hill, [one(start) for start in starts])


@dataclass(frozen=True, eq=False)
class Squares:
    """The `Hill` of least squares: half the sum of the squares of residuals.

    Linear parameters are solved for at every look (variable projection; Golub and Pereyra, SIAM J.
    Numer. Anal. 10 (1973) 413, with Kaufman's Jacobian).

    residuals : points (n, n_par), and to which descents (n,) they belong -> (n, n_res).
    low, high : (n_par,) limits.
    size : (n_par,) by which a parameter is measured that is smaller.
    linear, bent : which parameters are solved for, and which go down; others stay.
    step : of differences, of a parameter's size.
    n_res : residuals of a descent.
    """

    residuals: Callable[[FloatArray, Indices], FloatArray]
    low: FloatArray
    high: FloatArray
    size: FloatArray
    linear: Indices
    bent: Indices
    step: float
    n_res: int

    @property
    def lasting(self) -> bool:
        return False

    @property
    def closing(self) -> float:
        return 0.9

    def reach(self, points: FloatArray) -> FloatArray:
        return np.maximum(np.abs(points), self.size)

    def heights(self, points: FloatArray, which: Indices | None = None) -> FloatArray:
        """(n,) inf where the residuals are not finite."""
        which = np.arange(len(points)) if which is None else which
        with np.errstate(all="ignore"):
            half = np.concatenate(
                [
                    0.5 * np.einsum("ij,ij->i", residuals, residuals)
                    for part in self._parts(len(points), 1)
                    for residuals in (self.residuals(points[part], which[part]),)
                ]
            )
        return np.where(np.isfinite(half), half, np.inf)

    def solved(self, points: FloatArray, which: Indices | None = None) -> FloatArray:
        """Points (n, n_par) with their linear parameters at the least-squares solution."""
        which, solution = np.arange(len(points)) if which is None else which, points.copy()
        for part in self._parts(len(points), self.linear.size) if self.linear.size else ():
            base, columns = self.tangents(points[part], self.linear, 1.0, which[part])
            with np.errstate(all="ignore"):
                step = solve(columns, -base)
            solution[part, self.linear] += np.where(np.isfinite(step), step, 0.0)
        return solution

    def looked_at(
        self, points: FloatArray, which: Indices | None = None
    ) -> tuple[FloatArray, FloatArray]:
        solved = self.solved(points, which)
        return solved, self.heights(solved, which)

    def shape(
        self, points: FloatArray, which: Indices, curved: Flags
    ) -> tuple[FloatArray, FloatArray]:
        slopes, curvatures = np.zeros_like(points), np.zeros((*points.shape, points.shape[1]))
        moving = np.concatenate([self.linear, self.bent])
        for part in self._parts(len(points), moving.size):
            base, columns = self.tangents(points[part], moving, self.step, which[part])
            columns = _finite(columns)
            bent = columns[:, :, self.linear.size :]
            if self.linear.size:
                basis = np.linalg.qr(columns[:, :, : self.linear.size])[0]
                bent = bent - basis @ (np.swapaxes(basis, 1, 2) @ bent)
            turned = np.swapaxes(bent, 1, 2)
            slopes[part, self.bent] = (turned @ base[:, :, None])[..., 0]
            curvatures[part, self.bent[:, None], self.bent] = turned @ bent
        return slopes, curvatures

    def tangents(
        self, points: FloatArray, moving: Indices, step: float, which: Indices | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Residuals (n, n_res) at points (n, n_par), and their derivatives (n, n_res, n_moving) by
        differences of `step` of a parameter's size.
        """
        which = np.arange(len(points)) if which is None else which
        steps = step * np.maximum(np.abs(points[:, moving]), self.size[moving])
        steps = np.where(points[:, moving] + steps > self.high[moving], -steps, steps)
        rows = np.repeat(points[None, :, :], 1 + moving.size, axis=0)
        rows[1 + np.arange(moving.size), :, moving] += steps.T
        steps = rows[1 + np.arange(moving.size), :, moving].T - points[:, moving]
        every = self.residuals(
            rows.reshape(-1, points.shape[1]), np.tile(which, 1 + moving.size)
        ).reshape(1 + moving.size, len(points), -1)
        with np.errstate(all="ignore"):
            every[1:] -= every[0]
            every[1:] /= steps.T[:, :, None]
        return every[0], np.moveaxis(every[1:], 0, 2)

    def descend(
        self, points: FloatArray, *, share: float, most: int, hopeless: float = math.inf
    ) -> tuple[FloatArray, FloatArray, Flags]:
        """Where points (n, n_par) come to lie, each in its place, the sums of squares there, inf
        where there is none (such a point stays), and which of them are minima.

        share : of the squares, the promised fall at which a descent ends; after `most` steps in
            any case.
        hopeless : times the lowest squares, above which the higher half is given up every few
            steps.
        """
        descents = _Descents(self, len(points), share=share, most=most)
        descents.points[:], descents.held[:], descents.going[:] = points, True, True
        descents.held[:, self.bent] = False
        for n in count(1):
            if not np.any(descents.going):
                break
            descents.advance()
            if n % _PATIENCE == 0 and hopeless < math.inf and np.any(descents.going):
                middle = np.median(descents.heights[descents.going])
                bound = max(hopeless * np.min(descents.heights), middle)
                descents.going &= descents.heights <= bound
        return descents.points, 2.0 * descents.heights, descents.settled

    def _parts(self, n: int, columns: int) -> list[slice]:
        # residuals at a time: they stay in the cache
        rows = max(1, 100_000 // max(1, self.n_res * (1 + columns)))
        return [slice(k, k + rows) for k in range(0, max(1, n), rows)]


def solve(
    columns: FloatArray, target: FloatArray, damping: float | FloatArray = 1e-12
) -> FloatArray:
    """(n_point, n_col) damped least squares of target (n_point, n_res) by columns (n_point, n_res,
    n_col).
    """
    columns, target = _finite(columns), _finite(target)
    gram = np.swapaxes(columns, 1, 2) @ columns
    scale = np.sqrt(np.diagonal(gram, axis1=1, axis2=2))
    scale = np.where(scale > 0.0, scale, 1.0)
    gram = gram / (scale[:, :, None] * scale[:, None, :])
    gram += np.asarray(damping).reshape(-1, 1, 1) * np.eye(gram.shape[1])
    slope = (np.swapaxes(columns, 1, 2) @ target[:, :, None])[..., 0] / scale
    return np.asarray(np.linalg.solve(gram, slope[..., None])[..., 0] / scale)


def _finite(values: FloatArray) -> FloatArray:
    """The same with 0 where a value is not finite."""
    finite = np.isfinite(values)
    return values if np.all(finite) else np.where(finite, values, 0.0)


class _Descents:
    """Descents, a row each: points (n, n_par), heights (n,), inf before the first look, and what
    else is known of each.

    instead : where to look if there is no height at the first point, nan for nowhere.
    slopes, curvatures : at the points unless `stale`.
    known : where the slope was taken last.
    learned : whether the curvature is from elsewhere.  doubted : whether it is to be taken anew.
    least, share : the promised fall at which one ends, and as a share of its height.
    promise : of the step with next to no damping.
    """

    def __init__(self, hill: Hill, n: int, *, share: float = 0.0, most: int = 60) -> None:
        n_par = hill.low.size
        self.hill, self.share, self.most = hill, share, most
        self.points, self.slopes = np.zeros((2, n, n_par))
        self.instead, self.known = np.full((2, n, n_par), np.nan)
        self.curvatures, self.held = np.zeros((n, n_par, n_par)), np.zeros((n, n_par), dtype=bool)
        self.heights, self.promise = np.full((2, n), np.inf)
        self.damping, self.least, self.steps = (
            np.full(n, _FIRST_DAMPING),
            np.zeros(n),
            np.zeros(n, dtype=np.int64),
        )
        self.stale, self.doubted = np.ones((2, n), dtype=bool)
        self.going, self.settled, self.learned = np.zeros((3, n), dtype=bool)

    def begin(self, k: int, start: Start) -> None:
        low = self.hill.low
        high = self.hill.high
        held = np.isin(np.arange(self.hill.low.size), start.held)
        self.points[k] = np.where(held, start.values, np.clip(start.values, low, high))
        self.instead[k] = (
            np.nan
            if start.instead is None
            else np.where(held, start.instead, np.clip(start.instead, low, high))
        )
        self.heights[k] = self.promise[k] = np.inf
        self.held[k], self.least[k], self.steps[k], self.damping[k] = (
            held,
            start.settled,
            0,
            _LEAST_DAMPING,
        )
        self.stale[k], self.doubted[k], self.going[k], self.settled[k] = (
            True,
            start.near is None,
            True,
            False,
        )
        if start.near is not None:
            self.known[k], self.slopes[k], self.curvatures[k] = (
                start.near.values,
                start.near.slope,
                start.near.curvature,
            )

    def end(self, k: int) -> End:
        return End(
            self.points[k].copy(),
            float(self.heights[k]),
            bool(self.settled[k]),
            self.slopes[k].copy(),
            self.curvatures[k].copy(),
        )

    def advance(self) -> None:
        """One step of all that are going: look at the next point of each, and go there if it is
        lower.
        """
        going = np.flatnonzero(self.going)
        begun = going[np.isfinite(self.heights[going])]
        self._surveyed(begun[self.stale[begun]])
        begun = begun[self.going[begun]]
        trials = self.points.copy()
        step, _ = self._steps(begun, self.damping[begun])
        trials[begun] = np.where(
            self.held[begun],
            self.points[begun],
            np.clip(self.points[begun] + step, self.hill.low, self.hill.high),
        )
        now = np.flatnonzero(self.going)
        if not now.size:
            return
        reached, heights = self.hill.looked_at(trials[now], now)
        lost = np.flatnonzero(~np.isfinite(heights) & np.isfinite(self.heights[now]))
        if lost.size:
            # of the way to where there is no height: it may be missing at a limit alone
            reached[lost], heights[lost] = self.hill.looked_at(
                self.points[now[lost]] + 0.99 * (trials - self.points)[now[lost]], now[lost]
            )
        self._started(now, heights)
        lower = heights < self.heights[now]
        self.points[now[lower]], self.heights[now[lower]] = reached[lower], heights[lower]
        old = self.learned[now] & ~lower
        self.doubted[now[old]], self.stale[now] = True, lower | old
        raised = np.maximum(self.damping[now] * _FACTOR, _FIRST_DAMPING)
        self.damping[now] = np.where(
            lower,
            np.maximum(self.damping[now] / _FACTOR, _LEAST_DAMPING),
            np.where(old, self.damping[now], raised),
        )
        self.steps[now] += 1
        stuck = now[(self.damping[now] > _MOST_DAMPING) | (self.steps[now] >= self.most)]
        # promised fall of a minimum below which no step leads, or not soon
        self.settled[stuck], self.going[stuck] = self.promise[stuck] < 1e-4, False

    def _started(self, now: Indices, heights: FloatArray) -> None:
        """Where there was no height at a first point, look elsewhere, or end."""
        nowhere = now[~np.isfinite(self.heights[now]) & ~np.isfinite(heights)]
        elsewhere = np.all(np.isfinite(self.instead[nowhere]), axis=1)
        self.points[nowhere[elsewhere]] = self.instead[nowhere[elsewhere]]
        self.instead[nowhere] = np.nan
        self.going[nowhere[~elsewhere]] = False

    def _surveyed(self, which: Indices) -> None:
        """The slopes and curvatures at `which`, those of which end that are promised next to
        nothing.
        """
        if not which.size:
            return
        points, doubted = self.points[which], self.doubted[which]
        slopes, curvatures = self.hill.shape(points, which, doubted)
        if not np.all(doubted):
            # of a reach: two slopes closer than that teach nothing of a curvature
            learned = _learned(
                self.curvatures[which],
                points - self.known[which],
                slopes - self.slopes[which],
                2e-4 * self.hill.reach(points),
            )
            curvatures = np.where(doubted[:, None, None], curvatures, learned)
        self.curvatures[which] = curvatures
        self.slopes[which], self.known[which], self.learned[which], self.stale[which] = (
            slopes,
            points,
            ~doubted,
            False,
        )
        self.doubted[which] = not self.hill.lasting
        _, self.promise[which] = self._steps(which, np.full(which.size, _LEAST_DAMPING))
        ended = self.promise[which] <= self.least[which] + self.share * np.abs(self.heights[which])
        self.settled[which[ended]], self.going[which[ended]] = True, False

    def _steps(self, which: Indices, damping: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The next steps (n, n_par) of `which`, and by how much each promises to go down."""
        points = self.points[which]
        box = self.hill.reach(points) * np.sqrt(np.minimum(1.0, _FIRST_DAMPING / damping))[:, None]
        return steps_between(
            self.slopes[which],
            self.curvatures[which],
            damping,
            ~self.held[which],
            np.maximum(-box, self.hill.closing * (self.hill.low - points)),
            np.minimum(box, self.hill.closing * (self.hill.high - points)),
        )


def steps_between(
    slopes: FloatArray,
    curvatures: FloatArray,
    damping: FloatArray,
    free: Flags,
    low: FloatArray,
    high: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Damped steps (n, n_par) of the `free` parameters between `low` and `high`, and by how much
    each promises to go down: those that are too long are cut where they leave the box, or shortened
    as a whole.
    """
    free = free & ~(((low >= 0.0) & (slopes > 0.0)) | ((high <= 0.0) & (slopes < 0.0)))
    step = _damped(slopes, curvatures, damping, free)
    with np.errstate(all="ignore"):
        share = np.where(step == 0.0, 1.0, np.where(step > 0.0, high, low) / step)
        shorter = step * np.min(share, axis=1, initial=1.0)[:, None]
    for _ in range(3):
        beyond = free & ((step < low) | (step > high))
        if not np.any(beyond):
            break
        step, free = np.clip(step, low, high), free & ~beyond
        held = np.where(free, 0.0, step)
        more = slopes + np.einsum("kij,kj->ki", curvatures, held)
        step = np.where(free, _damped(more, curvatures, damping, free), step)
    cut = np.clip(step, low, high)
    promises = [_promise(tried, slopes, curvatures) for tried in (cut, shorter)]
    further = promises[0] >= promises[1]
    return np.where(further[:, None], cut, shorter), np.where(further, *promises)


def _promise(steps: FloatArray, slopes: FloatArray, curvatures: FloatArray) -> FloatArray:
    """(n,) by how much steps (n, n_par) go down."""
    return -np.sum(steps * slopes, axis=1) - 0.5 * np.einsum(
        "ki,kij,kj->k", steps, curvatures, steps
    )


def _learned(
    curvatures: FloatArray, steps: FloatArray, changes: FloatArray, telling: FloatArray
) -> FloatArray:
    """Curvatures (n, n_par, n_par) with what changes of the slope along steps (n, n_par) say of
    them: BFGS, damped (Powell) to stay positive.
    """
    with np.errstate(all="ignore"):
        before = np.einsum("kij,kj->ki", curvatures, steps)
        expected, observed = np.sum(steps * before, axis=1), np.sum(steps * changes, axis=1)
        share = np.where(observed < 0.2 * expected, 0.8 * expected / (expected - observed), 1.0)[
            :, None
        ]
        changes = share * changes + (1.0 - share) * before
        observed = np.sum(steps * changes, axis=1)
        updated = (
            curvatures
            + _squared(changes) / observed[:, None, None]
            - _squared(before) / expected[:, None, None]
        )
        sound = (
            np.any(np.abs(steps) > telling, axis=1)
            & (expected > 0.0)
            & np.all(np.isfinite(updated), axis=(1, 2))
        )
    return np.where(sound[:, None, None], updated, curvatures)


def _squared(vectors: FloatArray) -> FloatArray:
    return vectors[:, :, None] * vectors[:, None, :]


def _damped(
    slopes: FloatArray, curvatures: FloatArray, damping: FloatArray, free: Flags
) -> FloatArray:
    """(n, n_par) steps of the `free` parameters to the minimum of slope.s + s.curvature.s/2, damped
    in proportion to its diagonal.
    """
    scale = np.sqrt(np.maximum(np.diagonal(curvatures, axis1=1, axis2=2), 0.0))
    scale = np.where(free & (scale > 0.0) & np.isfinite(scale), scale, 1.0)
    identity = np.eye(scale.shape[1])
    unit = np.where(
        free[:, :, None] & free[:, None, :],
        curvatures / (scale[:, :, None] * scale[:, None, :]),
        identity,
    )
    with np.errstate(all="ignore"):
        step = (
            -np.linalg.solve(
                unit + damping[:, None, None] * identity,
                np.where(free, slopes / scale, 0.0)[..., None],
            )[..., 0]
            / scale
        )
    return np.where(free & np.isfinite(step), step, 0.0)
