"""The section of a report on whether the runs of a joint fit agree; the text stands in
`templates/consistency.md.j2`.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from estim.checks import P_INCONSISTENT, PRIORS, Consistency
from estim.common import Markdown, phrase
from estim.drawing import BLUE, GREY, INK, VERMILION, Figure, grid, legend_below, name_ticks
from estim.reports.rendering import render

_MOST_ROWS, _FARTHEST = 64, 24


def consistency_text(
    consistency: Consistency,
    pictures: Collection[str] = (),
    *,
    limits_only: bool = False,
    on_edge: Collection[str] = (),
) -> Markdown:
    """Markdown fragment without a heading: verdict, table of sources, table of estimates, how to
    read them.

    pictures : paths of the figures beside it.
    limits_only : leave out what all runs give together, where that is no result.
    on_edge : parameters of which it is a limit and no value.
    """
    return render(
        "consistency.md.j2",
        pictures=pictures,
        consistency=consistency,
        priors=PRIORS,
        on_edge=on_edge,
        reject_below=P_INCONSISTENT,
        limits_only=limits_only,
    )


def forest_figure(
    consistency: Consistency,
    *,
    on_edge: Collection[str] = (),
    edges: Mapping[str, tuple[float, float]] = {},
) -> Figure:
    """One panel a shared parameter, one line a run; bars are one standard uncertainty, the shaded
    band is the joint fit.

    Runs that disagree are vermilion.  Of more than 64 runs the 24 are drawn that are farthest from
    all others, in their order.
    edges : parameter -> ends of its prior, beyond which nothing is drawn.
    """
    drawn = {name: _drawn(consistency, name) for name in consistency.shared}
    tallest = max(map(len, drawn.values()))
    figure, axes = grid(len(drawn), height=0.22 * tallest + 1.1, columns=3)
    panels = zip(axes, drawn.items(), consistency.labels, strict=True)
    for i, (ax, (name, runs), label) in enumerate(panels):
        low, high = (edge * label.factor for edge in edges.get(name, (-np.inf, np.inf)))
        centre = consistency.joint.mean[i] * label.factor
        sd = consistency.joint.sd[i] * label.factor
        if name not in on_edge:  # there all runs together give a limit
            left, right = max(centre - sd, low), min(centre + sd, high)
            ax.axvspan(left, right, color=GREY, alpha=0.25, label=phrase("all"))
            ax.axvline(centre, color=GREY)
        for place, run in enumerate(runs):
            own = VERMILION if run in consistency.suspects else BLUE
            alone = phrase("this run and the stated values")
            for estimate, offset, colour, face, words in (
                (consistency.others[run], 0.17, INK, "white", phrase("all but this run")),
                (consistency.alone[run], -0.17, own, own, alone),
            ):
                value, bar = _within(
                    estimate.mean[i] * label.factor, estimate.sd[i] * label.factor, low, high
                )
                ax.errorbar(
                    value, place + offset, None, bar, "o", color=colour, mfc=face, label=words
                )
        name_ticks(ax.yaxis, range(len(runs)), runs)
        for tick, run in zip(ax.get_yticklabels(), runs, strict=True):
            tick.set_fontweight("bold" if run in consistency.suspects else "normal")
        ax.set(xlabel=label.axis, ylim=(len(runs) - 0.4, -0.6))
        ax.locator_params(axis="x", nbins=3)
    legend_below(figure)
    cut = any(len(drawn[name]) < len(consistency.used[name]) for name in drawn)
    figure.suptitle(phrase("the {n} runs farthest from all others", n=_FARTHEST) if cut else "")
    return figure


def _drawn(consistency: Consistency, name: str) -> Sequence[str]:
    """The runs of the panel of a parameter."""
    runs = consistency.used[name]
    if len(runs) <= _MOST_ROWS:
        return runs
    i = consistency.shared.index(name)

    def distance(run: str) -> float:
        alone, others = consistency.alone[run], consistency.others[run]
        return (
            float(np.abs(alone.mean[i] - others.mean[i]) / max(alone.sd[i], 1e-300))
            if np.isfinite(alone.sd[i])
            else 0.0
        )

    chosen = set(sorted(runs, key=distance, reverse=True)[:_FARTHEST])
    return [run for run in runs if run in chosen]


def _within(value: float, sd: float, low: float, high: float) -> tuple[float, list[list[float]]]:
    """A value and the ends of its bar, no farther than the edges."""
    reach, value = (float(sd) if np.isfinite(sd) else 0.0), float(np.clip(value, low, high))
    return value, [[min(reach, value - low)], [min(reach, high - value)]]
