"""Figures of a plan: what each option leaves of a standard deviation, and where along a curve a reading tells most."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estim.common import phrase
from estim.drawing import COLOURS, GREY, INK, MARKS, name_ticks, new_figure
from estim.planning import Option, Plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDE = 68  # characters of a row's name
_MOST = len(COLOURS)  # targets


def ratio_figure(plan: Plan, options: Sequence[Option]) -> Figure:
    """Standard deviations over those as things are, one row an option, the best at the top."""
    names = [option.wish.words if len(option.wish.words) <= _WIDE else f"{option.wish.words[:_WIDE]}…" for option in options]
    places = -np.arange(len(names), dtype=float)
    figure = new_figure(0.2 * len(names) + 1.1)
    ax = figure.subplots()
    ax.axvline(1.0, color=INK, lw=0.8)
    ax.axvline(0.5, color=INK, lw=0.8, ls="--")
    ax.hlines(places, 0.0, 1.0, color=GREY, lw=0.4, alpha=0.5)
    for k, target in enumerate(plan.targets[:_MOST]):
        ratios = [option.ratio[k] for option in options]
        said = phrase("u of {quantity}", quantity=target.label.tex)
        ax.plot(ratios, places, MARKS[k], color=COLOURS[k], ms=5, ls="none", label=said, mec="white", mew=0.5)
    ax.set_xlim(0.0, max(1.05, 1.03 * max(float(np.max(option.ratio)) for option in options)))
    ax.set_ylim(float(places[-1]) - 0.8, 0.8)
    name_ticks(ax.yaxis, places, names, fontsize=7)
    ax.tick_params(axis="y", length=0)
    ax.set_xlabel(phrase("expected u / u as things are (dashed: halved)"), fontsize=8)
    ax.tick_params(axis="x", labelsize=8)
    if len(plan.targets) > 1:
        figure.legend(loc="outside lower center", ncols=min(len(plan.targets), 3), fontsize=8, frameon=False)
    else:
        ax.set_title(phrase("u of {quantity}", quantity=plan.targets[0].label.tex), fontsize=8)
    return figure


def along_figure(plan: Plan) -> Figure:
    """One further reading at each place: what it leaves of the standard deviations; grey: the range of the readings at hand."""
    runs = plan.fit.problem.runs
    figure = new_figure(2.4 * len(plan.along) + 0.4)
    axes = figure.subplots(len(plan.along), 1, squeeze=False)[:, 0]
    for ax, along in zip(axes, plan.along, strict=True):
        run = next(run for run in runs if run.name == along.run)
        ax.axvspan(*along.inside, color=GREY, alpha=0.18, lw=0)
        ax.axhline(1.0, color=INK, lw=0.8)
        for k, target in enumerate(plan.targets[:_MOST]):
            ax.plot(along.x, along.ratio[k], color=COLOURS[k], lw=1.4, label=phrase("u of {quantity}", quantity=target.label.tex))
            best = int(np.argmin(along.ratio[k]))
            ax.plot(along.x[best], along.ratio[k][best], MARKS[k], color=COLOURS[k], ms=6)
        ax.plot(run.x, np.full(run.n_obs, 1.0), "|", color=INK, ms=5, mew=0.6)
        ax.set_xlabel(run.x_label, fontsize=8)
        ax.set_ylabel(phrase("u / u as things are"), fontsize=8)
        ax.tick_params(labelsize=8)
        if len(plan.along) > 1:
            ax.set_title(along.run, fontsize=8)
    axes[0].legend(fontsize=8, frameon=False)
    return figure
