"""The report of a plan: what to measure next, `report.md`, `plan.json` and figures."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from estim.common import (
    FigureChoice,
    Files,
    Json,
    Status,
    bracketed,
    decide,
    format_quantity,
    phrase,
    with_unit,
)
from estim.drawing import (
    COLOURS,
    GREY,
    INK,
    MARKS,
    Figure,
    grid,
    legend_below,
    name_ticks,
    new_figure,
)
from estim.planning import FAR, MORE, Halving, Option, Plan
from estim.problem import Parameter
from estim.reports.pages import Drawers, page
from estim.reports.result import provenance
from estim.words import describe

SCHEMA = "estim-plan/2"
_WIDE = 68  # characters of a row's name
_MOST = len(COLOURS)  # targets


def plan_status(plan: Plan) -> tuple[Status, list[str]]:
    """Whether the plan may be trusted, and why not: it can be no better than the fit that it comes
    from.
    """
    if plan.findings:
        return decide(plan.findings), [describe(f) for f in plan.findings]
    if plan.shortfall:
        return Status.NOT_CONVERGED, [plan.shortfall]
    reasons = [
        phrase(
            "linear theory gives u({symbol}) = {linear}, but the sampled posterior gives "
            "{drawn}: the ratios are only approximate",
            symbol=p.label.symbol,
            linear=_size(p, plan.now[i]),
            drawn=_size(p, plan.drawn[i]),
        )
        for i, p in enumerate(plan.targets)
        if p in plan.far
    ]
    return Status.METHODS_DISAGREE if reasons else Status.OK, reasons


def plan_answers(plan: Plan) -> list[str]:
    """What to do, in one sentence for each target; nothing where the data contradict what is
    planned from.
    """
    return (
        []
        if plan.findings
        else [_answer(plan, halving, i) for i, halving in enumerate(plan.halving)]
    )


def plan_record(plan: Plan) -> Json:
    """Every number of a plan, as `plan.json` has it."""
    status, reasons = plan_status(plan)
    names = [p.name for p in plan.targets]
    return {
        "schema": SCHEMA,
        "title": plan.campaign.title,
        "kind": plan.campaign.kind,
        "status": status,
        "reasons": reasons,
        "answers": plan_answers(plan),
        "runs": plan.names,
        "targets": {  # standard deviations as things are, by linear theory and of the posterior
            p.name: {
                "unit": p.unit,
                "value": plan.values[i],
                "u_linear": plan.now[i],
                "u_drawn": plan.drawn[i],
                "linear_holds": p not in plan.far,
            }
            for i, p in enumerate(plan.targets)
        },
        "options": [  # the best first
            {
                "what": o.change.words,
                "group": o.change.group,
                "asked": o.change.own,  # by the campaign's [plan]
                "u": dict(zip(names, o.u, strict=True)),  # of each target
                "ratio": dict(zip(names, o.ratio, strict=True)),  # over that as things are
                "remarks": o.remarks,
            }
            for o in plan.options
        ],
        "cannot_be_measured": [{"what": o.change.words, "reason": o.reason} for o in plan.refused],
        "to_halve": {
            h.target.name: [
                {"what": w.words, "ratio": w.ratio} for w in h.ways if np.isfinite(w.ratio)
            ]
            for h in plan.halving
        },
        "provenance": provenance(plan.campaign, plan.names, plan.seed),
    }


def plan_report(plan: Plan, *, figures: FigureChoice) -> Files:
    """`report.md`, `plan.json` and the figures."""
    record, options = plan_record(plan), shown_options(plan.options)
    drawers: Drawers = (
        {"figures/ratios.png": partial(ratio_figure, plan, options)} if options else {}
    )
    if plan.along:
        drawers["figures/places.png"] = partial(along_figure, plan)
    return page(
        drawers,
        "plan.md.j2",
        {"plan.json": record},
        figure_choice=figures,
        kind=plan.campaign.kind,
        record=record,
        plan=plan,
        how=phrase(plan.how),
        shown=options,
        left_out=len(plan.options) - len(options),
        heads=[
            head
            for p in plan.targets
            for head in (f"u({p.label.symbol})" + bracketed(p.label.unit), phrase("ratio"))
        ],
        value_alone=value_alone,
        with_unit=with_unit,
        size=_size,
        far=FAR,
        refused=_refused(plan.refused),
    )


def shown_options(options: Sequence[Option]) -> tuple[Option, ...]:
    """All requested options, and of the further runs that were tried the best, one of each
    tilt.
    """
    chosen, keys = [], set[object]()
    for option in options:
        if option.change.group == MORE and not option.change.own:
            run = option.change.runs[0] if len(option.change.runs) == 1 else None
            key = (
                option.change.words
                if run is None
                else (
                    run.like,
                    *(run.quantities[q].value for q in ("phi", "gamma") if q in run.quantities),
                    bool(run.quantities),
                )
            )
            if key in keys or len(keys) == 8:  # suggested further runs that are shown
                continue
            keys.add(key)
        chosen.append(option)
    return tuple(chosen)


def _answer(plan: Plan, halving: Halving, i: int) -> str:
    target = halving.target
    symbol, sd = target.label.symbol, _size(target, plan.now[i])
    enough = [way.words for way in halving.ways if way.enough][:3]
    idle = _idle(plan, i)
    if enough:
        return phrase(
            "u({symbol}) = {sd} would be halved by {ways}{idle}.",
            symbol=symbol,
            sd=sd,
            ways=phrase(", or ").join(enough),
            idle=idle,
        )
    best = min(plan.options, key=lambda option: option.ratio[i], default=None)
    if best is None or best.ratio[i] > 1.0 - 0.02:  # of a standard deviation: a gain below is none
        return phrase(
            "No single option that was tried halves u({symbol}) = {sd}, and none reduces "
            "it by 2 %.",
            symbol=symbol,
            sd=sd,
        )
    return phrase(
        "No single option that was tried halves u({symbol}) = {sd}; the most effective one "
        "is {what}, which leaves {left:.0f} % of it{idle}.",
        symbol=symbol,
        sd=sd,
        what=best.change.words,
        left=100.0 * best.ratio[i],
        idle=idle,
    )


def _idle(plan: Plan, i: int) -> str:
    """What twice as many frames, or readings, gain."""
    twice = next((o for o in plan.options if o.change.frames == 2.0 and not o.change.own), None)
    if twice is None or twice.ratio[i] < 0.9:
        return ""
    gain = 100.0 * (1.0 - twice.ratio[i])
    return phrase(
        "; {what} would not reduce it"
        if gain < 0.5
        else "; {what} would reduce it by {gain:.0f} %",
        what=twice.change.words,
        gain=gain,
    )


def _size(p: Parameter, u: float) -> str:
    label = p.label
    return with_unit(f"{u * label.factor:.2g}", label.unit)


def value_alone(value: float, u: float) -> str:
    """A value to the digits that its uncertainty leaves, without the uncertainty: '0.75' of 0.75 ±
    0.14, '4.3×10²' of (4.3 ± 0.4)×10².
    """
    text = format_quantity(value, u)
    return text.split(" ± ")[0].removeprefix("(") + text.partition(")")[2]


def _refused(options: Sequence[Option]) -> list[tuple[str, list[str], int]]:
    """Why, what cannot be measured, and how many further ones of those that were tried."""
    by_reason: dict[str, list[Option]] = {}
    for option in options:
        by_reason.setdefault(option.reason, []).append(option)
    rows = []
    for reason, refused in by_reason.items():
        words = [
            option.change.words
            for option in sorted(refused, key=lambda option: not option.change.own)
        ]
        n = max(6, sum(option.change.own for option in refused))
        rows.append((reason, words[:n], len(words[n:])))
    return rows


def ratio_figure(plan: Plan, options: Sequence[Option]) -> Figure:
    """Standard deviations over those as things are, one row an option, the best at the top."""
    names = [
        option.change.words
        if len(option.change.words) <= _WIDE
        else f"{option.change.words[:_WIDE]}…"
        for option in options
    ]
    places = -np.arange(len(names), dtype=float)
    figure = new_figure(0.2 * len(names) + 1.1)
    ax = figure.subplots()
    ax.axvline(1.0, color=INK)
    ax.axvline(0.5, color=INK, ls="--")
    ax.hlines(places, 0.0, 1.0, color=GREY, lw=0.4, alpha=0.5)
    for k, target in enumerate(plan.targets[:_MOST]):
        ratios = [option.ratio[k] for option in options]
        ax.plot(
            ratios,
            places,
            MARKS[k],
            color=COLOURS[k],
            ls="none",
            label=phrase("u of {quantity}", quantity=target.label.tex),
            mec="white",
            mew=0.5,
        )
    ax.set_xlim(0.0, max(1.05, 1.03 * max(float(np.max(option.ratio)) for option in options)))
    ax.set_ylim(float(places[-1]) - 0.8, 0.8)
    name_ticks(ax.yaxis, places, names)
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel(phrase("expected u / present u (dashed: halved)"))
    if len(plan.targets) > 1:
        legend_below(figure, ncols=min(len(plan.targets), 3))
    else:
        ax.set_title(phrase("u of {quantity}", quantity=plan.targets[0].label.tex))
    return figure


def along_figure(plan: Plan) -> Figure:
    """One further reading at each place: what it leaves of the standard deviations; grey: the range
    of the readings at hand.
    """
    runs = plan.fit.problem.runs
    figure, axes = grid(len(plan.along), height=2.4, columns=1)
    for ax, along in zip(axes, plan.along, strict=True):
        run = next(run for run in runs if run.name == along.run)
        ax.axvspan(*along.inside, color=GREY, alpha=0.18)
        ax.axhline(1.0, color=INK)
        for k, target in enumerate(plan.targets[:_MOST]):
            ax.plot(
                along.x,
                along.ratio[k],
                color=COLOURS[k],
                label=phrase("u of {quantity}", quantity=target.label.tex),
            )
            best = int(np.argmin(along.ratio[k]))
            ax.plot(along.x[best], along.ratio[k][best], MARKS[k], color=COLOURS[k])
        ax.plot(run.x, np.full(run.n_obs, 1.0), "|", color=INK)
        ax.set(xlabel=run.x_label, ylabel=phrase("u / present u"))
        if len(plan.along) > 1:
            ax.set_title(along.run)
    axes[0].legend()
    return figure
