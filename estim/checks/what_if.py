"""What an error that no residual can show would do to the result: a clock, a scale, a ramp that sags, a value taken as exact.

To first order an error that moves the residuals by d moves the mode by

    -(J^T J)^-1 J^T d,        J the Jacobian of the residuals of data and priors,

the linear response of least squares.  Told in posterior standard deviations: more than half of one, and the result is only as good as
what is known of that input.  The errors belong to what was measured (`Observations.errors_in_common`); values taken as exact to the campaign.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import Amount, Finding, Kind
from estim.fitting import Fit, curve_indices, linear_response
from estim.problem import CommonError, Curve, Flat, LocalCurve, Parameter, Problem, SpeedCurve

TOLD_FROM = 0.5  # posterior standard deviations


@dataclass(frozen=True)
class Influence:
    """One input that the data cannot check.

    name : what is wrong ("clock").  size : by how much, in `unit` ("1": a share).  runs : those that it concerns.
    shifts : parameter -> how far it moves, in posterior standard deviations.
    """

    name: str
    size: float
    unit: str
    runs: tuple[str, ...]
    shifts: Mapping[str, float]

    @property
    def strongest(self) -> str:
        """The parameter that moves most."""
        return max(self.shifts, key=lambda name: abs(self.shifts[name]))

    @property
    def largest(self) -> float:
        return abs(self.shifts[self.strongest])


@dataclass(frozen=True, eq=False)
class _Shifted:
    """A curve that further arguments move: argument -> (n_obs,) by how much at the points x, for a value of 1; between them straight."""

    curve: Curve
    x: FloatArray
    shifts: Mapping[str, FloatArray]

    def value(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        return self.curve.value(x, arguments)

    def local(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        inner, order = self.curve.local(x, arguments), np.argsort(self.x)
        moved = {name: np.interp(x, self.x[order], shift[order]) for name, shift in self.shifts.items()}
        return replace(inner, gradient={**inner.gradient, **moved})

    def time_derivative(self, x: FloatArray, arguments: Mapping[str, ArrayLike], order: int) -> FloatArray:
        return cast(SpeedCurve, self.curve).time_derivative(x, arguments, order)


def influences(fit: Fit) -> tuple[Influence, ...]:
    """What each error in common to the data would do, the strongest first; none where the fit has no standard deviations."""
    inside = [i for i in curve_indices(fit) if np.isfinite(fit.sds[i])]
    if fit.singular or not inside:
        return ()
    problem, named = fit.problem, fit.problem.named(fit.values)
    errors = {run.name: {error.name: error for error in run.errors_in_common(run.bind(named))} for run in problem.runs}
    kinds = {name: error for of_run in errors.values() for name, error in of_run.items()}
    # an error that moves the data as a parameter moves the curve moves that parameter by as much
    steps = _moved(problem, fit.values, errors, tuple(kinds)) / fit.sds[:, None]
    found = [
        Influence(
            name, error.size, error.unit, tuple(run for run in errors if name in errors[run]), {fit.names[i]: float(steps[i, k]) for i in inside}
        )
        for k, (name, error) in enumerate(kinds.items())
    ]
    return tuple(sorted((one for one in found if np.isfinite(one.largest)), key=lambda one: -one.largest))


def _moved(
    problem: Problem, values: FloatArray, errors: Mapping[str, Mapping[str, CommonError]], names: Sequence[str]
) -> FloatArray:
    """(n_par, n_error) how far each of the errors `names` moves the least squares, taken as one more parameter of the curves."""
    runs = []
    for run in problem.runs:
        own = {f"error of {name}": error.shift for name, error in errors[run.name].items()}
        noise = run.noise if run.noise.counted is None else run.noise.for_search()  # counts as readings about as precise: their response is linear
        runs.append(replace(run, curve=_Shifted(run.curve, run.x, own), arguments={**run.arguments, **{name: name for name in own}}, noise=noise))
    further = tuple(Parameter(f"error of {name}", "1", Flat(-np.inf, np.inf, 0.0), name) for name in names)
    at = np.concatenate([values, np.zeros(len(names))])
    posterior = replace(problem, parameters=(*problem.parameters, *further), runs=tuple(runs)).linearised(at)
    roots, effects, columns = [], [], []
    for jacobian, used in zip(posterior.narrow_jacobians(at), posterior.problem.columns, strict=True):
        of_error = used >= values.size
        effect = np.zeros((len(jacobian), len(names)))
        effect[:, used[of_error] - values.size] = jacobian[:, of_error]
        roots.append(jacobian[:, ~of_error])
        effects.append(effect)
        columns.append(used[~of_error])
    slopes = posterior.prior_slopes(at)[: values.size]
    return linear_response(roots, columns, slopes)(effects, np.zeros((values.size, len(names))))


def large_influences(fit: Fit, found: Sequence[Influence]) -> list[Finding]:
    """What moves a result by more than half a standard deviation, as one finding; none where nothing does."""
    parts = []
    for one in found:
        if one.largest > TOLD_FROM:
            parameter = fit.problem.parameters[fit.names.index(one.strongest)]
            amount = Amount(one.strongest, one.largest, parameter.label)
            parts.append(Finding(Kind.COMMON_ERROR, test=one.name, size=one.size, parameters=(amount,)))
    return [Finding(Kind.COMMON_ERRORS, parts=tuple(parts))] if parts else []
