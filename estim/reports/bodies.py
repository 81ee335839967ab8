"""Report and `result.json` of bodies given by their parts."""

from __future__ import annotations

import numpy as np

from estim.campaign import OUTPUTS, CampaignFile
from estim.common import as_json, behind, format_quantity, number
from estim.reports.pages import numbered
from estim.reports.records import Record, Report
from estim.reports.rendering import render
from estim.reports.result import Correlation, Provenance, provenance_of
from estim.studies.bodies import BodyProperties

_LEAST_SHARE = 0.5  # %, of what is told of a budget


class BodyValue(Record):
    """One quantity of a body: by linear propagation, by Monte Carlo, and the share (%) of each
    input in the linear variance.
    """

    unit: str
    meaning: str
    value: float
    u: float
    mean: float | None  # of the draws
    sd: float | None
    low_95: float | None
    high_95: float | None
    linear_holds: bool
    budget: dict[str, float]


class BodyInput(Record):
    """What was measured of the parts."""

    value: float
    u: float  # 0: exact
    unit: str


class BodySummary(Record):
    """One body."""

    parts: list[str]
    values: dict[str, BodyValue]


class BodyResult(Report):
    """Everything of `estim body`; the report prints from it."""

    title: str
    kind: str
    bodies: dict[str, BodySummary]
    correlation: Correlation  # linear; names are "gamma[heavy]"
    inputs: dict[str, BodyInput]
    notes: list[str]
    provenance: Provenance


def body_result(source: CampaignFile, weighing: BodyProperties, *, seed: int) -> BodyResult:
    """The record of bodies given by their parts."""
    linear, drawn = weighing.linear, weighing.sampled
    bodies = {
        body.name: BodySummary([part for part, _ in body.parts], {}) for body in weighing.bodies
    }
    for i, (body, out) in enumerate(weighing.names):
        _, unit, meaning = OUTPUTS[out]
        bodies[body].values[out] = BodyValue(
            unit,
            meaning,
            float(linear.value[i]),
            float(weighing.u[i]),
            number(drawn.mean[i]),
            number(drawn.u[i]),
            number(drawn.symmetric.low[i]),
            number(drawn.symmetric.high[i]),
            bool(weighing.linear_holds[i]),
            {
                row.input.name: round(row.share, 3)
                for row in weighing.budgets[i].rows
                if weighing.u[i] * row.input.u > 0.0
            },
        )
    uncertain = [i for i, u in enumerate(weighing.u) if u > 0.0]
    names = [f"{weighing.names[i][1]}[{weighing.names[i][0]}]" for i in uncertain]
    matrix = weighing.correlation[np.ix_(uncertain, uncertain)].round(6).tolist()
    inputs = {
        quantity.name: BodyInput(quantity.value, quantity.u, quantity.unit)
        for quantity in linear.inputs
    }
    at = provenance_of(source.path, source.sha256, {}, seed)
    return BodyResult(
        "estim-body/1",
        source.title,
        source.kind,
        bodies,
        Correlation(names, matrix),
        inputs,
        list(weighing.notes),
        at,
    )


def body_report(source: CampaignFile, weighing: BodyProperties, *, seed: int) -> dict[str, bytes]:
    """`report.md` and `result.json`."""
    result = body_result(source, weighing, seed=seed)
    text = render(
        "body.md.j2",
        result=result,
        outputs=OUTPUTS,
        telling_inputs=_telling_inputs,
        least_share=_LEAST_SHARE,
        label=lambda out, unit: OUTPUTS[out][0].label(unit),
        symbols=[
            f"{OUTPUTS[out][0].symbol}[{rest}"
            for out, _, rest in (name.partition("[") for name in result.correlation.names)
        ],
    )
    return {"report.md": numbered(text).encode(), "result.json": as_json(result)}


def body_lines(weighing: BodyProperties) -> list[str]:
    """One line a body for a terminal: its values."""
    lines: dict[str, list[str]] = {}
    for i, (body, out) in enumerate(weighing.names):
        notation, unit, _ = OUTPUTS[out]
        label = notation.label(unit)
        value = format_quantity(
            float(weighing.linear.value[i]) * label.factor,
            float(weighing.u[i]) * label.factor,
            plus_minus=False,
        )
        lines.setdefault(body, []).append(f"{label.symbol} = {value}{behind(label.unit)}")
    return [f"{body}: {', '.join(values)}" for body, values in lines.items()]


def _telling_inputs(body: BodySummary) -> list[str]:
    """The inputs that have a share worth telling in the variance of some quantity, the largest
    first.
    """
    largest: dict[str, float] = {}
    for quantity in body.values.values():
        for name, share in quantity.budget.items():
            largest[name] = max(largest.get(name, 0.0), share)
    ordered = sorted(largest, key=lambda name: -largest[name])
    return [name for name in ordered if largest[name] >= _LEAST_SHARE]
