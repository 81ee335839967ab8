"""Reports: Markdown, figures and JSON of an analysis, as a mapping from relative path to bytes.

The text stands in `templates/`; every number in it comes from `result.Result`, rounded by its
uncertainty here.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial

from estim.campaign import Campaign
from estim.checks import P_CONFLICT, P_POOR_FIT, P_TOLD
from estim.common import (
    FigureChoice,
    Files,
    Label,
    Notation,
    as_json,
    format_quantity,
    format_rounded,
    phrase,
    split_level,
)
from estim.explanation import Explanation, across_runs
from estim.fitting import MANY_RUNS, ProfileInterval, moved_by_integration
from estim.pipeline import Analysis
from estim.reports.consistency import consistency_text, forest_figure
from estim.reports.copying import copies_of
from estim.reports.corner_figures import corner_figure, corner_words, trace_figure
from estim.reports.counts import counts_figure, counts_text
from estim.reports.curve_figures import (
    MOST_DRAWN,
    abscissas_figure,
    drawn_runs,
    phase_figure,
    residual_figure,
    together_figure,
)
from estim.reports.derived import derived_rows
from estim.reports.explanation import explanation_text, runs_text, slip_words
from estim.reports.identifiability import direction_figure, identify_section, profile_figure
from estim.reports.model_discrepancy import discrepancy_figure, force_figure
from estim.reports.pages import Drawers, finished, images, numbered, shortened
from estim.reports.records import DRAWS, LEAST_SHIFT
from estim.reports.rendering import render
from estim.reports.result import (
    ParameterSummary,
    Result,
    Subject,
    first_reasons,
    first_screen,
    opened_by,
    result_of,
)
from estim.reports.rolling import friction_cell, rolling_figure
from estim.reports.sections import sections_called, written
from estim.reports.uncertainty_budget import Shares, budget_figure, budget_of, shares_of
from estim.sampling import Summary, value_cell
from estim.studies.determination import determine
from estim.words import first_step, name_of_test, one_sided

# parameters, beyond which a figure of directions, or a table of all correlations, is not for
# reading
_MOST_DIRECTIONS, _MOST_CORRELATED = 60, 40


def analysis_report(
    campaign: Subject,
    analysis: Analysis,
    *,
    figures: FigureChoice = "main",
    profiles: bool = True,
    sections: Sequence[str] = (),
) -> dict[str, bytes]:
    """`report.md`, `result.json` and `figures/*.png` of one analysis.

    campaign : what was analysed: a `Campaign`.
    figures : "main" is curve and data alone.  profiles : whether there are profile intervals.
    sections : names of further ones, by installed packages (docs/extending.md).  Raises InputError.

    >>> from estim import Target, analyse, analysis_report, load_campaign
    >>> campaign = load_campaign("data/gallery/hubble.toml", only="with-intercept")
    >>> analysis = analyse(campaign, ["with-intercept"], seed=1, target=Target(ess=400.0))
    >>> sorted(analysis_report(campaign, analysis, figures="none", profiles=False))
    ['report.md', 'result.json']
    """
    return report_and_result(
        campaign, analysis, figures=figures, profiles=profiles, sections=sections
    )[0]


def report_and_result(
    campaign: Subject,
    analysis: Analysis,
    *,
    figures: FigureChoice,
    profiles: bool = True,
    sections: Sequence[str],
) -> tuple[Files, Result]:
    """The files of `analysis_report`, and the record that they show."""
    added = sections_called(sections)  # their versions are in the record
    determination = determine(analysis, profiles=profiles)
    budget = budget_of(analysis)
    result = result_of(campaign, analysis, determination, budget=budget)
    shares = None if budget is None else shares_of(analysis, budget, result.labels)
    section = identify_section(
        analysis.problem,
        analysis.identifiability,
        determination.intervals,
        determination.sensitivity,
        analysis.chain.thinned(4000),
    )

    drawers: Drawers = {"figures/phase.png": partial(phase_figure, analysis)}
    if any(run.numbered for run in analysis.problem.runs):
        drawers["figures/abscissas.png"] = partial(abscissas_figure, analysis)
    if any(run.noise.counted is not None for run in analysis.problem.runs):
        drawers["figures/counts.png"] = partial(counts_figure, analysis.fit, analysis.goodness)
    drawn = images(
        drawers,
        figure_choice=figures,
        further=_further_drawers(analysis, determination.intervals, shares, campaign.truth),
        kind=campaign.kind,
    )
    text = _text(campaign, analysis, result, section, shares, drawn)
    text = finished(text + "".join(written(plugin, result) for plugin in added))
    return drawn | shortened(text) | {"result.json": as_json(result)}, result


def _further_drawers(
    analysis: Analysis,
    intervals: Sequence[ProfileInterval],
    shares: Shares | None,
    truth: Mapping[str, float],
) -> Drawers:
    drawn = drawn_runs(analysis.goodness)
    figures: Drawers = {
        "figures/residuals.png": lambda: residual_figure(
            [analysis.problem.runs[i] for i in drawn], [analysis.goodness[i] for i in drawn]
        ),
        "figures/corner.png": lambda: corner_figure(analysis, truth),
        "figures/traces.png": lambda: trace_figure(analysis),
    }
    if analysis.problem.n_par <= _MOST_DIRECTIONS:
        figures["figures/directions.png"] = lambda: direction_figure(
            analysis.problem, analysis.identifiability
        )
    if intervals:
        figures["figures/profiles.png"] = lambda: profile_figure(
            analysis.problem, intervals, analysis.chain.thinned(DRAWS)
        )
    if shares is not None:
        figures["figures/budget.png"] = partial(
            budget_figure,
            [label.tex for label in shares.labels],
            shares.sources,
            100.0 * shares.shares,
        )
    if analysis.consistency is not None:
        figures["figures/consistency.png"] = partial(
            forest_figure,
            analysis.consistency,
            on_edge=analysis.fit.at_bound,
            edges={p.name: (p.prior.low, p.prior.high) for p in analysis.problem.parameters},
        )
    if len(analysis.problem.runs) > 1:
        figures["figures/residuals_together.png"] = lambda: together_figure(
            analysis.problem, analysis.goodness
        )
    if analysis.fit.forces:
        figures["figures/force.png"] = lambda: force_figure(
            analysis.fit.forces, analysis.problem.runs
        )
    if analysis.diagnosis.ok and any(check.stated for check in analysis.rolling):
        figures["figures/rolling.png"] = lambda: rolling_figure(
            analysis.problem, analysis.chain.thinned(1000), analysis.rolling
        )
    if analysis.fit.deviations:
        figures["figures/deviation.png"] = lambda: discrepancy_figure(
            analysis.fit.deviations, analysis.problem.runs
        )
    return figures


def _text(
    campaign: Subject,
    analysis: Analysis,
    result: Result,
    section: Mapping[str, object],
    shares: Shares | None,
    pictures: Collection[str],
) -> str:
    """The Markdown report of one analysis, with the figures at the paths `pictures`.

    section : its part about the data against the priors.
    shares : of the sources of uncertainty, None where there is no uncertainty to explain.
    """
    agreement, fit = analysis.consistency, analysis.fit
    spreads, scaled = fit.spreads_and_effects
    axes = list(dict.fromkeys((run.x, run.y) for run in result.runs.values()))
    among = max(1.0, len(result.runs) / MANY_RUNS)
    note_below = (
        P_TOLD / among if any("speed" in run.checks for run in result.runs.values()) else None
    )
    screen = first_screen(result)
    return render(
        "analysis.md.j2",
        pictures=pictures,
        opened=opened_by(result),
        screen=screen,
        copies=copies_of(screen.estimates, kind=result.kind) if screen.estimates else None,
        numbered=all(run.numbered for run in analysis.problem.runs),
        several=[", ".join(run.places) for run in analysis.problem.runs if run.places],
        budget=shares,
        result=result,
        prior=prior_cell,
        fit=fit_cell,
        symbols=[
            result.labels.symbol(name) for name in result.correlation.names[:_MOST_CORRELATED]
        ],
        derived=derived_rows(result.runs, result.labels),
        reject_below=P_POOR_FIT / among,
        note_below=note_below,
        conflict_below=P_CONFLICT,
        plain=Notation(""),
        spreads=[
            result.labels.symbol(name)
            for name in moved_by_integration(fit.posterior, fit.values, fit.cov, spreads)
        ],
        effects=sorted({split_level(name)[0] for name in scaled}),
        identify=section,
        # the parameters that some error moves by more than rounding hides
        influenced=[
            name
            for name in result.parameters
            if any(abs(effect.shifts.get(name, 0.0)) >= LEAST_SHIFT for effect in result.what_if)
        ],
        least_shift=LEAST_SHIFT,
        consistency=""
        if agreement is None
        else consistency_text(
            agreement,
            pictures,
            limits_only=not analysis.diagnosis.ok,
            on_edge=analysis.fit.at_bound,
        ),
        friction=friction_cell,
        axes=axes,
        axes_words=phrase(" and ").join(phrase("{y} against {x}", y=y, x=x) for x, y in axes),
        limits_only=result.status != "ok",
        converged=analysis.chain.convergence.met,
        corner_words=corner_words(analysis.problem, truth=bool(campaign.truth)),
        lacks=result.curve_deviation,
        explanation="" if analysis.explanation is None else explanation_text(analysis.explanation),
        counts=counts_text(analysis.fit, pictures),
        deviation=result.deviation,
        complete=complete_runs([result]),
        name_of_test=name_of_test,
        first_step=slip_words(analysis.explanation) or first_step(analysis.diagnosis.findings),
        reasons=first_reasons(result.reasons),
        shown_notes=[
            *complete_runs([result]),
            *(
                words
                for force in (result.deviation or {}).values()
                for words in (force.words, force.noise_words)
            ),
        ]
        if result.status == "ok"
        else [],
        drawn=MOST_DRAWN,
        x_named="x" in re.findall(r"\w+", result.formula or ""),
    )


def complete_runs(results: Iterable[Result]) -> dict[str, list[str]]:
    """Each reason for which curves are taken as complete, and the runs."""
    runs: dict[str, list[str]] = {}
    for result in results:
        for name, run in result.runs.items():
            if run.complete is not None:
                runs.setdefault(run.complete, []).append(name)
    return runs


def index_report(
    campaign: Campaign, results: Mapping[str, Result], explanations: Sequence[Explanation] = ()
) -> Files:
    """`report.md` that leads to the reports of runs fit one by one, each in a folder of its name.

    explanations : of what may be missing, for the runs for which candidates were tried.
    """
    parameters = {
        run: {result.labels.bare[name]: p for name, p in result.parameters.items()}
        for run, result in results.items()
    }
    derived = {
        run: {
            result.labels.derived[key][name]: summary.derived[name]
            for key, summary in result.runs.items()
            for name in summary.sought
        }
        for run, result in results.items()
    }
    text = render(
        "index.md.j2",
        title=campaign.title,
        kind=campaign.kind,
        columns=list(
            dict.fromkeys(
                label
                for cells in (parameters, derived)
                for of_run in cells.values()
                for label in of_run
            )
        ),
        results=results,
        cells={run: {**parameters[run], **derived[run]} for run in results},
        cell=_index_cell,
        causes=runs_text(across_runs(explanations)) if len(explanations) > 1 else "",
    )
    return {"report.md": numbered(text).encode()}


def _index_cell(p: Summary, shown: Label) -> str:
    """A value or a limit; "as stated" of a parameter that the data hardly constrain further."""
    if not isinstance(p, ParameterSummary) or p.measured or p.limit is not None:
        return value_cell(p, shown)
    if p.upper_95 is not None:
        return one_sided("upper", p.upper_95, 0.0, factor=shown.factor)
    return phrase("as stated")


def fit_cell(name: str, p: ParameterSummary, result: Result) -> str:
    """What least squares give of a parameter, in its shown unit."""
    label = result.labels.parameters[name]
    value, sd = result.fit.values[name] * label.factor, result.fit.sds[name]
    if result.status != "ok":
        size = abs(value) if p.q975 is None or p.q025 is None else (p.q975 - p.q025) * label.factor
        return format_rounded(value, 0.1 * size)
    if p.limit is not None:
        edge = format_rounded(
            p.limit.edge * label.factor, 0.25 * abs(p.limit.limit_95 - p.limit.edge) * label.factor
        )
        return phrase("{value} (at its edge)", value=edge)
    if sd is None:
        return phrase(
            "{value} (no symmetric sd)", value=format_rounded(value, (p.sd or 0.0) * label.factor)
        )
    return format_quantity(value, sd * label.factor)


def prior_cell(p: ParameterSummary, shown: Label) -> str:
    """What was stated of a parameter before, in its shown unit."""
    if p.prior == "normal" and p.prior_mean is not None and p.prior_sd is not None:
        return phrase(
            "{value} (normal)",
            value=format_quantity(p.prior_mean * shown.factor, p.prior_sd * shown.factor),
        )
    return p.prior + (f" {p.unit}" if p.unit != "1" and shown.factor != 1.0 else "")
