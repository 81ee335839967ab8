"""Fitting a user's own curve y = f(x; parameters): `fit_curve`, from numbers to a result with a status.

The curve is a formula in text (`estim.curves.formula` says what it may hold) or a Python function `curve(x, **parameters)`.
Say `u_y` where the errors of y are known: then chi-square tests the curve.  Without it their common size is estimated
from the residuals, as a textbook regression does, and nothing tests it.  `estim.reports.curve.sample_curve` goes on from here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.checks import (
    Goodness,
    check_goodness,
    check_stated_values,
    curve_findings,
    curve_remarks,
    deviation_finding,
    failed_tests,
    laplace_modes,
    pressed_limits,
    same_curve,
    several_solutions,
    stated_values,
)
from estim.common import Finding, Kind, Status, code, decide, markdown, one_line, table, wrong
from estim.curves import AxisNames, Component, Counting, CurveProblem, pose_curve
from estim.deviation import FoundDeviation
from estim.fitting import (
    FEW,
    N_START,
    Ends,
    Fit,
    Optimum,
    chi2_p,
    find_optimum,
    fit_lacking,
    fit_least_squares,
    led_here,
    sds_beside_limits,
    shown_value,
    spread,
    with_others,
)
from estim.problem import Prior, Problem, informative
from estim.words import advice, advice_for, tell

_ROUNDS = 60  # of the size of the errors, where priors make it matter
_ADVISED = (Kind.SEVERAL_SOLUTIONS, Kind.STEP_UNSETTLED)  # of which a reason says what to do as well
_PERFECT = 3e-14  # residuals below this share of y are rounding errors


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

    @property
    def correlation(self) -> FloatArray:
        """(n_par, n_par) correlation matrix; nan beside a parameter without a standard deviation."""
        sds = np.sqrt(np.diag(self.cov))
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.cov / np.outer(sds, sds)

    def __str__(self) -> str:
        width = max(len(name) for name in self.names)
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
        few = self.sigma is not None and self.dof <= FEW
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
        ]

    def _summary(self) -> str:
        if self.sigma is None:
            size = "chi2" if self.problem.runs[0].noise.counted is None else "deviance"
            return f"{size} = {self.chi2:.4g}, dof = {self.dof}, p = {self.p_value:.2g}; {self.message}"
        return f"residual sd = {self.sigma:.4g} (estimated: u_y was not given), dof = {self.dof}; {self.message}"


def fit_curve(
    curve: str | Callable[..., Any],
    x: ArrayLike,
    y: ArrayLike | None,
    *,
    start: Mapping[str, float],
    u_y: ArrayLike | None = None,
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
    priors: Mapping[str, Prior | str] | None = None,
    rng: np.random.Generator | None = None,
    cov_y: ArrayLike | None = None,
    u_x: ArrayLike | None = None,
    errors: Sequence[Component] = (),
    units: Mapping[str, str] | None = None,
    axes: AxisNames | None = None,
    n_start: int = N_START,
    fixed: Mapping[str, float] | None = None,
    deviation: float = 0.0,
    correlated: ArrayLike | bool = False,
    noise: Counting | str | None = None,
) -> CurveFit:
    """The curve fit to points x, y (n_obs,) by least squares.

    curve : formula in x and parameters, or function curve(x, **parameters) that returns (n_obs,).
    start : a starting value for each parameter that is fit; the order of magnitude and the sign matter, several further starts are tried.
    u_y : standard uncertainty of y, a number or (n_obs,).  cov_y : (n_obs, n_obs) covariance matrix in its place.
    u_x : standard uncertainty of x, a number or (n_obs,), beside u_y; None where x is exact.  The true abscissas are integrated out one by one
        under a normal distribution fitted to the x (`estim.problem.abscissas`); values are the maximum of that likelihood and cov its inverse Fisher
        information.  The curve is evaluated up to 4.8 u_x beside each x; where it is not defined there, no true abscissa lies.
    fixed : name -> exact value of each parameter of the curve that is not fit; it has neither start nor prior nor uncertainty.
    bounds : name -> (low, high), None for no limit.  priors : name -> prior, or text like "9.81(2)"; else flat.
    errors : errors common to all points (`Component`), fit as further parameters.  units : name -> unit, for tables.
    axes : names and units of x and y (`AxisNames`), for figures, tables and the units of `errors`.
    deviation : how large a smooth deviation of y from the curve would not surprise you (the scale of a half-normal prior, unit of y); 0 for none.
    correlated : whether errors of points that follow each other may be alike: True in the order given, or their times (n_obs,).
        With either, values, sds and intervals are those of a mixture over its size and length, linear in the parameters (`estim.deviation`).
    noise : what y counts, in place of u_y: "poisson", or `Poisson(bins=...)`, `Binomial(trials=...)`, `EventTimes(low, high)` with y = None
        (`estim.curves.counting`).  Intervals are then profiles of the likelihood, and chi2 is the deviance.
    rng : of the further starts and of the simulated tests; None always draws the same.  n_start : starts tried, 1 for the given one alone.

    Raises InputError where an argument breaks a rule.
    """
    rng = np.random.default_rng(1) if rng is None else rng
    posed = pose_curve(
        curve, x, y, start=start, u_y=u_y, cov_y=cov_y, u_x=u_x, bounds={} if bounds is None else bounds,
        priors={} if priors is None else priors, errors=tuple(errors), units={} if units is None else units,
        axes=AxisNames() if axes is None else axes, fixed={} if fixed is None else fixed,
        deviation=deviation, correlated=correlated, noise=noise,
    )
    complete = (_fit_stated if posed.stated else _fit_estimated)(posed, rng, n_start)
    found = complete.status not in (Status.NOT_IDENTIFIED, Status.NOT_CONVERGED) and complete.goodness
    return _fit_lacking(posed, complete, rng) if posed.lacks is not None and found else complete


def _fit_stated(posed: CurveProblem, rng: np.random.Generator, n_start: int) -> CurveFit:
    problem = posed.with_sigma(1.0)
    best = find_optimum(problem, problem.start(), rng=rng, n_start=n_start)
    return _concluded(posed, best, problem, sigma=None, scale=1.0, rng=rng)


def _fit_estimated(posed: CurveProblem, rng: np.random.Generator, n_start: int) -> CurveFit:
    """The fit whose residuals say how large the errors are; with informative priors, in rounds until that size settles."""
    pulled = any(informative(p.prior) for p in posed.parameters)
    sigma = float(np.std(posed.y)) or 1.0 if pulled else 1.0
    problem = posed.with_sigma(sigma)
    best = first = find_optimum(problem, problem.start(), rng=rng, n_start=n_start, unstated=True)
    for _ in range(_ROUNDS if pulled else 0):
        before, sigma = sigma, _residual_sd(posed, best.values)
        problem = posed.with_sigma(sigma)
        best = find_optimum(problem, best.values, rng=rng, n_start=1, unstated=True)
        if abs(sigma / before - 1.0) < 1e-10:
            break
    best = replace(
        best, n_start=first.n_start, n_same=first.n_same, others=first.others, symmetry=first.symmetry, aliases=first.aliases
    )
    estimated = _residual_sd(posed, best.values)
    return _concluded(posed, best, problem, sigma=estimated, scale=1.0 if pulled else estimated, rng=rng)


def _fit_lacking(posed: CurveProblem, complete: CurveFit, rng: np.random.Generator) -> CurveFit:
    """The fit of a curve that may lack something, from the one `complete` that takes it as it is."""
    problem = posed.with_lacks(complete.sigma or 1.0)
    start = np.array([complete.values[p.name] for p in problem.parameters])
    fit = fit_lacking(fit_least_squares(problem, rng=rng, n_start=1, start=start), rng=rng)
    fit = replace(fit, n_start=complete.fit.n_start, n_same=complete.fit.n_same, symmetry=complete.fit.symmetry, aliases=complete.fit.aliases)
    (found,) = fit.deviations
    goodness = check_goodness(fit, rng=rng)
    kept = [f for f in complete.findings if f.kind is Kind.SEVERAL_SOLUTIONS]
    tests = [replace(f, run="") for f in failed_tests(goodness)]
    findings = wrong([*kept, *pressed_limits(fit, fit.values), *tests, stated_values(fit, check_stated_values(fit))])
    about = deviation_finding(found, x_unit=posed.axes.x_unit, y_unit=posed.axes.y_unit)
    sds, near = sds_beside_limits(found, problem)
    values, names = np.clip(found.mean, *problem.support()).tolist(), fit.names
    return replace(
        complete, values=dict(zip(names, values, strict=True)), sds=dict(zip(names, sds.tolist(), strict=True)), intervals=found.intervals,
        cov=found.cov, chi2=fit.chi2, p_value=fit.p_value, sigma=None if complete.sigma is None else found.noise[1], status=decide(findings),
        findings=findings, remarks=(*near, replace(about, run="")), goodness=goodness, fit=fit,
    )


def _residual_sd(posed: CurveProblem, values: FloatArray) -> float:
    """Square root of the residuals' squares over the degrees of freedom, no smaller than rounding errors of y."""
    pulls = sum(informative(p.prior) for p in posed.parameters)
    squares = float(np.sum(posed.residuals(values) ** 2))
    return max(math.sqrt(squares / max(1, posed.y.size + pulls - values.size)), _floor(posed))


def _floor(posed: CurveProblem) -> float:
    return _PERFECT * (float(np.max(np.abs(posed.y))) or 1.0)


def _concluded(posed: CurveProblem, best: Optimum, problem: Problem, *, sigma: float | None, scale: float, rng: np.random.Generator) -> CurveFit:
    """The record of an optimum of `problem`, whose covariance is to be multiplied by scale^2."""
    pulls = sum(informative(p.prior) for p in posed.parameters)
    dof = posed.y.size + pulls - len(posed.parameters)
    squares = float(np.sum(posed.residuals(best.values) ** 2))
    inner = _inner_fit(posed, best, problem, sigma, rng)
    chi2 = _size(inner, best) if sigma is None else squares
    whitened = problem.linearised(best.values).residuals(best.values)[: posed.y.size]
    perfect = squares <= posed.y.size * _floor(posed) ** 2 or float(np.sum(whitened**2)) <= best.rounding
    p_value = chi2_p(chi2, dof) if sigma is None and dof > 0 else math.nan
    fixed = inner if sigma is None else _fixed_fit(posed.with_sigma(sigma), best, rng)
    found = spread(fixed, best, dof=math.inf if sigma is None else dof, scale=scale, unknown=perfect and sigma is not None)
    tested = dof >= 1 and not perfect and not best.singular
    goodness = check_goodness(inner, rng=rng) if tested else ()
    if goodness and inner.posterior.likelihoods[0].normal is None:  # chi^2 is only nearly what it is called
        p_value = goodness[0].checks["chi2"].p_value if "chi2" in goodness[0].checks else p_value
    conflict = None if best.singular else check_stated_values(inner)
    solutions = several_solutions(inner, laplace_modes(inner)) if inner.others.size else []
    stated = [] if conflict is None else [stated_values(inner, conflict)]
    findings = wrong([*solutions, *curve_findings(fixed, best, p_value, chi2, dof, goodness, estimated=sigma is not None), *stated])
    names = tuple(p.name for p in posed.parameters)
    return CurveFit(
        names=names, values=dict(zip(names, best.values.tolist(), strict=True)), sds=dict(zip(names, found.sds.tolist(), strict=True)),
        intervals=found.intervals, cov=found.cov, chi2=chi2, dof=dof, p_value=p_value, sigma=sigma, status=decide(findings), findings=findings,
        remarks=(*found.notes, *curve_remarks(inner, best, p_value, chi2, dof, goodness, stated=sigma is None, perfect=perfect)),
        message=_message(best, sigma, perfect, [tell(f) for f in same_curve(inner)]), goodness=goodness,
        fit=inner, text=posed.text, fixed=posed.fixed,
    )


def _fixed_fit(problem: Problem, best: Optimum, rng: np.random.Generator) -> Fit:
    """The same optimum as a record with errors of a fixed size."""
    return replace(fit_least_squares(problem, rng=rng, n_start=1, start=best.values), values=best.values, posterior=problem.linearised(best.values))


def _size(inner: Fit, best: Optimum) -> float:
    """chi^2 of the data and of the priors."""
    return float(np.sum(inner.posterior.size_residuals(best.values) ** 2) + np.sum(inner.posterior.prior_residuals(best.values) ** 2))


def _inner_fit(posed: CurveProblem, best: Optimum, problem: Problem, sigma: float | None, rng: np.random.Generator) -> Fit:
    """The same optimum as the record that the tests and the sampler take, with the size of the errors unknown if it was not stated."""
    if sigma is None:
        start = best.values
    else:
        problem, start = posed.with_unknown_sigma(sigma), np.append(best.values, sigma)
    fit = fit_least_squares(problem, rng=rng, n_start=1, start=start)
    values = fit.values.copy()
    values[: best.values.size] = best.values
    words = f"{'settled' if best.settled else 'did not settle'}; {led_here(best.n_same, best.n_start)}"
    posterior = problem.linearised(values)
    fit = replace(fit, values=values, posterior=posterior, n_start=best.n_start, n_same=best.n_same, success=best.settled, message=words)
    return with_others(fit, best, rng)


def _message(best: Optimum, sigma: float | None, perfect: bool, same: list[str]) -> str:
    words = [led_here(best.n_same, best.n_start), *same]
    if perfect:
        words.append("the curve passes through every point to rounding error")
    elif sigma is not None:
        words.append("the size of the errors was estimated from the residuals")
    return "; ".join(words)


def _unit(problem: Problem, name: str) -> str:
    unit = next(p.unit for p in problem.parameters if p.name == name)
    return "" if unit == "1" else unit
