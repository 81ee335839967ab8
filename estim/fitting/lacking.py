"""The posterior mode with what a user's own curve lacks, from a fit with independent errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray
from estim.deviation import pose_deviation
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.problem import Independent, Observations, Problem, Scale


def fit_lacking(white: Fit, *, rng: np.random.Generator) -> Fit:
    """The fit `white`, and then with a deviation in every run that may have one."""
    problem = sized_by_residuals(white.problem, white.values)
    if problem is not white.problem:
        white = replace(fit_least_squares(problem, rng=rng, n_start=1, start=white.values), symmetry=white.symmetry, aliases=white.aliases)
    values, without = white.values, np.sqrt(np.diag(white.cov))
    posed = {run.name: pose_deviation(run, problem, values, without=without) for run in problem.runs if run.lacks is not None}
    runs = tuple(replace(run, noise=posed[run.name].noise) if run.lacks is not None else run for run in problem.runs)
    low, high = problem.support()
    start = np.clip(np.mean([one.found.mean for one in posed.values()], axis=0), low, high)
    fit = fit_least_squares(Problem(problem.parameters, runs), rng=rng, n_start=1, start=start)
    return replace(
        fit, deviations=tuple(one.found for one in posed.values()), symmetry=white.symmetry, aliases=white.aliases,
        n_start=white.n_start, n_same=white.n_same,
    )


def sized_by_residuals(problem: Problem, values: FloatArray) -> Problem:
    """The problem whose unstated errors are as large as the residuals at `values` (n_par,); itself where all were stated."""
    if all(run.lacks is None or run.lacks.stated for run in problem.runs):
        return problem
    return Problem(problem.parameters, tuple(_sized(run, problem, values) for run in problem.runs))


def _sized(run: Observations, problem: Problem, values: FloatArray) -> Observations:
    if run.lacks is None or run.lacks.stated:
        return run
    assert isinstance(run.noise, Independent), "a covariance matrix is stated"
    residuals = run.y - np.broadcast_to(run.points.value(problem.named(values)), (1, run.n_obs))[0]
    free = max(1, run.n_obs - len(run.curve_parameters))
    size = float(np.sqrt(np.sum(np.square(residuals / run.noise.relative)) / free))
    return replace(run, noise=replace(run.noise, sigma=Scale(size)))
