"""Report and `result.json` of bodies given by their parts."""

from __future__ import annotations

import numpy as np

from estim.campaign import OUTPUTS, CampaignFile
from estim.common import Files, Json, as_json, behind, format_quantity, number
from estim.reports.pages import numbered
from estim.reports.rendering import render
from estim.reports.result import provenance_of
from estim.studies.bodies import BodyProperties

_LEAST_SHARE = 0.5  # %, of the inputs of a budget that the report lists


def body_result(source: CampaignFile, properties: BodyProperties, *, seed: int) -> Json:
    """Bodies given by their parts, as `result.json` has them; the report prints from it."""
    linear, drawn = properties.linear, properties.sampled
    bodies: Json = {
        body.name: {"parts": [part for part, _ in body.parts], "values": {}}
        for body in properties.bodies
    }
    for i, (body, out) in enumerate(properties.names):
        _, unit, meaning = OUTPUTS[out]
        bodies[body]["values"][out] = {
            "unit": unit,
            "meaning": meaning,
            "value": linear.value[i],
            "u": properties.u[i],
            "mean": number(drawn.mean[i]),  # of the draws
            "sd": number(drawn.u[i]),
            "low_95": number(drawn.symmetric.low[i]),
            "high_95": number(drawn.symmetric.high[i]),
            "linear_holds": properties.linear_holds[i],
            "budget": {  # share (%) of each input in the linear variance
                row.input.name: round(row.share, 3)
                for row in properties.budgets[i].rows
                if properties.u[i] * row.input.u > 0.0
            },
        }
    uncertain = [i for i, u in enumerate(properties.u) if u > 0.0]
    return {
        "schema": "estim-body/1",
        "title": source.title,
        "kind": source.kind,
        "bodies": bodies,
        "correlation": {  # linear
            "names": [f"{properties.names[i][1]}[{properties.names[i][0]}]" for i in uncertain],
            "matrix": properties.correlation[np.ix_(uncertain, uncertain)].round(6).tolist(),
        },
        "inputs": {  # what was measured of the parts; u 0: exact
            quantity.name: {"value": quantity.value, "u": quantity.u, "unit": quantity.unit}
            for quantity in linear.inputs
        },
        "notes": properties.notes,
        "provenance": provenance_of(source.path, source.sha256, {}, seed),
    }


def body_report(source: CampaignFile, properties: BodyProperties, *, seed: int) -> Files:
    """`report.md` and `result.json`."""
    result = body_result(source, properties, seed=seed)
    text = render(
        "body.md.j2",
        result=result,
        outputs=OUTPUTS,
        main_inputs=_main_inputs,
        least_share=_LEAST_SHARE,
        label=lambda out, unit: OUTPUTS[out][0].label(unit),
        symbols=[
            f"{OUTPUTS[out][0].symbol}[{rest}"
            for out, _, rest in (name.partition("[") for name in result["correlation"]["names"])
        ],
    )
    return {"report.md": numbered(text).encode(), "result.json": as_json(result)}


def body_lines(properties: BodyProperties) -> list[str]:
    """One line a body for a terminal: its values."""
    lines: dict[str, list[str]] = {}
    for i, (body, out) in enumerate(properties.names):
        notation, unit, _ = OUTPUTS[out]
        label = notation.label(unit)
        value = format_quantity(
            float(properties.linear.value[i]) * label.factor,
            float(properties.u[i]) * label.factor,
            plus_minus=False,
        )
        lines.setdefault(body, []).append(f"{label.symbol} = {value}{behind(label.unit)}")
    return [f"{body}: {', '.join(values)}" for body, values in lines.items()]


def _main_inputs(body: Json) -> list[str]:
    """The inputs with a share of at least `_LEAST_SHARE` in the variance of some quantity, the
    largest first.
    """
    largest: dict[str, float] = {}
    for quantity in body["values"].values():
        for name, share in quantity["budget"].items():
            largest[name] = max(largest.get(name, 0.0), share)
    ordered = sorted(largest, key=lambda name: -largest[name])
    return [name for name in ordered if largest[name] >= _LEAST_SHARE]
