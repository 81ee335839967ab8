"""What was counted: the expectations of the curve beside the counts, as a figure and in words."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from estim.arrays import FloatArray
from estim.checks import Goodness
from estim.common import PROBABILITIES, later, phrase
from estim.drawing import BLUE, GREY, INK, Axes, Figure, draw_pulls, fill, new_figure
from estim.fitting import Fit
from estim.problem import Counted, Law, Observations
from estim.reports.rendering import render

_FEW = 5.0  # expected events below which a bin alone constrains little


def counts_text(fit: Fit, pictures: Collection[str]) -> str:
    """The section of a report about the counts; "" where nothing was counted."""
    rows, single = [], False
    for run in fit.problem.runs:
        if (counted := run.noise.counted) is None:
            continue
        mean, trials, single = run.drawn(fit.named), counted.trials, single or counted.single
        scarce = np.minimum(mean, 1.0 - mean) if math.isfinite(counted.law.ceiling) else mean
        few, empty = int(np.sum(trials * scarce < _FEW)), int(np.sum(run.y == 0.0))
        rows.append(
            (
                run.name,
                f"{np.sum(trials * run.y):.0f}",
                f"{np.sum(trials * mean):.1f}",
                str(run.n_obs),
                str(few),
                str(empty),
            )
        )
    return (
        render("counts.md.j2", rows=rows, few=f"{_FEW:.0f}", events=single, pictures=pictures)
        if rows
        else ""
    )


def counts_figure(fit: Fit, goodness: Sequence[Goodness]) -> Figure:
    """Counts as bars or points, what the fitted curve expects, where a count would lie, and the
    pulls below.
    """
    pairs = [
        (run, good, run.noise.counted)
        for run, good in zip(fit.problem.runs, goodness, strict=True)
        if run.noise.counted is not None
    ]
    figure = new_figure(4.4 * len(pairs))
    axes = figure.subplots(2 * len(pairs), 1, height_ratios=[3, 1] * len(pairs))
    for (run, good, counted), top, below in zip(pairs, axes[::2], axes[1::2], strict=True):
        _draw_counts(top, run, run.drawn(fit.named), counted)
        top.set(title=run.name, ylabel=run.y_label, ylim=(0.0, None))
        top.legend(loc="best")
        top.tick_params(labelbottom=False)
        draw_pulls(below, good.whitened)
        below.vlines(run.x, 0.0, good.whitened, color=INK)
        below.plot(run.x, good.whitened, "o", color=INK, ms=2.5)
        below.set(xlabel=run.x_label, ylabel=phrase("pull"))
        below.sharex(top)
    return figure


def _draw_counts(ax: Axes, run: Observations, mean: FloatArray, counted: Counted) -> None:
    law, edges = counted.law, counted.bins
    lies = later(
        "range of a count, {p:.0f} %" if law.word == "counts" else "range of a fraction, {p:.0f} %"
    )
    ends = {level: _interval(law, mean, counted.trials, level) for level in PROBABILITIES}
    if edges is None:
        for level, width in zip(PROBABILITIES[::-1], (1.2, 3.5), strict=True):
            ax.vlines(
                run.x,
                *ends[level],
                color=BLUE,
                lw=width,
                alpha=0.55,
                label=phrase(lies, p=100 * level),
            )
        ax.plot(
            run.x, mean, "_", color=BLUE, ms=9, mew=1.6, label=phrase("expectation of the curve")
        )
        ax.plot(run.x, run.y, "o", color=INK, label=phrase(law.word), zorder=5, clip_on=False)
        return
    for low, high, height in zip(edges[:, 0], edges[:, 1], run.y, strict=True):
        ax.fill_between([low, high], 0.0, height, color=GREY, alpha=0.3)
    ax.fill_between([], [], [], color=GREY, alpha=0.3, label=phrase("observed counts"))
    x = edges.ravel()
    for level, shade in zip(PROBABILITIES[::-1], (0.18, 0.38), strict=True):
        low, high = (np.repeat(end, 2) for end in ends[level])
        fill(ax, x, low, high, BLUE, shade, label=phrase(lies, p=100 * level))
    ax.plot(x, np.repeat(mean, 2), color=BLUE, label=phrase("expectation of the curve"))
    ax.plot(run.x, run.y, "o", color=INK, ms=2.5, zorder=5, clip_on=False)


def _interval(
    law: Law, mean: FloatArray, trials: FloatArray, level: float
) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest (n_obs,) of the counts that hold at least `level`, the rest shared between
    both sides.
    """
    expected, tail = np.maximum(mean, 0.0), 0.5 - 0.5 * level
    return law.quantile(tail, expected, trials), law.quantile(1.0 - tail, expected, trials)
