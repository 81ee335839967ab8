"""Figures of a comparison of models: what each makes of the quantities of interest, and data sets drawn from one beside the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from estim.common import later, phrase
from estim.drawing import BLUE, GREY, INK, ORANGE, PALE, name_ticks, new_figure
from estim.explanation import Predicted
from estim.problem import Parameter
from estim.sampling import Summary

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COLUMNS = 3
_SHORT = {"energy": later("change of energy"), "its_place": later("place of largest speed")}
_FAR = 0.02  # of the data sets beyond what is drawn, on either side


class _Row(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def status(self) -> str: ...
    @property
    def posterior(self) -> Mapping[str, Summary]: ...


def values_figure(rows: Sequence[_Row], common: Sequence[Parameter], recommended: str) -> Figure:
    """68 and 95 % intervals of each quantity under each model; those of a model that is not ok in grey, dashed."""
    columns = min(_COLUMNS, max(len(common), 1))
    lines = -(-max(len(common), 1) // columns)
    figure = new_figure(0.8 + (0.5 + 0.27 * len(rows)) * lines)
    axes = figure.subplots(lines, columns, squeeze=False).ravel()
    places = np.arange(len(rows))[::-1]
    for i, (ax, p) in enumerate(zip(axes, common, strict=False)):
        for place, row in zip(places, rows, strict=True):
            _interval(ax, place, row.posterior[p.name], p.label.factor, ok=row.status == "ok", recommended=row.name == recommended)
        name_ticks(ax.yaxis, places, [row.name if i % columns == 0 else "" for row in rows], fontsize=7.5)
        ax.set_ylim(-0.6, len(rows) - 0.4)
        ax.set_xlabel(p.label.axis, fontsize=9)
        ax.tick_params(axis="x", labelsize=7.5)
        ax.locator_params(axis="x", nbins=4)
    for extra in axes[len(common) :]:
        extra.set_visible(False)
    title = phrase("median, 68 and 95 % intervals; orange square: recommended; grey, dashed: not ok, not to be used")
    figure.suptitle(title, fontsize=8.5)
    return figure


def _interval(ax: Axes, place: float, summary: Summary, factor: float, *, ok: bool, recommended: bool) -> None:
    quantiles = (summary.q025, summary.q16, summary.median, summary.q84, summary.q975)
    if any(q is None for q in quantiles):
        return
    low, lower, middle, upper, high = (float(q) * factor for q in quantiles if q is not None)
    colour = ORANGE if recommended else BLUE if ok else GREY
    ax.plot([low, high], [place, place], color=colour, lw=1.0, ls="-" if ok else (0, (3, 2)))
    ax.plot([lower, upper], [place, place], color=colour, lw=2.6 if ok else 1.6)
    ax.plot(middle, place, "s" if recommended else "o", color=colour, mfc=colour if ok else "white", ms=5 if recommended else 4, zorder=4)


def predictive_figure(predicted: Sequence[Predicted], model: str) -> Figure:
    """Histograms of each statistic of the data sets, and that of the data: a line, or an outline where it depends on the parameters."""
    runs = list(dict.fromkeys(one.run for one in predicted))
    names = list(dict.fromkeys(one.name for one in predicted))
    figure = new_figure(0.7 + 1.75 * len(runs))
    axes = figure.subplots(len(runs), len(names), squeeze=False)
    by_place = {(one.run, one.name): one for one in predicted}
    for i, run in enumerate(runs):
        for k, name in enumerate(names):
            ax, one = axes[i, k], by_place.get((run, name))
            if one is None:
                ax.set_visible(False)
                continue
            _histogram(ax, one)
            if k == 0:
                ax.set_ylabel(run, fontsize=8)
    title = phrase("{model}: filled: data sets drawn from the posterior; orange: the data", model=model)
    figure.suptitle(title, fontsize=8.5)
    return figure


def _histogram(ax: Axes, one: Predicted) -> None:
    again, observed = one.again * one.label.factor, one.observed * one.label.factor
    ends = np.quantile(again[np.isfinite(again)], [_FAR / 2.0, 1.0 - _FAR / 2.0]) if np.any(np.isfinite(again)) else np.array([0.0, 1.0])
    low, high = min(float(ends[0]), float(np.min(observed))), max(float(ends[1]), float(np.max(observed)))
    width = max(high - low, 1e-12)
    edges: list[float] = np.linspace(low - 0.03 * width, high + 0.03 * width, 31).tolist()
    ax.hist(again, bins=edges, color=PALE, edgecolor=BLUE, linewidth=0.4)
    if observed.size > 1:
        ax.hist(observed, bins=edges, histtype="step", color=ORANGE, linewidth=1.6)
    else:
        ax.axvline(float(observed[0]), color=ORANGE, lw=2.2)
    ax.set_yticks([])
    ax.set_xlim(edges[0], edges[-1])
    ax.tick_params(axis="x", labelsize=7)
    ax.locator_params(axis="x", nbins=3)
    unit = "" if one.label.unit == "1" else f" ({one.label.unit})"
    ax.set_xlabel(_short(one) + unit, fontsize=7.5)
    ax.set_title(f"p {one.p_words}" if "<" in one.p_words else f"p = {one.p_words}", fontsize=8, color=INK)


def _short(one: Predicted) -> str:
    return phrase(_SHORT.get(one.name, one.words))
