"""Report, figure and `result.json` of the energy along runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from estim.campaign import Campaign
from estim.common import (
    FigureChoice,
    Files,
    Json,
    Quantity,
    format_p,
    gravest,
    percentage,
    phrase,
    significant,
    with_unit,
)
from estim.drawing import GREY, MARKS, RUN_COLOURS, Figure, fill, legend_below, new_figure
from estim.pipeline import Analysis
from estim.reports.pages import page
from estim.reports.rendering import shown
from estim.reports.result import provenance
from estim.studies.energy import Drift, EnergyRecord, energy_status

_ANYTHING = 1.0  # standard uncertainty of a ratio that is undetermined


def summarise_energy(e: EnergyRecord) -> Json:
    """Energy along one run, as files have it: relative to the energy at release (as in the paper)
    and to the largest kinetic energy; null where there is none.
    """
    return {
        "unit": "1",  # of the ratios
        "mean_relative": e.mean_relative,
        "extreme_relative": e.extreme_relative,
        "mean_to_kinetic": e.mean_to_kinetic,
        "extreme_to_kinetic": e.extreme_to_kinetic,
        "loss_per_metre": e.loss.of_unit("J/(kg m)"),
        "loss_interval_95": e.loss_interval,
        "loss_force": e.loss_force.of_unit("N"),
    }


def summarise_drift(drift: Drift) -> Json:
    """The test for a loss of energy, as files have it."""
    names = ("free", "determined", "seen", "narrowing", "gain", "p_value", "limit")
    return {name: getattr(drift, name) for name in names}


def drift_words(drift: Json) -> str:
    """What the data show of a loss of energy, in words."""
    if not drift["free"]:
        return phrase(
            "This fit held the rolling resistance fixed, so the energies agree with it by "
            "construction and contain no information about "
            "a loss: give rolling_resistance a prior."
        )
    return phrase(
        "Allowing a loss improves χ² by {gain:.1f} ({p} if there were none); the data "
        "reduce the uncertainty of the rolling "
        "resistance to {share} of its prior, so the loss below is measured."
        if drift["seen"]
        else "Allowing a loss improves χ² by {gain:.1f} ({p} if there were none), which is "
        "consistent with no loss. The data reduce the "
        "uncertainty of the rolling resistance to {share} of its prior: c_rr ≤ {limit} "
        "with probability 95 %; read the loss below as "
        "a limit, not as a measurement."
        if drift["determined"]
        else "Allowing a loss improves χ² by {gain:.1f} ({p} if there were none). After the fit "
        "the rolling resistance is about as uncertain "
        "as its prior ({share} of the prior's width): a loss computed from it would reflect this "
        "prior and not a measurement, so these data do not determine how large a loss is. A "
        "joint fit of more runs, or a wider prior, lets the data determine it.",
        gain=max(drift["gain"], 0.0),
        p=format_p(drift["p_value"]),
        share=percentage(drift["narrowing"]),
        limit=significant(drift["limit"], 2),
    )


def energy_words(drift: Json) -> str:
    """The same in a few words."""
    if not drift["free"]:
        return phrase("a loss cannot be detected, because the rolling resistance was held fixed")
    if drift["seen"]:
        return phrase("a loss is measured ({p} if there were none)", p=format_p(drift["p_value"]))
    if drift["determined"]:
        return phrase(
            "no loss is detected, c_rr ≤ {limit} (95 %)", limit=significant(drift["limit"], 2)
        )
    return phrase("the data do not determine how much energy is lost")


def energy_lines(analysis: Analysis, drift: Drift) -> list[str]:
    """The lines of a terminal on the energy: why there is no result, or the result."""
    if not analysis.diagnosis.ok:
        return list(analysis.diagnosis.reasons)
    summary = summarise_drift(drift)
    return [energy_words(summary) if drift.determined else drift_words(summary)]


def percent(ratio: Quantity) -> str:
    """A ratio as text, in per cent; none where it is divided by what may be 0."""
    return with_unit(shown(ratio, 100.0), "%") if ratio.u <= _ANYTHING else "n/a"


def average_words(energies: Mapping[str, Json]) -> str:
    """How far the energies are from that at release on average, in words: as shares of it, or of
    the largest kinetic energy where it may be 0.
    """
    by_start = all(e["mean_relative"].u <= _ANYTHING for e in energies.values())
    shares = [
        percent(e["mean_relative" if by_start else "mean_to_kinetic"]) for e in energies.values()
    ]
    fields = {"shares": ", ".join(shares), "runs": ", ".join(energies)}
    return phrase(
        "Averaged over the frames of a run, the energy differs from its value at "
        "release by {shares} ({runs})."
        if by_start
        else "Averaged over the frames of a run, the energy differs from its value at release "
        "by {shares} of the largest kinetic energy ({runs}).",
        **fields,
    )


def energy_report(
    campaign: Campaign,
    analyses: Sequence[Analysis],
    records: Sequence[EnergyRecord],
    drifts: Sequence[Drift],
    *,
    seed: int,
    figures: FigureChoice,
) -> Files:
    """`report.md`, `result.json` and `figures/energy.png`.

    records : in the order of the analyses' runs.
    drifts : one for each analysis.
    """
    fits = {
        ", ".join(a.problem.run_names): (a, drift)
        for a, drift in zip(analyses, drifts, strict=True)
    }
    statuses = {
        run.name: energy_status(a, drift) for a, drift in fits.values() for run in a.problem.runs
    }
    bad = frozenset(run.name for a in analyses if not a.diagnosis.ok for run in a.problem.runs)
    result = {
        "schema": "estim-energy/1",
        "title": campaign.title,
        "kind": campaign.kind,
        "status": gravest(statuses.values()),  # of the fits
        "reasons": {r: a.diagnosis.reasons for r, (a, _) in fits.items() if not a.diagnosis.ok},
        "statuses": statuses,
        "energies": {e.run: summarise_energy(e) for e in records if statuses[e.run] == "ok"},
        # by the runs that were fit together
        "drift": {r: summarise_drift(drift) for r, (a, drift) in fits.items() if a.diagnosis.ok},
        "provenance": provenance(campaign, statuses, seed),
    }
    return page(
        {"figures/energy.png": partial(energy_figure, records, title=campaign.title, bad=bad)},
        "energy.md.j2",
        {"result.json": result},
        figure_choice=figures,
        kind=campaign.kind,
        result=result,
        energies=result["energies"],
        percent=percent,
        drift_words=drift_words,
        energy_words=energy_words,
    )


def energy_figure(
    records: Sequence[EnergyRecord], *, title: str, bad: frozenset[str] = frozenset()
) -> Figure:
    """Position, speed, energy and relative change of energy against time, as the paper's figure 3;
    no bands for runs that are `bad`.

    Energies have a strip for each run: the bands of several runs in one panel hide each other.
    """
    n = len(records)
    figure = new_figure(3.2 + max(2.6, 0.95 * n))
    axes = figure.subplots(
        1 + n, 2, squeeze=False, height_ratios=(2.8, *[max(2.6, 0.95 * n) / n] * n)
    )
    (x_panel, v_panel), energies, changes = axes[0], axes[1:, 0], axes[1:, 1]
    for column in (energies, changes):
        for strip in column[:-1]:
            strip.sharex(column[-1])
            strip.tick_params(labelbottom=False)
    for change in changes[1:]:
        change.sharey(changes[0])
    timed = all(record.t is not None for record in records)
    for record, colour, mark, strip, change in zip(
        records, RUN_COLOURS * n, MARKS * n, energies, changes, strict=False
    ):
        t = record.t if timed and record.t is not None else record.x
        none = np.zeros_like(record.x)
        panels = (
            (x_panel, record.x, none),
            (v_panel, record.v, record.u_v),
            (strip, record.total, record.u_total),
        )
        for ax, y, u in (*panels, (change, 100.0 * record.relative, 100.0 * record.u_relative)):
            ax.plot(t, y, mark, color=colour, ms=2.5, label=record.run)
            if record.run not in bad:
                fill(ax, t, y - u, y + u, colour, 0.25)
        change.axhline(0.0, color=GREY)
        for ax in (strip, change):
            ax.set_title(record.run, fontsize=7, loc="right", pad=2)
    along = f"{phrase('time t')} (s)" if timed else f"{phrase('position x')} (m)"
    x_panel.set(xlabel=along, ylabel=phrase("(a) position x (m)"))
    v_panel.set(xlabel=along, ylabel=phrase("(b) speed v (m/s)"))
    for strips, name in (
        (energies, phrase("(c) energy E/M (J/kg)")),
        (changes, "(d) (E − E₀)/E₀ (%)"),
    ):
        strips[-1].set_xlabel(along)
        strips[0].set_title(name, loc="left", pad=2)
    legend_below(figure, ncols=min(n, 6))
    figure.suptitle(title)
    return figure
