"""Shifted readings as causes: which one it would be, or from which on all, and the problem in which
the shift is an unknown.

An error e of reading k moves y - f by e q_k, with q_k a column of A = S - diag(f') for speeds made
of positions, a unit vector else; a shift of all readings from k on by the sum of these columns.  At
the mode, with whitened residuals z, whitened derivatives J and P the precision of the priors,
chi-squared falls by

    (q^T z)^2 / (q^T [1 - J (J^T J + P)^-1 J^T] q)

Where only single errors are tried, a shift that stays (counts that an encoder lost, a mark that
moved) is blamed on a reading far from it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from scipy.sparse import eye_array

from estim.arrays import FloatArray, Named
from estim.common import Notation, format_rounded, phrase, with_unit
from estim.discrepancy import Pattern, Shifts
from estim.explanation.candidates import Cause
from estim.fitting import Fit
from estim.problem import Curve, Flat, LocalCurve, Parameter, Problem, Root, SpeedCurve

_ARGUMENT = "error_of_reading"


@dataclass(frozen=True, eq=False)
class Displaced:
    """A curve and one further argument, which moves it by `shift` (n_obs,) at the points x, for a
    value of 1.
    """

    curve: Curve
    x: FloatArray
    shift: FloatArray

    def value(self, x: FloatArray, arguments: Named) -> FloatArray:
        return self.curve.value(x, arguments) + arguments[_ARGUMENT] * self._at(x)

    def local(self, x: FloatArray, arguments: Named) -> LocalCurve:
        inner, moved = self.curve.local(x, arguments), self._at(x)
        return replace(
            inner,
            value=inner.value + arguments[_ARGUMENT] * moved,
            gradient={**inner.gradient, _ARGUMENT: moved},
        )

    def time_derivative(self, x: FloatArray, arguments: Named, order: int) -> FloatArray:
        return cast(SpeedCurve, self.curve).time_derivative(x, arguments, order)

    def _at(self, x: FloatArray) -> FloatArray:
        if np.array_equal(x, self.x):
            return self.shift
        order = np.argsort(self.x)
        return np.interp(x, self.x[order], self.shift[order])


def frame_causes(base: Fit) -> tuple[Cause, ...]:
    """The reading of each run that is most likely off by itself, and that from which on all most
    likely are, where readings follow each other.

    None of a run whose errors are not normal.
    """
    problem, named, causes = base.problem, base.named, []
    information = problem.prior_information(base.values)
    parts = []
    for run, likelihood in zip(problem.runs, base.posterior.likelihoods, strict=True):
        if likelihood.normal is None:
            return ()
        root = likelihood.normal.root(named)
        jacobian = root.whiten(run.points.gradient(named, problem.names).T).T
        z = root.whiten(likelihood.y - run.drawn(named))
        parts.append((run, root, jacobian, z))
        information = information + jacobian.T @ jacobian
    inverse = np.asarray(np.linalg.pinv(information, hermitian=True), dtype=np.float64)
    for i, (run, root, jacobian, z) in enumerate(parts):
        moved = run.noise.of_positions(run.points, named)
        matrix = eye_array(run.n_obs, format="csr") if moved is None else moved
        user_curve = run.motion is None and not run.numbered
        in_sequence = user_curve or run.positions or run.noise.made_of_positions
        shifts = Shifts(matrix, np.zeros(matrix.shape[1]), 1.0, in_sequence)
        kinds = ("frame", "step") if in_sequence else ("frame",)
        for kind in kinds:
            patterns = [pattern for pattern in shifts.patterns() if pattern.kind == kind]
            if not patterns:
                continue
            row, column, n_tried = _best(shifts, patterns, root, jacobian, z, inverse)
            causes.append(
                _cause(problem, i, row, column, len(kinds) * n_tried, stays=kind == "step")
            )
    return tuple(causes)


def _best(
    shifts: Shifts,
    patterns: Sequence[Pattern],
    root: Root,
    jacobian: FloatArray,
    z: FloatArray,
    inverse: FloatArray,
) -> tuple[int, FloatArray, int]:
    """The reading by whose shift chi-squared falls most, what that does to the points (n_obs,), and
    how many readings were tried.
    """
    projections = shifts.projections(patterns, root.turned_back(np.column_stack([jacobian, z]).T).T)
    size, along, pulled = shifts.squares(root, patterns), projections[:, :-1], projections[:, -1]
    remainder = size - np.einsum("kp,pq,kq->k", along, inverse, along)
    # of its size, what the fit leaves of the error of a reading; less cannot be detected
    determined = remainder > 1e-3 * np.max(size)
    fall = np.where(determined, pulled**2 / np.where(determined, remainder, 1.0), 0.0)
    best = patterns[int(np.argmax(fall))]
    return best.row, shifts.columns([best])[:, 0], int(np.sum(determined))


def _cause(
    problem: Problem, index: int, frame: int, pattern: FloatArray, n_tried: int, *, stays: bool
) -> Cause:
    run, n = problem.runs[index], frame + 1
    gap = np.diff(run.x[frame - 1 : frame + 1]) if stays and run.motion is None else np.zeros(0)
    in_formula = gap.size > 0 and gap[0] > 0.0  # whether a term of it is the remedy
    name = f"{'shift_from' if stays else 'reading'}_{n}[{run.name}]"
    of_positions = run.noise.made_of_positions or run.positions
    unit = run.y_unit if run.positions or not of_positions else run.x_unit
    meaning = (
        phrase("a shift of all readings after a certain point")
        if stays
        else phrase("error of one reading")
    )
    unknown = Parameter(
        name,
        unit,
        Flat(-math.inf, math.inf, 0.0),
        meaning,
        Notation("s" if in_formula else f"{'s' if stays else 'e'}_{n}"),
    )
    displaced = replace(
        run,
        curve=Displaced(run.curve, run.x, pattern),
        arguments={**run.arguments, _ARGUMENT: name},
    )
    runs = (*problem.runs[:index], displaced, *problem.runs[index + 1 :])
    with_error = Problem((*problem.parameters, unknown), runs)
    rows = run.noise.made_of_positions
    if stays:
        words = phrase(
            "a shift of all readings from fitted point {n} onwards (lost counts, a mark "
            "that moved)",
            n=n,
        )
        if rows:
            words = phrase(
                "a shift of all readings from row {n} onwards (lost counts, a mark that moved)", n=n
            )
        remark = phrase("fit the readings before and after that one separately (window)")
        if in_formula:
            at = run.x[frame] - 0.5 * gap[0]
            size = format_rounded(abs(at), 2.0 * gap[0])
            words = phrase(
                "a shift of all readings beyond {x} = {at} (lost counts, a change of range; "
                "+ s*heaviside({x} {sign} {size}, 0) in the formula)",
                x=getattr(run.curve, "variable", "x"),
                at=with_unit(size if at >= 0.0 else f"−{size}", run.x_unit),
                sign="-" if at >= 0.0 else "+",
                size=size,
            )
    else:
        words = phrase("one bad reading, number {n} of the fitted points", n=n)
        if rows:
            words = phrase("one bad reading, in row {n}", n=n)
        remark = phrase("look at that reading, and put # before its line if it is bad")
    words += phrase(" of run {run}", run=run.name) if len(problem.runs) > 1 else ""
    return Cause(
        f"bad_frame[{run.name}]",
        words,
        with_error,
        (name,),
        (),
        remark,
        searched=2.0 * math.log(n_tried),
    )
