"""What an error that no residual can show would do to the result: a clock, a scale, a ramp that
sags, a value taken as exact.

The mode of a new fit that accounts for the error, from the mode that was found, in posterior
standard deviations: more than half of one, and the result is only as good as what is known of that
input.  What the curve lacks and the size of the noise are taken as they were found.  No linear
response is reported in its place: a millimetre of sag may move a result by so much that it is wrong
by factors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray, all_finite, positive_or
from estim.common import Amount, Finding, Kind
from estim.curves import scale_errors_of
from estim.fitting import Fit, descend_by_runs
from estim.problem import CommonError, Observations, Problem

LARGE_FROM = 0.5  # posterior standard deviations
# of a new fit; standard deviations that its last round may move
_MOST_ROUNDS, _CONVERGED = 40, 0.005


@dataclass(frozen=True)
class Influence:
    """One input that the data cannot check.

    name : what is wrong ("clock").
    size : by how much, in `unit` ("1": a share).  runs : those that it concerns.
    shifts : parameter -> by how many posterior standard deviations the error has moved it; empty
        where no fit that accounts for the error settles.
    along : m, length of the ramp of a sag; None for other errors, and where the runs have several.
    """

    name: str
    size: float
    unit: str
    runs: tuple[str, ...]
    shifts: Mapping[str, float]
    along: float | None = None

    @property
    def strongest(self) -> str:
        """The parameter that moves most."""
        return max(self.shifts, key=lambda name: abs(self.shifts[name]))

    @property
    def largest(self) -> float:
        """inf where it is not known."""
        return abs(self.shifts[self.strongest]) if self.shifts else np.inf


def influences(fit: Fit, sds: FloatArray | None = None) -> tuple[Influence, ...]:
    """What each error in common to the data has done, were it there, the largest first; none where
    the fit has no standard deviations.

    sds : (n_par,) of the posterior, by which shifts are divided; None: those at the mode.
    """
    sds = fit.sds if sds is None else sds
    inside = [i for i in fit.problem.of_curve if np.isfinite(fit.sds[i])]
    if fit.singular or not inside:
        return ()
    concerned: dict[str, dict[str, CommonError]] = {}
    for run in fit.problem.runs:
        for error in _errors_of(run):
            concerned.setdefault(error.name, {})[run.name] = error
    records = []
    for name, errors in concerned.items():
        *_, kind = errors.values()
        values = _mode_near(fit, _accounting(fit.problem, errors))
        shifts = (
            {}
            if values is None
            else {fit.names[i]: float((fit.values[i] - values[i]) / sds[i]) for i in inside}
        )
        ramps = {error.along for error in errors.values()}
        records.append(
            Influence(
                name,
                kind.size,
                kind.unit,
                tuple(errors),
                shifts,
                ramps.pop() if len(ramps) == 1 else None,
            )
        )
    return tuple(sorted(records, key=lambda influence: -influence.largest))


def _errors_of(run: Observations) -> tuple[CommonError, ...]:
    if run.noise.own_density:
        return ()
    if run.motion is None:
        kinds = (("scale_x", not run.numbered), ("scale_y", run.noise.counted is None))
        return scale_errors_of(run.curve, [kind for kind, may_be in kinds if may_be])
    return run.motion.errors_in_common(run.curve, run.arguments)


def _accounting(problem: Problem, errors: Mapping[str, CommonError]) -> Problem:
    """The problem whose curves account for the errors, run -> error."""
    runs = (
        replace(
            run,
            curve=errors[run.name].curve,
            arguments={**run.arguments, **errors[run.name].arguments},
        )
        if run.name in errors
        else run
        for run in problem.runs
    )
    return replace(problem, runs=tuple(runs))


def _mode_near(fit: Fit, problem: Problem) -> FloatArray | None:
    """(n_par,) the mode of `problem` next to that of the fit, the noise held; None where the steps
    do not settle.
    """
    values, free, scale = fit.values, fit.problem.of_curve, positive_or(fit.scale, np.inf)
    for _ in range(_MOST_ROUNDS):
        with np.errstate(all="ignore"):
            posterior = problem.linearised(values)
            if not all_finite(posterior.residuals(values)):
                return None
        before, values = values, descend_by_runs(posterior, values, free, most=1)
        if np.max(np.abs(values - before)[free] / scale[free]) < _CONVERGED:
            return values
    return None


def large_influences(fit: Fit, influences: Sequence[Influence]) -> list[Finding]:
    """What moves a result by more than half a standard deviation, as one finding; none where
    nothing does.
    """
    parts = []
    for influence in influences:
        if influence.largest > LARGE_FROM:
            moved = (
                (fit.problem.parameters[fit.names.index(influence.strongest)],)
                if influence.shifts
                else ()
            )
            amounts = tuple(
                Amount(parameter.name, influence.largest, parameter.label) for parameter in moved
            )
            along = {} if influence.along is None else {"along": influence.along}
            parts.append(
                Finding(
                    Kind.COMMON_ERROR,
                    test=influence.name,
                    size=influence.size,
                    parameters=amounts,
                    numbers=along,
                )
            )
    return [Finding(Kind.COMMON_ERRORS, parts=tuple(parts))] if parts else []
