"""Batched minimisation between bounds by Levenberg-Marquardt steps, from many points at once.

What is minimised is an `ObjectiveFunction`, with its gradient and a positive semidefinite Hessian:
J^T r and J^T J of least squares, or those of minus the logarithm of a density.  Each is computed in
one call for all points that are still descending.  A parameter that a step would take beyond its
bound is held there, and the step of the others is computed anew.

`run_descents` runs tasks that ask for one descent after the other (a path, whose next point depends
on the last).  `LeastSquares` is a sum of squares, which `descend` minimises from many points.

Source: Marquardt, J. Soc. Ind. Appl. Math. 11 (1963) 431.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Protocol, TypeVar

import numpy as np

from estim.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    all_finite,
    finite_or,
    positive_or,
    squared_rows,
)

_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING, _FACTOR = 1e-3, 1e-9, 1e5, 10.0
# looks for parameters beyond their bounds; times the part of a step to the nearest bound
_PASSES, _FARTHEST = 4, 10.0
_BATCH = 60_000  # residuals in one call: larger arrays leave the cache, and their pages the process
_PATIENCE = 4  # steps, after which descents are compared

T = TypeVar("T")


class ObjectiveFunction(Protocol):
    """What is minimised.

    low, high : (n_par,) bounds.
    quasi_newton : whether the Hessian, which costs more than a gradient, is kept and updated by
        every gradient (BFGS) until it leads no further down.
    fraction_to_bound : part of the way to a bound that a parameter may go in one step; below 1 it
        comes near a bound, never onto it, where the objective may be flat (a width of 0).

    `which` (n,) says to which of the descents a point belongs.
    """

    @property
    def low(self) -> FloatArray: ...

    @property
    def high(self) -> FloatArray: ...

    @property
    def quasi_newton(self) -> bool: ...

    @property
    def fraction_to_bound(self) -> float: ...

    def reach(self, points: FloatArray) -> FloatArray:
        """The longest step of each parameter at points (n, n_par)."""

    def evaluate(self, points: FloatArray, which: IntArray) -> tuple[FloatArray, FloatArray]:
        """Points (n, n_par) with what follows from the other parameters put in, and their
        objectives (n,), inf where there is none.
        """

    def derivatives(
        self, points: FloatArray, which: IntArray, curved: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """Gradients (n, n_par) at points, and Hessians (n, n_par, n_par), positive, of which those
        at `curved` (n,) are wanted.
        """


@dataclass(frozen=True, eq=False)
class Start:
    """Where a descent starts.

    values : (n_par,).
    held : parameters that stay.  near : an end whose Hessian is known.
    instead : (n_par,) where to start if there is no objective at `values`.
    tolerance : predicted decrease at which the descent ends.
    """

    values: FloatArray
    held: tuple[int, ...] = ()
    near: End | None = None
    instead: FloatArray | None = None
    tolerance: float = 1e-7


@dataclass(frozen=True, eq=False)
class End:
    """Where a descent ended.

    values : (n_par,).
    objective : its value there, inf where there is none.  converged : whether it is a minimum.
    gradient, hessian : (n_par,), (n_par, n_par), as they were used last.
    """

    values: FloatArray
    objective: float
    converged: bool
    gradient: FloatArray
    hessian: FloatArray


Task = Generator[Start, End, T]


@np.errstate(all="ignore")
def run_descents(
    function: ObjectiveFunction, tasks: Sequence[Task[T]], *, max_steps: int = 60
) -> list[T]:
    """What the tasks return, in their order; each is sent the end of the descent from every start
    that it yields, which ends after `max_steps` in any case.
    """
    results: dict[int, T] = {}
    on_their_way = _Descents(function, len(tasks), max_steps=max_steps)

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


def minima(function: ObjectiveFunction, starts: Sequence[Start]) -> list[End]:
    """The lowest point near each of `starts`, over the parameters that are not held."""

    def one(start: Start) -> Task[End]:
        return (yield start)

    return run_descents(function, [one(start) for start in starts])


@np.errstate(all="ignore")
def minima_from(
    function: ObjectiveFunction,
    points: FloatArray,
    *,
    instead: FloatArray,
    tolerance: float,
    max_steps: int,
) -> tuple[FloatArray, FloatArray]:
    """The lowest points near each of `points` (n, n_par), and the Hessians (n, n_par, n_par) there,
    not numbers where there is no objective.

    instead, tolerance : of `Start`, for all of them.
    """
    descents = _Descents(function, len(points), max_steps=max_steps)
    descents.points[:], descents.instead[:], descents.least[:] = points, instead, tolerance
    descents.damping[:], descents.going[:] = _LEAST_DAMPING, True
    while np.any(descents.going):
        descents.advance()
    descents.hessians[~np.isfinite(descents.objectives)] = np.nan
    return descents.points, descents.hessians


@dataclass(frozen=True, eq=False)
class LeastSquares:
    """The `ObjectiveFunction` of least squares: half the sum of the squares of residuals.

    Linear parameters are solved for at every look (variable projection; Golub and Pereyra, SIAM J.
    Numer. Anal. 10 (1973) 413, with Kaufman's Jacobian).

    residuals : points (n, n_par), and to which descents (n,) they belong -> (n, n_res).
    low, high : (n_par,) limits.
    size : (n_par,) by which a parameter is measured that is smaller.
    linear, nonlinear : which parameters are solved for, and which descend; others stay.
    step : of differences, of a parameter's size.
    n_res : residuals of a descent.
    exact : points (n, n_par), to which descents (n,) they belong, and parameters (n_moving,) ->
        residuals (n, n_res), and their derivatives (n, n_res, n_moving) in place of differences.
    """

    residuals: Callable[[FloatArray, IntArray], FloatArray]
    low: FloatArray
    high: FloatArray
    size: FloatArray
    linear: IntArray
    nonlinear: IntArray
    step: float
    n_res: int
    exact: Callable[[FloatArray, IntArray, IntArray], tuple[FloatArray, FloatArray]] | None = None

    quasi_newton, fraction_to_bound = False, 0.9

    def reach(self, points: FloatArray) -> FloatArray:
        return np.maximum(np.abs(points), self.size)

    def objectives(self, points: FloatArray) -> FloatArray:
        """(n,) at points as they are, inf where the residuals are not finite."""
        with np.errstate(all="ignore"):
            return self.solved_for(self.linear[:0], points, np.arange(len(points)))[1]

    def evaluate(self, points: FloatArray, which: IntArray) -> tuple[FloatArray, FloatArray]:
        return self.solved_for(self.linear, points, which)

    def solved_for(
        self, moving: IntArray, points: FloatArray, which: IntArray, step: float = 1.0
    ) -> tuple[FloatArray, FloatArray]:
        """Points (n, n_par) with the parameters `moving` put where the residuals are least, to
        first order by differences of `step` of a parameter's size, and the objectives there (n,),
        inf where there is none.
        """
        solved, squares = points.copy(), np.empty(len(points))
        for part in self.parts(len(points), moving.size):
            residuals, columns = self.tangents(points[part], moving, step, which[part])
            if moving.size:
                by = finite_or(solve(columns, -residuals[:, :, None]), 0.0)
                solved[part, moving] += by[..., 0]
                residuals = residuals + (columns @ by)[..., 0]
            squares[part] = np.einsum("ij,ij->i", residuals, residuals)
        return solved, finite_or(0.5 * squares, np.inf)

    def derivatives(
        self, points: FloatArray, which: IntArray, curved: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        gradients, hessians = np.zeros_like(points), np.zeros((*points.shape, points.shape[1]))
        moving = np.concatenate([self.linear, self.nonlinear])
        for part in self.parts(len(points), moving.size):
            base, columns = self.tangents(points[part], moving, self.step, which[part])
            columns = finite_or(columns, 0.0)
            nonlinear = columns[:, :, self.linear.size :]
            if self.linear.size:
                basis = np.linalg.qr(columns[:, :, : self.linear.size])[0]
                nonlinear = nonlinear - basis @ (np.swapaxes(basis, 1, 2) @ nonlinear)
            turned = np.swapaxes(nonlinear, 1, 2)
            gradients[part, self.nonlinear] = (turned @ base[:, :, None])[..., 0]
            hessians[part, self.nonlinear[:, None], self.nonlinear] = turned @ nonlinear
        return gradients, hessians

    def tangents(
        self, points: FloatArray, moving: IntArray, step: float, which: IntArray | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Residuals (n, n_res) at points (n, n_par), and their derivatives (n, n_res, n_moving) by
        differences of `step` of a parameter's size, unless exact ones are known.
        """
        which = np.arange(len(points)) if which is None else which
        if self.exact is not None and moving.size:
            return self.exact(points, which, moving)
        at, n_row = points[:, moving], 1 + moving.size
        steps = step * np.maximum(np.abs(at), self.size[moving])
        beside = at + np.where(at + steps > self.high[moving], -steps, steps)
        rows = np.repeat(points, n_row, axis=0)
        rows.reshape(len(points), n_row, points.shape[1])[:, np.arange(1, n_row), moving] = beside
        every = self.residuals(rows, np.repeat(which, n_row))
        every = every.reshape(len(points), n_row, self.n_res)
        columns = every[:, 1:]
        columns -= every[:, :1]
        columns /= (beside - at)[:, :, None]
        return every[:, 0], np.swapaxes(columns, 1, 2)

    @np.errstate(all="ignore")
    def descend(
        self, points: FloatArray, *, ftol: float, max_steps: int, hopeless: float = math.inf
    ) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Where points (n, n_par) come to lie, each in its place, the sums of squares there, inf
        where there is none (such a point stays), and which of them are minima.

        ftol : predicted decrease, as a part of the squares, at which a descent ends; after
            `max_steps` in any case.
        hopeless : times the lowest squares, above which the higher half is given up every few
            steps.
        """
        if not self.nonlinear.size:
            solved, halves = self.evaluate(points, np.arange(len(points)))
            found = np.isfinite(halves)
            return np.where(found[:, None], solved, points), 2.0 * halves, found
        descents = _Descents(self, len(points), ftol=ftol, max_steps=max_steps)
        descents.points[:], descents.held[:], descents.going[:] = points, True, True
        descents.held[:, self.nonlinear] = False
        for n in count(1):
            if not np.any(descents.going):
                break
            descents.advance()
            if n % _PATIENCE == 0 and hopeless < math.inf and np.any(descents.going):
                middle = np.median(descents.objectives[descents.going])
                bound = max(hopeless * np.min(descents.objectives), middle)
                descents.going &= descents.objectives <= bound
        return descents.points, 2.0 * descents.objectives, descents.converged

    def parts(self, n: int, columns: int) -> list[slice]:
        """Points that are looked at in one call, each with its derivatives in some `columns`."""
        rows = max(1, _BATCH // max(1, self.n_res * (1 + columns)))
        return [slice(k, k + rows) for k in range(0, max(1, n), rows)]


def solve(columns: FloatArray, targets: FloatArray, damping: float = 1e-12) -> FloatArray:
    """(n_point, n_col, n_target) damped least squares of targets (n_point, n_res, n_target) by
    columns (n_point, n_res, n_col).
    """
    columns, targets = finite_or(columns, 0.0), finite_or(targets, 0.0)
    rows = np.swapaxes(columns, 1, 2)
    gram = rows @ columns
    scale = np.sqrt(np.diagonal(gram, axis1=1, axis2=2))
    scale = positive_or(scale, 1.0)
    gram = gram / squared_rows(scale) + damping * np.eye(gram.shape[1])
    return np.linalg.solve(gram, rows @ targets / scale[..., None]) / scale[..., None]


class _Descents:
    """Descents, a row each: points (n, n_par), objectives (n,), inf before the first look, and what
    else is known of each.

    instead : where to look if there is no objective at the first point, nan for nowhere.
    gradients, hessians : at the points unless `stale`.
    known : where the gradient was taken last.
    learned : whether the Hessian is from elsewhere.  outdated : whether it is to be taken anew.
    least, ftol : the predicted decrease at which one ends, and as a part of its objective.
    predicted : decrease of the step with next to no damping.
    """

    def __init__(
        self, function: ObjectiveFunction, n: int, *, ftol: float = 0.0, max_steps: int
    ) -> None:
        n_par = function.low.size
        self.function, self.ftol, self.max_steps = function, ftol, max_steps
        self.points, self.gradients = np.zeros((2, n, n_par))
        self.instead, self.known = np.full((2, n, n_par), np.nan)
        self.hessians, self.held = np.zeros((n, n_par, n_par)), np.zeros((n, n_par), dtype=bool)
        self.objectives, self.predicted = np.full((2, n), np.inf)
        self.damping, self.least, self.steps = (
            np.full(n, _FIRST_DAMPING),
            np.zeros(n),
            np.zeros(n, dtype=np.int64),
        )
        self.stale, self.outdated = np.ones((2, n), dtype=bool)
        self.going, self.converged, self.learned = np.zeros((3, n), dtype=bool)

    def begin(self, k: int, start: Start) -> None:
        low = self.function.low
        high = self.function.high
        held = np.isin(np.arange(self.function.low.size), start.held)
        self.points[k] = np.where(held, start.values, np.clip(start.values, low, high))
        self.instead[k] = (
            np.nan
            if start.instead is None
            else np.where(held, start.instead, np.clip(start.instead, low, high))
        )
        self.objectives[k] = self.predicted[k] = np.inf
        self.held[k], self.least[k], self.steps[k], self.damping[k] = (
            held,
            start.tolerance,
            0,
            _LEAST_DAMPING,
        )
        self.stale[k], self.outdated[k], self.going[k], self.converged[k] = (
            True,
            start.near is None,
            True,
            False,
        )
        if start.near is not None:
            self.known[k], self.gradients[k], self.hessians[k] = (
                start.near.values,
                start.near.gradient,
                start.near.hessian,
            )

    def end(self, k: int) -> End:
        return End(
            self.points[k].copy(),
            float(self.objectives[k]),
            bool(self.converged[k]),
            self.gradients[k].copy(),
            self.hessians[k].copy(),
        )

    def advance(self) -> None:
        """One step of all that are going: look at the next point of each, and go there if it is
        lower.
        """
        going = np.flatnonzero(self.going)
        defined = going[np.isfinite(self.objectives[going])]
        trials = self.points.copy()
        if defined.size:
            trials[defined] = self._next(defined, defined[self.stale[defined]])
        now = np.flatnonzero(self.going)
        if not now.size:
            return
        reached, objectives = self.function.evaluate(trials[now], now)
        if not all_finite(objectives):
            lost = np.flatnonzero(~np.isfinite(objectives) & np.isfinite(self.objectives[now]))
            if lost.size:
                # of the way to where there is no objective: it may be missing at a limit alone
                nearer = self.points + 0.99 * (trials - self.points)
                reached[lost], objectives[lost] = self.function.evaluate(
                    nearer[now[lost]], now[lost]
                )
            self._started(now, objectives)
        lower = objectives < self.objectives[now]
        self.points[now[lower]], self.objectives[now[lower]] = reached[lower], objectives[lower]
        old = self.learned[now] & ~lower
        self.outdated[now[old]], self.stale[now] = True, lower | old
        raised = np.maximum(self.damping[now] * _FACTOR, _FIRST_DAMPING)
        self.damping[now] = np.where(
            lower,
            np.maximum(self.damping[now] / _FACTOR, _LEAST_DAMPING),
            np.where(old, self.damping[now], raised),
        )
        self.steps[now] += 1
        stuck = now[(self.damping[now] > _MOST_DAMPING) | (self.steps[now] >= self.max_steps)]
        # predicted decrease below which a point that no step improves counts as a minimum
        self.converged[stuck], self.going[stuck] = self.predicted[stuck] < 1e-4, False

    def _started(self, now: IntArray, objectives: FloatArray) -> None:
        """Where there was no objective at a first point, look elsewhere, or end."""
        nowhere = now[~np.isfinite(self.objectives[now]) & ~np.isfinite(objectives)]
        elsewhere = np.all(np.isfinite(self.instead[nowhere]), axis=1)
        self.points[nowhere[elsewhere]] = self.instead[nowhere[elsewhere]]
        self.instead[nowhere] = np.nan
        self.going[nowhere[~elsewhere]] = False

    def _next(self, moving: IntArray, stale: IntArray) -> FloatArray:
        """(n, n_par) where `moving` look next, their gradients and Hessians taken anew at `stale`;
        of these, descents whose predicted decrease is small enough end here.
        """
        if stale.size:
            self._survey(stale)
        both = np.append(moving, stale)
        least = np.full(stale.size, _LEAST_DAMPING)
        damping, points = np.append(self.damping[moving], least), self.points[both]
        box = (
            self.function.reach(points)
            * np.sqrt(np.minimum(1.0, _FIRST_DAMPING / damping))[:, None]
        )
        low, high = self.function.low, self.function.high
        steps, predicted = bounded_steps(
            self.gradients[both],
            self.hessians[both],
            damping,
            ~self.held[both],
            np.maximum(-box, self.function.fraction_to_bound * (low - points)),
            np.minimum(box, self.function.fraction_to_bound * (high - points)),
        )
        self.predicted[stale] = predicted[moving.size :]
        ended = self.predicted[stale] <= self.least[stale] + self.ftol * np.abs(
            self.objectives[stale]
        )
        self.converged[stale[ended]], self.going[stale[ended]] = True, False
        at = points[: moving.size]
        return np.where(self.held[moving], at, np.clip(at + steps[: moving.size], low, high))

    def _survey(self, which: IntArray) -> None:
        """Gradients and Hessians at `which`."""
        points, outdated = self.points[which], self.outdated[which]
        gradients, hessians = self.function.derivatives(points, which, outdated)
        if not np.all(outdated):
            # of a reach: gradients at points closer than that do not tell the Hessian
            learned = _learned(
                self.hessians[which],
                points - self.known[which],
                gradients - self.gradients[which],
                2e-4 * self.function.reach(points),
            )
            hessians = np.where(outdated[:, None, None], hessians, learned)
        self.hessians[which] = hessians
        self.gradients[which], self.known[which], self.learned[which], self.stale[which] = (
            gradients,
            points,
            ~outdated,
            False,
        )
        self.outdated[which] = not self.function.quasi_newton


def bounded_steps(
    gradients: FloatArray,
    hessians: FloatArray,
    damping: FloatArray,
    free: BoolArray,
    low: FloatArray,
    high: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Damped steps (n, n_par) of the `free` parameters between `low` and `high`, and the
    decrease that is predicted for each: those that are too long are cut where they leave the box,
    or shortened as a whole.
    """
    free = free & ~(((low >= 0.0) & (gradients > 0.0)) | ((high <= 0.0) & (gradients < 0.0)))
    step = _damped(gradients, hessians, damping, free)
    beyond = free & ((step < low) | (step > high))
    if not beyond.any():
        return step, _predicted(step, gradients, hessians)
    shorter = step * np.min(_inside(step, low, high), axis=1, initial=1.0)[:, None]
    for _ in range(_PASSES):
        # the farthest first: where little is known of one, it takes others far along
        share = np.where(beyond, _inside(step, low, high), np.inf)
        farthest = beyond & (share <= _FARTHEST * np.min(share, axis=1, keepdims=True))
        step, free = np.clip(step, low, high), free & ~farthest
        held = np.where(free, 0.0, step)
        more = gradients + np.einsum("kij,kj->ki", hessians, held)
        step = np.where(free, _damped(more, hessians, damping, free), step)
        beyond = free & ((step < low) | (step > high))
        if not beyond.any():
            break
    cut = np.clip(step, low, high)
    predictions = [_predicted(tried, gradients, hessians) for tried in (cut, shorter)]
    further = predictions[0] >= predictions[1]
    return np.where(further[:, None], cut, shorter), np.where(further, *predictions)


def _inside(step: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Parts of steps that stay between bounds, 1 or more where all does."""
    return np.where(step == 0.0, 1.0, np.where(step > 0.0, high, low) / step)


def _predicted(steps: FloatArray, gradients: FloatArray, hessians: FloatArray) -> FloatArray:
    """(n,) decrease that is predicted for steps (n, n_par)."""
    return -np.sum(steps * gradients, axis=1) - 0.5 * np.einsum(
        "ki,kij,kj->k", steps, hessians, steps
    )


def _learned(
    hessians: FloatArray, steps: FloatArray, changes: FloatArray, telling: FloatArray
) -> FloatArray:
    """Hessians (n, n_par, n_par) updated by the changes of the gradient along steps (n, n_par):
    BFGS, damped (Powell) to stay positive definite.
    """
    before = np.einsum("kij,kj->ki", hessians, steps)
    expected, observed = np.sum(steps * before, axis=1), np.sum(steps * changes, axis=1)
    share = np.where(observed < 0.2 * expected, 0.8 * expected / (expected - observed), 1.0)
    changes = share[:, None] * changes + (1.0 - share[:, None]) * before
    observed = np.sum(steps * changes, axis=1)
    updated = (
        hessians
        + squared_rows(changes) / observed[:, None, None]
        - squared_rows(before) / expected[:, None, None]
    )
    sound = (
        np.any(np.abs(steps) > telling, axis=1)
        & (expected > 0.0)
        & np.all(np.isfinite(updated), axis=(1, 2))
    )
    return np.where(sound[:, None, None], updated, hessians)


def _damped(
    gradients: FloatArray, hessians: FloatArray, damping: FloatArray, free: BoolArray
) -> FloatArray:
    """(n, n_par) steps of the `free` parameters to the minimum of gradient.s + s.Hessian.s/2,
    damped in proportion to its diagonal.
    """
    scale = np.sqrt(np.maximum(np.diagonal(hessians, axis1=1, axis2=2), 0.0))
    scale = np.where(free & (scale > 0.0) & np.isfinite(scale), scale, 1.0)
    identity = np.eye(scale.shape[1])
    unit = np.where(free[:, :, None] & free[:, None, :], hessians / squared_rows(scale), identity)
    system = unit + damping[:, None, None] * identity
    target = np.where(free, gradients / scale, 0.0)
    step = -np.linalg.solve(system, target[..., None])[..., 0] / scale
    return np.where(free & np.isfinite(step), step, 0.0)
