"""Figure of the unmodelled force along the track of each run, or of those that share one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estim.common import OF_BODY, phrase
from estim.deviation import FoundForce
from estim.drawing import BLUE, GREY, INK, ORANGE, grid
from estim.problem import Observations
from estim.reports.joint_figures import RUN_COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def force_figure(forces: Sequence[FoundForce], runs: Sequence[Observations]) -> Figure:
    """Median with 68 and 95 % bands, in percent of the weight; ticks where the points lie."""
    figure, axes = grid(len(forces), height=2.8)
    by_name = {run.name: run for run in runs}
    for ax, found in zip(axes, forces, strict=True):
        several, force = [by_name[name] for name in found.runs], found.force
        low_95, low_68, median, high_68, high_95 = 100.0 * force.quantiles
        ax.fill_between(force.x, low_95, high_95, color=BLUE, alpha=0.18, lw=0, label="95 %")
        ax.fill_between(force.x, low_68, high_68, color=BLUE, alpha=0.38, lw=0, label="68 %")
        ax.plot(force.x, median, color=BLUE, lw=1.6, label=phrase("median"))
        ax.axhline(0.0, color=GREY, lw=0.8)
        if force.back is not None:
            ax.plot(force.x, 100.0 * force.back[2], color=ORANGE, lw=1.4, ls="--", label=phrase("way back, median and 68 %"))
            ax.plot(np.tile(force.x, (2, 1)).T, 100.0 * force.back[[1, 3]].T, color=ORANGE, lw=0.7, ls=":")
        for own, colour in zip(found.own, RUN_COLOURS[1:] * len(found.own), strict=False):
            ax.plot(own.x, 100.0 * own.mean, color=colour, lw=0.8, label=phrase("{run} adds", run=own.run))
        place = np.concatenate([run.y if run.positions else run.x for run in several])
        label = several[0].y_label if several[0].positions else several[0].x_label
        ax.plot(place, 0.0 * place + 0.025, "|", color=INK, ms=6, transform=ax.get_xaxis_transform(), label=phrase("points that are fit"))
        ax.set(xlabel=label, ylabel=phrase("force (% of the weight)"), xlim=(force.x[0], force.x[-1]))
        said = phrase("{title}: P(amplitude > 0) = {p:.3f}", title=_title(found), p=force.probability)
        ax.set_title(said, fontsize=10)
        ax.legend(fontsize=7.5, frameon=False, loc="upper left", bbox_to_anchor=(0.0, -0.22), ncols=4)
    return figure


def _title(found: FoundForce) -> str:
    return found.run if len(found.runs) == 1 else phrase("body {body}, shared by {n} runs", body=found.run.removeprefix(OF_BODY), n=len(found.runs))
