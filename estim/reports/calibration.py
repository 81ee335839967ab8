"""The report of a calibration: `report.md`, `calibration.json` and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from estim.calibration import (
    EDGES,
    N_RANK,
    UNIFORM_BELOW,
    Calibration,
    coverage_sentence,
    direction,
    findings,
    rank_counts,
    uniformity_band,
)
from estim.campaign import Campaign
from estim.common import (
    PROBABILITIES,
    FigureChoice,
    Files,
    Json,
    PhraseTable,
    decide,
    number,
    percentage,
    phrase,
)
from estim.drawing import BLUE, GREY, INK, ORANGE, Figure, fill, grid, name_ticks
from estim.problem import Problem
from estim.reports.pages import Drawers, page
from estim.reports.result import provenance
from estim.words import describe, direction_words

SCHEMA = "estim-calibration/1"
_AT = {"sbc": "priors", "coverage": "fit"}
_ENGINES = PhraseTable({"importance sampling": "importance sampling", "chain": "chain"})


def unlike_fit(problem: Problem, with_usual_errors: Problem) -> str:
    """What `estim fit` adds to the curves of a problem and a calibration does not, in words; ""
    where it is the same analysis.
    """
    has_default_errors = problem.names != with_usual_errors.names
    additions = [phrase("an unmodelled force")] if any(run.force for run in problem.runs) else []
    additions += [phrase("default errors of clock and scale")] if has_default_errors else []
    if not additions:
        return ""
    return phrase(
        "the intervals checked are those of the curve alone; those of estim fit also allow "
        "for {beside}, and are not checked here",
        beside=phrase(" and ").join(additions),
    )


def calibration_report(
    campaign: Campaign, calibrations: Sequence[Calibration], *, unlike: str, figures: FigureChoice
) -> Files:
    """The files of one or two calibrations (ranks, coverage) of the same runs.

    unlike : how the analysis differs from that of `estim fit`, "" where it does not.
    """
    records = {c.what: calibration_record(campaign, c) for c in calibrations}
    drawers: Drawers = {}
    for calibration in calibrations:
        if calibration.what == "sbc":
            drawers["figures/ranks.png"] = partial(rank_figure, calibration)
        drawers[f"figures/coverage-{_AT[calibration.what]}.png"] = partial(
            coverage_figure, calibration
        )
    return page(
        drawers,
        "calibration.md.j2",
        {"calibration.json": records},
        figure_choice=figures,
        kind=campaign.kind,
        title=campaign.title,
        runs=", ".join(calibrations[0].runs),
        uniform_below=UNIFORM_BELOW,
        coverage_sds=calibrations[0].off_sds,
        n_rank=N_RANK,
        parts=[_part(calibration, records[calibration.what]) for calibration in calibrations],
        unlike=unlike,
    )


def calibration_record(campaign: Campaign, c: Calibration) -> Json:
    """Every number of a calibration, as `calibration.json` has it."""
    calibration_findings = findings(c)
    numbers = {}
    for name, unit in c.reported.items():
        places = c.places_of(name)
        coverage = zip(PROBABILITIES, c.share(name), c.share_sd(), strict=True)
        numbers[name] = {
            "unit": unit,
            "p_value": number(c.p_value(name)),
            # as a share of all ranks; 0.5 where estimates are not biased
            "mean_rank": np.mean(places) if places.size else None,
            # share of the trials whose interval contains the truth; its sd if the coverage is
            # nominal
            "coverage": [{"probability": p, "share": share, "sd": sd} for p, share, sd in coverage],
        }
    return {
        "schema": SCHEMA,
        "what": c.what,
        "status": decide(calibration_findings),
        "findings": [describe(f) for f in calibration_findings],
        "runs": c.runs,
        "n_trial": c.n_trial,
        "n_rejected": c.n_rejected,
        "n_failed": c.n_failed,
        "n_short": c.n_short,
        "engines": dict(c.how),
        "failures": dict(c.failures),
        "leaning": c.leaning,
        "n_rank": N_RANK,
        "numbers": numbers,
        "ranks": {name: c.ranks[:, i] for i, name in enumerate(c.reported)},
        "provenance": provenance(campaign, c.runs, c.seed),
    }


def _part(c: Calibration, record: Json) -> Mapping[str, object]:
    """What the template shows of one calibration."""
    engines = [
        phrase("{count} by {how}", count=count, how=_ENGINES[how])
        for how, count in sorted(c.how.items())
        if how != "none"
    ]
    return {
        "calibration": c,
        "at": _AT[c.what],
        "findings": record["findings"],
        "numbers": record["numbers"],
        "directions": {name: direction_words(direction(c, name)) for name in c.reported},
        "sds": [f"{100 * sd:.1f}" for sd in c.share_sd()],
        "engines": ", ".join(engines),
        "leaning": [c.labels[name].symbol for name in c.leaning] if c.what == "coverage" else [],
        "sentences": [coverage_sentence(c, name) for name in c.reported]
        if c.what == "coverage"
        else [],
    }


def rank_figure(calibration: Calibration) -> Figure:
    """Distribution function of the ranks minus that of uniform ranks, one panel a quantity, with
    the 95 % simultaneous band.
    """
    names = list(calibration.reported)
    figure, axes = grid(len(names), height=1.75, columns=3, sharey=True)
    for ax, name in zip(axes, names, strict=True):
        ranks = calibration.ranks_of(name)
        ax.axhline(0.0, color=GREY)
        ax.set_title(calibration.labels[name].tex)
        if ranks.size == 0:
            continue
        low, high = (end - EDGES for end in uniformity_band(ranks.size))
        difference = rank_counts(ranks) / ranks.size - EDGES
        inside = bool(np.all((difference >= low) & (difference <= high)))
        fill(ax, EDGES, low, high, GREY, 0.3)
        ax.step(
            EDGES,
            difference,
            where="mid",
            color=BLUE if inside else ORANGE,
            lw=1.2 if inside else 1.8,
        )
    figure.supxlabel(phrase("rank of the true value among posterior draws, as a fraction"))
    figure.supylabel(phrase("ECDF − uniform"))
    return figure


def coverage_figure(calibration: Calibration) -> Figure:
    """Share of the trials whose interval contains the truth, with one and `off_sds` Monte-Carlo
    standard deviations about the stated probability.
    """
    names = list(calibration.reported)
    n = len(PROBABILITIES)
    figure, axes = grid(n, height=0.26 * len(names) + 0.5, columns=n, sharey=True)
    rows = np.arange(len(names))[::-1]
    for i, (ax, p, sd) in enumerate(zip(axes, PROBABILITIES, calibration.share_sd(), strict=True)):
        for width, shade in ((1.0, 0.35), (calibration.off_sds, 0.18)):
            ax.axvspan(
                100 * (p - width * sd), min(100 * (p + width * sd), 100.0), color=GREY, alpha=shade
            )
        ax.axvline(100 * p, color=INK)
        shares = np.array([calibration.share(name)[i] for name in names])
        outside = np.abs(shares - p) > calibration.off_sds * sd
        ax.plot(100 * shares[~outside], rows[~outside], "o", color=BLUE)
        ax.plot(100 * shares[outside], rows[outside], "D", color=ORANGE)
        ax.set_xlabel(phrase("covered by the {p} interval (%)", p=percentage(p)))
    name_ticks(axes[0].yaxis, rows, [calibration.labels[name].tex for name in names])
    return figure
