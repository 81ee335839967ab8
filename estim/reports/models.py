"""The report of models of a body side by side: `report.md`, `models.json` and figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from estim.campaign import Campaign
from estim.common import (
    FigureChoice,
    Files,
    Json,
    PhraseTable,
    bracketed,
    later,
    number,
    phrase,
    signed,
    split_level,
)
from estim.drawing import BLUE, GREY, INK, ORANGE, PALE, Axes, Figure, grid, name_ticks, new_figure
from estim.explanation import P_NOT_BROUGHT_BACK, Predicted
from estim.problem import Parameter
from estim.reports.pages import Drawers, page
from estim.reports.result import provenance
from estim.sampling import K_HAT_LIMIT, Summary
from estim.studies.model_comparison import (
    FORCE,
    START,
    ComparedModel,
    Ground,
    ModelComparison,
    NoEvidence,
    contains,
    log_odds,
    rival_of,
)
from estim.studies.noise_comparison import in_common

_WORTH = (
    (
        1.0,
        later(
            "not worth more than a "
            # of a log Bayes factor: Kass and Raftery 1995
            "bare mention"
        ),
    ),
    (3.0, later("positive")),
    (5.0, later("strong")),
)
_GROUNDS = PhraseTable(
    {
        Ground.ROOM: (
            "it allows for an unmodelled deviation, and no model with an effect that it does "
            "not contain has higher {what}"
        ),
        Ground.UNDECIDED: (
            "{best} has higher {what}{odds}, but these data do not distinguish it from every "
            "model without its additional effect"
        ),
        Ground.SHOWN: (
            "it contains an additional effect that the default model does not contain, and the "
            "data distinguish it from "
            "every model without this effect"
        ),
        Ground.BEST: "of the models with status ok it has the highest {what}",
        Ground.NONE: "no model has status ok",
    }
)
_LACKS = PhraseTable(
    {
        NoEvidence.NOT_COMPUTED: "not computed for so many unknowns",
        NoEvidence.UNRELIABLE: "not reliable (k-hat above 0.7)",
        NoEvidence.OTHER_NOISE: (
            "its noise could not be given the same freedom as in the other models"
        ),
        NoEvidence.IMPROPER: "a prior is not a normalised distribution",
    }
)
_ROOM = PhraseTable({FORCE: "size of the unmodelled force", START: "energy of the free start"})
_SHORT = PhraseTable({"energy": "change of energy", "its_place": "position of largest speed"})
_FAR = 0.02  # of the data sets beyond what is drawn, on either side


def models_report(
    campaign: Campaign, comparison: ModelComparison, *, seed: int, figures: FigureChoice
) -> Files:
    """The files of a comparison of models."""
    rows, problem = comparison.rows, comparison.rows[0].analysis.problem
    # the quantities of interest
    common = [p for p in in_common(rows) if split_level(p.name)[0] in ("gamma", "kappa", "theta0")]
    summaries = [_summary(row) for row in rows]
    runs = problem.run_names
    drawn = _shown(rows)
    record = {
        "title": campaign.title,
        "kind": campaign.kind,
        "runs": runs,
        "recommended": comparison.recommended or None,
        "ground": str(comparison.ground),
        "models": summaries,
        "provenance": provenance(campaign, runs, seed),
    }
    drawers: Drawers = {
        "figures/values.png": partial(values_figure, summaries, common, comparison.recommended)
    }
    if drawn.predicted:
        drawers["figures/predictive.png"] = partial(
            predictive_figure, drawn.predicted, drawn.model.name
        )
    return page(
        drawers,
        "models.md.j2",
        {"models.json": record},
        figure_choice=figures,
        kind=campaign.kind,
        title=campaign.title,
        runs=runs,
        rows=summaries,
        recommended=comparison.recommended,
        ground=ground_words(comparison),
        verdicts=verdicts(comparison),
        by_evidence=comparison.by_evidence,
        common=common,
        widths=_width_table(rows),
        predicted=_predicted_table(rows),
        shown=drawn.model.name,
        strange=[statistic for statistic in drawn.predicted if not statistic.brought_back],
        limit=P_NOT_BROUGHT_BACK,
        influential=K_HAT_LIMIT,
        odds=odds_words,
        lines=next(
            (row.model.lines for row in rows if row.model.name == comparison.recommended), ()
        ),
        price=next((row.price_of_start for row in rows if row.model.forced), 0.0),
        price_words=price_words(comparison),
        names=[row.model.name for row in rows],
    )


def ground_words(comparison: ModelComparison) -> str:
    """Why the recommended model is recommended."""
    rival = rival_of(comparison.rows, by_evidence=comparison.by_evidence)
    default = next((row for row in comparison.rows if row.model.forced), None)
    what = phrase(
        "evidence"
        if comparison.by_evidence
        else "predictive density (leave-one-out; not every model has an evidence)"
    )
    odds = ""
    if comparison.by_evidence and rival is not None and default is not None:
        odds = f", {odds_words(log_odds(rival, default))}"
    return _GROUNDS[comparison.ground].format(
        best="" if rival is None else rival.model.name, what=what, odds=odds
    )


def verdicts(comparison: ModelComparison) -> list[tuple[str, str]]:
    """Each model that is not recommended, and why not."""
    chosen = next(
        (row for row in comparison.rows if row.model.name == comparison.recommended), None
    )
    return [(row.model.name, _why_not(row, chosen)) for row in comparison.rows if row is not chosen]


def price_words(comparison: ModelComparison) -> str:
    """That odds leave out what a free start costs, "" where none does."""
    row = next((row for row in comparison.rows if row.price_of_start), None)
    return (
        ""
        if row is None
        else phrase(
            "the odds exclude the penalty for the free start of {name}, {odds}: its width "
            "is a convention, and models that start exactly at "
            "rest do not incur it",
            name=row.model.name,
            odds=odds_words(row.price_of_start),
        )
    )


def odds_words(difference: float) -> str:
    """A difference of log evidence as odds, and in words."""
    odds = math.exp(min(abs(difference), 700.0))
    ratio = (
        phrase("more than a million")
        if odds > 1e6  # odds that nobody needs more exactly
        else f"{odds:.2g}"
        if odds < 10.0
        else f"{odds:,.0f}".replace(",", " ")
    )
    return phrase(
        "{odds} to 1 ({words})",
        odds=ratio,
        words=phrase(
            next(
                (words for limit, words in _WORTH if abs(difference) < limit), later("very strong")
            )
        ),
    )


def _why_not(row: ComparedModel, chosen: ComparedModel | None) -> str:
    log_ratio = (
        None
        if chosen is None or chosen.lack is not None or row.lack is not None
        else log_odds(row, chosen)
    )
    against = later("the odds against it are {odds}")
    if not row.ok:
        reason = f"{row.analysis.diagnosis.status}: {row.analysis.diagnosis.reasons[0]}"
        if log_ratio is None or log_ratio >= 0.0:
            return reason
        return f"{reason}; {phrase(against, odds=odds_words(log_ratio))}"
    if chosen is None:
        return phrase("no model is recommended")
    if log_ratio is None:
        advantage = chosen.behind - row.behind
        words = phrase(
            "its predictions are better by {by:.1f} (elpd)"
            if advantage > 0.0
            else "its predictions are worse by {by:.1f} (elpd)",
            by=abs(advantage),
        )
    else:
        odds = later("the odds for it are {odds}") if log_ratio >= 0.0 else against
        words = phrase(odds, odds=odds_words(log_ratio))
    return (
        phrase("contained in the recommended model; {words}", words=words)
        if contains(chosen, row)
        else words
    )


def _shown(rows: Sequence[ComparedModel]) -> ComparedModel:
    """The model whose data sets are drawn: the default, else what the campaign states, else the
    simplest.
    """
    by_name = {row.model.name: row for row in rows}
    return by_name.get("unmodelled-force") or by_name.get("as-stated") or rows[0]


def _summary(row: ComparedModel) -> Json:
    analysis, status = row.analysis, row.analysis.diagnosis.status
    posterior = dict(zip(analysis.fit.names, analysis.summaries, strict=True))
    return {
        "name": row.model.name,
        "words": row.model.words,
        "adds": row.model.own,
        "lines": row.model.lines,
        "status": status,
        "reasons": analysis.diagnosis.reasons,
        "posterior": posterior,
        "log_evidence": number(row.log_evidence),
        "u_log_evidence": number(row.u_log_evidence),
        "no_evidence": "" if row.lack is None else _LACKS[row.lack],
        "behind_evidence": number(row.odds),
        # log evidence that a free start costs; the odds do not include it
        "price_of_start": row.price_of_start,
        "elpd": number(row.loo.elpd),
        "behind_elpd": number(row.behind),
        "se_behind_elpd": number(row.behind_se),
        "influential": sum(int((k > K_HAT_LIMIT).sum()) for k in row.loo.k_hat),
        "widths": row.widths,
        "predicted": [_predicted(entry) for entry in row.predicted],
    }


def _predicted(statistic: Predicted) -> Json:
    low, middle, high = np.quantile(statistic.replicated, [0.025, 0.5, 0.975], method="nearest")
    return {
        "run": statistic.run,
        "statistic": statistic.name,
        "unit": statistic.label.unit if statistic.label.factor == 1.0 else "1",
        "observed": np.median(statistic.observed),
        "q025": low,
        "median": middle,
        "q975": high,
        "p": statistic.p,
    }


def _width_table(rows: Sequence[ComparedModel]) -> list[tuple[str, str, list[str]]]:
    """Model, what, and the change of the log evidence for each factor."""
    table = []
    for row in rows:
        labels = {p.name: p.label.symbol for p in row.analysis.problem.parameters}
        for of in dict.fromkeys(width.of for width in row.widths):
            by_factor = {width.factor: width.change for width in row.widths if width.of == of}
            changes = [
                _change(by_factor[factor]) if factor in by_factor else ""
                for factor in (0.0, 0.5, 2.0)
            ]
            table.append((row.model.name, labels.get(of) or _ROOM.get(of, of), changes))
    return table


def _change(value: float) -> str:
    return signed(f"{value:+.2f}") if math.isfinite(value) else "n/a"


def _predicted_table(rows: Sequence[ComparedModel]) -> list[tuple[str, str, list[str]]]:
    """Run, statistic, and p under each model."""
    every = {
        (statistic.run, statistic.name): statistic.words
        for row in rows
        for statistic in row.predicted
    }
    of_row = [
        {(statistic.run, statistic.name): statistic.p_words for statistic in row.predicted}
        for row in rows
    ]
    return [
        (run, words, [cells.get((run, name), "—") for cells in of_row])
        for (run, name), words in every.items()
    ]


def values_figure(
    rows: Sequence[Json], common: Sequence[Parameter], recommended: str = ""
) -> Figure:
    """68 and 95 % intervals of each quantity under each model; those of a model that is not ok in
    grey, dashed.

    rows : "name", "status" and "posterior" of each model.
    """
    figure, axes = grid(len(common), height=0.5 + 0.27 * len(rows), columns=3)
    places = np.arange(len(rows))[::-1]
    for i, (ax, p) in enumerate(zip(axes, common, strict=True)):
        for place, row in zip(places, rows, strict=True):
            _interval(
                ax,
                place,
                row["posterior"][p.name],
                p.label.factor,
                ok=row["status"] == "ok",
                recommended=row["name"] == recommended,
            )
        name_ticks(ax.yaxis, places, [row["name"] if i % 3 == 0 else "" for row in rows])
        ax.set(xlabel=p.label.axis, ylim=(-0.6, len(rows) - 0.4))
        ax.locator_params(axis="x", nbins=4)
    figure.suptitle(
        phrase(
            "median, 68 and 95 % intervals; orange square: recommended; grey, dashed: not "
            "ok, do not use"
            if recommended
            else "median, 68 and 95 % intervals; grey, dashed: not ok, not to be used"
        )
    )
    return figure


def _interval(
    ax: Axes, place: float, summary: Summary, factor: float, *, ok: bool, recommended: bool
) -> None:
    quantiles = (summary.q025, summary.q16, summary.median, summary.q84, summary.q975)
    if any(q is None for q in quantiles):
        return
    low, lower, middle, upper, high = (float(q) * factor for q in quantiles if q is not None)
    colour = ORANGE if recommended else BLUE if ok else GREY
    ax.plot([low, high], [place, place], color=colour, ls="-" if ok else (0, (3, 2)))
    ax.plot([lower, upper], [place, place], color=colour, lw=2.6 if ok else 1.6)
    ax.plot(
        middle,
        place,
        "s" if recommended else "o",
        color=colour,
        mfc=colour if ok else "white",
        ms=5 if recommended else 4,
        zorder=4,
    )


def predictive_figure(predicted: Sequence[Predicted], model: str) -> Figure:
    """Histograms of each statistic of the data sets, and that of the data: a line, or an outline
    where it depends on the parameters.
    """
    runs = list(dict.fromkeys(statistic.run for statistic in predicted))
    names = list(dict.fromkeys(statistic.name for statistic in predicted))
    figure = new_figure(0.7 + 1.75 * len(runs))
    axes = figure.subplots(len(runs), len(names), squeeze=False)
    by_place = {(statistic.run, statistic.name): statistic for statistic in predicted}
    for i, run in enumerate(runs):
        for k, name in enumerate(names):
            ax, statistic = axes[i, k], by_place.get((run, name))
            if statistic is None:
                ax.set_visible(False)
                continue
            _histogram(ax, statistic)
            if k == 0:
                ax.set_ylabel(run)
    figure.suptitle(
        phrase("{model}: filled: data sets drawn from the posterior; orange: the data", model=model)
    )
    return figure


def _histogram(ax: Axes, statistic: Predicted) -> None:
    replicated, observed = (
        statistic.replicated * statistic.label.factor,
        statistic.observed * statistic.label.factor,
    )
    ends = (
        np.quantile(replicated[np.isfinite(replicated)], [_FAR / 2.0, 1.0 - _FAR / 2.0])
        if np.any(np.isfinite(replicated))
        else np.array([0.0, 1.0])
    )
    low = min(float(ends[0]), float(np.min(observed)))
    high = max(float(ends[1]), float(np.max(observed)))
    width = max(high - low, 1e-12)
    edges: list[float] = np.linspace(low - 0.03 * width, high + 0.03 * width, 31).tolist()
    ax.hist(replicated, bins=edges, color=PALE, edgecolor=BLUE, linewidth=0.4)
    if observed.size > 1:
        ax.hist(observed, bins=edges, histtype="step", color=ORANGE, linewidth=1.6)
    else:
        ax.axvline(float(observed[0]), color=ORANGE, lw=2.2)
    ax.set(yticks=[], xlim=(edges[0], edges[-1]))
    ax.locator_params(axis="x", nbins=3)
    short = _SHORT.get(statistic.name, statistic.words)
    ax.set_xlabel(short + bracketed(statistic.label.unit), fontsize=7.5)
    ax.set_title(
        f"p {statistic.p_words}" if "<" in statistic.p_words else f"p = {statistic.p_words}",
        color=INK,
    )
