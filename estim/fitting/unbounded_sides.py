"""Parameters without a stated value that the data leave open on a side without a limit.

However far such a parameter goes, the others make up for it (a terminal speed with a time constant
far beyond the recording).  The posterior may then be improper: an interval for it is where a search
or a chain happened to end.
"""

from __future__ import annotations

import math

import numpy as np

from estim.arrays import BoolArray, FloatArray, finite_or, positive_or
from estim.common import Amount, Finding, Kind
from estim.distributions import chi2_tail
from estim.fitting.least_squares import NEVER_MET, Fit
from estim.fitting.profile import ProfileInterval, profile_intervals
from estim.problem import Parameter, Problem

_PROBABILITY = 0.95
_VAGUE = 0.5  # ranges of the data
_STRAIGHT = 0.05  # standard deviations of the residuals, by which a step of one bends them
_FAR, _LONGER = 10.0, 1.5  # standard deviations; times the other side, in logarithms


def open_sides(fit: Fit, sds: FloatArray) -> list[Finding]:
    """The parameters without a stated value that are left open, where one of them is vague; of
    counts, whose prior is flat, also those that reach over decades: it would favour large values;
    and those that it lets go to infinity, which a chain does sooner or later.

    sds : (n_par,) of the fit.
    """
    if endless := _endless(fit):
        return endless
    if not np.any(vague(fit, sds)):
        return []
    free = np.flatnonzero(fit.problem.unstated)
    names = [fit.problem.names[i] for i in free]
    intervals = profile_intervals(fit, names=names, probabilities=(_PROBABILITY,))
    findings = []
    for i, interval in zip(free, intervals, strict=True):
        parameter, far = fit.problem.parameters[i], _FAR * float(sds[i])
        open_side = open_side_finding(interval, parameter, float(sds[i]))
        ends = interval.low[_PROBABILITY], interval.high[_PROBABILITY]
        flat = fit.jeffreys is None and not (fit.flat is not None and fit.flat.by_size[i])
        # the measure of runs is known about the fit alone
        strained = fit.measure is not None and interval.by_size
        over = flat and (strained or max(abs(end - interval.value) for end in ends) > far)
        findings += open_side or ([_open("decades", parameter)] if over else [])
    return findings


def _endless(fit: Fit) -> list[Finding]:
    """The parameters of counts at whose far ends the likelihood, and with it their flat prior's
    posterior, stays above e^-15 of the highest: it has no integral, and chains find out by chance.
    """
    problem = fit.problem
    if fit.singular or not problem.counted:
        return []
    own = problem.incidental if fit.measure is not None else ()
    flat = [
        p
        for p, free in zip(problem.parameters, problem.unstated, strict=True)
        if free and p.name not in own
    ]
    level = 1.0 - float(chi2_tail(NEVER_MET, 1))
    intervals = profile_intervals(fit, names=[p.name for p in flat], probabilities=(level,))
    return [
        _open("counts", p)
        for interval, p in zip(intervals, flat, strict=True)
        if open_side_finding(interval, p)
    ]


def vague(fit: Fit, sds: FloatArray) -> BoolArray:
    """(n_par,) whether one standard deviation of a parameter without a stated value would, alone,
    move the curve by half the range of the data, and its derivatives do not tell what the other
    parameters make of that.

    Of the constant of a power law far from x = 1, value ± 1.96 sds hold 87 % in place of 95 %, the
    profile 95 %.  For the intercept of a line far from the origin they are exact.  sds : (n_par,)
    of the fit.
    """
    free = np.flatnonzero(fit.problem.unstated)
    far = np.zeros(sds.size, dtype=bool)
    moved = _moved(fit.problem, fit.values, [fit.problem.names[i] for i in free])
    far[free] = moved * sds[free] >= _VAGUE
    return far & (bending(fit) >= _STRAIGHT) if np.any(far) else far


def bending(fit: Fit) -> FloatArray:
    """(n_par,) by how many standard deviations the residuals bend (their second difference) where
    each parameter goes one standard deviation and the others follow it; inf where the curve ends, 0
    where a sixteenth of the step bends them as much, by rounding errors.
    """
    n, steps = len(fit.names), fit.cov / positive_or(fit.scale, 1.0)[:, None]
    points = np.vstack([np.zeros(n), steps, -steps, steps / 16.0, steps / -16.0])
    with np.errstate(all="ignore"):
        ends = fit.posterior.residuals_at(np.clip(fit.values + points, *fit.problem.support()))
        pairs = ends[1:].reshape(2, 2, n, -1).sum(axis=1) - 2.0 * ends[0]
        full_step, part_step = np.nan_to_num(
            np.linalg.norm(pairs, axis=2), nan=np.inf, posinf=np.inf
        )
    return np.where(part_step <= 0.5 * full_step, full_step, 0.0)


def open_side_finding(
    interval: ProfileInterval, parameter: Parameter, sd: float = math.inf
) -> list[Finding]:
    """The finding that an interval of any probability has no end on a side without a limit, or none
    within ten standard deviations (of its logarithm, if that was followed), unless it is as long on
    both sides in logarithms: that of a positive quantity may reach over decades.
    """
    value, probability = interval.value, max(interval.low)
    low, high = interval.low[probability], interval.high[probability]
    down, up = value - low, high - value
    if low > 0.0 or high < 0.0:
        ratios = abs(math.log(low / value)), abs(math.log(high / value))
        if interval.by_size:
            down, up = (ratio * abs(value) for ratio in ratios)
        elif max(ratios) < _LONGER * min(ratios):
            down, up = 0.0, 0.0
    below = any(interval.open_low.values()) or down > _FAR * sd
    above = any(interval.open_high.values()) or up > _FAR * sd
    below = below and math.isinf(parameter.prior.low)
    above = above and math.isinf(parameter.prior.high)
    if not (below or above):
        return []
    side = "both" if below and above else "below" if below else "above"
    return [_open(side, parameter)]


def _open(side: str, parameter: Parameter) -> Finding:
    amount = Amount(parameter.name, label=parameter.label)
    return Finding(Kind.OPEN_SIDE, test=side, parameters=(amount,))


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
            moved = np.maximum(moved, np.max(finite_or(steps, 0.0), axis=0))
    return moved
