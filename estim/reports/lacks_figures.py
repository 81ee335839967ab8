"""Figure of what a user's own curve lacks: the part that no values of its parameters can imitate, with the residuals it is read from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from estim.common import phrase
from estim.deviation import FoundDeviation
from estim.drawing import BLUE, GREY, INK, grid
from estim.problem import Observations

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def lacks_figure(deviations: Sequence[FoundDeviation], runs: Sequence[Observations]) -> Figure:
    """Median with 68 and 95 % bands; points: the residuals of the best curve with independent errors."""
    figure, axes = grid(len(deviations), height=2.8)
    by_name = {run.name: run for run in runs}
    for ax, found in zip(axes, deviations, strict=True):
        run, visible = by_name[found.run], found.visible
        low_95, low_68, median, high_68, high_95 = visible.quantiles
        ax.fill_between(visible.x, low_95, high_95, color=BLUE, alpha=0.18, lw=0, label="95 %")
        ax.fill_between(visible.x, low_68, high_68, color=BLUE, alpha=0.38, lw=0, label="68 %")
        ax.plot(visible.x, median, color=BLUE, lw=1.6, label=phrase("median"))
        ax.plot(visible.x, visible.residuals, ".", color=INK, ms=3.5, label=phrase("residuals"))
        ax.axhline(0.0, color=GREY, lw=0.8)
        ax.set(xlabel=run.x_label, ylabel=phrase("deviation of {y}", y=run.y_label), xlim=(visible.x[0], visible.x[-1]))
        said = phrase("{title}: P(amplitude > 0) = {p:.3f}", title=run.name, p=found.probability)
        ax.set_title(said, fontsize=10)
    figure.legend(*axes[0].get_legend_handles_labels(), fontsize=7.5, frameon=False, loc="outside lower center", ncols=4)
    return figure
