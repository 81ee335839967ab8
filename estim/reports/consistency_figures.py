"""Figure of the agreement of runs: every shared parameter by each run, by all the others, and by all together."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from estim.checks import Consistency
from estim.common import phrase
from estim.drawing import BLUE, GREY, INK, name_ticks, new_figure
from estim.reports.residual_panels import VERMILION

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MOST_ROWS, _FARTHEST = 64, 24


def forest_figure(
    consistency: Consistency, *, on_edge: Collection[str] = (), edges: Mapping[str, tuple[float, float]] = MappingProxyType({})
) -> Figure:
    """One panel a shared parameter, one line a run; bars are one standard uncertainty, the shaded band is the joint fit.

    Runs that disagree are vermilion.  Of more than 64 runs the 24 are drawn that are
    farthest from all others, in their order.  edges : parameter -> ends of its prior, beyond which nothing is drawn.
    """
    panels = [(i, name, shown) for i, (name, shown) in enumerate(zip(consistency.shared, consistency.labels, strict=True))]
    columns = min(3, len(panels))
    drawn = {name: _drawn(consistency, name) for _, name, _ in panels}
    tallest = max(map(len, drawn.values()))
    rows = -(-len(panels) // columns)
    figure = new_figure(rows * (0.22 * tallest + 1.1) + 0.5, width=max(7.2, 2.7 * columns))
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    wrong = {row.source for row in consistency.rows if row.source in consistency.suspects}
    for ax, (i, name, shown) in zip(axes, panels, strict=False):
        runs = drawn[name]
        low, high = (edge * shown.factor for edge in edges.get(name, (-np.inf, np.inf)))
        centre, sd = consistency.joint.mean[i] * shown.factor, consistency.joint.sd[i] * shown.factor
        if name not in on_edge:  # there all runs together give a limit
            ax.axvspan(max(centre - sd, low), min(centre + sd, high), color=GREY, alpha=0.25, lw=0, label=phrase("all"))
            ax.axvline(centre, color=GREY, lw=0.8)
        for place, run in enumerate(runs):
            others, alone = consistency.others[run], consistency.alone[run]
            colour = VERMILION if run in wrong else BLUE
            value, bar = _within(others.mean[i] * shown.factor, others.sd[i] * shown.factor, low, high)
            ax.errorbar(
                value, place + 0.17, xerr=bar, fmt="o", mfc="white", ms=3.5, color=INK, lw=0.9,
                label=phrase("all but this run") if place == 0 else None,
            )
            value, bar = _within(alone.mean[i] * shown.factor, alone.sd[i] * shown.factor, low, high)
            ax.errorbar(
                value, place - 0.17, xerr=bar, fmt="o", ms=3.5, color=colour, lw=1.4,
                label=phrase("this run and the stated values") if place == 0 else None,
            )
        name_ticks(ax.yaxis, range(len(runs)), runs, fontsize=7.5)
        for tick, run in zip(ax.get_yticklabels(), runs, strict=True):
            tick.set_fontweight("bold" if run in wrong else "normal")
        ax.set_ylim(len(runs) - 0.4, -0.6)
        ax.tick_params(axis="x", labelsize=7.5)
        ax.locator_params(axis="x", nbins=3)
        ax.set_xlabel(shown.axis, fontsize=9)
    for extra in axes[len(panels) :]:
        extra.set_visible(False)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    cut = any(len(drawn[name]) < len(consistency.used[name]) for name in drawn)
    some = phrase("the {n} runs farthest from all others", n=_FARTHEST) if cut else ""
    figure.suptitle(some, fontsize=9)
    return figure


def _drawn(consistency: Consistency, name: str) -> Sequence[str]:
    """The runs of the panel of a parameter."""
    runs = consistency.used[name]
    if len(runs) <= _MOST_ROWS:
        return runs
    i = consistency.shared.index(name)

    def apart(run: str) -> float:
        one, others = consistency.alone[run], consistency.others[run]
        return float(np.abs(one.mean[i] - others.mean[i]) / max(one.sd[i], 1e-300)) if np.isfinite(one.sd[i]) else 0.0

    chosen = set(sorted(runs, key=apart, reverse=True)[:_FARTHEST])
    return [run for run in runs if run in chosen]


def _within(value: float, sd: float, low: float, high: float) -> tuple[float, list[list[float]]]:
    """A value and the ends of its bar, no farther than the edges."""
    reach, value = (float(sd) if np.isfinite(sd) else 0.0), float(np.clip(value, low, high))
    return value, [[min(reach, value - low)], [min(reach, high - value)]]
