"""The record of a user's own curve, fitted (`fit_curve` makes it): values, intervals, status, and
how a person reads them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, all_finite, sds_of
from estim.checks import P_FLOOR, Goodness, unasked
from estim.common import (
    Finding,
    InputError,
    Kind,
    Status,
    code,
    decide,
    format_p,
    markdown,
    number,
    one_line,
    phrase,
    require_one_of,
    signed,
    table,
)
from estim.curve_fitting.figures import ConfidenceRegion, Prediction, curve_figure, region_of
from estim.curves import are_abscissas, at_abscissas, refuse_quantities
from estim.discrepancy import FoundDeviation
from estim.distributions import student_quantile
from estim.fitting import (
    FEW,
    Ends,
    ErrorSizes,
    Fit,
    LinearDerived,
    contour,
    error_sizes,
    fixed_size,
    linear_derived,
    profile_intervals,
    shown_value,
)
from estim.given_numbers import check_probability, real_numbers
from estim.problem import Observations, Problem
from estim.words import advice, advice_for, describe

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# of which a reason says what to do as well
_ADVISED = (
    Kind.SEVERAL_SOLUTIONS,
    Kind.STEP_UNSETTLED,
    Kind.ROUNDING,
    Kind.HARDLY_HELD,
    Kind.STEPS_OPEN,
    Kind.EFFECTS_FITTED,
)
# which refer a reader to the interval of a parameter
_TO_INTERVAL = (Kind.AT_LIMIT, Kind.NEAR_LIMIT, Kind.CUT_BY_LIMIT, Kind.CUT_BY_NONE, Kind.LOPSIDED)
_WITH_NUMBERS = (Status.OK, Status.POOR_FIT, Status.AT_BOUND)
_TOLD_CORRELATION = 0.1
_ALONG = 401  # points along a drawn curve
_TITLE = 60  # marks of a formula that a title has room for


@dataclass(frozen=True, eq=False)
class CurveFit:
    """A fitted curve.

    names : of the parameters, shared errors included.
    values, sds : name -> best value and standard deviation (nan where a symmetric one would be
        wrong: at a limit, where the data determine nothing or have no scatter; `notes` says which).
    intervals : name -> probability (0.68, 0.95) -> (low, high), by Student's t where the size of
        the errors was estimated, by profiles beside a limit (`estim.fitting.curve_intervals`); an
        end at the limit itself is open.  nan where there is none.
    cov : (n_par, n_par) covariance matrix in the order of `names`.
    chi2 : squared residuals over u_y, priors included; without u_y the plain sum of squared
        residuals (unit of y squared); of a log density -2 log L.  With u_x a residual is the normal
        score of y, F^-1(P(Y < y | x)); for a line (y - f)/sqrt(u_y^2 + b^2 u_x^2) but for the
        shrinking of x.
    dof : points and informative priors minus parameters.
    p_value : P(chi2 or more), nan without u_y; with u_x from simulated data
        sets.
    sigma : standard deviation of one y estimated from the residuals, of its independent part beside
        correlated errors or a deviation; None where u_y was given.
    findings : everything wrong, gravest first.
    seen : what to know before using it, nothing wrong.  complete : whether the curve is taken as it
        is: `remarks` then say how probable it is that it lacks a term, too.
    reasons, notes : findings and remarks in words.
    message : how the search went.
    goodness : tests of the residuals, in order of x; empty where the points are too few.
    text : the formula, or how the function is called.
    called : "gaussian + line" where the curve was given by name, else the same.
    fixed : name -> exact value of the parameters that were not fit.
    fit, problem : what sampling starts from; without u_y `problem` has `sigma_y` as a further
        parameter.
    held : the same optimum with errors of a fixed size, that of the residuals without u_y.

    >>> from estim import fit_curve
    >>> fit = fit_curve("a*x + b", [0, 1, 2, 3, 4], [1.0, 3.1, 4.9, 7.2, 9.0], u_y=0.1)
    >>> fit.status, fit.names, round(fit.values["a"], 2)
    ('ok', ('a', 'b'), 2.01)
    >>> float(fit.predict([2.5]).value[0].round(2))
    6.04
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
    findings: tuple[Finding, ...]
    seen: tuple[Finding, ...]
    complete: bool
    message: str
    goodness: tuple[Goodness, ...]
    fit: Fit
    held: Fit
    text: str
    fixed: Mapping[str, float]
    called: str

    @property
    def status(self) -> Status:
        """What follows from the findings, "ok" where there are none."""
        return decide(self.findings)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Everything wrong, a sentence each, gravest first; empty where the status is ok."""
        return tuple(
            f"{describe(f)}; {advice(f)}" if f.kind in _ADVISED else describe(f)
            for f in self.findings
        )

    @property
    def advice(self) -> tuple[str, ...]:
        """What to do where the residuals have a pattern."""
        return tuple(advice_for(f for f in self.findings if f.kind is Kind.CURVE_LACKS))

    @property
    def deviation(self) -> FoundDeviation | None:
        """What the curve lacks, where `deviation` or `correlated` was given."""
        return next(iter(self.fit.deviations), None)

    @cached_property
    def remarks(self) -> tuple[Finding, ...]:
        """What to know before using it, nothing wrong."""
        lacking = unasked(self.fit) if self.complete else []
        untested = [Finding(Kind.NOT_TESTABLE)] if self.problem.own_density else []
        seen = (f for f in self.seen if f.kind not in _TO_INTERVAL or self._has_interval(f))
        return (*seen, *lacking, *untested)

    def _has_interval(self, finding: Finding) -> bool:
        """Whether the parameter of a finding has an interval that a reader sees."""
        ends = self.intervals[finding.parameters[0].name].values()
        return self.status in _WITH_NUMBERS and not np.isnan([*ends]).all()

    @property
    def notes(self) -> tuple[str, ...]:
        """What to know before using it, a sentence each."""
        return tuple(map(describe, self.remarks))

    @property
    def problem(self) -> Problem:
        """Points, parameters and priors, as they were fitted."""
        return self.fit.problem

    @cached_property
    def derived(self) -> Mapping[str, LinearDerived]:
        """Name -> what follows from the parameters by the formulas `derived`, linear about the fit;
        `sample_curve` computes it from draws.
        """
        unknown = [name for name, sd in self.sds.items() if not math.isfinite(sd)]
        values = np.array([self.values[name] for name in self.names])
        quantities: dict[str, LinearDerived] = {}
        for run in self.problem.runs:
            across = {formula.name for formula in run.sought if formula.others}
            for quantity in linear_derived(
                run,
                self.names,
                values,
                self.cov,
                sizes=self._sizes,
                unknown=unknown,
                intervals=self.intervals,
            ):
                of_run = quantity.name not in across and any(
                    "[" in name
                    for name, slope in zip(self.names, quantity.gradient, strict=True)
                    if slope != 0.0
                )
                quantities.setdefault(
                    f"{quantity.name}[{run.name}]" if of_run else quantity.name, quantity
                )
        return quantities

    def __call__(self, x: ArrayLike, *, data: str | None = None) -> FloatArray:
        """The fitted curve at x, shaped as x, or (n,) at n places of several abscissas.

        data : as in `predict`.
        """
        refuse_quantities(x=x)
        if isinstance(x, Mapping) or self._run(data).numbered:
            return self.predict(x, data=data).value
        return self.predict(np.ravel(x), data=data).value.reshape(np.shape(x))

    @cached_property
    def residuals(self) -> FloatArray:
        """(n_obs,) y - f, unit of y, in the order of the points as they were given, data sets below
        each other; of single events, of their cells.
        """
        parts = []
        for run in self.problem.runs:
            self._require_readings(run, "residuals")
            y_minus_f = run.y - run.drawn(self.values)
            if run.order is not None:
                y_minus_f[run.order] = y_minus_f.copy()
            parts.append(y_minus_f)
        return np.concatenate(parts)

    def predict(
        self, x: ArrayLike, *, probability: float = 0.95, data: str | None = None
    ) -> Prediction:
        """The curve at x, a number or (n,), with the uncertainty of its parameters (linear; JCGM
        100:2008, 5.2.2), not the scatter of a new reading.

        x : of a curve of several abscissas, these, as `fit_curve` takes them.
        probability : of the interval low to high, by Student's t where the size of the errors was
            estimated.
        data : name of the data set, where several were fit together.  Raises InputError.
        """
        refuse_quantities(x=x)
        run = self._run(data)
        if run.numbered or are_abscissas(x):
            curve, abscissas = at_abscissas(run.curve, x)
            return self._predicted(replace(run, curve=curve), abscissas, probability)
        abscissas = np.atleast_1d(real_numbers(x, "x"))
        if abscissas.ndim != 1 or not all_finite(abscissas):
            raise InputError("must be finite numbers along one axis", field="x", value=x)
        return self._predicted(run, abscissas, probability)

    def _predicted(
        self, run: Observations, abscissas: FloatArray, probability: float
    ) -> Prediction:
        check_probability(probability)
        value = np.array(run.drawn(self.values, abscissas))
        gradient = replace(run.points, x=abscissas).gradient(self.values, self.names)
        # the curve is known as well whatever its parameters are: exp(b) in place of a
        lopsided = {f.parameters[0].name for f in self.seen if f.kind is Kind.LOPSIDED}
        of_curve = set(self.names) - self.problem.noise_names - lopsided
        known = self.status.ok and all(math.isfinite(self.sds[name]) for name in of_curve)
        u = (
            np.sqrt(np.einsum("ni,ij,nj->n", gradient, self.cov, gradient))
            if known
            else np.full(abscissas.size, np.nan)
        )
        dof = self._sizes.degrees_of_freedom(self._sizes.shares(gradient))
        half = student_quantile(0.5 + 0.5 * probability, dof) * u
        return Prediction(abscissas, value, u, value - half, value + half)

    def plot(
        self, figure: Figure | None = None, *, ax: Axes | None = None, data: str | None = None
    ) -> Figure:
        """Points with their errors, the curve with its 68 % and 95 % bands, and the residuals in
        the unit of y; of a curve of several abscissas, against the fitted value, without bands.

        figure : to draw in, as from `matplotlib.pyplot.figure`; a new one if None, which a notebook
            shows and `savefig` writes.
        ax : axes of a figure of the user's own to draw points and curve in, without residuals.
        data : name of the data set, where several were fit together.  A curve whose status is not
            ok has no band.
        """
        run = self._run(data)
        self._require_readings(run, "plot")
        ends = (run.noise.counted.bins if run.noise.counted is not None else None, run.x)
        low, high = (float(f(next(e for e in ends if e is not None))) for f in (np.min, np.max))
        edges = run.noise.counted is not None or run.spread_in_decades
        room = 0.0 if edges else 0.02 * (high - low)
        x = run.along(low - room, high + room, _ALONG)
        outer, inner = (self._predicted(run, x, p) for p in (0.95, 0.68))
        fitted = run.drawn(self.values)
        gain = np.zeros(run.n_obs) if run.noise.counted is not None else run.noise.reading_gain()
        gain = share * np.abs(fitted) if (share := run.noise.share) else gain
        if run.numbered:
            run, nan = run.against_fit(fitted), np.full(run.n_obs, np.nan)
            outer = inner = Prediction(fitted, fitted, nan, nan, nan)
        one_curve = ";" not in self.called  # of data sets with curves of their own
        return curve_figure(
            run,
            fitted,
            outer,
            inner,
            sd=gain * (1.0 if self.sigma is None else self.sigma),
            sd_x=run.noise.x_gain(),
            title=": ".join(
                [
                    *([data] if data else []),
                    *([self.called] if len(self.called) <= _TITLE and one_curve else []),
                    str(self.status),
                ]
            ),
            figure=figure,
            ax=ax,
        )

    def contour(
        self, a: str, b: str, *, probabilities: tuple[float, ...] = (0.68, 0.95)
    ) -> ConfidenceRegion:
        """Where the parameters a and b lie together, by profiles of the likelihood, beside the
        ellipses of the linear theory.

        A notebook shows it; `.plot()` draws it.  Raises InputError for unknown names, and where the
        status is not ok or the curve may lack something (`deviation`, `correlated`): then no region
        would have its stated coverage.
        """
        self._require_profiles("contour")
        profile = contour(self.held, a, b, probabilities, sizes=self._sizes)
        at = [self.names.index(name) for name in (a, b)]
        known = {p.name: p.label for p in self.problem.parameters}
        return region_of(
            profile,
            best=np.array([self.values[a], self.values[b]]),
            cov=self.cov[np.ix_(at, at)],
            labels=(known[a], known[b]),
        )

    def profile_interval(self, name: str, *, probability: float = 0.95) -> tuple[float, float]:
        """Where the parameter `name` lies with that probability, by the profile of the likelihood
        and priors: every other parameter is fitted anew for each of its values.

        An end is a limit, or infinite, where nothing closes that side.  Raises InputError for an
        unknown name, and where `contour` does.
        """
        self._require_profiles("profile_interval")
        (interval,) = profile_intervals(
            self.held, names=[name], probabilities=(probability,), sizes=self._sizes
        )
        return interval.low[probability], interval.high[probability]

    def _require_profiles(self, field: str) -> None:
        """Raises InputError where a region of the profile would not have its stated coverage."""
        if not self.status.ok:
            rule = f"needs a fit with status ok, not {self.status}: its region would not have its "
            raise InputError(f"{rule}nominal coverage", field=field)
        if self.deviation is not None:
            rule = "is not available with 'deviation' or 'correlated': use fit.cov, or sample_curve"
            raise InputError(rule, field=field)

    def ufloats(self) -> dict[str, Any]:
        """Name -> `ufloat` of the package uncertainties, correlated as the parameters are, so that
        what is computed from several of them has the right uncertainty; of what is derived or tied
        too, linear in the parameters.

        Raises InputError where the status is not ok or a parameter has no standard deviation.
        """
        from uncertainties import correlated_values

        if not self.status.ok or not all(map(math.isfinite, self.sds.values())):
            missing = [name for name, sd in self.sds.items() if not math.isfinite(sd)]
            what = f"{', '.join(missing)} has none" if self.status.ok else f"status {self.status}"
            raise InputError(
                f"need a standard deviation of every parameter ({what})", field="ufloats"
            )
        numbers = correlated_values([self.values[name] for name in self.names], self.cov)
        deviations = np.array([number - number.nominal_value for number in numbers])
        following = {name: d.value + d.gradient @ deviations for name, d in self.derived.items()}
        return dict(zip(self.names, numbers, strict=True)) | following

    def quantities(self, registry: Any) -> dict[str, Any]:
        """The same numbers as quantities of a unit registry of the package pint, each in its unit:
        `fit.quantities(registry)["tau"].to("ms")`.

        Raises InputError where `ufloats` does, and where the registry does not know a unit.
        """
        units = self._units | {name: quantity.unit for name, quantity in self.derived.items()}
        known = {}
        for name, value in self.ufloats().items():
            try:
                known[name] = registry.Quantity(value, units[name])
            except Exception as error:  # whatever a registry raises
                rule = f"has a unit that the registry does not know: {error}"
                raise InputError(rule, field=name, value=units[name]) from None
        return known

    def to_dict(self) -> dict[str, Any]:
        """The result as numbers, texts, lists and mappings, which `json.dumps` takes: a number that
        there is not is None.
        """
        units = self._units
        parameters = {
            name: {
                "value": self.values[name],
                "sd": number(self.sds[name]),
                "unit": units[name],
                "intervals": {
                    f"{p:g}": list(map(number, ends)) for p, ends in self.intervals[name].items()
                },
            }
            for name in self.names
        }
        derived = {
            name: {"value": quantity.value, "sd": number(quantity.sd), "unit": quantity.unit}
            for name, quantity in self.derived.items()
        }
        return {
            "curve": self.called,
            "status": str(self.status),
            "reasons": list(self.reasons),
            "notes": list(self.notes),
            "parameters": parameters,
            "derived": derived,
            "fixed": dict(self.fixed),
            "covariance": [list(map(number, row)) for row in self.cov.tolist()],
            "chi2": self.chi2,
            "dof": self.dof,
            "p_value": number(self.p_value),
            "sigma": self.sigma,
            "n_obs": self.problem.n_obs,
        }

    def to_frame(self) -> pd.DataFrame:
        """The parameters as a table of pandas, a row each: value, sd, ends of the intervals, unit.

        Raises InputError where pandas is missing.
        """
        try:
            from pandas import DataFrame
        except ImportError:
            raise InputError('needs pandas: pip install "estim[arviz]"', field="to_frame") from None
        units = self._units
        rows = {
            name: {"value": self.values[name], "sd": self.sds[name]}
            | {
                f"{side} {100 * p:.0f} %": end
                for p, ends in self.intervals[name].items()
                for side, end in zip(("low", "high"), ends, strict=True)
            }
            | {"unit": units[name]}
            for name in self.names
        }
        frame = DataFrame.from_dict(rows, orient="index")
        frame.index.name = "parameter"
        frame.attrs.update(curve=self.called, status=str(self.status), reasons=list(self.reasons))
        return frame

    @property
    def aic(self) -> float:
        """Akaike's criterion -2 ln L + 2 k; k counts an estimated size of the errors.  nan beside
        informative priors, which it does not know.
        """
        return self._criterion(2.0)

    @property
    def bic(self) -> float:
        """Schwarz's criterion -2 ln L + k ln n."""
        return self._criterion(math.log(self.problem.n_obs))

    @property
    def r_squared(self) -> float:
        """Share of the scatter of y about the mean of its data set that the curve explains,
        unweighted; no test of the curve.
        """
        if self.problem.own_density:
            return math.nan
        total = sum(run.n_obs * float(np.var(run.y)) for run in self.problem.runs)
        squares = float(np.sum(np.abs(self.residuals) ** 2))
        return 1.0 - squares / total if total > 0.0 else math.nan

    def summary(self) -> str:
        """What `print` shows, with criteria for comparing curves on the same points, and
        correlations (where the status is ok).
        """
        criteria = f"AIC = {self.aic:.6g}, BIC = {self.bic:.6g}, R2 = {self.r_squared:.6g}"
        lines = [str(self), f"{criteria}, {phrase('{n} points', n=self.problem.n_obs)}"]
        matrix = self.correlation
        pairs = [
            (float(matrix[i, j]), f"{a}, {b}")
            for i, a in enumerate(self.names)
            for j, b in enumerate(self.names[:i])
        ]
        correlations = sorted(
            (pair for pair in pairs if abs(pair[0]) >= _TOLD_CORRELATION),
            key=lambda pair: -abs(pair[0]),
        )
        if self.status.ok and correlations:
            lines.append(
                phrase("correlations (those below {size} are omitted):", size=_TOLD_CORRELATION)
            )
            lines += [f"  {names}: {signed(f'{r:+.3f}')}" for r, names in correlations]
        return "\n".join(lines)

    def _run(self, data: str | None) -> Observations:
        runs = {run.name: run for run in self.problem.runs}
        if data is None and len(runs) == 1:
            return self.problem.runs[0]
        require_one_of(data, runs, field="data")
        return runs[str(data)]

    def _require_readings(self, run: Observations, field: str) -> None:
        if run.noise.own_density:
            raise InputError(
                "needs readings about a curve, and a log density has none", field=field
            )

    def _criterion(self, weight: float) -> float:
        n, k = self.problem.n_obs, len(self.names)
        if any(p.prior.informative for p in self.problem.parameters if p.name in self.names):
            return math.nan
        if self.sigma is not None and self.deviation is None:
            return (
                n * (math.log(2.0 * math.pi * self.chi2 / n) + 1.0) + weight * (k + 1)
                if self.chi2 > 0.0
                else -math.inf
            )
        return -2.0 * self._log_likelihood + weight * k

    @property
    def _log_likelihood(self) -> float:
        return float(self.fit.posterior.log_likelihood(self.fit.values[None, :])[0])

    @property
    def _units(self) -> dict[str, str]:
        return {p.name: p.unit for p in self.problem.parameters}

    @cached_property
    def _sizes(self) -> ErrorSizes:
        if self.sigma is None or self.deviation is not None:
            return error_sizes(self.held)
        return fixed_size(self.dof)

    @property
    def correlation(self) -> FloatArray:
        """(n_par, n_par) correlation matrix; nan beside a parameter without a standard
        deviation.
        """
        sds = sds_of(self.cov)
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.cov / np.outer(sds, sds)

    def __str__(self) -> str:
        width = max(map(len, (*self.names, *self.derived)))
        rows = [
            f"{name:<{width}} {f'{relation} {value}'.strip()}"
            for name, (relation, value) in self._rows()
        ]
        head = [f"{self.called}: {self.status}", *(f"  {reason}" for reason in self.reasons)]
        head += [f"  {phrase('what to do: {words}', words=words)}" for words in self.advice]
        lines = [
            *head,
            *rows,
            *self._fixed_words(),
            *(phrase("note: {words}", words=note) for note in self.notes),
        ]
        return "\n".join(map(one_line, [*lines, self._summary()]))

    def __repr__(self) -> str:
        return str(self)

    def _repr_markdown_(self) -> str:
        head = [
            f"{code(self.called)}: **{self.status}**",
            *(f"- {markdown(reason)}" for reason in self.reasons),
        ]
        head += [f"- {phrase('What to do:')} {markdown(words)}" for words in self.advice]
        rows = [(name, value) for name, (_, value) in self._rows()]
        lines = (
            ["", table((phrase("parameter"), phrase("value and intervals")), rows)] if rows else []
        )
        notes = [
            *self._fixed_words(),
            *(phrase("Note: {words}", words=note) for note in self.notes),
        ]
        return "\n".join(
            [
                *head,
                *lines,
                "",
                *(f"- {markdown(note)}" for note in notes),
                "",
                markdown(self._summary()),
            ]
        )

    def _fixed_words(self) -> list[str]:
        return [f"{name} = {value:.10g} ({phrase('fixed')})" for name, value in self.fixed.items()]

    def _rows(self) -> list[tuple[str, tuple[str, str]]]:
        """Name, and relation and value in words; limits where the curve or an edge is contradicted,
        nothing where no number is a result.
        """
        if self.status not in _WITH_NUMBERS:
            return []
        shares = self._sizes.shares(np.eye(len(self.held.names)))
        dofs = dict(
            zip(self.held.names, self._sizes.degrees_of_freedom(shares).tolist(), strict=True)
        )
        least, anywhere = min(dofs.values(), default=math.inf), (-math.inf, math.inf)
        priors, units = {p.name: p.prior for p in self.problem.parameters}, self._units
        rows = [
            (
                name,
                shown_value(
                    self.values[name],
                    self.sds[name],
                    self.intervals[name],
                    (priors[name].low, priors[name].high),
                    unit=_shown(units[name]),
                    few=dofs[name] <= FEW,
                    ok=self.status.ok,
                ),
            )
            for name in self.names
        ]
        for name, d in self.derived.items():
            relation, text = shown_value(
                d.value,
                d.sd,
                d.interval,
                anywhere,
                unit=_shown(d.unit),
                few=least <= FEW,
                ok=self.status.ok,
            )
            how = phrase(
                "derived, linear"
                if math.isfinite(d.interval[0.95][0])
                else "derived; sample_curve can provide one"
            )
            rows.append((name, (relation, f"{text} ({how})")))
        return rows

    def _summary(self) -> str:
        if self.problem.own_density:
            value = phrase("log-likelihood = {value:.6g}", value=self._log_likelihood)
            return f"{value}; {self.message}"
        if self.held.problem.noise_names or self.problem.robust:
            return f"dof = {self.dof}; {self.message}"  # chi2 tests nothing here
        if self.sigma is None:
            size = (
                "chi2"
                if all(run.noise.counted is None for run in self.problem.runs)
                else phrase("deviance")
            )
            p = format_p(self.p_value, P_FLOOR if self.p_value == P_FLOOR else 0.0)
            tested = f", {p}" if self.dof > 0 else ""
            return f"{size} = {self.chi2:.4g}, dof = {self.dof}{tested}; {self.message}"
        independent = any(run.lacks for run in self.fit.problem.runs)
        size = (
            phrase(
                "sd of the independent part of the errors = {sd:.4g} (estimated: u_y was not "
                "given)",
                sd=self.sigma,
            )
            if independent
            else phrase("residual sd = {sd:.4g} (estimated: u_y was not given)", sd=self.sigma)
        )
        return f"{size}, dof = {self.dof}; {self.message}"


def unnamed(findings: Iterable[Finding], fit: Fit) -> tuple[Finding, ...]:
    """The findings, without the name that the points of `fit` have where nobody gave them one."""
    several = len(fit.problem.runs) > 1
    return tuple(finding if several else replace(finding, run="") for finding in findings)


def _shown(unit: str) -> str:
    return "" if unit == "1" else unit
