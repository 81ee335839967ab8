"""Report, figures and `trials.json` of trials of release."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from functools import partial
from typing import TYPE_CHECKING

import msgspec

from estim.campaign import Campaign, gamma_origin
from estim.checks import Estimate, interval_cell, parameter_cells, screen_lines, value_cell
from estim.common import Label, Notation, Quantity, Status, as_json, e_n, format_quantity, kind_words, later, one_line, phrase, signed
from estim.line import UNKNOWNS, WAYS, LineAnalysis, TrialsAnalysis
from estim.reports.pages import Drawers, page
from estim.reports.rendering import render
from estim.reports.result import Provenance, software_versions
from estim.reports.trials_figures import chances_figure, starts_figure
from estim.sampling import Summary, number, trusted
from estim.words import STATUS_WORDS, Voice, advice_for, told_apart

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TRIALS_SCHEMA = "estim-trials/1"
_LINES = {"york": later("York's line through the θ_min series"), "posterior": later("Bayesian line through the θ_min series")}
_GAMMA = Notation("γ").label("1")


class WayRow(msgspec.Struct, frozen=True):
    """gamma by one way; e_n against the stated value, e_n_trials against gamma of all trials (null for those that share trials with it)."""

    words: str
    gamma: Summary
    e_n: float | None
    e_n_trials: float | None
    reliable: bool


class ThresholdRow(msgspec.Struct, frozen=True):
    """Where ascents begin at one tilt by itself; angles in rad.  quantiles : at 2.5, 16, 50, 84, 97.5 %."""

    end: str
    phi: float
    n_trial: int
    n_climbed: int
    quantiles: list[float]


class TrialsResult(msgspec.Struct, frozen=True, rename={"schema_": "schema"}):
    """Everything of trials of release; the report prints from it.  Where the status is not ok, what it does not allow is null or empty."""

    schema_: str
    title: str
    kind: str
    status: str
    reasons: list[str]
    advice: list[str]
    disagreements: list[str]
    body: str
    n_trial: int
    n_climbed: int
    n_tilt: int
    gamma_masses: float | None
    u_gamma_masses: float | None
    gamma_origin: str
    unknowns: dict[str, Summary]
    priors: dict[str, str]
    resistance_fixed: float | None
    ways: dict[str, WayRow]
    ends_apart: list[float] | None  # difference, its standard uncertainty, in sds, E_n
    thresholds: list[ThresholdRow]
    offset: list[float] | None  # rad, with its standard uncertainty, at phi_mean
    phi_mean: float
    told_apart: list[str]
    second_computation: str
    provenance: Provenance


def trials_result(campaign: Campaign, analysis: TrialsAnalysis, *, line: LineAnalysis | None = None, voice: Voice = Voice.PYTHON) -> TrialsResult:
    """The record of an analysis of trials.  line : of the same body, to stand beside it.  voice : to whom advice is given."""
    status, trials, masses = analysis.status, analysis.trials, analysis.gamma_masses
    posterior = analysis.posterior
    return TrialsResult(
        schema_=TRIALS_SCHEMA, title=campaign.title, kind=campaign.kind, status=status, reasons=list(analysis.reasons),
        advice=advice_for(analysis.findings, voice), disagreements=list(analysis.disagreements), body=trials.body, n_trial=trials.n_trial,
        n_climbed=trials.n_climbed, n_tilt=len(trials.tilts), gamma_masses=None if masses is None else masses.value,
        u_gamma_masses=None if masses is None else masses.u, gamma_origin=gamma_origin(campaign.source, trials.body),
        unknowns={name: trusted(analysis.summary(name), status) for name in analysis.chain.names},
        priors={name: _shown_prior(analysis, name) for name in analysis.chain.names}, resistance_fixed=number(posterior.resistance),
        ways=_ways(analysis, line) if status.ok else {},
        ends_apart=_apart(analysis) if status.ok else None,
        thresholds=[ThresholdRow(t.end, t.phi, t.n_trial, t.n_climbed, t.quantiles.tolist()) for t in analysis.thresholds],
        offset=[analysis.offset.value, analysis.offset.u] if status.ok else None, phi_mean=analysis.phi_mean,
        told_apart=told_apart({name: told.share for name, told in analysis.told.items()}, analysis.correlation) if status.ok else [],
        second_computation=analysis.agreement.reason,
        provenance=Provenance(
            one_line(str(campaign.source.path)), campaign.source.sha256, {one_line(trials.file): trials.sha256}, analysis.seed, software_versions()
        ),
    )


def _shown_prior(analysis: TrialsAnalysis, name: str) -> str:
    """The prior in the unit in which its unknown is shown."""
    trials, degrees = analysis.trials, math.degrees
    return {
        "scatter": phrase("log-normal about {middle:.3g}, within a factor of 4 with 95 %", middle=degrees(trials.u_theta)),
        "release": phrase("half-normal, scale {scale:.3g}", scale=degrees(trials.release)),
        "zero_phi": phrase("normal, sd {sd:.3g}", sd=degrees(trials.u_zero_phi)),
        "zero_theta": phrase("normal, sd {sd:.3g}", sd=degrees(trials.u_zero_theta)),
    }.get(name) or analysis.posterior.priors[name].describe()


def _ways(analysis: TrialsAnalysis, line: LineAnalysis | None) -> dict[str, WayRow]:
    rows = {name: WayRow(phrase(WAYS[name]), way.gamma, number(way.e_n), None, way.reliable) for name, way in analysis.ways.items()}
    if line is None or not line.status.ok or line.series.body != analysis.trials.body:
        return rows
    found = analysis.ways["both"].quantity
    for name, words in _LINES.items():
        reading = line.readings[name]
        rows[name] = WayRow(phrase(words), _plain(reading.gamma), number(reading.e_n), number(e_n(reading.gamma, found)), True)
    return rows


def _plain(gamma: Quantity) -> Summary:
    """A value and a standard uncertainty as a summary, normal."""
    q025, q16, q84, q975 = (gamma.value + k * gamma.u for k in (-1.959964, -0.994458, 0.994458, 1.959964))
    return Summary("1", phrase(UNKNOWNS["gamma"][1]), gamma.value, gamma.u, gamma.value, q025, q16, q84, q975)


def _apart(analysis: TrialsAnalysis) -> list[float] | None:
    apart = analysis.ends_apart
    return None if apart is None else [apart.difference.value, apart.difference.u, apart.sds, apart.e_n]


def trials_files(
    campaign: Campaign, analysis: TrialsAnalysis, *, line: LineAnalysis | None, voice: Voice
) -> tuple[Drawers, dict[str, object], bytes]:
    """Figures, what the template of the section needs, and `trials.json`."""
    result = trials_result(campaign, analysis, line=line, voice=voice)
    drawers: dict[str, partial[Figure]] = {"figures/trials.png": partial(starts_figure, analysis)}
    if analysis.status.ok:
        drawers["figures/chances.png"] = partial(chances_figure, analysis)
    return drawers, trials_values(result), as_json(result)


def trials_report(campaign: Campaign, analysis: TrialsAnalysis, *, voice: Voice = Voice.PYTHON, figures: bool = True) -> dict[str, bytes]:
    """`report.md`, `trials.json` and the figures of trials by themselves.  voice : to whom advice is given.  figures : whether there are any."""
    drawers, values, record = trials_files(campaign, analysis, line=None, voice=voice)
    return page(drawers, partial(trials_text, values), wanted=figures, kind=campaign.kind) | {"trials.json": record}


def trials_lines(campaign: Campaign, analysis: TrialsAnalysis) -> list[str]:
    """What a terminal says of trials whose status is ok."""
    masses, true = analysis.gamma_masses, campaign.truth.get(f"gamma[{analysis.trials.body}]")
    stated = "" if masses is None else format_quantity(masses.value, masses.u)
    return screen_lines([Estimate(Notation("γ").label("1", "[trials]"), analysis.summary("gamma"), stated, True, None, true)])


def trials_text(values: Mapping[str, object], pictures: Collection[str]) -> str:
    """The Markdown report of trials alone, with the figures at the paths `pictures`."""
    return render("trials.md.j2", pictures=pictures, trials=values)


def trials_values(result: TrialsResult) -> dict[str, object]:
    """What the section of a report needs."""
    status = Status(result.status)
    labels = {name: UNKNOWNS[name][2].label(UNKNOWNS[name][0]) for name in result.unknowns}
    masses = None if result.gamma_masses is None else format_quantity(result.gamma_masses, result.u_gamma_masses)
    return {
        "result": result, "kind": kind_words(result.kind), "status_words": STATUS_WORDS[status], "meaningless": not status.draws_count,
        "gamma": value_cell(result.unknowns["gamma"], _GAMMA) if status.ok else None,
        "gamma_interval": interval_cell(result.unknowns["gamma"], _GAMMA),
        "gamma_masses": masses, "unknowns": [_unknown_cells(result, name, label) for name, label in labels.items()],
        "ways": [(row.words, *_way_cells(row)) for row in result.ways.values()],
        "apart": None if result.ends_apart is None else (
            format_quantity(result.ends_apart[0], result.ends_apart[1]),
            signed(f"{result.ends_apart[2]:+.1f}"), signed(f"{result.ends_apart[3]:+.2f}")
        ),
        "offset": None if result.offset is None else format_quantity(math.degrees(result.offset[0]), math.degrees(result.offset[1])),
        "phi_mean": f"{math.degrees(result.phi_mean):.2g}", "thresholds": [_threshold_cells(row) for row in result.thresholds],
        "both_ends": len({row.end for row in result.thresholds}) > 1,
    }


def _unknown_cells(result: TrialsResult, name: str, label: Label) -> tuple[str, ...]:
    symbol, meaning, value, interval, unit = parameter_cells(result.unknowns[name], label)
    return symbol, meaning, result.priors[name], value, interval, unit


def _way_cells(row: WayRow) -> tuple[str, str, str, str]:
    if not row.reliable:
        return phrase("n/a (its importance weights cannot be trusted)"), "", "", ""
    stated, trials = ("" if value is None else signed(f"{value:+.2f}") for value in (row.e_n, row.e_n_trials))
    return value_cell(row.gamma, _GAMMA), interval_cell(row.gamma, _GAMMA), stated, trials


def _threshold_cells(row: ThresholdRow) -> tuple[str, ...]:
    low95, low68, middle, high68, high95 = (f"{math.degrees(angle):.1f}" for angle in row.quantiles)
    name = "θ_min" if row.end == "min" else "θ_max"
    counts = phrase("{n} of {total}", n=row.n_climbed, total=row.n_trial)
    if 0 < row.n_climbed < row.n_trial:
        return name, f"{math.degrees(row.phi):.2f}", counts, middle, f"[{low68}, {high68}]", f"[{low95}, {high95}]"
    above = (row.n_climbed == 0) == (row.end == "min")
    limit = f"> {low95}" if above else f"< {high95}"
    return name, f"{math.degrees(row.phi):.2f}", counts, phrase("one outcome only"), "", limit
