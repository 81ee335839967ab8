"""Report, figure and `result.json` of a mean."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from estim.common import (
    FigureChoice,
    Files,
    behind,
    bracketed,
    format_rounded,
    interval,
    per_cent,
    phrase,
    significant,
    table,
)
from estim.drawing import (
    BLUE,
    INK,
    ORANGE,
    PALE,
    Figure,
    legend_below,
    name_ticks,
    new_figure,
    whole_ticks,
)
from estim.means import TableMean
from estim.reports.measurement import expanded_statement
from estim.reports.pages import page
from estim.reports.result import provenance_of


def mean_statement(table_mean: TableMean) -> str:
    """The recommended mean as a sentence for a paper."""
    best, unit, name = table_mean.mean.best, behind(table_mean.unit), table_mean.name
    if not math.isnan(best.k):
        return expanded_statement(
            f"{phrase('mean')}: ",
            name,
            unit,
            best.value,
            best.u,
            best.k,
            best.dof,
            table_mean.mean.probability,
        )
    size = best.u if math.isfinite(best.u) else 0.25 * (best.high - best.low)
    shown = format_rounded(best.value, size) + unit
    if math.isfinite(best.u):  # three values and fewer have an interval alone
        shown = phrase(
            "{value} with standard uncertainty u = {u}",
            value=shown,
            u=format_rounded(best.u, best.u, beside=best.value) + unit,
        )
    return phrase(
        "{name} = {value}, {percent} interval {ends}, with a dark uncertainty of {tau}.",
        name=name,
        value=shown,
        percent=per_cent(table_mean.mean.probability),
        ends=interval(best.low, best.high, size, 2) + unit,
        tau=significant(best.tau, 2) + unit,
    )


def mean_report(table_mean: TableMean, *, seed: int, figures: FigureChoice) -> Files:
    """`report.md`, `result.json` and `figures/mean.png`."""
    mean, groups = table_mean.mean, table_mean.mean.groups
    shown = mean.shown()
    result = {
        "schema": "estim-mean/1",
        "status": mean.status,
        "column": table_mean.name,
        "n": mean.data.size,
        "recommended": mean.recommended,
        "reason": mean.reason,
        "statement": mean_statement(table_mean) if mean.status.ok else "",
        # k and dof are null where the interval is one of quantiles
        "averages": {
            name: {"value": a.value, "u": a.u, "unit": table_mean.unit} | a._asdict()
            for name, a in mean.averages.items()
        },
        # chi2, its probability and tau are null for readings
        "chi2": mean.chi2,
        "dof": mean.dof,
        "p_value": mean.p_value,
        "birge": mean.birge,
        "consistent": mean.consistent,
        "tau_interval": mean.tau_interval,
        "groups": groups
        and {
            "means": dict(zip(groups.names, groups.means, strict=True)),
            "s_within": groups.s_within,
            "s_between": groups.s_between,
            "F": groups.F,
            "dof_between": groups.dof_between,
            "dof_within": groups.dof_within,
            "p_value": groups.p_value,
        },
        "probability": mean.probability,
        "provenance": provenance_of(
            table_mean.path, table_mean.sha256, {str(table_mean.path): table_mean.sha256}, seed
        ),
    }
    return page(
        {"figures/mean.png": partial(mean_figure, table_mean)},
        "mean.md.j2",
        {"result.json": result},
        figure_choice=figures,
        result=result,
        unit=table_mean.unit,
        averages=table(shown.head, shown.rows),
        facts=(table_mean.told, *table_mean.facts),
    )


def _interval_of(name: str, probability: float) -> str:
    return f"{phrase(name)}, {per_cent(probability)}"


def mean_figure(table_mean: TableMean) -> Figure:
    """The values with their standard uncertainties, and the interval of each mean that counts: of
    the recommended one a band, of the other its ends.
    """
    mean = table_mean.mean
    figure = new_figure(3.8)
    ax = figure.subplots()
    places = np.arange(1.0, mean.data.size + 1.0)
    if mean.groups is not None:
        places = 1.0 + np.array([mean.groups.names.index(label) for label in table_mean.labels])
    others = "weighted" if mean.u_data is not None else "readings"
    with_tau = "hierarchical" if mean.u_data is not None else mean.recommended
    for name in {others, with_tau} - {mean.recommended}:
        a = mean.averages[name]
        ax.axhline(a.value, color=ORANGE)
        for end in (a.low, a.high):
            ax.axhline(end, color=ORANGE, ls="--", label=_interval_of(name, mean.probability))
    a = mean.best
    label = _interval_of(mean.recommended, mean.probability)
    if mean.status.ok:
        label += f" ({phrase('recommended')})"
    ax.axhspan(a.low, a.high, color=PALE, zorder=0.5, label=label)
    ax.axhline(a.value, color=BLUE)
    ax.errorbar(
        places,
        mean.data,
        mean.u_data,
        fmt="o",
        color=INK,
        label=phrase("readings" if mean.u_data is None else "values, ± 1 standard uncertainty"),
    )
    if mean.groups is not None and len(mean.groups.names) <= 40:
        name_ticks(ax.xaxis, np.unique(places), mean.groups.names)
    else:
        whole_ticks(ax.xaxis)
    ax.set(
        ylabel=table_mean.name + bracketed(table_mean.unit),
        xlabel=phrase("number of the value" if mean.groups is None else "group"),
    )
    ax.ticklabel_format(axis="y", useOffset=False)
    legend_below(figure)
    return figure
