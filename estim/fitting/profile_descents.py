"""Descents inside profiles, many at once: the lowest -2 log density over some parameters while others are held.

A task asks for one minimum after the other (a walk, whose next point depends on the last).  All tasks advance together: the heights, the
gradients and the curvatures that their descents want next are one call each.  A descent tries the Newton step, then the same at several
dampings (Levenberg-Marquardt with all its trials at once); bounds are kept by clipping and by leaving out parameters that push outward.
The metric comes from the point before and learns from every gradient (BFGS).  Where it leads no further down, or not soon, the Fisher
information takes its place, and then the measured curvature.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.fitting.profile_search import ProfileSearch

_DAMPING = np.array([1e-9, 1e-3, 3e-2, 0.3, 3.0, 30.0, 1e3, 1e5])
_SHARES = np.array([[0.99], [0.7], [0.3]])  # of a step that disappoints: beside an edge at which the density is zero
_SETTLED = 1e-7  # fall of the objective that the next step promises: an end moves by less than 1e-7 sd
_ACCEPTABLE = 1e-4  # the same where no step leads further down
_MAX_ITERATIONS = 60
_PATIENCE = 8  # iterations after which another metric is tried
_KEPT = 0.25  # of the promised fall: a step that keeps less is compared with the more damped ones
_TELLING = 1e-3  # standard deviations: two gradients closer than that teach nothing
_FLOOR = 1e-9  # least curvature, for the arithmetic

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Point:
    """Where a descent ended.

    values : (n_par,).  objective : -2 log density there, inf outside the support.  settled : whether it is a minimum.
    gradient, metric : (n_par,) and (n_par, n_par) first derivatives there and second ones as far as they are known, in standard deviations.
    """

    values: FloatArray
    objective: float
    settled: bool
    gradient: FloatArray
    metric: FloatArray


@dataclass(frozen=True, eq=False)
class Start:
    """Where a descent starts.

    values : (n_par,).  held : parameters that stay.  near : a point whose metric is taken; None for the Fisher information at the fit.
    instead : (n_par,) where to start if the density is zero at `values`.  settled : promised fall at which the descent ends.
    """

    values: FloatArray
    held: tuple[int, ...]
    near: Point | None = None
    instead: FloatArray | None = None
    settled: float = _SETTLED


Task = Generator[Start, Point, T]


def together(search: ProfileSearch, tasks: Sequence[Task[T]]) -> list[T]:
    """What the tasks return, in their order; each is sent the minimum for every start that it yields."""
    results: dict[int, T] = {}
    descents: dict[int, _Descent] = {}

    def go_on(k: int, point: Point | None) -> None:
        try:
            start = next(tasks[k]) if point is None else tasks[k].send(point)
            descents[k] = _begun(search, start)
        except StopIteration as end:
            descents.pop(k, None)
            results[k] = end.value

    for k in range(len(tasks)):
        go_on(k, None)
    while descents:
        _advance(search, list(descents.values()))
        for k, descent in list(descents.items()):
            if descent.done:
                go_on(k, descent.point)
    return [results[k] for k in range(len(tasks))]


def minima(search: ProfileSearch, starts: Sequence[Start]) -> list[Point]:
    """The lowest objective near each of `starts`, over the parameters that are not held."""

    def one(start: Start) -> Task[Point]:
        return (yield start)

    return together(search, [one(start) for start in starts])


@dataclass(eq=False)
class _Descent:
    """A descent on its way.

    trials : (n_trial, n_par) to be looked at next.  more : (n_trial, n_par) trials to look at if those disappoint.
    known : (n_par,) where `gradient` was taken; None if it was not yet.
    promise : fall of the objective that the trials promise.  doubts : how often the metric was replaced; fresh : whether that was here.
    """

    held: tuple[int, ...]
    settled: float
    trials: FloatArray
    more: FloatArray
    values: FloatArray
    objective: float
    gradient: FloatArray
    metric: FloatArray
    known: FloatArray | None
    promise: float = math.inf
    iteration: int = 0
    doubts: int = 0
    fresh: bool = False
    done: bool = False
    minimum: bool = False

    @property
    def point(self) -> Point:
        return Point(self.values, self.objective, self.minimum, self.gradient, self.metric)

    def end(self, minimum: bool) -> None:
        self.done, self.minimum = True, minimum


def _begun(search: ProfileSearch, start: Start) -> _Descent:
    held = list(start.held)
    trials = np.array([start.values] if start.instead is None else [start.values, start.instead])
    clipped = np.clip(trials, search.low, search.high)
    clipped[:, held] = trials[:, held]
    near = start.near
    metric = 2.0 * np.linalg.inv(search.cov) * np.outer(search.scale, search.scale) if near is None else near.metric
    gradient = np.zeros(search.scale.size) if near is None else near.gradient
    known = None if near is None else near.values
    return _Descent(start.held, start.settled, clipped, clipped[:0], clipped[0], math.inf, gradient, metric, known)


def _advance(search: ProfileSearch, descents: Sequence[_Descent]) -> None:
    """One step of every descent: look at its trials, then choose the next ones, or end."""
    heights = np.split(search.objectives(np.vstack([d.trials for d in descents])), np.cumsum([len(d.trials) for d in descents])[:-1])
    moved = [descent for descent, own in zip(descents, heights, strict=True) if _judged(descent, own)]
    if moved:
        for descent, gradient in zip(moved, search.gradients(np.array([d.values for d in moved])), strict=True):
            _learn(search, descent, gradient)
    going = [descent for descent in descents if not descent.done and not len(descent.trials)]
    _doubt(search, [descent for descent in going if descent not in moved or descent.iteration == (descent.doubts + 1) * _PATIENCE])
    if going:
        _choose(search, going)


def _judged(descent: _Descent, heights: FloatArray) -> bool:
    """Whether a descent goes on from a lower point; it ends where there is none, or is left without trials to have its metric measured."""
    first = not math.isfinite(descent.objective)
    lowest = int(np.flatnonzero(np.isfinite(heights))[0]) if first and np.any(np.isfinite(heights)) else int(np.argmin(heights))
    tried, height = descent.trials[lowest], float(heights[lowest])
    if first:
        descent.values, descent.objective = tried if math.isfinite(height) else descent.trials[-1], height
        descent.trials = descent.trials[:0]
        if not math.isfinite(height):
            descent.end(False)
        return math.isfinite(height)
    if len(descent.more) and not height <= descent.objective - _KEPT * descent.promise:
        descent.trials, descent.more = np.vstack([descent.more, tried]), descent.more[:0]
        return False
    descent.trials, descent.more = descent.trials[:0], descent.more[:0]
    lower, fall = height < descent.objective, descent.objective - height
    if lower:
        descent.values, descent.objective, descent.fresh = tried, height, False
        descent.iteration += 1
    if descent.promise < _ACCEPTABLE and not fall > descent.settled:
        descent.end(True)
    elif descent.iteration >= _MAX_ITERATIONS or (not lower and descent.fresh and descent.doubts > 1):
        descent.end(False)
    return lower


def _doubt(search: ProfileSearch, descents: Sequence[_Descent]) -> None:
    """Another metric for each of the descents: the Fisher information the first time, then the curvature as measured."""
    measured = [descent for descent in descents if descent.doubts]
    curvatures = search.curvatures(np.array([d.values for d in measured])) if measured else ()
    found = {id(descent): metric for descent, metric in zip(measured, curvatures, strict=True)}
    for descent in descents:
        metric = found[id(descent)] if descent.doubts else search.information(descent.values)
        if np.all(np.isfinite(metric)):
            descent.metric = metric
        descent.doubts, descent.fresh = descent.doubts + 1, True


def _learn(search: ProfileSearch, descent: _Descent, gradient: FloatArray) -> None:
    """The gradient where a descent stands, and what it says of the metric (BFGS, damped as by Powell so that it stays positive)."""
    if descent.known is not None:
        step = (descent.values - descent.known) / search.scale
        before = descent.metric @ step + _FLOOR * step
        change, expected = gradient - descent.gradient, float(step @ before)
        if np.max(np.abs(step)) > _TELLING and expected > 0.0 and np.all(np.isfinite(change)):
            told = float(step @ change)
            if told < 0.2 * expected:
                share = 0.8 * expected / (expected - told)
                change = share * change + (1.0 - share) * before
                told = 0.2 * expected
            descent.metric = descent.metric - np.outer(before, before) / expected + np.outer(change, change) / told
    descent.known, descent.gradient = descent.values, gradient


def _choose(search: ProfileSearch, descents: Sequence[_Descent]) -> None:
    """The next trials of each descent; it ends where all parameters push outward or no step promises anything."""
    values, slopes = np.array([d.values for d in descents]), np.array([d.gradient for d in descents])
    moving = ~(((values <= search.low) & (slopes > 0.0)) | ((values >= search.high) & (slopes < 0.0)))
    for row, descent in zip(moving, descents, strict=True):
        row[list(descent.held)] = False
    slopes = np.where(moving, slopes, 0.0)
    metrics = np.array([d.metric for d in descents])
    room = np.stack([search.low - values, search.high - values], axis=1) / search.scale
    room = np.where(moving[:, None, :], room, 0.0)
    moves = _damped(metrics, slopes, moving)
    blocked = moving & ((moves[:, 0] <= room[:, 0]) | (moves[:, 0] >= room[:, 1]))
    stopped = np.flatnonzero(np.any(blocked, axis=1))
    constrained = np.empty((0, *moves.shape[1:]))
    if stopped.size:
        # go to those bounds, and let the others make the best of it
        ends = np.where(blocked[stopped], np.clip(moves[stopped, 0], room[stopped, 0], room[stopped, 1]), 0.0)
        pushed = slopes[stopped] + np.einsum("kij,kj->ki", metrics[stopped], ends)
        constrained = _damped(metrics[stopped], pushed, moving[stopped] & ~blocked[stopped]) + ends[:, None, :]
    order = {int(k): place for place, k in enumerate(stopped)}
    for k, descent in enumerate(descents):
        if not np.any(moving[k]):
            descent.end(True)
            continue
        own = np.vstack([constrained[order[k]], moves[k]]) if k in order else moves[k]
        own = np.clip(own, room[k, 0], room[k, 1])
        fall = -own @ slopes[k] - 0.5 * np.einsum("ki,ij,kj->k", own, metrics[k], own)
        best = int(np.argmax(fall))
        descent.promise = float(fall[best])
        if descent.promise < descent.settled:
            descent.end(True)
            continue
        trials = np.clip(values[k] + own * search.scale, search.low, search.high)
        trials[:, ~moving[k]] = values[k, ~moving[k]]
        part_way = values[k] + _SHARES * (trials[best] - values[k])
        descent.trials, descent.more = trials[best : best + 1], np.vstack([np.delete(trials, best, axis=0), part_way])


def _damped(metrics: FloatArray, slopes: FloatArray, moving: NDArray[np.bool_]) -> FloatArray:
    """(n, n_damping, n_par) steps to the minimum of slope.z + z.metric.z/2 over the `moving`, damped more and more, in standard deviations."""
    pairs = moving[:, :, None] & moving[:, None, :]
    alone = np.where(moving, 0.0, 1.0)[:, :, None] * np.eye(moving.shape[1])
    stiffness, axes = np.linalg.eigh(np.where(pairs, 0.5 * (metrics + metrics.transpose(0, 2, 1)), alone))
    along = np.einsum("kij,ki->kj", axes, np.where(moving, slopes, 0.0))
    moves = -(along[:, None, :] / (np.maximum(stiffness, 0.0)[:, None, :] + _DAMPING[:, None])) @ axes.transpose(0, 2, 1)
    moves = np.where(moving[:, None, :], moves, 0.0)
    # no further than 5 standard deviations at once: beyond, the metric says nothing
    length = np.max(np.abs(moves), axis=2, keepdims=True, initial=0.0)
    return np.asarray(moves * np.minimum(1.0, 5.0 / np.maximum(length, 1e-300)))
