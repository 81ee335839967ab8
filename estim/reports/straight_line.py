"""Report, figure and `result.json` of a straight line through any points."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from estim.checks import Estimate, best_words
from estim.common import (
    FigureChoice,
    Files,
    Json,
    Notation,
    PhraseTable,
    Status,
    behind,
    bracketed,
    format_quantity,
    format_rounded,
    interval,
    one_line,
    per_cent,
    phrase,
    signed,
    significant,
    with_unit,
)
from estim.drawing import BLUE, GREEN, INK, ORANGE, Figure, fill, legend_below, new_figure
from estim.line import (
    CONVENTIONS,
    LineFit,
    PredictedPoint,
    StraightLine,
    confidence_band,
    coverage_factor,
    line_goodness,
)
from estim.reports.copying import copies_of
from estim.reports.pages import page
from estim.reports.result import provenance_of
from estim.sampling import Summary

_METHODS = PhraseTable(
    {
        "ols": "ordinary least squares",
        "weighted": "weighted by u(y)",
        "york": "York: errors in both variables",
        "correlated": "generalised distance regression: correlated errors of points",
    }
)
_ROUNDING = 1e-12  # of a standard error: what is smaller is an error of rounding


def straight_line_result(line: StraightLine) -> Json:
    """Everything of `estim line FILE.csv`, as `result.json` has it; the report prints from it."""
    fit = line.fit
    return {
        "schema": "estim-straight-line/1",
        "status": line.status,
        "message": line.message,
        "method": fit.method,
        "columns": {
            key: None if name is None else one_line(name)
            for key, name in vars(line.columns).items()
        },
        # what is stated of errors that points share
        "correlated": [one_line(words) for words in line.correlated],
        "n_obs": fit.data.x.size,
        "intercept": fit.intercept,
        "slope": fit.slope,
        # the same, with the recommended u
        "coefficients": {
            key: {"value": value, "u": u, "unit": unit}
            for key, (_, unit, value, u) in _coefficients(line).items()
        },
        # of x, y, intercept and slope; "1" where the table states none
        "units": line.units,
        **line_figures(fit),
        "probability": line.probability,
        "k": line.k,
        "slope_interval": [line.slope.low, line.slope.high],
        "predictions": line.predictions,
        "inverses": line.inverses,
        "provenance": provenance_of(line.path, line.sha256, {str(line.path): line.sha256}, 0),
    }


def line_figures(fit: LineFit) -> Json:
    """What a report shows of a line: where it lies, how it fits, and its standard errors,
    convention -> u(intercept), u(slope), covariance.
    """
    errors = {name: [e.u_intercept, e.u_slope, e.cov] for name, e in fit.standard_errors.items()}
    return {
        "intercept": fit.intercept,
        "slope": fit.slope,
        "chi2": fit.chi2,
        "dof": fit.dof,
        "p_value": fit.p_value,
        "standard_errors": errors,
        "recommended": fit.recommended,
        "reason": fit.reason,
    }


def _coefficients(line: StraightLine) -> dict[str, tuple[str, str, float, float]]:
    """Name, unit, value and recommended standard error of intercept and slope."""
    fit, units = line.fit, line.units
    error = fit.standard_errors[fit.recommended]
    return {
        "intercept": (phrase("intercept"), units["intercept"], fit.intercept, error.u_intercept),
        "slope": (phrase("slope"), units["slope"], fit.slope, error.u_slope),
    }


def straight_line_report(line: StraightLine, *, figures: FigureChoice) -> Files:
    """`report.md`, `result.json` and `figures/line.png`."""
    result = straight_line_result(line)

    coefficients, units = _coefficients(line), line.units
    x, y = line.axes.x_name, line.axes.y_name
    intercept, slope = (
        f"({_pair(value, u)}){behind(unit)}" for _, unit, value, u in coefficients.values()
    )
    return page(
        {"figures/line.png": partial(straight_line_figure, line)},
        "straight_line.md.j2",
        {"result.json": result},
        figure_choice=figures,
        result=result,
        method=_METHODS[line.fit.method],
        percent=f"{100.0 * line.probability:g}",
        conventions=CONVENTIONS,
        pair=_pair,
        given=_given,
        ends=_ends,
        x=x,
        y=y,
        heads={
            key: name + bracketed(units[key])
            for key, name in zip(units, (x, y, phrase("intercept"), phrase("slope")), strict=True)
        },
        equation=f"{y} = {intercept} + {slope} · {x}",
        scatter=with_unit(significant(math.sqrt(line.fit.chi2 / line.fit.dof), 2), units["y"]),
        best=_best(line),
        first_step=line.first_step,
        facts=line.facts,
        uncertainties=_uncertainties(result["columns"], result["correlated"]),
        slope=_ends(line.slope.low, line.slope.high, coefficients["slope"][-1], units["slope"]),
        copies=copies_of(_estimates(line)) if line.status.ok else None,
    )


def _best(line: StraightLine) -> str:
    """The best line in words where it is no result; "" where it means nothing."""
    fit, units = line.fit, line.units
    if line.status is not Status.POOR_FIT:
        return ""
    x = fit.data.x
    order = np.argsort(x, kind="stable")
    residuals = (fit.data.y - fit.intercept - fit.slope * x)[order]
    far = np.abs(residuals) / line_goodness(fit).sd
    i = int(np.argmax(far))
    place = float(f"{x[order][i]:.4g}")
    return best_words(
        [
            f"{name} = {with_unit(significant(value if abs(value) > _ROUNDING * u else 0.0), unit)}"
            for name, unit, value, u in _coefficients(line).values()
        ],
        float(far[i]),
        f"{line.axes.x_name} = {with_unit(format_quantity(place), units['x'])}",
    )


def _estimates(line: StraightLine) -> list[Estimate]:
    """Intercept and slope with the recommended standard errors."""
    estimates = []
    for name, unit, value, u in _coefficients(line).values():
        if math.isfinite(value) and math.isfinite(u):
            # probabilities of the intervals in the table to copy
            wide, narrow = (u * coverage_factor(line.fit, probability=p) for p in (0.95, 0.68))
            ends = value - wide, value - narrow, value + narrow, value + wide
            summary = Summary(unit, "", value, u, value, *ends)
            estimates.append(Estimate(Notation(name).label(unit), summary, "", True))
    return estimates


def straight_line_lines(line: StraightLine) -> list[str]:
    """The lines of a terminal on a straight line."""
    if not line.status.ok:
        step = phrase("first step: {words}", words=line.first_step)
        return [*filter(None, (line.message, _best(line))), step]
    values = {
        key: with_unit(_pair(value, u), unit)
        for key, (_, unit, value, u) in _coefficients(line).items()
    }
    convention = line.fit.recommended
    lines = [
        phrase(
            "intercept {intercept}, slope {slope} ({errors}: {convention})",
            **values,
            errors=phrase(
                "errors from the scatter of the points"
                if convention == "scaled"
                else "errors as stated"
            ),
            convention=phrase(convention),
        )
    ]
    x, y = (line.axes.x_name, line.units["x"]), (line.axes.y_name, line.units["y"])
    for points, (given, given_unit), (found, unit) in (
        (line.predictions, x, y),
        (line.inverses, y, x),
    ):
        for p in points:
            lines.append(
                phrase(
                    "{given}: {found}, {percent} interval {ends}",
                    given=f"{given} = {with_unit(_given(p), given_unit)}",
                    found=f"{found} = {with_unit(_pair(p.value, p.u), unit)}",
                    percent=per_cent(line.probability),
                    ends=_ends(p.low, p.high, p.u, unit),
                )
            )
    return lines


def _given(point: PredictedPoint) -> str:
    """Where a prediction is asked for, with the digits that were typed where it is exact."""
    exact = point.u_given == 0.0
    return signed(f"{point.given:.12g}") if exact else format_quantity(point.given, point.u_given)


def _pair(value: float, u: float, digits: int = 2) -> str:
    """Value ± uncertainty to as many digits of it."""
    return format_rounded(value, u, digits) + (
        f" ± {format_rounded(u, u, digits, beside=value)}" if 0.0 < u < math.inf else ""
    )


def _ends(low: float, high: float, u: float, unit: str = "1") -> str:
    known = math.isfinite(low) and math.isfinite(high)
    return interval(low, high, u, 3) + behind(unit) if known else phrase("unbounded")


def _uncertainties(names: Mapping[str, str | None], correlated: Sequence[str]) -> str:
    columns = (("u(x)", names["u_x"]), ("u(y)", names["u_y"]))
    sources = [
        phrase("{key} from {name}", key=key, name=name) for key, name in columns if name is not None
    ]
    if names["r_xy"] is not None and len(sources) == 2:
        sources.append(phrase("their correlation from {name}", name=names["r_xy"]))
    sources += correlated
    return ", ".join(sources) or phrase("no uncertainties are stated")


def straight_line_figure(line: StraightLine) -> Figure:
    """Points and line with its band above, residuals below; predictions marked."""
    fit, data = line.fit, line.fit.data
    figure = new_figure(5.4)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    marks = [
        *(p.given for p in line.predictions),
        *(p.value for p in line.inverses if math.isfinite(p.value)),
    ]
    low = min(float(data.x.min()), *marks, math.inf)
    high = max(float(data.x.max()), *marks, -math.inf)
    x = np.linspace(low - 0.05 * (high - low), high + 0.05 * (high - low), 200)
    percent = per_cent(line.probability)
    bars = [u if np.any(u > 0.0) and fit.method != "ols" else None for u in (data.u_y, data.u_x)]
    if math.isfinite(fit.slope):
        if line.status.ok:
            band = confidence_band(fit, x, probability=line.probability)
            label = phrase("{percent} band of the line, point by point", percent=percent)
            fill(upper, x, band.low, band.high, BLUE, 0.25, label=label)
        upper.plot(x, fit.intercept + fit.slope * x, color=BLUE, label=_METHODS[fit.method])
        residuals = data.y - fit.intercept - fit.slope * data.x
        lower.axhline(0.0, color=BLUE)
        lower.errorbar(data.x, residuals, *bars, "o", color=INK)
    upper.errorbar(
        data.x,
        data.y,
        *bars,
        "o",
        color=INK,
        label=phrase("points, ± 1 standard uncertainty" if fit.method != "ols" else "points"),
    )
    if line.status.ok:
        mark: dict[str, Any] = {"mec": INK, "ms": 6, "lw": 2, "zorder": 5}
        label = phrase("prediction, {percent}", percent=percent)
        for p in line.predictions:
            upper.errorbar(
                p.given, p.value, _bar(p), p.u_given or None, "s", color=ORANGE, label=label, **mark
            )
        label = phrase("inverse prediction, {percent}", percent=percent)
        for q in line.inverses:
            if math.isfinite(q.low):
                upper.errorbar(
                    q.value, q.given, None, _bar(q), "D", color=GREEN, label=label, **mark
                )
    units = line.units
    upper.set(ylabel=line.axes.y_name + bracketed(units["y"]))
    lower.set(
        xlabel=line.axes.x_name + bracketed(units["x"]),
        ylabel=phrase("residual") + bracketed(units["y"]),
    )
    legend_below(figure, ncols=2)
    return figure


def _bar(p: PredictedPoint) -> list[list[float]]:
    """How far the ends of its interval are from a point, below and above."""
    return [[p.value - p.low], [p.high - p.value]]
