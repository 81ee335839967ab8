"""Report, figure and `result.json` of a theta_min line."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import msgspec
import numpy as np

from estim.arrays import FloatArray, sds_of
from estim.campaign import Campaign, gamma_origin
from estim.checks import Estimate, result_table, screen_lines
from estim.common import (
    QUANTILES,
    FigureChoice,
    Files,
    Json,
    Notation,
    PhraseTable,
    Quantity,
    format_quantity,
    later,
    phrase,
    significant,
)
from estim.drawing import BLUE, INK, ORANGE, Figure, draw_bands, legend_below, new_figure
from estim.line import CONVENTIONS, LineAnalysis, TrialsAnalysis
from estim.reports.copying import copies_of
from estim.reports.pages import Drawers, page
from estim.reports.rendering import shown
from estim.reports.result import provenance_of
from estim.reports.straight_line import line_figures
from estim.reports.trials import UNKNOWN_LABELS, trials_section
from estim.sampling import summarise, trusted
from estim.words import advice_for

_METHODS = PhraseTable(
    {
        "ols": "ordinary least squares (the paper's)",
        "weighted": "weighted by u(θ_min) alone",
        "york": "York: errors in both variables",
        "posterior": "Bayesian, true tilts marginalised",
    }
)


_STRENGTHS = (
    (1.0, later("no significant evidence")),
    (3.0, later("positive evidence")),
    (5.0, later("strong evidence")),
)


def line_result(campaign: Campaign, analysis: LineAnalysis) -> Json:
    """Everything of a line, as `result.json` has it; the report prints from it.  Where the status
    is not ok, uncertainties and what follows from them are null or empty.
    """
    intercept = analysis.chain.column("intercept")
    tilt = float(np.mean(np.cos(analysis.series.phi)))
    angle = float(np.mean(np.cos(analysis.series.theta_min)))
    steepest, status, ok = analysis.steepest, analysis.status, analysis.status.ok
    exact, evidence = analysis.slope_exact, analysis.evidence
    return {
        "schema": "estim-line/1",
        "title": campaign.title,
        "kind": campaign.kind,
        "status": status,
        "reasons": analysis.reasons,
        "advice": advice_for(analysis.findings),
        "disagreement": analysis.disagreement,
        "body": analysis.series.body,
        "n_obs": analysis.series.x.size,
        "gamma_masses": analysis.gamma_masses and analysis.gamma_masses.of_unit(),
        "gamma_origin": gamma_origin(campaign.source, analysis.series.body),
        "methods": {name: _row(analysis, name) for name in _METHODS},
        "posterior": {
            name: trusted(summarise(draws, unit="1", meaning=meaning), status)
            for name, draws, meaning in (
                ("gamma", analysis.gamma_draws, phrase("1/slope")),
                ("intercept", intercept, phrase("sin θ_min at φ = 0")),
                ("slope", analysis.chain.column("slope"), "1/γ"),
                (
                    "rolling_resistance",
                    analysis.resistance_draws,
                    phrase("intercept · γ, if all of it is rolling resistance"),
                ),
            )
        },
        "slope_interval": [exact.low, exact.high] if status.draws_count else [None, None],
        "steepest_phi": Quantity(
            math.asin(min(max(steepest.x0, -1.0), 1.0)),
            steepest.u_x0 / math.sqrt(max(1.0 - steepest.x0**2, 1e-12)),
        ).of_unit("rad")
        if ok
        else None,
        "log_bayes_factor_intercept": Quantity(
            evidence.log_bayes_factor, evidence.u_log_bayes_factor
        ).of_unit()
        if ok
        else None,
        "intercept_prior_sd": evidence.intercept_sd,
        # the intercept read as a zero error: of the plumb line (theta_min too large), or of the
        # protractor (phi too small)
        "zero_phi": float(np.mean(intercept * analysis.gamma_draws)) / tilt if ok else None,
        "zero_theta_min": float(np.mean(intercept)) / angle if ok else None,
        "above_theory": _above_theory(analysis, intercept) if ok else None,
        "provenance": provenance_of(
            campaign.source.path,
            campaign.source.sha256,
            {analysis.series.file: analysis.series.sha256},
            analysis.seed,
        ),
    }


def _above_theory(analysis: LineAnalysis, intercept: FloatArray) -> Json | None:
    """The measured theta_min beside the theory with gamma as stated; None where no gamma is stated,
    or the body would not climb at the mean tilt.

    intercept : (n_draw,).
    """
    gamma, x = analysis.gamma_masses, analysis.series.x
    tilt = float(np.mean(x))
    if gamma is None or tilt >= gamma.value:
        return None
    theory = math.asin(tilt / gamma.value)
    fitted = np.arcsin(np.clip(intercept + tilt / analysis.gamma_draws, -1.0, 1.0))
    u_theory = math.tan(theory) * gamma.u / gamma.value
    excess = Quantity(float(np.mean(fitted)) - theory, math.hypot(np.std(fitted), u_theory))
    return {
        "points": int(np.sum(analysis.series.y > x / gamma.value)),  # how many lie above it
        "tilt": math.asin(tilt),  # their mean
        "excess": excess.of_unit(
            "rad"
        ),  # theta_min of the Bayesian line there, less that of the theory
    }


def _row(analysis: LineAnalysis, method: str) -> Json:
    """The result of a method; of a status that is not ok the best line and its fit, without
    any uncertainty.
    """
    if method == "posterior":
        names = ("intercept", "slope")
        line = analysis.chain.flat[:, [analysis.chain.names.index(name) for name in names]]
        intercept, slope = line.mean(axis=0)
        cov = np.cov(line.T)
        row = {
            "intercept": intercept,
            "slope": slope,
            "chi2": None,
            "dof": None,
            "p_value": math.nan,
            "standard_errors": {"posterior sd": [*sds_of(cov), cov[0, 1]]},
            "recommended": None,
            "reason": None,
        }
    else:
        fits = {"ols": analysis.ols, "weighted": analysis.weighted, "york": analysis.york}
        row = line_figures(fits[method])
    reading = analysis.readings[method]
    row |= {
        "unit": "1",
        "gamma": reading.gamma,
        "rolling_resistance": reading.resistance,
        "e_n": reading.e_n,
    }
    if analysis.status.ok:
        return row
    uncertain = ("recommended", "reason", "gamma", "rolling_resistance", "e_n")
    return row | dict.fromkeys(uncertain) | {"standard_errors": {}}


def line_report(
    campaign: Campaign,
    analysis: LineAnalysis,
    *,
    trials: TrialsAnalysis | None = None,
    figures: FigureChoice,
) -> Files:
    """`report.md`, `result.json` and `figures/line.png`; with `trials` their section, `trials.json`
    and figures too.
    """
    result = line_result(campaign, analysis)
    drawers: Drawers = {"figures/line.png": partial(line_figure, analysis)}
    records = {"result.json": result}
    if trials is not None:
        of_trials, records["trials.json"] = trials_section(campaign, trials, line=analysis)
        drawers = {**drawers, **of_trials}
    estimates = [line_estimate(result, campaign.truth)] if analysis.status.ok else []
    return page(
        drawers,
        "line.md.j2",
        records,
        figure_choice=figures,
        kind=campaign.kind,
        result=result,
        assumption=analysis.assumption,
        trials=records.get("trials.json"),
        found=result_table(estimates),
        copies=copies_of(estimates, kind=campaign.kind) if estimates else None,
        **LINE_WORDS,
        labels=UNKNOWN_LABELS,
    )


def line_lines(campaign: Campaign, analysis: LineAnalysis) -> list[str]:
    """The lines of a terminal on a line whose status is ok."""
    result = line_result(campaign, analysis)
    resistance = phrase(
        "c_rr = {value}, if all of the intercept is rolling resistance",
        value=shown(analysis.readings["posterior"].resistance),
    )
    return screen_lines([line_estimate(result, campaign.truth)], minds=[resistance])


def line_estimate(result: Json, truth: Mapping[str, float]) -> Estimate:
    """gamma of a line whose status is ok, beside what was stated.  truth : name -> true value of
    synthetic data, where it is known.
    """
    summary = msgspec.structs.replace(
        result["posterior"]["gamma"],
        meaning=phrase("1/slope of the θ_min line of {body}", body=result["body"]),
    )
    return Estimate(
        Notation("γ").label("1", "[line]"),
        summary,
        shown(result["gamma_masses"]) if result["gamma_masses"] else "",
        True,
        None,
        truth.get(f"gamma[{result['body']}]"),
    )


def evidence_words(log_bayes_factor: float) -> str:
    """The odds, and the strength of the evidence in the words of Kass and Raftery 1995."""
    return phrase(
        "{odds} : 1 for an intercept, {strength}"
        if log_bayes_factor > 0
        else "{odds} : 1 for a line through the origin, {strength}",
        odds=significant(math.exp(min(abs(log_bayes_factor), 200.0)), 2),
        strength=phrase(
            next(
                (words for limit, words in _STRENGTHS if abs(log_bayes_factor) < limit),
                later("very strong evidence"),
            )
        ),
    )


LINE_WORDS: Mapping[str, Any] = {
    "line_methods": _METHODS,
    "conventions": CONVENTIONS,
    "evidence_words": evidence_words,
    "plain": Notation("").label("1"),
    "e_n_explained": False,  # whether E_n is explained above
}
"""What `line_body.md.j2` needs beside the record."""


def line_figure(analysis: LineAnalysis) -> Figure:
    """Points with their uncertainties, the theory line from the masses, OLS, York, and the
    posterior band.
    """
    series = analysis.series
    figure = new_figure(4.6)
    ax = figure.subplots()
    x = np.linspace(0.0, 1.08 * float(series.x.max()), 100)
    if analysis.status == "ok":
        draws = analysis.chain.thinned(4000)
        names = analysis.chain.names
        lines = draws[:, [names.index("intercept")]] + draws[:, [names.index("slope")]] * x
        draw_bands(
            ax,
            x,
            np.quantile(lines, QUANTILES, axis=0),
            label=later("posterior of the line, {p} %"),
        )
    if analysis.gamma_masses is not None:
        gamma = analysis.gamma_masses
        ax.plot(
            x,
            x / gamma.value,
            color=ORANGE,
            label=phrase(
                "theory, with the stated γ = {gamma}", gamma=format_quantity(gamma.value, gamma.u)
            ),
        )
    ax.plot(
        x,
        analysis.ols.intercept + analysis.ols.slope * x,
        color=INK,
        ls="--",
        label=phrase("ordinary least squares"),
    )
    ax.plot(x, analysis.york.intercept + analysis.york.slope * x, color=BLUE, label="York")
    ax.errorbar(
        series.x,
        series.y,
        series.u_y,
        series.u_x,
        "o",
        color=INK,
        label=phrase("measured, ± 1 standard uncertainty"),
    )
    ax.set(
        title=series.body,
        xlabel=phrase("sin φ  (tilt of the ramp)"),
        ylabel=phrase(
            "sin {theta_min}  (smallest ascending angle)",
            theta_min=Notation("θ_min").label("rad").tex,
        ),
        xlim=(0.0, None),
        ylim=(min(0.0, float(np.min(series.y - series.u_y))), None),
    )
    legend_below(figure, ncols=2)
    return figure
