"""Least squares with the linear parameters separated (separable least squares), for
`estim.fitting.optimum`.

A parameter counts as linear where the derivatives of the curve in it do not change when it, and the
other linear ones, are moved; it must have no limits.  For given values of the others these
parameters follow by one linear solution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estim.arrays import FloatArray, IntArray, all_finite, max_abs, positive_or
from estim.common import InputError
from estim.levenberg_marquardt import LeastSquares
from estim.problem import EXACT, Posterior, Problem

_SAFETY = 20.0
RESOLVED = _SAFETY * EXACT  # `SeparableSearch.resolved` where derivatives are exact


@dataclass(frozen=True, eq=False)
class SeparableSearch:
    """The posterior's least squares over its curve parameters: limits, and which of them enter
    linearly.
    """

    posterior: Posterior
    start_values: FloatArray  # (n_par,) the user's start, and the values of the noise parameters
    low: FloatArray
    high: FloatArray
    linear: IntArray
    nonlinear: IntArray
    unstated: bool = False  # whether only the residuals show how large the errors are

    @property
    def free(self) -> IntArray:
        return np.sort(np.concatenate([self.linear, self.nonlinear]))

    @property
    def dof(self) -> int:
        """Degrees of freedom of the sum of squares; 1 at least."""
        return max(1, self.posterior.problem.n_obs - self.free.size)

    @cached_property
    def limited(self) -> bool:
        """Whether any parameter has a limit."""
        return bool(np.isfinite([self.low, self.high]).any())

    @property
    def resolved(self) -> float:
        """Ratio of singular values (columns of unit length) that the rounding errors of the
        derivatives let be distinguished from zero.
        """
        return _SAFETY * max(
            getattr(run.curve, "precision", EXACT) for run in self.posterior.problem.runs
        )

    @cached_property
    def squares(self) -> LeastSquares:
        """What batched descents go down: residuals of the data and of the priors that pull."""
        parameters = self.posterior.problem.parameters
        pulling = [i for i in self.free if parameters[i].prior.informative]
        of_prior = np.array([p.prior.sd if math.isfinite(p.prior.sd) else 0.0 for p in parameters])
        # a parameter with a prior is no smaller than this share of its standard deviation
        size = np.maximum(np.abs(self.start_values), 1e-3 * of_prior)

        def residuals(points: FloatArray, _which: IntArray) -> FloatArray:
            of_data = self.posterior.residuals_at(points)
            if not pulling:
                return of_data
            pulls = self.posterior.problem.prior_residuals(points)[:, pulling]
            return np.hstack([of_data, pulls])

        return LeastSquares(
            residuals,
            self.low,
            self.high,
            positive_or(size, 1.0),
            self.linear,
            self.nonlinear,
            max(1e-6, math.sqrt(self.resolved / _SAFETY)),
            self.posterior.problem.n_obs + len(pulling),
        )

    @cached_property
    def rounding(self) -> float:
        """A sum of squares that rounding errors of the data alone may reach."""
        posterior = self.posterior
        named = posterior.problem.named(self.start_values)
        groups = zip(posterior.problem.groups, posterior.likelihoods, strict=True)
        sizes = [likelihood.squared_size(group.y, named) for group, likelihood in groups]
        return 1e-28 * float(np.nansum(sizes))  # where counts have no expectation no scatter either

    def rounding_at(self, values: FloatArray, jacobian: FloatArray) -> float:
        """The same with those of the curve at `values` (n_par,), where it has this `jacobian`.

        A parameter is known to a unit in its last place, so the terms of a sum like a + b x + c x^2
        that all but cancel leave at least their own rounding errors, |df/da a| times the machine's
        precision.
        """
        terms = np.abs(jacobian[: self.posterior.problem.n_obs] * values).sum(axis=1)
        # relative rounding error of a term of the curve
        return self.rounding + 1e-15**2 * float(np.sum(terms**2))

    def chi2_at(self, points: FloatArray) -> FloatArray:
        """(n_point,) sums of squares of the data, and of the priors of the parameters that are
        moved, at points (n_point, n_par); inf where the curve is not finite.
        """
        return 2.0 * self.squares.objectives(points)

    @property
    def creeps(self) -> bool:
        """Whether least squares creep, so that steps by the information must finish."""
        return any(run.creeps for run in self.posterior.likelihoods)

    def chi2(self, values: FloatArray) -> float:
        """That at values (n_par,)."""
        return float(self.chi2_at(values[None, :])[0])


def separated(
    problem: Problem, start: FloatArray, rng: np.random.Generator, *, unstated: bool = False
) -> SeparableSearch:
    """The search of a problem from `start` (n_par,), its linear parameters found by trial moves
    drawn with `rng`.
    """
    posterior = problem.linearised(start)
    (low, high), free = problem.support(), problem.of_curve
    if not free:
        raise InputError("leave nothing to fit: every quantity is exact", field="parameters")
    linear = _linear(posterior, start, free, low, high, rng)
    nonlinear = np.array([i for i in free if i not in linear], dtype=np.int64)
    return SeparableSearch(
        posterior,
        start,
        low,
        high,
        np.array(linear, dtype=np.int64),
        nonlinear,
        # a robust sum does not scale with the size of the errors
        unstated or (bool(problem.noise_names) and not problem.robust),
    )


def _linear(
    posterior: Posterior,
    start: FloatArray,
    free: list[int],
    low: FloatArray,
    high: FloatArray,
    rng: np.random.Generator,
) -> list[int]:
    """Parameters without limits that the residuals are jointly linear in: their columns do not move
    when they do.
    """
    linear: list[int] = []
    if any(likelihood.creeps for likelihood in posterior.likelihoods):
        return linear
    reference, before = posterior.jacobian(start), posterior.residuals(start)
    for i in free:
        trial = [*linear, i]
        if math.isfinite(low[i]) or math.isfinite(high[i]) or not all_finite(reference[:, i]):
            continue
        moves = [
            (1.0 + np.abs(start[trial]))
            * rng.uniform(0.3, 1.5, len(trial))
            * rng.choice([-1.0, 1.0], len(trial))
            for _ in range(2)
        ]
        moved = np.tile(start, (2, 1))
        moved[:, trial] += moves
        columns = reference[:, trial]
        if np.any(reference[:, i] != 0.0) and _stays_straight(
            posterior, before, moved, trial, np.array(moves) @ columns.T, columns
        ):
            linear = trial
    return linear


def _stays_straight(
    posterior: Posterior,
    before: FloatArray,
    moved: FloatArray,
    trial: list[int],
    expected: FloatArray,
    columns: FloatArray,
) -> bool:
    """Whether the residuals at points `moved` (n, n_par) are as much above those `before` as is
    `expected` (n, n_res), and their derivatives the same `columns` (n_res, n_trial); residuals
    first, which cost a part of their derivatives.
    """
    pulls = posterior.problem.prior_residuals(moved)
    residuals = np.hstack([posterior.residuals_at(moved), pulls])
    size = np.maximum(max_abs(before), np.max(np.abs(expected), axis=1, keepdims=True))
    # of the largest residual: a first look, with room for rounding
    if not np.all(np.abs(residuals - before - expected) <= 1e-4 * size):
        return False
    room = 1e-9 * np.max(np.abs(columns), axis=0)
    jacobians = (posterior.jacobian(point)[:, trial] for point in moved)
    return all(bool(np.all(np.abs(jacobian - columns) <= room)) for jacobian in jacobians)
