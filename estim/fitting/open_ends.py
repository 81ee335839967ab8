"""Parameters without a stated value that the data leave open on a side without a limit.

However far such a parameter goes, the others make up for it (a terminal speed with a time constant
far beyond the recording).  With a flat prior the posterior is then improper: an interval for it is
where a search or a chain happened to end.
"""

from __future__ import annotations

import math

import numpy as np

from estim.arrays import FloatArray
from estim.common import Amount, Finding, Kind
from estim.fitting.least_squares import Fit
from estim.fitting.profile import ProfileInterval, profile_intervals
from estim.problem import Parameter, Problem

_PROBABILITY = 0.95


def open_sides(fit: Fit, sds: FloatArray, *, dof: float = math.inf) -> list[Finding]:
    """The parameters without a stated value that are left open, where one of them is vague.

    A parameter is vague where one standard deviation of it alone would move the curve by the whole
    range of the data: only other parameters keep the curve at the points then, and what its
    derivatives say of that need not hold far away.  It is open where its profile has no end within
    ten standard deviations.  The intercept of a line far from the origin is not.

    sds : (n_par,) of the fit.  dof : degrees of freedom of the size of the errors.
    """
    problem = fit.problem
    free = [
        i
        for i, p in enumerate(problem.parameters)
        if not math.isfinite(p.prior.sd) and p.name not in problem.noise_names
    ]
    names = [problem.names[i] for i in free]
    # ranges of the data by which one standard deviation moves the curve, from which on it is no
    # small step of it
    if not np.any(_moved(problem, fit.values, names) * sds[free] >= 1.0):
        return []
    intervals = profile_intervals(fit, names=names, probabilities=(_PROBABILITY,), dof=dof)
    findings = []
    for i, interval in zip(free, intervals, strict=True):
        # standard deviations: an interval that reaches so far has no end worth the name
        far, prior = 10.0 * sds[i], problem.parameters[i].prior
        below = math.isinf(prior.low) and interval.value - interval.low[_PROBABILITY] > far
        above = math.isinf(prior.high) and interval.high[_PROBABILITY] - interval.value > far
        findings += _finding(problem.parameters[i], below, above)
    return findings


def side_left_open(interval: ProfileInterval, parameter: Parameter) -> list[Finding]:
    """The finding that an interval of any probability has no end on a side without a limit."""
    below = any(interval.open_low.values()) and math.isinf(parameter.prior.low)
    above = any(interval.open_high.values()) and math.isinf(parameter.prior.high)
    return _finding(parameter, below, above)


def _finding(parameter: Parameter, below: bool, above: bool) -> list[Finding]:
    if not (below or above):
        return []
    side = "both" if below and above else "below" if below else "above"
    return [
        Finding(
            Kind.OPEN_SIDE, test=side, parameters=(Amount(parameter.name, label=parameter.label),)
        )
    ]


def _moved(problem: Problem, values: FloatArray, names: list[str]) -> FloatArray:
    """(n_free,) by how many ranges of the data a unit of each parameter moves the curve, where it
    moves it most.
    """
    named, moved = problem.named(values), np.zeros(len(names))
    for run in problem.runs if names else ():
        width = float(np.ptp(run.y))
        if width > 0.0:
            with np.errstate(all="ignore"):
                steps = np.abs(run.points.gradient(named, names)) / width
            moved = np.maximum(moved, np.max(np.where(np.isfinite(steps), steps, 0.0), axis=0))
    return moved
