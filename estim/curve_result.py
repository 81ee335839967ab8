"""The record of a user's own curve, fitted (`estim.curve_fit.fit_curve` makes it): values, intervals, status, and how a person reads them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estim.arrays import FloatArray
from estim.checks import Goodness
from estim.common import Finding, Kind, Status, code, markdown, one_line, table
from estim.deviation import FoundDeviation
from estim.fitting import FEW, Ends, Fit, LinearDerived, linear_derived, shown_value
from estim.problem import Problem
from estim.words import advice, advice_for, tell

_ADVISED = (Kind.SEVERAL_SOLUTIONS, Kind.STEP_UNSETTLED)  # of which a reason says what to do as well


@dataclass(frozen=True, eq=False)
class CurveFit:
    """A fitted curve.

    names : of the parameters, shared errors included.  values, sds : name -> best value and standard deviation (nan where a
        symmetric one would be wrong: at a limit, where the data determine nothing or have no scatter; `notes` says which).
    intervals : name -> probability (0.68, 0.95) -> (low, high), by Student's t where the size of the errors was estimated, by
        profiles beside a limit (`estim.fitting.curve_intervals`); an end at the limit itself, or infinite, is open.  nan where there is none.
    cov : (n_par, n_par) covariance matrix in the order of `names`.
    chi2 : squared residuals over u_y, priors included; without u_y the plain sum of squared residuals (unit of y squared).  With u_x
        a residual is the normal score of y, F^-1(P(Y < y | x)); for a line (y - f)/sqrt(u_y^2 + b^2 u_x^2) but for the shrinking of x.
    dof : points and informative priors minus parameters.  p_value : P(chi2 or more), nan without u_y; with u_x from 20,000 simulated data sets.
    sigma : standard deviation of one y estimated from the residuals, None where u_y was given.
    findings : everything wrong, gravest first, and the status that follows.  remarks : what to know before using it, nothing wrong.
    reasons, notes : the same in words.  message : how the search went.
    goodness : tests of the residuals, in order of x; empty where the points are too few.
    fixed : name -> exact value of the parameters that were not fit.
    fit, problem : what sampling starts from; without u_y `problem` has `sigma_y` as a further parameter.
    """

    names: tuple[str, ...]
    values: Mapping[str, float]
    sds: Mapping[str, float]
    intervals: Mapping[str, Ends]
    cov: FloatArray
    chi2: float
    dof: int
    p_value: float
    sigma: float | None
    status: Status
    findings: tuple[Finding, ...]
    remarks: tuple[Finding, ...]
    message: str
    goodness: tuple[Goodness, ...]
    fit: Fit
    text: str
    fixed: Mapping[str, float]

    @property
    def reasons(self) -> tuple[str, ...]:
        return tuple(f"{tell(f)}; {advice(f)}" if f.kind in _ADVISED else tell(f) for f in self.findings)

    @property
    def advice(self) -> tuple[str, ...]:
        """What to do where the residuals have a pattern."""
        return tuple(advice_for(f for f in self.findings if f.kind is Kind.CURVE_LACKS))

    @property
    def deviation(self) -> FoundDeviation | None:
        """What the curve lacks, where `deviation` or `correlated` asked for it."""
        return next(iter(self.fit.deviations), None)

    @property
    def notes(self) -> tuple[str, ...]:
        return tuple(map(tell, self.remarks))

    @property
    def problem(self) -> Problem:
        return self.fit.problem

    @cached_property
    def derived(self) -> Mapping[str, LinearDerived]:
        """Name -> what follows from the parameters by the formulas `derived`, linear about the fit; `sample_curve` computes it from draws."""
        unknown = [name for name, sd in self.sds.items() if not math.isfinite(sd)]
        dof = math.inf if self.sigma is None or self.deviation is not None else self.dof
        values = np.array([self.values[name] for name in self.names])
        return {one.name: one for one in linear_derived(self.problem.runs[0], self.names, values, self.cov, dof=dof, unknown=unknown)}

    @property
    def correlation(self) -> FloatArray:
        """(n_par, n_par) correlation matrix; nan beside a parameter without a standard deviation."""
        sds = np.sqrt(np.diag(self.cov))
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.cov / np.outer(sds, sds)

    def __str__(self) -> str:
        width = max(map(len, (*self.names, *self.derived)))
        rows = [f"{name:<{width}} {f'{relation} {value}'.strip()}" for name, (relation, value) in self._rows()]
        head = [f"{self.text}: {self.status}", *(f"  {reason}" for reason in self.reasons)]
        head += [f"  what to do: {words}" for words in self.advice]
        said = [*head, *rows, *self._fixed_words(), *(f"note: {note}" for note in self.notes)]
        return "\n".join(map(one_line, [*said, self._summary()]))

    def _repr_markdown_(self) -> str:
        head = [f"{code(self.text)}: **{self.status}**", *(f"- {markdown(reason)}" for reason in self.reasons)]
        head += [f"- What to do: {markdown(words)}" for words in self.advice]
        rows = [(name, value) for name, (_, value) in self._rows()]
        shown = ["", table(("parameter", "value and intervals"), rows)] if rows else []
        notes = [*self._fixed_words(), *(f"Note: {note}" for note in self.notes)]
        return "\n".join([*head, *shown, "", *(f"- {markdown(note)}" for note in notes), "", markdown(self._summary())])

    def _fixed_words(self) -> list[str]:
        return [f"{name} = {value:.10g} (fixed)" for name, value in self.fixed.items()]

    def _rows(self) -> list[tuple[str, tuple[str, str]]]:
        """Name, and relation and value in words; limits where the curve or an edge is contradicted, nothing where no number is a result."""
        if self.status not in (Status.OK, Status.POOR_FIT, Status.AT_BOUND):
            return []
        few, anywhere = self.sigma is not None and self.dof <= FEW, (-math.inf, math.inf)
        priors = {p.name: p.prior for p in self.problem.parameters}
        return [
            (
                name,
                shown_value(
                    self.values[name], self.sds[name], self.intervals[name], (priors[name].low, priors[name].high), unit=_unit(self.problem, name),
                    few=few, ok=self.status.ok,
                ),
            )
            for name in self.names
        ] + [
            (name, (relation, f"{shown} ({'derived, linear' if math.isfinite(d.interval[0.95][0]) else 'derived; sample_curve may know one'})"))
            for name, d in self.derived.items()
            for relation, shown in [shown_value(d.value, d.sd, d.interval, anywhere, unit=_shown(d.unit), few=few, ok=self.status.ok)]
        ]

    def _summary(self) -> str:
        if self.sigma is None:
            return f"chi2 = {self.chi2:.4g}, dof = {self.dof}, p = {self.p_value:.2g}; {self.message}"
        return f"residual sd = {self.sigma:.4g} (estimated: u_y was not given), dof = {self.dof}; {self.message}"


def _unit(problem: Problem, name: str) -> str:
    return _shown(next(p.unit for p in problem.parameters if p.name == name))


def _shown(unit: str) -> str:
    return "" if unit == "1" else unit
