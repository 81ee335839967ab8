"""Report, figure and `result.json` of the energy along runs."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
from matplotlib.figure import Figure

from estim import figures
from estim.campaign import Campaign
from estim.energy import EnergyRecord, Estimate
from estim.pipeline import Analysis
from estim.problem import Observations
from estim.quantity import Quantity, format_quantity
from estim.report import KINDS, STATUS_WORDS, render
from estim.result import Provenance, number, provenance

ENERGY_SCHEMA = "estim-energy/1"


class Value(msgspec.Struct, frozen=True):
    """A value and its standard uncertainty; null where there is none."""

    value: float | None
    u: float | None


class EnergySummary(msgspec.Struct, frozen=True):
    """Energy along one run; relative to the energy at release (as in the paper) and to the largest kinetic energy."""

    mean_relative: Value
    extreme_relative: Value
    mean_to_kinetic: Value
    extreme_to_kinetic: Value
    loss_per_metre: Value  # J/(kg m)
    loss_interval_95: list[float | None]
    loss_force: Value  # N
    drift_p: float
    steady_p: float


class EnergyResult(msgspec.Struct, frozen=True, rename={"schema_": "schema"}):
    """Everything of an energy check; the report prints from it."""

    schema_: str
    title: str
    kind: str
    statuses: dict[str, str]
    energies: dict[str, EnergySummary]
    provenance: Provenance


def to_value(quantity: Quantity | Estimate) -> Value:
    return Value(number(quantity.value), number(quantity.u))


def summarise_energy(e: EnergyRecord) -> EnergySummary:
    """The record of one run's energy."""
    return EnergySummary(
        mean_relative=to_value(e.mean_relative), extreme_relative=to_value(e.extreme_relative), mean_to_kinetic=to_value(e.mean_to_kinetic),
        extreme_to_kinetic=to_value(e.extreme_to_kinetic), loss_per_metre=to_value(e.loss),
        loss_interval_95=[number(e.loss.low), number(e.loss.high)], loss_force=to_value(e.loss_force), drift_p=e.drift_p, steady_p=e.steady_p,
    )


def shown(value: Value | None) -> str:
    """A value as text, rounded by its uncertainty."""
    return "n/a" if value is None or value.value is None else format_quantity(value.value, value.u)


def percent(value: Value) -> str:
    """A ratio as text, in per cent."""
    return "n/a" if value.value is None or value.u is None else format_quantity(100.0 * value.value, 100.0 * value.u) + " %"


def energy_report(campaign: Campaign, analyses: Sequence[Analysis], records: Sequence[EnergyRecord], *, seed: int) -> dict[str, bytes]:
    """`report.md`, `result.json` and `figures/energy.png`; `records` in the order of the analyses' runs."""
    runs = [run for analysis in analyses for run in analysis.problem.runs]
    statuses = {run.name: analysis.diagnosis.status for analysis in analyses for run in analysis.problem.runs}
    result = EnergyResult(
        ENERGY_SCHEMA, campaign.title, campaign.kind, statuses, {e.run: summarise_energy(e) for e in records},
        provenance(campaign, [run.name for run in runs], seed),
    )
    figure = energy_figure(records, runs[0], synthetic=campaign.kind == "synthetic", title=campaign.title)
    trusted = {name: e for name, e in result.energies.items() if statuses[name] == "ok"}
    text = render("energy.md.j2", result=result, energies=trusted, kind=KINDS[campaign.kind], status_words=STATUS_WORDS, shown=shown, percent=percent)
    return {
        "report.md": text.encode(),
        "result.json": msgspec.json.format(msgspec.json.encode(result), indent=1) + b"\n",
        "figures/energy.png": figures.png(figure),
    }


def energy_figure(records: Sequence[EnergyRecord], run: Observations, *, synthetic: bool, title: str) -> Figure:
    """Position, speed, energy and relative change of energy against time, as the paper's figure 3; `run` has the units."""
    figure = figures.new_figure(5.6)
    axes = figure.subplots(2, 2).ravel()
    for record, colour, mark in zip(records, figures.COLOURS * 4, figures.MARKS * 4, strict=False):
        t = record.x if record.t is None else record.t
        none = np.zeros_like(record.x)
        panels = ((record.x, none), (record.v, record.u_v), (record.total, record.u_total), (record.relative, record.u_relative))
        for ax, (y, u) in zip(axes, panels, strict=True):
            ax.plot(t, y, mark, color=colour, ms=2.5, label=record.run)
            ax.fill_between(t, y - u, y + u, color=colour, alpha=0.18, lw=0)
    names = (f"(a) {run.x_label}", f"(b) {run.y_label}", "(c) energy E/M (J/kg)", "(d) (E − E₀)/E₀")
    for ax, name in zip(axes, names, strict=True):
        ax.set(xlabel="time t (s)" if records[0].t is not None else run.x_label, ylabel=name)
    axes[3].axhline(0.0, color=figures.GREY, lw=0.8)
    axes[0].legend(fontsize=8, frameon=False)
    figure.suptitle(title + (" (SYNTHETIC data)" if synthetic else ""), fontsize=10)
    return figure
