"""Report, figures and `trials.json` of trials of release."""

from __future__ import annotations

import math
from collections import Counter
from functools import partial

import numpy as np

from estim.arrays import FloatArray
from estim.campaign import Campaign, gamma_origin
from estim.checks import Estimate, screen_lines
from estim.common import (
    QUANTILES,
    FigureChoice,
    Files,
    Json,
    Notation,
    PhraseTable,
    Quantity,
    e_n,
    format_quantity,
    later,
    number,
    phrase,
)
from estim.drawing import BLUE, GREY, INK, ORANGE, Axes, Figure, draw_bands, grid, legend_below
from estim.line import HIGH, LOW, UNKNOWNS, WAYS, LineAnalysis, TrialsAnalysis, effective_start
from estim.reports.pages import Drawers, page
from estim.reports.result import provenance_of
from estim.sampling import Summary, trusted
from estim.words import advice_for, told_apart

_LINES = PhraseTable(
    {
        "york": "York's line through the θ_min series",
        "posterior": "Bayesian line through the θ_min series",
    }
)
_MARKS = {
    (LOW, True): ("^", BLUE),
    (LOW, False): ("o", "white"),
    (HIGH, True): ("v", ORANGE),
    (HIGH, False): ("s", "white"),
}
_NAMES = PhraseTable({LOW: "below 90°", HIGH: "above 90°"})


UNKNOWN_LABELS = {name: notation.label(unit) for name, (unit, _, notation) in UNKNOWNS.items()}


def trials_result(
    campaign: Campaign, analysis: TrialsAnalysis, *, line: LineAnalysis | None
) -> Json:
    """Everything of trials of release, as `trials.json` has it; the report prints from it.  Where
    the status is not ok, what it does not allow is null or empty.

    line : of the same body, to stand beside it.
    """
    status, trials, masses = analysis.status, analysis.trials, analysis.gamma_masses
    return {
        "schema": "estim-trials/1",
        "title": campaign.title,
        "kind": campaign.kind,
        "status": status,
        "reasons": analysis.reasons,
        "advice": advice_for(analysis.findings),
        "disagreements": analysis.disagreements,
        "body": trials.body,
        "n_trial": trials.n_trial,
        "n_climbed": trials.n_climbed,
        "n_tilt": len(trials.tilts),
        "gamma_masses": None if masses is None else masses.value,
        "u_gamma_masses": None if masses is None else masses.u,
        "gamma_origin": gamma_origin(campaign.source, trials.body),
        "unknowns": {
            name: trusted(analysis.summary(name), status) for name in analysis.chain.names
        },
        "priors": {name: _shown_prior(analysis, name) for name in analysis.chain.names},
        "resistance_fixed": number(analysis.posterior.resistance),
        "ways": _gamma_by_way(analysis, line) if status.ok else {},
        "ends_apart": _difference_of_ends(analysis) if status.ok else None,
        "thresholds": analysis.thresholds,
        # rad, with its standard uncertainty, at phi_mean
        "offset": [analysis.offset.value, analysis.offset.u] if status.ok else None,
        "phi_mean": analysis.phi_mean,
        "told_apart": told_apart(dict(analysis.told), analysis.correlation) if status.ok else [],
        "second_computation": analysis.agreement.reason,
        "provenance": provenance_of(
            campaign.source.path,
            campaign.source.sha256,
            {trials.file: trials.sha256},
            analysis.seed,
        ),
    }


def _shown_prior(analysis: TrialsAnalysis, name: str) -> str:
    """The prior in the unit in which its unknown is shown."""
    trials, degrees = analysis.trials, math.degrees
    return {
        "scatter": phrase(
            "log-normal about {middle:.3g}, within a factor of 4 with probability 95 %",
            middle=degrees(trials.u_theta),
        ),
        "release": phrase("half-normal, scale {scale:.3g}", scale=degrees(trials.release)),
        "zero_phi": phrase("normal, sd {sd:.3g}", sd=degrees(trials.u_zero_phi)),
        "zero_theta": phrase("normal, sd {sd:.3g}", sd=degrees(trials.u_zero_theta)),
    }.get(name) or analysis.posterior.priors[name].describe()


def _gamma_by_way(analysis: TrialsAnalysis, line: LineAnalysis | None) -> dict[str, Json]:
    """gamma by each way; e_n against the stated value, e_n_trials against gamma of all trials (null
    for those that share trials with it).
    """
    rows = {
        name: {
            "words": WAYS[name],
            "gamma": way.gamma,
            "e_n": number(way.e_n),
            "e_n_trials": None,
            "reliable": way.reliable,
        }
        for name, way in analysis.ways.items()
    }
    if line is None or not line.status.ok or line.series.body != analysis.trials.body:
        return rows
    gamma = analysis.ways["both"].quantity
    for name, words in _LINES.items():
        reading = line.readings[name]
        rows[name] = {
            "words": words,
            "gamma": _normal_summary(reading.gamma),
            "e_n": number(reading.e_n),
            "e_n_trials": number(e_n(reading.gamma, gamma)),
            "reliable": True,
        }
    return rows


def _normal_summary(gamma: Quantity) -> Summary:
    """A value and a standard uncertainty as a summary, normal."""
    q025, q16, q84, q975 = (
        gamma.value + k * gamma.u for k in (-1.959964, -0.994458, 0.994458, 1.959964)
    )
    return Summary(
        "1", phrase(UNKNOWNS["gamma"][1]), gamma.value, gamma.u, gamma.value, q025, q16, q84, q975
    )


def _difference_of_ends(analysis: TrialsAnalysis) -> list[float] | None:
    """Difference, its standard uncertainty, in sds, E_n."""
    difference = analysis.ends_apart
    if difference is None:
        return None
    return [
        difference.value,
        difference.u,
        difference.value / difference.u,
        e_n(difference, Quantity(0.0)),
    ]


def trials_section(
    campaign: Campaign, analysis: TrialsAnalysis, *, line: LineAnalysis | None
) -> tuple[Drawers, Json]:
    """Figures, and the record that the section of a report prints, which is `trials.json`."""
    drawers: Drawers = {"figures/trials.png": partial(starts_figure, analysis)}
    if analysis.status.ok:
        drawers["figures/chances.png"] = partial(chances_figure, analysis)
    return drawers, trials_result(campaign, analysis, line=line)


def trials_report(campaign: Campaign, analysis: TrialsAnalysis, *, figures: FigureChoice) -> Files:
    """`report.md`, `trials.json` and the figures of trials by themselves."""
    drawers, result = trials_section(campaign, analysis, line=None)
    return page(
        drawers,
        "trials.md.j2",
        {"trials.json": result},
        figure_choice=figures,
        kind=campaign.kind,
        trials=result,
        labels=UNKNOWN_LABELS,
    )


def trials_lines(campaign: Campaign, analysis: TrialsAnalysis) -> list[str]:
    """The lines of a terminal on trials whose status is ok."""
    masses, true = analysis.gamma_masses, campaign.truth.get(f"gamma[{analysis.trials.body}]")
    stated = "" if masses is None else format_quantity(masses.value, masses.u)
    return screen_lines(
        [
            Estimate(
                Notation("γ").label("1", "[trials]"),
                analysis.summary("gamma"),
                stated,
                True,
                None,
                true,
            )
        ]
    )


def starts_figure(analysis: TrialsAnalysis) -> Figure:
    """Every trial, the intervals of each tilt by itself, and where ascents begin and end by all
    trials at once; a panel for each end.
    """
    trials = analysis.trials
    figure, axes = grid(len(trials.ends), height=3.6, columns=1)
    read = np.array([tilt.phi for tilt in trials.tilts])
    room = 0.08 * max(float(np.ptp(read)), 0.01)
    phi = np.linspace(min(0.0, read.min() - room), read.max() + room, 120)
    for ax, end in zip(axes, reversed(trials.ends), strict=True):
        _draw_starts(ax, analysis, end, phi)
        _draw_trials(ax, analysis, end, float(np.degrees(np.ptp(phi))))
        ax.set(xlim=np.degrees(phi[[0, -1]]), ylabel=phrase("θ, angle of release as set (°)"))
        low, high = ax.get_ylim()
        ax.set_ylim(max(low, 0.0), min(high, 180.0))
    axes[-1].set_xlabel(phrase("φ, tilt of the ramp as read (°)"))
    axes[0].set_title(trials.body + ("" if analysis.status.ok else f" — {analysis.status}"))
    legend_below(figure, ncols=2)
    return figure


def _draw_starts(ax: Axes, analysis: TrialsAnalysis, end: str, phi: FloatArray) -> None:
    if analysis.status.ok:
        starts = np.quantile(np.degrees(analysis.starts(end, phi)), QUANTILES, axis=0)
        draw_bands(
            ax,
            np.degrees(phi),
            starts,
            label=later("threshold of climbing, all trials jointly, {p:.0f} %"),
        )
    gamma = analysis.gamma_masses
    if gamma is not None:
        sine = np.sin(phi) / gamma.value
        smallest = np.degrees(
            np.where(np.abs(sine) <= 1.0, np.arcsin(np.clip(sine, -1.0, 1.0)), np.nan)
        )
        ax.plot(
            np.degrees(phi),
            smallest if end == LOW else 180.0 - smallest,
            color=ORANGE,
            label=phrase(
                "theory, with the stated γ = {gamma}", gamma=format_quantity(gamma.value, gamma.u)
            ),
        )
    label = phrase("threshold of climbing, each tilt separately, 95 %")
    for threshold in (candidate for candidate in analysis.thresholds if candidate.end == end):
        low, high = np.degrees(threshold.quantiles[[0, -1]])
        ax.plot(
            [np.degrees(threshold.phi)] * 2, [low, high], color=GREY, lw=2.5, zorder=3, label=label
        )


def _draw_trials(ax: Axes, analysis: TrialsAnalysis, end: str, width: float) -> None:
    """Ascents right of their tilt, refusals left of it, those of one angle side by side.  width :
    degrees, of the panel.
    """
    for climbed, mark, face, label in (
        (True, "^", BLUE, phrase("climbed (right of the tilt)")),
        (False, "o", "white", phrase("did not climb (left of it)")),
    ):
        x, y = [], []
        for tilt in analysis.trials.tilts:
            part = tilt.end(end)
            for place, angle in _side_by_side(part.theta[part.climbed == climbed], Counter()):
                x.append(
                    np.degrees(tilt.phi)
                    # of the width of the panel: from a mark to the next of the same angle
                    + (1.0 if climbed else -1.0) * (place + 1.0) * 0.011 * width
                )
                y.append(angle)
        ax.plot(x, y, mark, mfc=face, mec=INK, ls="", label=label, zorder=4)


def _side_by_side(angles: FloatArray, counts: Counter[float]) -> list[tuple[int, float]]:
    """Angles in degrees, each with the number of equal angles before it, which `counts` continues
    from earlier calls.
    """
    placed = []
    for angle in np.round(np.degrees(angles), 6).tolist():
        placed.append((counts[angle], angle))
        counts[angle] += 1
    return placed


def chances_figure(analysis: TrialsAnalysis) -> Figure:
    """The chance of an ascent against the angle, a panel for each tilt, and its trials at 1 and 0;
    angles above 90 degrees mirrored there.
    """
    trials = analysis.trials
    chosen = np.unique(
        np.linspace(0, len(trials.tilts) - 1, min(len(trials.tilts), 12)).round().astype(int)
    )
    figure, axes = grid(len(chosen), height=2.2 if len(chosen) > 2 else 2.8)
    for ax, which in zip(axes, chosen, strict=True):
        tilt = trials.tilts[which]
        inside = np.minimum(tilt.theta, np.pi - tilt.theta)
        room = 4.0 * float(np.median(analysis.chain.column("scatter")))
        angles = np.linspace(
            max(0.0, inside.min() - room), min(0.5 * np.pi, inside.max() + room), 161
        )
        chance = _chances(analysis, tilt.phi, angles, trials.ends[0])
        draw_bands(
            ax,
            np.degrees(angles),
            np.quantile(chance, QUANTILES, axis=0),
            label=later("probability of climbing, {p:.0f} %"),
        )
        if len(trials.ends) > 1 and trials.u_zero_theta > 0.0:  # else the two ends have one curve
            middle = np.median(_chances(analysis, tilt.phi, angles, HIGH), axis=0)
            ax.plot(
                np.degrees(angles), middle, color=ORANGE, ls="--", label=phrase("median above 90°")
            )
        for climbed, level, step in ((True, 1.0, -0.07), (False, 0.0, 0.07)):
            counts: Counter[float] = Counter()
            for end in trials.ends:
                part = tilt.end(end)
                placed = _side_by_side(
                    np.minimum(part.theta, np.pi - part.theta)[part.climbed == climbed], counts
                )
                mark, face = _MARKS[end, climbed]
                label = phrase("climbed" if climbed else "did not climb")
                label += f", {_NAMES[end]}" if len(trials.ends) > 1 else ""
                heights = [level + step * place for place, _ in placed]
                ax.plot(
                    [angle for _, angle in placed],
                    heights,
                    mark,
                    mfc=face,
                    mec=INK,
                    ls="",
                    label=label,
                    clip_on=False,
                    zorder=4,
                )
        ax.set(xlim=np.degrees(angles[[0, -1]]), ylim=(-0.08, 1.08))
        ax.set_yticks([0.0, 0.5, 1.0])
        ax.set_title(phrase("φ read as {phi:.2f}°", phi=math.degrees(tilt.phi)))
    as_set = phrase("θ, angle of release as set (°)")
    mirrored = (
        phrase("θ, or 180° − θ (°)")
        if len(trials.ends) > 1
        else "180° − θ (°)"
        if trials.ends == (HIGH,)
        else as_set
    )
    for ax in axes[-2:] if len(axes) > 2 else axes[-1:]:
        ax.set_xlabel(mirrored)
    for ax in axes[::2] if len(axes) > 2 else axes:
        ax.set_ylabel(phrase("probability of climbing"))
    legend_below(figure)
    return figure


def _chances(analysis: TrialsAnalysis, phi: float, inside: FloatArray, end: str) -> FloatArray:
    """(n_draw, n_angle) chance of an ascent at a tilt read as `phi`, over its errors, `inside` rad
    from the vertical at that end.
    """
    posterior, names = analysis.posterior, analysis.chain.names
    draws = analysis.chain.thinned(300)
    values = dict(zip(names, draws.T, strict=True))
    starts = effective_start(values, end, posterior.true_tilts(phi), posterior.resistance)
    zero = (
        draws[:, [names.index("zero_theta")]] * (1.0 if end == LOW else -1.0)
        if "zero_theta" in names
        else 0.0
    )
    per_width = math.pi / math.sqrt(3.0) / draws[:, [names.index("scatter")]]
    total = np.zeros((len(draws), inside.size))
    for k, weight in enumerate(np.exp(posterior.log_weights)):
        total += weight * 0.5 * (1.0 + np.tanh(0.5 * (inside - starts[:, [k]] - zero) * per_width))
    return total
