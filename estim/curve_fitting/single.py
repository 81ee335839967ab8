"""Fitting a user's own curve y = f(x; parameters): `fit_curve`, from numbers to a result with a
status.

The curve is a formula in text (`estim.curves.formula` says what it may hold) or a Python function
`curve(x, **parameters)`.  Say `u_y` where the errors of y are known: then chi-square tests the
curve.  Without it their common size is estimated from the residuals, as a textbook regression does,
and nothing tests it.  `estim.reports.curve.sample_curve` goes on from here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, finite_or, max_abs, sds_of
from estim.checks import (
    check_consistency,
    check_goodness,
    check_stated_values,
    comparable,
    curve_findings,
    curve_remarks,
    data_remarks,
    deviation_finding,
    failed_tests,
    find_modes,
    same_curve,
    several_solutions,
    stated_values,
    too_many_outliers,
    unsettled_findings,
    values_outside,
    wrong_curves,
)
from estim.common import PROBABILITIES, Amount, Finding, Kind, Status, phrase, split_level, wrong
from estim.curve_fitting.complex_values import ComplexFit, parts_of
from estim.curve_fitting.result import CurveFit, unnamed
from estim.curves import (
    AxisNames,
    Component,
    Counting,
    CurveProblem,
    DataSet,
    JointProblem,
    ParameterSettings,
    in_time,
    join,
    numbered,
    pose_points,
    require_points,
    roughness,
    with_defaults,
    with_joint_priors,
)
from estim.distributions import student_quantile
from estim.fitting import (
    PERFECT,
    Ends,
    ErrorSizes,
    Fit,
    Optimum,
    at_mode,
    chi2_p,
    converged_message,
    error_sizes,
    find_optimum,
    fit_discrepancy,
    fit_least_squares,
    fit_optimum,
    moved_by_integration,
    origin_of,
    pressed_edges,
    profiled,
    sds_near_limits,
    silent_parameters,
    spread,
    unsigned,
    with_other_modes,
)
from estim.given_numbers import are_complex, random_generator
from estim.problem import Problem
from estim.words import describe

_ROUNDS = 60  # of the size of the errors, where priors make it matter
_SETTLED = 1e-7  # standard deviations, between two rounds with the slopes of the curve
# the same where terms of the curve cancel, which leaves it fewer digits; beyond, the curve has too
# few to be one
_NO_SCATTER = 1e-6


def fit_curve(
    curve: str | Callable[..., Any],
    x: ArrayLike,
    y: ArrayLike | None,
    *,
    start: Mapping[str, float] | None = None,
    u_y: ArrayLike | None = None,
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
    priors: Mapping[str, Any] | None = None,
    rng: np.random.Generator | int | None = None,
    cov_y: ArrayLike | None = None,
    u_x: ArrayLike | None = None,
    errors: Sequence[Component] = (),
    units: Mapping[str, str] | None = None,
    axes: AxisNames | None = None,
    scan: bool | None = None,
    fixed: Mapping[str, float] | None = None,
    deviation: float = 0.0,
    correlated: ArrayLike | bool = False,
    noise: Counting | str | None = None,
    derived: Mapping[str, str] | None = None,
    tied: Mapping[str, str] | None = None,
    jitter: Any = False,
    robust: str | None = None,
    cov_x: ArrayLike | None = None,
    r_xy: ArrayLike | None = None,
) -> CurveFit:
    """The curve fit to points x, y (n_obs,) by least squares.

    curve : formula in x and parameters, function curve(x, **parameters) that returns (n_obs,), or
        models by name, like "gaussian + line" (`estim.curves.models`), whose starts are found from
        the points where `start` gives none.
        A formula without x may call its variable t, or as `axes` call it.
    x : (n_obs,), or several abscissas, {"u": u, "v": v} or a data frame, whose names stand in the
        formula; a function is called with the same mapping, or with an array (n_x, n_obs) where
        one was given.  Only parameters in which a formula is linear then need no start, and x has
        neither errors nor an order along which the curve could deviate.
    y : (n_obs,); complex where a function returns complex numbers, whose real and imaginary parts
        are then fit together (`ComplexFit`): u_y is that of each part, or u_re + 1j*u_im.
    start : starting values; without any, a function's numbers by default are those (beside others
        they are held); the order of magnitude and the sign matter.  Those that a formula or models
        by name lack are found from the points; a function needs one for each parameter that is fit.
    u_y : standard uncertainty of y, a number or (n_obs,); or a share, given as text: "15%" is one
        of the curve, sd(y) = 0.15 |f(x)| with its logarithm in the likelihood, and "15% of y" one
        of each reading, 0.15 |y|, which pulls the curve down.  Two rows (2, n_obs) are
        errors below and above, where they differ (`estim.problem.tails`).
    cov_y, cov_x : (n_obs, n_obs) covariance matrices in place of u_y and u_x.  With either beside
        errors of x the curve is taken as straight within these.
    r_xy : correlation of the errors of x and y of the same point, a number or (n_obs,), beside u_x
        and u_y.
    u_x : standard uncertainty of x, a number or (n_obs,), beside u_y; None where x is exact.  The
        true abscissas are integrated out one by one under a normal distribution fitted to the x
        (`estim.problem.errors_in_x_quadrature`); values are the maximum of that likelihood and cov
        its inverse Fisher information.  The curve is evaluated up to 4.8 u_x beside each x; where
        it is not defined there, no true abscissa lies.
    fixed : name -> exact value of each parameter of the curve that is not fit; it has neither start
        nor prior nor uncertainty.
    bounds : name -> (low, high), None for no limit.
    priors : name -> prior (`estim.problem.priors`), text like "9.81(2)", a ufloat, or a frozen
        distribution of scipy.stats (norm, uniform, halfnorm, lognorm, truncnorm, beta).  Several
        measured values that are correlated: {("a", "b"): (means, cov)}, a frozen
        multivariate_normal of scipy.stats in its place, or correlated ufloats one by one.
    errors : errors common to all points (`Component`), fit as further parameters; with `groups`
        those of a part of the points, in the covariance of y.
    units : name -> unit, for tables.
    axes : names and units of x and y (`AxisNames`), for figures, tables and the units of `errors`.
    deviation : how large a smooth deviation of y from the curve would not surprise you (the scale
        of a half-normal prior, unit of y); 0 for none.
    correlated : whether errors of points that follow each other may correlate: True in the order
        given, or their times (n_obs,).  With either, values, sds and intervals are those of a
        mixture over its size and length, linear in the parameters (`estim.discrepancy`).
    noise : what y counts, in place of u_y: "poisson", or `Poisson(bins=...)`,
        `Binomial(trials=...)`, `EventTimes(low, high)` with y = None (`estim.curves.count_data`).
        Intervals are then profiles of the likelihood, and chi2 is the deviance.  `LogDensity()`
        with y = None: the curve is the logarithm of the density of each observation x.
    jitter : whether y has further independent errors beside u_y, whose common standard deviation is
        the parameter "jitter": True where its size is unknown (a flat prior from 0 to the range
        of y), or its prior.  Nothing then tests the size of the errors.
    robust : "student-t" or "mixture" where some points may be far off (`estim.problem.tails`), or a
        law of the errors that an installed package has by that name (docs/extending.md); a mixture
        adds the share of outliers and their width to the parameters.
    tied : name -> formula of the parameters that the curve's parameter of that name follows, like
        {"right_sigma": "left_sigma", "b": "2*a"}; it has neither start nor prior, and is reported
        among what follows from the fit.
    derived : name -> formula of the parameters, like {"g": "4*pi**2/slope"}; a formula may name
        those before it, `units` have its unit.  x, y, u_x, u_y, start, fixed and bounds may be
        quantities of pint: the fit is then in SI base units (`estim.curves.quantities`).
    rng : of the simulated tests, or its seed; None always draws the same.
    scan : whether every nonlinear parameter is scanned for other optima; False takes the one that
        the start leads to.  None: True, but not for differential equations (`estim.ode`).

    Raises InputError where an argument breaks a rule.

    >>> from estim import fit_curve
    >>> fit = fit_curve("a*x + b", [1.0, 2.0, 3.0, 4.0], [2.1, 3.9, 6.2, 7.8], u_y=0.2)
    >>> print(fit)
    a*x + b: ok
    a = 1.94 ± 0.09, 68 % in [1.851, 2.029], 95 % in [1.765, 2.115]
    b = 0.15 ± 0.24, 68 % in [−0.09, 0.39], 95 % in [−0.33, 0.63]
    chi2 = 2.05, dof = 2, p = 0.36; the starting values led to this optimum
    """
    rng = random_generator(rng)
    scan = getattr(curve, "scanned", True) if scan is None else scan
    is_complex = are_complex(y)
    curve, x = (curve, x) if is_complex else numbered(curve, x)
    priors = with_joint_priors(priors)
    starts = with_defaults(curve, start, fixed, tied)
    mappings: Iterable[Any] = (starts, bounds, priors, fixed, tied, derived, units)
    settings = ParameterSettings(*({} if one is None else one for one in mappings))
    curve = in_time(
        curve, getattr(axes, "x_name", ""), settings.start, settings.fixed, bounds, priors, tied
    )
    points = DataSet(x, y, u_y, cov_y, u_x, noise, curve, axes, jitter, robust, cov_x, r_xy)
    posed: CurveProblem | JointProblem
    if is_complex:
        lacking = None if correlated is False else correlated
        of_zero = [one for one in errors if one.kind == "zero_y"]  # which the parts do not share
        zeros = {f"errors[{one.parameter_name}]": one.kind for one in of_zero}
        parts = parts_of(points, deviation=deviation or None, correlated=lacking, **zeros)
        both = {name: pose_points(part, settings, errors) for name, part in parts.items()}
        posed = join(both, own={}, same_size=True)
        require_points(posed.parameters, posed.y.size, stated=posed.stated)
    else:
        posed = pose_points(points, settings, errors, deviation=deviation, correlated=correlated)
        require_points(posed.parameters, posed.x.size, stated=posed.stated)
    if posed.infers_errors:
        problem = (
            posed.with_sigma(1.0)
            if posed.stated
            else posed.with_unknown_sigma(roughness(posed.y, robust=True))
        )
        complete = fit_errors(posed, problem, rng, scan)
    elif posed.stated:
        complete = fit_stated(posed, posed.with_sigma(1.0), rng, scan)
    else:
        complete = _fit_estimated(posed, rng, scan)
    complete = without_fitted_effects(complete)
    if isinstance(posed, JointProblem):
        return ComplexFit(**vars(complete))
    unusable = complete.status in (
        Status.NOT_IDENTIFIED,
        Status.NOT_CONVERGED,
        Status.METHODS_DISAGREE,
    )
    if posed.lacks is None or unusable or not complete.goodness:
        return complete
    return _fit_discrepancy(posed, complete, rng)


def without_fitted_effects(result: CurveFit) -> CurveFit:
    """The fit without the uncertainties of parameters for which it makes a difference whether
    effects that are stated as 0 within an uncertainty are integrated out.
    """
    fit = result.fit
    if fit.singular or not fit.success:
        return result
    spreads, scaled = fit.spreads_and_effects
    influenced = moved_by_integration(fit.posterior, fit.values, fit.cov, spreads)
    if not influenced:
        return result
    effects = tuple(sorted({split_level(name)[0] for name in scaled}))
    findings = wrong(
        [
            *result.findings,
            *(
                Finding(Kind.EFFECTS_FITTED, size=shift, parameters=(Amount(name),), names=effects)
                for name, shift in influenced.items()
            ),
        ]
    )
    unknown = dict.fromkeys(PROBABILITIES, (math.nan, math.nan))
    return replace(
        result,
        sds={**result.sds, **dict.fromkeys(influenced, math.nan)},
        intervals={**result.intervals, **dict.fromkeys(influenced, unknown)},
        findings=findings,
        complete=False,
    )


def fit_stated(
    posed: CurveProblem | JointProblem,
    problem: Problem,
    rng: np.random.Generator,
    scan: bool,
    start: FloatArray | None = None,
) -> CurveFit:
    """The fit of points whose errors are stated.  start : (n_par,) where to begin; else where the
    problem does, and once more where profiles then meet a better point.
    """
    begin = problem.start() if start is None else start
    best = find_optimum(problem, begin, rng=rng, scan=scan)
    rounds = _ROUNDS if any(run.noise.holds_slopes for run in problem.runs) else 0
    for _ in range(rounds):
        before, best = best.values, _on(problem, best, rng, unstated=False)
        moved = np.abs(best.values - before)
        if np.all(moved <= _SETTLED * sds_of(best.cov)):
            break
    fit = _whole_fit(problem, best.values, best)
    concluded = _concluded(posed, best, problem, fit, fit, rng=rng)
    better = _better_point(concluded.findings) if start is None else None
    return concluded if better is None else fit_stated(posed, problem, rng, scan, better)


def _better_point(findings: Sequence[Finding]) -> FloatArray | None:
    """(n_par,) where profiles met a higher density than that of the fit, if they did."""
    for finding in findings:
        if finding.kind is Kind.BETTER_ELSEWHERE:
            return np.array([amount.value for amount in finding.parameters])
    return None


def _fit_estimated(
    posed: CurveProblem | JointProblem, rng: np.random.Generator, scan: bool
) -> CurveFit:
    """The fit whose residuals show how large the errors are; with informative priors, in rounds
    until that size settles.
    """
    pulled = any(p.prior.informative for p in posed.parameters)
    sigma = float(np.std(posed.y)) or 1.0 if pulled else 1.0
    problem = posed.with_sigma(sigma)
    best = find_optimum(problem, problem.start(), rng=rng, scan=scan, unstated=True)
    for _ in range(_ROUNDS if pulled else 0):
        before, sigma = sigma, _residual_sd(posed, problem, best)
        problem = posed.with_sigma(sigma)
        best = _on(problem, best, rng, unstated=True)
        if abs(sigma / before - 1.0) < 1e-10:
            break
    estimated = _residual_sd(posed, problem, best)
    fit = _whole_fit(posed.with_unknown_sigma(estimated), np.append(best.values, estimated), best)
    held = replace(at_mode(posed.with_sigma(estimated), best.values), symmetry=best.symmetry)
    scale = 1.0 if pulled else estimated
    return _concluded(posed, best, problem, fit, held, sigma=estimated, scale=scale, rng=rng)


def _on(problem: Problem, first: Optimum, rng: np.random.Generator, *, unstated: bool) -> Optimum:
    """The optimum from `first` on, with what was learnt there of others."""
    best = find_optimum(problem, first.values, rng=rng, scan=False, unstated=unstated)
    return replace(
        best,
        from_start=first.from_start,
        others=first.others,
        symmetry=first.symmetry,
        aliases=first.aliases,
        unheld=first.unheld,
    )


def fit_errors(
    posed: CurveProblem | JointProblem,
    problem: Problem,
    rng: np.random.Generator,
    scan: bool,
    start: FloatArray | None = None,
) -> CurveFit:
    """The fit of a curve together with what is unknown of its errors, or with errors that leave
    room for outliers: the mode, its curvature, and profiles.  start : as of `fit_stated`.
    """
    fit = fit_optimum(problem, rng=rng, scan=scan, start=start)
    values = dict(zip(fit.names, fit.values.tolist(), strict=True))
    nothing = dict.fromkeys(PROBABILITIES, (math.nan, math.nan))
    intervals: Mapping[str, Ends] = dict.fromkeys(fit.names, nothing)
    sds, cov = fit.sds, fit.cov
    findings: list[Finding | None] = []
    if fit.singular or not fit.success:
        mover = fit.mover or fit.names[0]
        findings += unsettled_findings(
            fit,
            silent_parameters(fit) if fit.singular else (mover,),
            Finding(Kind.STEP_UNSETTLED, size=fit.moved, parameters=(Amount(mover),)),
            singular=fit.singular,
        )
    else:
        sizes = error_sizes(fit)
        intervals, left_open = profiled(fit, sizes)
        if start is None and (better := _better_point(left_open)) is not None:
            return fit_errors(posed, problem, rng, scan, better)
        findings += [*left_open, *values_outside(values, intervals)]
        wider = _profiled_over_curvature(fit, intervals, sizes)
        folded = [0.0 in intervals[name][PROBABILITIES[-1]] for name in fit.names]
        sds = np.where(folded & unsigned(fit), np.nan, sds * wider)
        cov = cov * np.outer(wider, wider)
    goodness = () if fit.singular else check_goodness(fit, rng=rng)
    if fit.others.size:
        findings += several_solutions(fit, find_modes(fit))
    findings += [
        fit.unheld,
        *pressed_edges(fit, Kind.PRESSED_LIMIT),
        *failed_tests(goodness, dof=fit.dof),
        *_disagreement(fit),
        *too_many_outliers(fit),
        None if fit.singular else stated_values(fit, check_stated_values(fit)),
    ]
    reported = unnamed(wrong([finding for finding in findings if finding is not None]), fit)
    return CurveFit(
        names=fit.names,
        values=values,
        sds=dict(zip(fit.names, sds.tolist(), strict=True)),
        intervals=intervals,
        cov=cov,
        chi2=fit.chi2,
        dof=fit.dof,
        p_value=fit.p_value,
        sigma=None,
        findings=reported,
        seen=unnamed(data_remarks(fit.problem.runs), fit),
        complete=False,
        message="; ".join([fit.message, *_notes(fit.problem)]),
        goodness=goodness,
        fit=fit,
        held=fit,
        text=posed.text,
        fixed=posed.fixed,
        called=posed.called or posed.text,
    )


def _disagreement(fit: Fit) -> list[Finding]:
    """That data sets disagree about what they share, if they do."""
    consistency = check_consistency(fit) if comparable(fit) else None
    return [] if consistency is None or consistency.agree else [consistency.finding]


def _profiled_over_curvature(
    fit: Fit, intervals: Mapping[str, Ends], sizes: ErrorSizes
) -> FloatArray:
    """(n_par,) how much wider a standard deviation is by the 68 % interval of its parameter, which
    is Student's, than by the curvature at the mode; 1 for parameters of the errors, where a limit
    cuts the interval short, and never beyond what a prior says alone.

    The curvature ignores the degrees of freedom that the curve's parameters take from the
    size of the errors (of a line through five points: 0.77 of its standard deviation), nor of
    readings that change between good ones and outliers.
    """
    dof = sizes.degrees_of_freedom(sizes.shares(np.eye(len(fit.names))))
    quantile = student_quantile(0.5 + 0.5 * PROBABILITIES[0], dof)
    low, high = np.array([intervals[name][PROBABILITIES[0]] for name in fit.names]).T
    with np.errstate(all="ignore"):
        ratio = 0.5 * (high - low) / (quantile * fit.sds)
        alone = np.array([p.prior.sd for p in fit.problem.parameters]) / fit.sds
    of_curve = [name not in fit.problem.noise_names for name in fit.names]
    ratio = np.minimum(ratio, finite_or(alone, math.inf))
    return np.where(np.isfinite(ratio) & (ratio > 1.0) & of_curve, ratio, 1.0)


def _fit_discrepancy(posed: CurveProblem, complete: CurveFit, rng: np.random.Generator) -> CurveFit:
    """The fit of a curve that may lack something, from the one `complete` that takes it as it
    is.
    """
    problem = posed.with_sigma(complete.sigma or 1.0)
    problem = replace(problem, runs=(replace(problem.runs[0], lacks=posed.lacks),))
    start = np.array([complete.values[p.name] for p in problem.parameters])
    fit = fit_discrepancy(fit_least_squares(problem, start=start))
    fit = replace(fit, symmetry=complete.held.symmetry, aliases=complete.fit.aliases)
    (deviation,) = fit.deviations
    goodness = check_goodness(fit, rng=rng)
    solutions = [f for f in complete.findings if f.kind is Kind.SEVERAL_SOLUTIONS]
    values, names = np.clip(deviation.mean, *problem.support()).tolist(), fit.names
    outside = values_outside(dict(zip(names, values, strict=True)), deviation.intervals)
    findings = wrong(
        [
            *solutions,
            *outside,
            *pressed_edges(fit, Kind.PRESSED_LIMIT),
            *failed_tests(goodness, dof=fit.dof),
            *wrong_curves(fit.deviations),
            stated_values(fit, check_stated_values(fit)),
        ]
    )
    findings = unnamed(findings, fit)
    about = deviation_finding(deviation, x_unit=posed.axes.x_unit, y_unit=posed.axes.y_unit)
    sds, near = sds_near_limits(deviation, problem)
    return replace(
        complete,
        values=dict(zip(names, values, strict=True)),
        sds=dict(zip(names, sds.tolist(), strict=True)),
        intervals=deviation.intervals,
        cov=deviation.cov,
        chi2=fit.chi2,
        p_value=fit.p_value,
        sigma=None if complete.sigma is None else deviation.noise[1],
        findings=findings,
        seen=unnamed([*near, about], fit),
        goodness=goodness,
        fit=fit,
    )


def _squares(problem: Problem, values: FloatArray) -> float:
    """Sum of the squares of y - f, unit of y."""
    named = problem.named(values)
    return float(sum(np.sum((run.y - run.drawn(named)) ** 2) for run in problem.runs))


def _residual_sd(posed: CurveProblem | JointProblem, problem: Problem, best: Optimum) -> float:
    """Square root of the residuals' squares over the degrees of freedom, no smaller than rounding
    errors of y.
    """
    pulls = np.array([p.prior.informative for p in problem.parameters])
    dof = max(1, problem.n_obs - int(np.sum(~(best.at_bound | pulls))))
    return max(math.sqrt(_squares(problem, best.values) / dof), _floor(posed))


def _floor(posed: CurveProblem | JointProblem) -> float:
    return PERFECT * (max_abs(posed.y) or 1.0)


def _concluded(
    posed: CurveProblem | JointProblem,
    best: Optimum,
    problem: Problem,
    fit: Fit,
    held: Fit,
    *,
    sigma: float | None = None,
    scale: float = 1.0,
    rng: np.random.Generator,
) -> CurveFit:
    """The record of an optimum of `problem`, whose covariance is to be multiplied by scale^2.

    fit : what the tests and the sampler take, with the size of the errors unknown if it was not
        stated, but estimated as `sigma`; held : the same with errors of that size.
    """
    squares, dof = _squares(problem, best.values), held.dof
    chi2 = fit.chi2 if sigma is None else squares
    cancelled = (
        squares <= _NO_SCATTER**2 * float(np.sum(posed.y**2))
        and float(np.sum(problem.linearised(best.values).residuals_at(best.values[None, :]) ** 2))
        <= best.rounding
    )
    perfect = not problem.own_density and (
        cancelled or squares <= problem.n_obs * _floor(posed) ** 2
    )
    p_value = (
        chi2_p(chi2, dof) if sigma is None and dof > 0 and not problem.own_density else math.nan
    )
    uncertainty = spread(
        held,
        best,
        dof=math.inf if sigma is None else dof,
        scale=scale,
        unknown=perfect and sigma is not None,
    )
    tested = dof >= 1 and not perfect and not best.singular
    goodness = check_goodness(fit, rng=rng) if tested else ()
    # chi^2 is only nearly what it is called; of several data sets there is no test of them all
    unlike = any(run.noise.sides is None for run in fit.problem.runs) and any(
        item.normal is None for item in fit.posterior.likelihoods
    )
    p_below = math.nan if unlike else 1.0 - p_value
    if len(goodness) == 1 and unlike and (check := goodness[0].checks.get("chi2")) is not None:
        p_value, p_below = check.p_value, check.p_below
    conflict = None if best.singular else check_stated_values(fit)
    solutions = several_solutions(fit, find_modes(fit)) if fit.others.size else []
    stated = [] if conflict is None else [stated_values(fit, conflict)]
    values = dict(zip(held.names, best.values.tolist(), strict=True))
    outside = values_outside(values, uncertainty.intervals)
    about = curve_findings(
        held, best, p_value, chi2, dof, goodness, estimated=sigma is not None, perfect=perfect
    )
    disagreements = [] if best.singular else _disagreement(fit)
    findings = unnamed(
        wrong([*solutions, *outside, *uncertainty.open, *about, *disagreements, *stated]), fit
    )
    remarks = curve_remarks(
        fit, best, p_below, chi2, dof, goodness, stated=sigma is None, perfect=perfect
    )
    modelled = isinstance(posed, CurveProblem) and posed.lacks is not None
    return CurveFit(
        names=held.names,
        values=values,
        sds=dict(zip(held.names, uncertainty.sds.tolist(), strict=True)),
        intervals=uncertainty.intervals,
        cov=uncertainty.cov,
        chi2=chi2,
        dof=dof,
        p_value=p_value,
        sigma=sigma,
        findings=findings,
        seen=unnamed([*uncertainty.notes, *remarks], fit),
        complete=not (findings or perfect or modelled or problem.own_density),
        message=_message(best, sigma, perfect, [*map(describe, same_curve(fit)), *_notes(problem)]),
        goodness=goodness,
        fit=fit,
        held=held,
        text=posed.text,
        fixed=posed.fixed,
        called=posed.called or posed.text,
    )


def _whole_fit(problem: Problem, values: FloatArray, best: Optimum) -> Fit:
    """The optimum of a search as a fit of `problem` at the same `values` (n_par,)."""
    led = origin_of(best)
    outcome = converged_message(led) if best.settled else phrase("did not converge; {led}", led=led)
    fit = replace(at_mode(problem, values), success=best.settled, message=outcome)
    return with_other_modes(fit, best)


def _notes(problem: Problem) -> list[str]:
    """The notes of all runs, each once."""
    return [*dict.fromkeys(words for run in problem.runs for words in run.notes)]


def _message(best: Optimum, sigma: float | None, perfect: bool, further: list[str]) -> str:
    words = [origin_of(best), *further]
    if perfect:
        words.append(phrase("the curve passes through every point within rounding error"))
    elif sigma is not None:
        words.append(phrase("the size of the errors was estimated from the residuals"))
    return "; ".join(words)
