"""Figure of the force of the ramp along the way: how hard it presses, and the friction that rolling takes, beside the stated one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estim.arrays import FloatArray
from estim.checks import Rolling, way_of
from estim.common import phrase
from estim.drawing import BLUE, GREY, ORANGE, grid
from estim.problem import Motion, Problem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LEVELS = (0.025, 0.16, 0.5, 0.84, 0.975)


def rolling_figure(problem: Problem, draws: FloatArray, rolling: Sequence[Rolling]) -> Figure:
    """N/(M g) and |F|/N from the release to the farthest reading, one panel a run with a stated friction: median, 68 and 95 % bands.

    draws : (n_draw, n_par).
    """
    stated = {one.run: one for one in rolling if one.stated}
    figure, axes = grid(len(stated), height=2.8)
    named = problem.named(draws)
    for ax, run in zip(axes, (run for run in problem.runs if run.name in stated), strict=True):
        footing = run.body.footing(way_of(run), run.bind(named))
        along = np.median(footing.along, axis=0)
        _band(ax, along, footing.normal, GREY, "N/(M g)")
        _band(ax, along, np.where(np.isfinite(footing.needed), footing.needed, np.nan), BLUE, "|F|/N")
        _grip(ax, run.body)
        label = run.y_label if run.positions else run.x_label
        ax.set(xlabel=label, ylabel=phrase("share"), ylim=(0.0, None), xlim=(along[0], along[-1]))
        said = phrase("{run}: rolls all the way with probability {p:.2f}", run=run.name, p=stated[run.name].holds)
        ax.set_title(said, fontsize=10)
    axes[0].legend(fontsize=7.5, frameon=False, loc="best", ncols=3)
    return figure


def _band(ax: Axes, along: FloatArray, values: FloatArray, colour: str, name: str) -> None:
    """Where half of the draws get: beyond, a band would be that of the few that do."""
    there = np.mean(np.isfinite(values), axis=0) > 0.5
    low_95, low_68, median, high_68, high_95 = np.nanquantile(values[:, there], _LEVELS, axis=0)
    ax.fill_between(along[there], low_95, high_95, color=colour, alpha=0.18, lw=0)
    ax.fill_between(along[there], low_68, high_68, color=colour, alpha=0.38, lw=0)
    ax.plot(along[there], median, color=colour, lw=1.6, label=name)


def _grip(ax: Axes, motion: Motion) -> None:
    """The stated friction, a line with one standard uncertainty."""
    grip = motion.grip
    if grip is None:
        return
    centre, sd = (grip, 0.0) if isinstance(grip, float) else (grip.expectation, grip.sd)
    ax.axhline(centre, color=ORANGE, lw=1.4, ls="--", label=phrase("stated friction"))
    ax.axhspan(centre - sd, centre + sd, color=ORANGE, alpha=0.2, lw=0)
