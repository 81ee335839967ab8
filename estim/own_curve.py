"""Fitting a user's own curve y = f(x; parameters): `fit_curve`, from numbers to a result with a status.

The curve is a formula in text (`estim.formula` says what it may hold) or a Python function `curve(x, **parameters)`.
Say `u_y` where the errors of y are known: then chi-square tests the curve.  Without it their common size is estimated
from the residuals, as a textbook regression does, and nothing tests it.  `estim.curve_analysis.sample_curve` goes on from here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.conflict import check_stated_values, conflict_words
from estim.curve_problem import AxisNames, CurveProblem, pose_curve
from estim.diagnosis import STATUSES
from estim.fitting import Fit, chi2_p, fit_least_squares
from estim.goodness import REJECT_BELOW, Goodness, check_goodness
from estim.optimum import N_START, Optimum, find_optimum
from estim.priors import Prior
from estim.problem import Problem, informative
from estim.quantity import format_quantity
from estim.systematic import Component

FloatArray = NDArray[np.float64]

_ROUNDS = 60  # of the size of the errors, where priors make it matter
_PERFECT = 3e-14  # residuals below this share of y are rounding errors


@dataclass(frozen=True, eq=False)
class CurveFit:
    """A fitted curve.

    names : of the parameters, shared errors included.  values, sds : name -> best value and standard deviation (nan where a
        symmetric one would be wrong: at a limit, or where the data determine nothing).
    cov : (n_par, n_par) covariance matrix in the order of `names`.
    chi2 : squared residuals over u_y, priors included; without u_y the plain sum of squared residuals (unit of y squared).
    dof : points and informative priors minus parameters.  p_value : P(chi2 or more), nan without u_y.
    sigma : standard deviation of one y estimated from the residuals, None where u_y was given.
    status : one of `estim.diagnosis.STATUSES`.  reasons : what is wrong, empty if it is "ok".  message : how the search went.
    goodness : tests of the residuals, in order of x; empty where the points are too few.
    fit, problem : what sampling starts from; without u_y `problem` has `sigma_y` as a further parameter.
    """

    names: tuple[str, ...]
    values: Mapping[str, float]
    sds: Mapping[str, float]
    cov: FloatArray
    chi2: float
    dof: int
    p_value: float
    sigma: float | None
    status: str
    reasons: tuple[str, ...]
    message: str
    goodness: tuple[Goodness, ...]
    fit: Fit
    text: str

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
        rows = [f"{name:<{width}} = {_shown(self.values[name], self.sds[name])} {_unit(self.problem, name)}".rstrip() for name in self.names]
        return "\n".join([f"{self.text}: {self.status}", *(f"  {reason}" for reason in self.reasons), *rows, self._summary()])

    def _repr_markdown_(self) -> str:
        rows = [f"| {name} | {_shown(self.values[name], self.sds[name])} | {_unit(self.problem, name)} |" for name in self.names]
        head = [f"`{self.text}`: **{self.status}**", *(f"- {reason}" for reason in self.reasons)]
        return "\n".join([*head, "", "| parameter | value ± standard deviation | unit |", "|---|---|---|", *rows, "", self._summary()])

    def _summary(self) -> str:
        if self.sigma is None:
            return f"chi2 = {self.chi2:.4g}, dof = {self.dof}, p = {self.p_value:.2g}; {self.message}"
        return f"residual sd = {self.sigma:.4g} (estimated: u_y was not given), dof = {self.dof}; {self.message}"


def fit_curve(
    curve: str | Callable[..., Any],
    x: ArrayLike,
    y: ArrayLike,
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
) -> CurveFit:
    """The curve fit to points x, y (n_obs,) by least squares.

    curve : formula in x and parameters, or function curve(x, **parameters) that returns (n_obs,).
    start : a starting value for each parameter; the order of magnitude and the sign matter, several further starts are tried.
    u_y : standard uncertainty of y, a number or (n_obs,).  cov_y : (n_obs, n_obs) covariance matrix in its place.
    bounds : name -> (low, high), None for no limit.  priors : name -> prior, or text like "9.81(2)"; else flat.
    errors : errors common to all points (`Component`), fit as further parameters.  units : name -> unit, for tables.
    rng : of the further starts and of the simulated tests; None always draws the same.  n_start : starts tried, 1 for the given one alone.

    Raises InputError where an argument breaks a rule.
    """
    rng = np.random.default_rng(1) if rng is None else rng
    posed = pose_curve(
        curve, x, y, start=start, u_y=u_y, cov_y=cov_y, u_x=u_x, bounds=bounds or {}, priors=priors or {}, errors=tuple(errors), units=units or {},
        axes=axes or AxisNames(),
    )
    return (_fit_stated if posed.stated else _fit_estimated)(posed, rng, n_start)


def _fit_stated(posed: CurveProblem, rng: np.random.Generator, n_start: int) -> CurveFit:
    problem = posed.with_sigma(1.0)
    best = find_optimum(problem, problem.start(), rng=rng, n_start=n_start)
    return _concluded(posed, best, problem, sigma=None, scale=1.0, rng=rng)


def _fit_estimated(posed: CurveProblem, rng: np.random.Generator, n_start: int) -> CurveFit:
    """The fit whose residuals say how large the errors are; with informative priors, in rounds until that size settles."""
    pulled = any(informative(p.prior) for p in posed.parameters)
    sigma = float(np.std(posed.y)) or 1.0 if pulled else 1.0
    problem = posed.with_sigma(sigma)
    best = first = find_optimum(problem, problem.start(), rng=rng, n_start=n_start)
    for _ in range(_ROUNDS if pulled else 0):
        before, sigma = sigma, _residual_sd(posed, best.values)
        problem = posed.with_sigma(sigma)
        best = find_optimum(problem, best.values, rng=rng, n_start=1)
        if abs(sigma / before - 1.0) < 1e-10:
            break
    best = replace(best, n_start=first.n_start, n_same=first.n_same)
    estimated = _residual_sd(posed, best.values)
    return _concluded(posed, best, problem, sigma=estimated, scale=1.0 if pulled else estimated, rng=rng)


def _residual_sd(posed: CurveProblem, values: FloatArray) -> float:
    """Square root of the residuals' squares over the degrees of freedom, no smaller than rounding errors of y."""
    pulls = sum(informative(p.prior) for p in posed.parameters)
    squares = float(np.sum(posed.residuals(values) ** 2))
    return max(math.sqrt(squares / max(1, posed.y.size + pulls - values.size)), _floor(posed))


def _floor(posed: CurveProblem) -> float:
    return _PERFECT * (float(np.max(np.abs(posed.y))) or 1.0)


def _concluded(posed: CurveProblem, best: Optimum, problem: Problem, *, sigma: float | None, scale: float, rng: np.random.Generator) -> CurveFit:
    """The record of an optimum of `problem`, whose covariance is to be multiplied by scale^2."""
    cov = best.cov * scale**2
    curvature = np.sqrt(np.diag(cov))
    sds = np.where(best.singular | best.at_bound, np.nan, curvature)
    for i, parameter in enumerate(posed.parameters):
        if min(best.values[i] - parameter.prior.low, parameter.prior.high - best.values[i]) < curvature[i]:
            sds[i] = np.nan
    pulls = sum(informative(p.prior) for p in posed.parameters)
    dof = posed.y.size + pulls - len(posed.parameters)
    chi2 = best.chi2 if sigma is None else float(np.sum(posed.residuals(best.values) ** 2))
    perfect = float(np.sum(posed.residuals(best.values) ** 2)) <= posed.y.size * _floor(posed) ** 2
    p_value = chi2_p(chi2, dof) if sigma is None and dof > 0 else math.nan
    inner = _inner_fit(posed, best, problem, sigma, rng)
    tested = dof >= 1 and not perfect and not best.singular
    goodness = check_goodness(inner, rng=rng) if tested else ()
    conflict = None if best.singular else check_stated_values(inner)
    findings = _findings(posed, best, p_value, chi2, dof, goodness)
    if conflict is not None and not conflict.agree:
        findings.append(("poor-fit", conflict_words(inner, conflict)))
    names = tuple(p.name for p in posed.parameters)
    return CurveFit(
        names=names, values=dict(zip(names, best.values.tolist(), strict=True)), sds=dict(zip(names, sds.tolist(), strict=True)), cov=cov, chi2=chi2,
        dof=dof, p_value=p_value, sigma=sigma, status=findings[0][0] if findings else "ok", reasons=tuple(reason for _, reason in findings),
        message=_message(best, sigma, perfect), goodness=goodness, fit=inner, text=posed.text,
    )


def _inner_fit(posed: CurveProblem, best: Optimum, problem: Problem, sigma: float | None, rng: np.random.Generator) -> Fit:
    """The same optimum as the record that the tests and the sampler take, with the size of the errors unknown if it was not stated."""
    if sigma is None:
        start = best.values
    else:
        problem, start = posed.with_unknown_sigma(sigma), np.append(best.values, sigma)
    fit = fit_least_squares(problem, rng=rng, n_start=1, start=start)
    values = fit.values.copy()
    values[: best.values.size] = best.values
    words = f"{'settled' if best.settled else 'did not settle'}; {best.n_same} of {best.n_start} starts led to this optimum"
    posterior = problem.linearised(values)
    return replace(fit, values=values, posterior=posterior, n_start=best.n_start, n_same=best.n_same, success=best.settled, message=words)


def _findings(
    posed: CurveProblem, best: Optimum, p_value: float, chi2: float, dof: int, goodness: tuple[Goodness, ...]
) -> list[tuple[str, str]]:
    """(status, reason) for everything that is wrong, gravest first."""
    found = []
    if not best.settled and not best.singular:
        reason = f"the search did not settle: its last step was {best.step:.2g} standard deviations; try other starting values"
        found.append(("not-converged", reason))
    if best.singular:
        found.append(("not-identified", "the data do not determine a combination of the parameters: no standard deviations"))
    for parameter, value, stuck in zip(posed.parameters, best.values, best.at_bound, strict=True):
        if stuck:
            found.append(("at-bound", f"{parameter.name} lies on its limit {value:.6g}: quote a limit, not a value, or widen the bounds"))
    if p_value < REJECT_BELOW:
        found.append(("poor-fit", f"the residuals are larger than u_y allows: chi2 = {chi2:.4g} for {dof} degrees of freedom, p = {p_value:.1g}"))
    for run in goodness:
        for name in run.failed:
            if name != "chi2":
                found.append(("poor-fit", f"{run.checks[name].meaning} (test '{name}', p = {run.checks[name].p_value:.1g})"))
    return sorted(found, key=lambda finding: STATUSES.index(finding[0]))


def _message(best: Optimum, sigma: float | None, perfect: bool) -> str:
    words = [f"{best.n_same} of {best.n_start} starts led to this optimum"]
    if perfect:
        words.append("the curve passes through every point to rounding error")
    elif sigma is not None:
        words.append("the size of the errors was estimated from the residuals")
    return "; ".join(words)


def _shown(value: float, sd: float) -> str:
    return format_quantity(value, sd) if math.isfinite(sd) else f"{value:.6g} (no standard deviation)"


def _unit(problem: Problem, name: str) -> str:
    unit = next(p.unit for p in problem.parameters if p.name == name)
    return "" if unit == "1" else unit
