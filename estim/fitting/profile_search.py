"""The search inside a profile: the lowest -2 log density over some parameters while others are held.

Only the log density decides; it is differentiated by central differences of one vectorised call, so any likelihood will do.
The Fisher information gives the metric.  Each iteration tries the Newton step at several dampings in one more call and takes the best
(Levenberg-Marquardt with all its trials at once); bounds are kept by clipping and by leaving out parameters that push outward.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.fitting.fisher_information import data_information, information, prior_sds
from estim.fitting.least_squares import Fit
from estim.problem import Posterior

_STEP = 1e-3  # of a standard deviation, for differences: their error moves an optimum by 1e-6 sd
_DAMPING = np.array([1e-9, 1e-3, 3e-2, 0.3, 3.0, 30.0, 1e3, 1e5])
_SETTLED = 1e-9  # fall of the objective that the next step promises
_ACCEPTABLE = 1e-4  # the same where no step leads further down
_MAX_ITERATIONS = 60
_PATIENCE = 8  # iterations after which the curvature is measured instead of taken from the Fisher information


@dataclass(frozen=True, eq=False)
class Point:
    """values : (n_par,).  objective : -2 log density there, inf outside the support.  settled : whether it is a minimum."""

    values: FloatArray
    objective: float
    settled: bool


@dataclass(frozen=True, eq=False)
class ProfileSearch:
    """A posterior with the bounds and scales of its parameters.

    low, high : (n_par,) bounds.  scale : (n_par,) standard deviations at the fit, uniform priors counted with theirs.
    prior_sd : (n_par,).  cov : (n_par, n_par) that belongs to `scale`.
    """

    posterior: Posterior
    low: FloatArray
    high: FloatArray
    scale: FloatArray
    prior_sd: FloatArray
    cov: FloatArray

    def objectives(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) -2 log density, inf where it is not a number."""
        with np.errstate(all="ignore"):
            minus = -2.0 * self.posterior.log_density(draws)
        return np.where(np.isnan(minus), np.inf, minus)

    def objective(self, values: FloatArray) -> float:
        return float(self.objectives(values[None, :])[0])

    def tangent(self, values: FloatArray, i: int) -> FloatArray:
        """(n_par,) how the best values of all parameters move with parameter i, to first order at the fit."""
        slope = self.cov[:, i] / self.cov[i, i]
        at_bound = ((values <= self.low) | (values >= self.high)) & (np.arange(values.size) != i)
        return np.where(at_bound, 0.0, slope)

    def minimise(self, start: FloatArray, *, held: Sequence[int], settled: float = _SETTLED) -> Point:
        """The lowest objective near `start` (n_par,) over the parameters not in `held`, until a step promises less than `settled`."""
        values = np.clip(start, self.low, self.high)
        values[list(held)] = start[list(held)]
        free = np.array([k for k in range(values.size) if k not in held], dtype=int)
        best = self.objective(values)
        if not math.isfinite(best) or not free.size:
            return Point(values, best, settled=math.isfinite(best))
        for iteration in range(_MAX_ITERATIONS):
            gradient = self._gradient(values, best, free)
            outward = ((values[free] <= self.low[free]) & (gradient > 0.0)) | ((values[free] >= self.high[free]) & (gradient < 0.0))
            moving = free[~outward]
            if not moving.size:
                return Point(values, best, settled=True)
            steps, promise = self._steps(values, moving, gradient[~outward], curved=iteration >= _PATIENCE)
            if promise < settled:
                return Point(values, best, settled=True)
            trials = np.repeat(values[None, :], len(steps), axis=0)
            trials[:, moving] = np.clip(trials[:, moving] + steps, self.low[moving], self.high[moving])
            heights = self.objectives(trials)
            lowest = int(np.argmin(heights))
            if not heights[lowest] < best:
                return Point(values, best, settled=promise < _ACCEPTABLE)
            values, best = trials[lowest], float(heights[lowest])
        return Point(values, best, settled=False)

    def _gradient(self, values: FloatArray, here: float, free: FloatArray) -> FloatArray:
        """(n_free,) derivatives of the objective; one-sided at a bound and beside a hole in the density."""
        n = free.size
        draws = np.repeat(values[None, :], 2 * n, axis=0)
        draws[np.arange(n), free] = np.minimum(values[free] + _STEP * self.scale[free], self.high[free])
        draws[n + np.arange(n), free] = np.maximum(values[free] - _STEP * self.scale[free], self.low[free])
        heights = self.objectives(draws)
        above, below = heights[:n], heights[n:]
        up, down = draws[np.arange(n), free], draws[n + np.arange(n), free]
        up, above = np.where(np.isfinite(above), up, values[free]), np.where(np.isfinite(above), above, here)
        down, below = np.where(np.isfinite(below), down, values[free]), np.where(np.isfinite(below), below, here)
        return np.divide(above - below, up - down, out=np.zeros(n), where=up > down)

    def _steps(self, values: FloatArray, moving: FloatArray, gradient: FloatArray, *, curved: bool) -> tuple[FloatArray, float]:
        """(n_step, n_moving) steps to try, and the largest fall of the objective that one of them promises."""
        scale = self.scale[moving]
        if curved:
            metric = self._curvature(values, moving)
        else:
            with np.errstate(all="ignore"):
                metric = 2.0 * information(self.posterior, values)[np.ix_(moving, moving)] * np.outer(scale, scale)
        if not np.all(np.isfinite(metric)):
            metric = 2.0 * np.eye(moving.size)
        slope = gradient * scale
        room = np.array([self.low[moving] - values[moving], self.high[moving] - values[moving]]) / scale
        moves = _damped(metric, slope)
        blocked = (moves[0] <= room[0]) | (moves[0] >= room[1])
        if np.any(blocked):
            # go to those bounds, and let the others make the best of it
            ends = np.where(blocked, np.clip(moves[0], *room), 0.0)
            rest = np.flatnonzero(~blocked)
            constrained = np.repeat(ends[None, :], _DAMPING.size, axis=0)
            constrained[:, rest] = _damped(metric[np.ix_(rest, rest)], (slope + metric @ ends)[rest])
            moves = np.vstack([constrained, moves])
        moves = np.clip(moves, *room)
        fall = -moves @ slope - 0.5 * np.einsum("ki,ij,kj->k", moves, metric, moves)
        return moves * scale, float(np.max(fall))


    def _curvature(self, values: FloatArray, moving: FloatArray) -> FloatArray:
        """(n_moving, n_moving) second derivatives of the objective, in standard deviations, made positive."""
        n, h = moving.size, 0.02
        inward = np.where(values + 2.0 * h * self.scale < self.high, 1.0, -1.0)[moving]
        rows, columns = np.triu_indices(n)
        draws = np.repeat(values[None, :], 1 + n + rows.size, axis=0)
        draws[1 + np.arange(n), moving] += h * (inward * self.scale[moving])
        for axis in (rows, columns):
            draws[1 + n + np.arange(rows.size), moving[axis]] += h * (inward * self.scale[moving])[axis]
        heights = self.objectives(draws)
        with np.errstate(invalid="ignore"):
            mixed = (heights[1 + n :] - heights[1 + rows] - heights[1 + columns] + heights[0]) * (inward[rows] * inward[columns]) / h**2
        metric = np.zeros((n, n))
        metric[rows, columns] = metric[columns, rows] = mixed
        if not np.all(np.isfinite(metric)):
            return metric
        stiffness, axes = np.linalg.eigh(metric)
        return np.asarray((axes * np.abs(stiffness)) @ axes.T)


def _damped(metric: FloatArray, slope: FloatArray) -> FloatArray:
    """(n_damping, n) steps to the minimum of slope.z + z.metric.z/2, damped more and more, in standard deviations."""
    stiffness, axes = np.linalg.eigh(0.5 * (metric + metric.T))
    moves = -((axes.T @ slope) / (np.maximum(stiffness, 0.0) + _DAMPING[:, None])) @ axes.T
    # no further than 5 standard deviations at once: beyond, the metric says nothing
    length = np.max(np.abs(moves), axis=1, keepdims=True, initial=0.0)
    return np.asarray(moves * np.minimum(1.0, 5.0 / np.maximum(length, 1e-300)))


def search_of(fit: Fit) -> ProfileSearch:
    """The search around a fit, with the scales of the Gaussian there."""
    sds = prior_sds(fit.problem, fit.cov)
    with np.errstate(all="ignore"):
        whitened = data_information(fit.posterior, fit.values) * np.outer(sds, sds)
    if not np.all(np.isfinite(whitened)):
        whitened = np.zeros_like(whitened)
    cov = np.linalg.inv(0.5 * (whitened + whitened.T) + np.eye(sds.size)) * np.outer(sds, sds)
    low = np.array([p.prior.low for p in fit.problem.parameters])
    high = np.array([p.prior.high for p in fit.problem.parameters])
    return ProfileSearch(fit.posterior, low, high, np.sqrt(np.diag(cov)), sds, cov)
