"""The posterior mode with what a user's own curve lacks, from a fit with independent errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray, sds_of
from estim.common import Amount, Finding, Kind
from estim.discrepancy import FoundDeviation, pose_deviation
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.fitting.prior_limits import edge_of
from estim.problem import Problem


def fit_discrepancy(white: Fit) -> Fit:
    """The fit `white`, and then with a deviation in every run that may have one."""
    problem = white.problem
    posed = {
        run.name: pose_deviation(run, problem, white.values)
        for run in problem.runs
        if run.lacks is not None
    }
    means = [deviation.found.mean for deviation in posed.values()]
    start = np.clip(np.mean(means, axis=0), *problem.support())
    noises = {name: deviation.noise for name, deviation in posed.items()}
    fit = fit_least_squares(problem.with_noises(noises), start=start)
    return replace(
        fit,
        deviations=tuple(deviation.found for deviation in posed.values()),
        symmetry=white.symmetry,
        aliases=white.aliases,
    )


def sds_near_limits(
    deviation: FoundDeviation, problem: Problem
) -> tuple[FloatArray, tuple[Finding, ...]]:
    """Standard deviations (n_par,) of the linearised posterior, nan for a parameter less than one
    from a limit, and why.
    """
    sds = sds_of(deviation.cov)
    near = problem.room(deviation.mean) < sds
    edges = [
        Amount(p.name, edge_of(p.prior, float(mean)))
        for p, mean, is_near in zip(problem.parameters, deviation.mean, near, strict=True)
        if is_near
    ]
    notes = tuple(Finding(Kind.NEAR_LIMIT, parameters=(edge,)) for edge in edges)
    return np.where(near, np.nan, sds), notes
