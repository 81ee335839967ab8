"""Parameters without a stated value that the data leave open on a side without a limit.

However far such a parameter goes, the others make up for it (a terminal speed with a time constant
far beyond the recording).  With a flat prior the posterior is then improper: an interval for it is
where a search or a chain happened to end.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray
from estim.common import Amount, Finding, InputError, Kind
from estim.distributions import chi2_quantile
from estim.fitting.optimum import find_optimum
from estim.fitting.profile import ProfileInterval
from estim.problem import Normal, Parameter, Problem

# ranges of the data by which one standard deviation moves the curve, from which on it is no small
# step of it
_VAGUE = 1.0
_FAR = 10.0  # standard deviations away, where chi^2 should have risen by 100
_HELD = 1e-3  # of a standard deviation, how closely a parameter is held there
_PROBABILITY = 0.95


def open_sides(problem: Problem, values: FloatArray, sds: FloatArray) -> list[Finding]:
    """The parameters without a stated value that are left open, where one of them is vague; values,
    sds : (n_par,) of the fit.

    A parameter is vague where one standard deviation of it alone would move the curve by the whole
    range of the data: only other parameters keep the curve at the points then, and what its
    derivatives say of that need not hold so far away.  It is open where the others, fit anew with
    it held ten standard deviations away, do not let chi^2 rise to the end of the 95 % interval.
    The intercept of a line far from the origin is not.
    """
    free = [
        i
        for i, p in enumerate(problem.parameters)
        if not math.isfinite(p.prior.sd) and p.name not in problem.noise_names
    ]
    if not np.any(_moved(problem, values, [problem.names[i] for i in free]) * sds[free] >= _VAGUE):
        return []
    best = find_optimum(problem, values, rng=np.random.default_rng(1), n_start=1)
    if best.singular:
        return []
    spreads = np.sqrt(np.diag(best.cov))
    findings = []
    for i in free:
        prior = problem.parameters[i].prior
        if not 0.0 < spreads[i] < math.inf or not math.isfinite(sds[i]):
            continue
        limit = float(chi2_quantile(_PROBABILITY, 1)) * (sds[i] / spreads[i]) ** 2
        low, high = (
            math.isinf(edge)
            and _rise(problem, best.values, best.cov, i, side * _FAR * float(sds[i])) - best.chi2
            < limit
            for edge, side in ((prior.low, -1.0), (prior.high, 1.0))
        )
        findings += _finding(problem.parameters[i], low, high)
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


def _rise(problem: Problem, values: FloatArray, cov: FloatArray, i: int, step: float) -> float:
    """chi^2 with parameter i held `step` away and all others fit anew."""
    held = Normal(float(values[i]) + step, _HELD * abs(step) / _FAR)
    parameters = tuple(
        replace(p, prior=held) if k == i else p for k, p in enumerate(problem.parameters)
    )
    low, high = problem.support()
    start = np.clip(values + step * cov[:, i] / cov[i, i], low, high)
    try:
        return find_optimum(
            replace(problem, parameters=parameters), start, rng=np.random.default_rng(1), n_start=1
        ).chi2
    except InputError:  # the curve is not finite so far away
        return math.inf
