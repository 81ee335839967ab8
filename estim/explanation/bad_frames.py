"""One reading that is off, as a cause: which frame it would be, and the problem in which its error is an unknown.

An error e of reading k moves y - f by e q_k, with q_k a column of A = S - diag(f') for speeds made of positions, a unit vector else.  At the mode,
with whitened residuals z, whitened derivatives J and P the precision of the priors, chi-squared falls by

    (q^T z)^2 / (q^T [1 - J (J^T J + P)^-1 J^T] q)
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import Notation, phrase
from estim.explanation.candidates import Cause
from estim.fitting import Fit
from estim.problem import Curve, Flat, LocalCurve, Parameter, Problem, SpeedCurve

_ARGUMENT = "error_of_reading"
_SEEN = 1e-3  # of its size, what the fit leaves of the error of a reading; less cannot be seen


@dataclass(frozen=True, eq=False)
class Displaced:
    """A curve and one further argument, which moves it by `shift` (n_obs,) at the points x, for a value of 1."""

    curve: Curve
    x: FloatArray
    shift: FloatArray

    def value(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        return np.asarray(self.curve.value(x, arguments) + np.asarray(arguments[_ARGUMENT]) * self._at(x))

    def local(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        inner, moved = self.curve.local(x, arguments), self._at(x)
        return replace(inner, value=inner.value + np.asarray(arguments[_ARGUMENT]) * moved, gradient={**inner.gradient, _ARGUMENT: moved})

    def time_derivative(self, x: FloatArray, arguments: Mapping[str, ArrayLike], order: int) -> FloatArray:
        return cast(SpeedCurve, self.curve).time_derivative(x, arguments, order)

    def _at(self, x: FloatArray) -> FloatArray:
        if np.array_equal(x, self.x):
            return self.shift
        order = np.argsort(self.x)
        return np.asarray(np.interp(x, self.x[order], self.shift[order]))


def frame_causes(base: Fit) -> tuple[Cause, ...]:
    """The frame of each run that is most likely off by itself; none of a run whose errors are not normal."""
    problem, named, found = base.problem, base.problem.named(base.values), []
    slopes = np.array([p.prior.residual_slope(float(v)) for p, v in zip(problem.parameters, base.values, strict=True)])
    whole = np.diag(slopes**2)
    parts = []
    for run, likelihood in zip(problem.runs, base.posterior.likelihoods, strict=True):
        if likelihood.normal is None:
            return ()
        lower = np.linalg.cholesky(likelihood.normal.covariance(named))
        jacobian = np.linalg.solve(lower, run.points.gradient(named, problem.names))
        z = np.linalg.solve(lower, likelihood.y - np.ravel(np.broadcast_to(run.points.value(named), (1, run.n_obs))))
        parts.append((run, lower, jacobian, z))
        whole = whole + jacobian.T @ jacobian
    inverse = np.linalg.pinv(whole, hermitian=True)
    for i, (run, lower, jacobian, z) in enumerate(parts):
        moved = run.noise.of_positions(run.points, named)
        patterns = np.eye(run.n_obs) if moved is None else moved
        seen = np.linalg.solve(lower, patterns)
        size, along = np.sum(seen**2, axis=0), jacobian.T @ seen
        left = size - np.einsum("pk,pq,qk->k", along, inverse, along)
        told = left > _SEEN * np.max(size)
        fall = np.where(told, (seen.T @ z) ** 2 / np.where(told, left, 1.0), 0.0)
        frame = int(np.argmax(fall))
        found.append(_cause(problem, i, frame, patterns[:, frame], int(np.sum(told))))
    return tuple(found)


def _cause(problem: Problem, index: int, frame: int, pattern: FloatArray, n_frame: int) -> Cause:
    run = problem.runs[index]
    name = f"reading_{frame + 1}[{run.name}]"
    of_positions = run.noise.made_of_positions or run.positions
    unit = run.y_unit if run.positions or not of_positions else run.x_unit
    unknown = Parameter(name, unit, Flat(-math.inf, math.inf, 0.0), phrase("error of one reading"), Notation(f"e_{frame + 1}"))
    displaced = replace(run, curve=Displaced(run.curve, run.x, pattern), arguments={**run.arguments, _ARGUMENT: name})
    runs = (*problem.runs[:index], displaced, *problem.runs[index + 1 :])
    words = phrase("one bad reading, number {n} of the points that are fit", n=frame + 1)
    if run.noise.made_of_positions:
        words = phrase("one bad reading, number {n} of the rows", n=frame + 1)
    words += phrase(" of run {run}", run=run.name) if len(problem.runs) > 1 else ""
    remark = phrase("look at that frame, and put # before its line if it is bad")
    with_error = Problem((*problem.parameters, unknown), runs)
    return Cause(f"bad_frame[{run.name}]", words, with_error, (name,), (), remark, searched=2.0 * math.log(n_frame))
