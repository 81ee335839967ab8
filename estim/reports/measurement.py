"""Report and `result.json` of a measurement model: GUM and Monte Carlo side by side, budgets, a statement to paste, regions."""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import partial

import msgspec
import numpy as np

from estim.arrays import FloatArray
from estim.common import Status, as_json, gravest, later, one_line, phrase, signed
from estim.distributions import student_quantile
from estim.measurement import Propagation
from estim.reports.measurement_figures import budget_figure, distribution_figure, region_figure
from estim.reports.pages import page
from estim.reports.rendering import render
from estim.reports.result import Provenance, software_versions
from estim.reports.rounded import interval, rounded
from estim.sampling import number

MEASUREMENT_SCHEMA = "estim-propagation/1"
_DIGITS = 3  # of u in tables: one more than a statement has
_INTERVALS = {"symmetric": later("symmetric"), "shortest": later("shortest")}
_LAWS = {
    "normal": later("normal"), "rectangular": later("rectangular"), "triangular": later("triangular"), "trapezoidal": later("trapezoidal"),
    "curvilinear-trapezoidal": later("curvilinear-trapezoidal"), "arcsine": later("arcsine"), "t": later("t"),
    "standardised-t": later("standardised-t"), "exponential": later("exponential"), "lognormal": later("lognormal"), "gamma": later("gamma"),
    "exact": later("exact"),
}


class GumRecord(msgspec.Struct, frozen=True):
    """The GUM's framework.  dof : null for infinitely many.  k_whole, U_whole : with dof rounded down, as tables ask (GUM G.4.1)."""

    value: float | None
    u: float | None
    dof: float | None
    k: float
    U: float | None
    low: float | None
    high: float | None
    k_whole: float | None
    U_whole: float | None
    u_second_order: float | None


class MonteCarloRecord(msgspec.Struct, frozen=True):
    """The propagation of distributions.  *_error : Monte-Carlo standard errors of the two ends.  undefined : share of draws without a value."""

    n_draw: int
    mean: float | None
    u: float | None
    symmetric: list[float | None]
    symmetric_error: list[float | None]
    shortest: list[float | None]
    shortest_error: list[float | None]
    undefined: float


class ShareRecord(msgspec.Struct, frozen=True):
    """One line of a budget; share in %."""

    input: str
    sensitivity: float | None
    contribution: float | None
    share: float | None


class OutputRecord(msgspec.Struct, frozen=True):
    """One measurand.  quoted : "GUM", "Monte Carlo" or "" where neither can be."""

    formula: str
    unit: str
    meaning: str
    status: str
    quoted: str
    statement: str
    gum: GumRecord
    monte_carlo: MonteCarloRecord
    gum_holds: bool
    decided: bool
    d_low: float | None
    d_high: float | None
    tolerance: float | None
    budget: list[ShareRecord]
    correlation_share: float | None


class PartRecord(msgspec.Struct, frozen=True):
    """One input, or one component of an input."""

    value: float
    u: float  # 0: exact
    unit: str
    distribution: str
    dof: float | None
    meaning: str


class RegionRecord(msgspec.Struct, frozen=True):
    """Coverage regions of two outputs."""

    outputs: list[str]
    correlation: float
    correlation_drawn: float
    k_ellipse: float
    k_ellipse_drawn: float
    k_rectangle: float
    k_rectangle_drawn: float
    gum_ellipse_holds: float  # share of the draws in it


class MeasurementResult(msgspec.Struct, frozen=True, rename={"schema_": "schema"}):
    """Everything of `estim propagate`; the report prints from it."""

    schema_: str
    title: str
    source: str
    status: str
    probability: float
    digits: int
    interval: str
    outputs: dict[str, OutputRecord]
    inputs: dict[str, PartRecord]
    correlations: list[list[str | float]]
    regions: list[RegionRecord]
    validation: str
    notes: list[str]
    provenance: Provenance


def measurement_result(propagation: Propagation, *, seed: int) -> MeasurementResult:
    """The record of a measurement model."""
    model, linear = propagation.model, propagation.linear
    outputs = {output.name: _output(propagation, i) for i, output in enumerate(model.outputs)}
    meanings = [meaning for quantity in model.quantities for meaning in quantity.meanings]
    parts = {
        one.name: PartRecord(one.value, one.u, one.unit, one.distribution if one.u > 0.0 else "exact", number(one.dof), meaning)
        for one, meaning in zip(linear.inputs, meanings, strict=True)
    }
    pairs: list[list[str | float]] = [[a, b, r] for (a, b), r in (model.correlation or {}).items()]
    found = [
        RegionRecord(
            [model.outputs[k].name for k in one.pair], *one.correlation, one.k_ellipse, one.k_drawn, one.k_rectangle, one.k_rectangle_drawn, one.held
        )
        for one in propagation.regions
    ]
    at = Provenance(one_line(str(model.path)), model.sha256, {}, seed, software_versions())
    return MeasurementResult(
        MEASUREMENT_SCHEMA, model.title, model.source, gravest(propagation.statuses), model.probability, model.digits, model.interval, outputs, parts,
        pairs, found, propagation.validation.message, list(propagation.notes), at,
    )


def _output(propagation: Propagation, i: int) -> OutputRecord:
    linear, drawn, output, checked = propagation.linear, propagation.sampled, propagation.model.outputs[i], propagation.validation
    u, dof, second = float(linear.u[i]), float(linear.dof[i]), propagation.second_order
    k_whole = float(student_quantile(0.5 * (1.0 + linear.probability), max(math.floor(dof), 1))) if math.isfinite(dof) else None
    gum = GumRecord(
        number(linear.value[i]), number(u), number(dof), float(linear.k[i]), number(linear.k[i] * u), number(linear.low[i]), number(linear.high[i]),
        k_whole, None if k_whole is None else number(k_whole * u), None if second is None else number(second[i]),
    )

    def both(*ends: FloatArray) -> list[float | None]:
        return [number(end[i]) for end in ends]

    symmetric, shortest = drawn.symmetric, drawn.shortest
    sampled = MonteCarloRecord(
        drawn.n_draw, number(drawn.mean[i]), number(drawn.u[i]), both(symmetric.low, symmetric.high), both(symmetric.low_error, symmetric.high_error),
        both(shortest.low, shortest.high), both(shortest.low_error, shortest.high_error), float(drawn.undefined[i]),
    )
    status = propagation.statuses[i]
    quoted = "GUM" if propagation.gum_holds[i] and status.ok else "Monte Carlo" if status.ok else ""
    budget = propagation.budgets[i]
    return OutputRecord(
        output.formula.text, output.unit, output.meaning, status, quoted, statement(propagation, i, quoted), gum,
        sampled, bool(propagation.gum_holds[i]), bool(checked.decided[i]),
        number(checked.d_low[i]), number(checked.d_high[i]), number(checked.tolerance[i]),
        [
            ShareRecord(row.input.name, number(row.sensitivity), number(row.contribution), number(row.share))
            for row in budget.rows if row.input.u > 0.0
        ],
        number(budget.correlation_share),
    )


def statement(propagation: Propagation, i: int, quoted: str) -> str:
    """A sentence for a certificate or a paper (GUM 7.2.2-7.2.4; JCGM 101, 5.5), "" where nothing can be quoted."""
    linear, drawn, output = propagation.linear, propagation.sampled, propagation.model.outputs[i]
    unit = "" if output.unit == "1" else f" {output.unit}"
    what = f"{output.name}, {output.meaning}" if output.meaning else output.name
    percent = f"{100.0 * linear.probability:g} %"
    if quoted == "GUM":
        value, u, k, dof = (float(one[i]) for one in (linear.value, linear.u, linear.k, linear.dof))
        if u == 0.0:
            return phrase("{what}: {name} = {value}, exact.", what=what, name=output.name, value=rounded(value, 0.0, 2) + unit)
        expanded = f"{rounded(value, k * u, 2)} ± {rounded(k * u, k * u, 2, beside=value)}"
        law = phrase("the normal distribution") if dof > 1e6 else phrase("the t distribution with {dof:.3g} effective degrees of freedom", dof=dof)
        return phrase(
            "{what}: {name} = ({value}){unit}, where the number after ± is the expanded uncertainty U = k u, with the standard "
            "uncertainty u = {u} and the coverage factor k = {k:.2f} from {law} for a coverage probability of {percent}.",
            what=what, name=output.name, value=expanded, unit=unit, u=rounded(u, u, 2, beside=value) + unit, k=k, law=law, percent=percent,
        )
    if quoted == "Monte Carlo":
        low, high = (float(end[i]) for end in (propagation.interval.low, propagation.interval.high))
        scale = float(drawn.u[i]) if math.isfinite(drawn.u[i]) else 0.25 * (high - low)
        mean = float(drawn.mean[i])
        best = phrase(
            "{name} = {value} with standard uncertainty u = {u} and",
            name=output.name, value=rounded(mean, scale, 2) + unit, u=rounded(scale, scale, 2, beside=mean) + unit,
        ) if math.isfinite(drawn.u[i]) else phrase("{name} has no standard uncertainty (its tails are too long);", name=output.name)
        said = {"what": what, "best": best, "percent": percent, "ends": interval(low, high, scale, 2) + unit, "n": drawn.n_draw}
        if propagation.model.interval == "symmetric":
            return phrase(
                "{what}: {best} the probabilistically symmetric {percent} coverage interval {ends}, by propagation of distributions "
                "({n} Monte Carlo trials, JCGM 101).", **said,
            )
        return phrase(
            "{what}: {best} the shortest {percent} coverage interval {ends}, by propagation of distributions ({n} Monte Carlo trials, JCGM 101).",
            **said,
        )
    return ""


def measurement_report(propagation: Propagation, *, seed: int, figures: bool = True) -> dict[str, bytes]:
    """`report.md`, `result.json` and the figures.  figures : whether any are wanted."""
    result = measurement_result(propagation, seed=seed)
    drawers = {"figures/distribution.png": partial(distribution_figure, propagation)}
    if any(np.isfinite(row.share) for budget in propagation.budgets for row in budget.rows):
        drawers["figures/budget.png"] = partial(budget_figure, propagation)
    if propagation.regions:
        drawers["figures/regions.png"] = partial(region_figure, propagation)

    def text(*, pictures: Collection[str]) -> str:
        return render(
            "measurement.md.j2", pictures=pictures, result=result, percent=f"{100.0 * result.probability:g}", compared=_compared(result),
            budgets={name: _budget(result, one) for name, one in result.outputs.items()}, validation=_validation(result),
            alone=len(result.outputs) == 1, regions=_regions(result), inputs=_inputs(result), ok=result.status == Status.OK,
            which_interval=phrase(_INTERVALS[result.interval]),
        )

    return page(drawers, text, wanted=figures) | {"result.json": as_json(result)}


def measurement_lines(propagation: Propagation) -> list[str]:
    """The statements for a terminal, or why there is none."""
    found = []
    for i, (output, status) in enumerate(zip(propagation.model.outputs, propagation.statuses, strict=True)):
        quoted = "GUM" if propagation.gum_holds[i] else "Monte Carlo"
        none = phrase("{name}: {status}: no number can be quoted", name=output.name, status=status)
        found.append(statement(propagation, i, quoted) if status.ok else none)
    return found


def _cell(value: float | None, u: float | None, beside: float | None = None) -> str:
    return "n/a" if value is None else rounded(value, u or 0.0, _DIGITS, beside=beside or 0.0)


def _ends(ends: list[float | None], u: float | None) -> str:
    low, high = ends
    return "n/a" if low is None or high is None else interval(low, high, u or 0.25 * (high - low), _DIGITS)


def _compared(result: MeasurementResult) -> dict[str, list[tuple[str, ...]]]:
    """For each output a row for each method: value, u, degrees of freedom, k, U, interval."""
    tables: dict[str, list[tuple[str, ...]]] = {}
    for name, one in result.outputs.items():
        gum, drawn = one.gum, one.monte_carlo
        dof = "∞" if gum.dof is None else f"{gum.dof:.1f}"
        half, own = _cell(gum.U, gum.u, gum.value), _ends([gum.low, gum.high], gum.u)
        rows: list[tuple[str, ...]] = []
        rows.append(("GUM", _cell(gum.value, gum.u), _cell(gum.u, gum.u, gum.value), dof, f"{gum.k:.2f}", half, own))
        if gum.k_whole is not None and gum.dof is not None and gum.U_whole is not None and gum.dof != math.floor(gum.dof):
            whole = str(max(math.floor(gum.dof), 1))
            rows.append((phrase("GUM, ν_eff rounded down"), "", "", whole, f"{gum.k_whole:.2f}", *_expanded(gum.value, gum.U_whole, gum.u)))
        second = gum.u_second_order
        if second is not None and abs(second - (gum.u or 0.0)) > 0.005 * second:
            ends = _expanded(gum.value, gum.k * second, second)
            rows.append((phrase("GUM with terms of the next order"), "", _cell(second, second, gum.value), "", f"{gum.k:.2f}", *ends))
        spread = _cell(drawn.u, drawn.u, drawn.mean)
        rows.append(("Monte Carlo", _cell(drawn.mean, drawn.u), spread, "", "", "", phrase("{ends} symmetric", ends=_ends(drawn.symmetric, drawn.u))))
        rows.append(("", "", "", "", "", "", phrase("{ends} shortest", ends=_ends(drawn.shortest, drawn.u))))
        tables[name] = rows
    return tables


def _expanded(value: float | None, half: float, u: float | None) -> tuple[str, str]:
    """Cells of an expanded uncertainty and the interval that it makes."""
    ends: list[float | None] = [None, None] if value is None else [value - half, value + half]
    return _cell(half, u, value), _ends(ends, u)


def _budget(result: MeasurementResult, one: OutputRecord) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for row in one.budget:
        part = result.inputs[row.input]
        dof = "∞" if part.dof is None else f"{part.dof:.4g}"
        sensitivity = "n/a" if row.sensitivity is None else signed(f"{row.sensitivity:.4g}")
        contribution = "n/a" if row.contribution is None else f"{row.contribution:.3g}"
        share = "n/a" if row.share is None else f"{row.share:.1f}"
        uncertainty = f"{part.u:.3g}" + ("" if part.unit == "1" else f" {part.unit}")
        rows.append((row.input, part.meaning, signed(f"{part.value:.10g}"), uncertainty, _law(part), dof, sensitivity, contribution, share))
    return rows


def _validation(result: MeasurementResult) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for name, one in result.outputs.items():
        wrong = (
            phrase("the GUM's interval does not hold: believe the Monte Carlo") if one.decided
            else phrase("not decided by so many draws: believe the Monte Carlo")
        )
        verdict = phrase("the GUM's interval holds") if one.gum_holds else wrong
        rows.append((name, *(("n/a" if v is None else f"{v:.2g}") for v in (one.d_low, one.d_high, one.tolerance)), verdict))
    return rows


def _law(part: PartRecord) -> str:
    """Its distribution as a reader calls it."""
    return phrase(_LAWS[part.distribution])


def _regions(result: MeasurementResult) -> list[tuple[str, ...]]:
    return [
        (
            ", ".join(one.outputs), *(signed(f"{v:.3f}") for v in (one.correlation, one.correlation_drawn)), f"{one.k_ellipse:.2f}",
            f"{one.k_ellipse_drawn:.2f}", f"{one.k_rectangle:.2f}", f"{one.k_rectangle_drawn:.2f}", f"{100.0 * one.gum_ellipse_holds:.1f} %",
        )
        for one in result.regions
    ]


def _inputs(result: MeasurementResult) -> list[tuple[str, ...]]:
    return [
        (name, part.meaning, signed(f"{part.value:.10g}"), phrase("exact") if part.u == 0.0 else f"{part.u:.4g}",
         "" if part.unit == "1" else part.unit, _law(part), "" if part.u == 0.0 else "∞" if part.dof is None else f"{part.dof:.4g}")
        for name, part in result.inputs.items()
    ]
