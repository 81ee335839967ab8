"""Figure of the residuals of all runs of a joint fit over each other, with their mean: what repeats from run to run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estim.arrays import FloatArray
from estim.checks import Goodness
from estim.common import phrase
from estim.drawing import BLUE, GREEN, GREY, INK, ORANGE, PURPLE, new_figure
from estim.problem import Observations, Problem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_A_BIN, _MOST_BINS = 8, 24  # points of all runs in a bin of the mean at least, and bins at most
RUN_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, "#D55E00", "#56B4E9", "#8C6D31", "#6A3D9A")
_NAMED = len(RUN_COLOURS)  # runs beyond which single ones are grey


def together_figure(problem: Problem, goodness: Sequence[Goodness]) -> Figure:
    """Data less curve and whitened residuals, a row for each group of runs that share a force, and one for runs that share none."""
    found = {good.run: good for good in goodness}
    rows = [group.runs for group in problem.groups if len(group.runs) > 1]
    rows += [runs] if (runs := tuple(run for group in problem.groups if len(group.runs) == 1 for run in group.runs)) else []
    figure = new_figure(3.2 * len(rows))
    parts = np.ravel(figure.subfigures(len(rows), 1, squeeze=False))
    for part, runs in zip(parts, rows, strict=True):
        left, right = part.subplots(1, 2)
        _overlay(left, runs, [found[run.name].raw for run in runs])
        _overlay(right, runs, [found[run.name].whitened for run in runs])
        left.set_ylabel(phrase("data − curve") + (f" ({runs[0].y_unit})" if runs[0].y_unit != "1" else ""))
        right.set_ylabel(phrase("whitened residual"))
        left.set_title(phrase("{n} runs", n=len(runs)) if len(runs) > 1 else phrase("1 run"), fontsize=10)
        right.set_title(phrase("what is left"), fontsize=10)
        part.legend(*left.get_legend_handles_labels(), fontsize=7.5, frameon=False, loc="outside lower center", ncols=5)
    return figure


def binned_mean(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means of x and y, and the standard error of the latter, (n_bin,) each, in bins of as many points of (x, y), (n_obs,)."""
    n_bin = int(np.clip(x.size // _A_BIN, 1, _MOST_BINS))
    parts = np.array_split(np.argsort(x, kind="stable"), n_bin)
    errors = [np.std(y[part], ddof=1) / np.sqrt(part.size) if part.size > 1 else np.nan for part in parts]
    return np.array([x[part].mean() for part in parts]), np.array([y[part].mean() for part in parts]), np.array(errors)


def _overlay(ax: Axes, runs: Sequence[Observations], residuals: Sequence[FloatArray]) -> None:
    several = len(runs) <= _NAMED
    for run, rest, colour in zip(runs, residuals, (RUN_COLOURS if several else (GREY,)) * len(runs), strict=False):
        ax.plot(run.x, rest, "-o", color=colour, lw=0.6, ms=2, alpha=0.8 if several else 0.4, label=run.name if several else None)
    x, mean, error = binned_mean(np.concatenate([run.x for run in runs]), np.concatenate(residuals))
    ax.errorbar(x, mean, yerr=error, fmt="-", color=INK, lw=1.8, elinewidth=1.0, label=phrase("mean of the runs"), zorder=5)
    ax.axhline(0.0, color=GREY, lw=0.8)
    ax.set_xlabel(runs[0].x_label)
