"""Figure of the chains: a strip for each parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from estim.common import phrase
from estim.drawing import BLUE, GREEN, ORANGE, PURPLE, new_figure
from estim.pipeline import Analysis

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = (BLUE, ORANGE, GREEN, PURPLE)  # of ensembles
_MOST_STEPS, _MOST_STRIPS = 1000, 40


def trace_figure(analysis: Analysis) -> Figure:
    """The mean of each ensemble's walkers, and one of its walkers behind, against the step."""
    parameters, draws = analysis.problem.parameters, analysis.chain.draws
    places = analysis.problem.foremost(_MOST_STRIPS)
    columns = 1 if len(places) <= 8 else 2
    rows = -(-len(places) // columns)
    figure = new_figure(0.85 * rows + 0.7)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True).T.ravel()
    every = max(1, draws.shape[1] // _MOST_STEPS)
    steps = (np.arange(draws.shape[1]) + analysis.chain.n_burn)[::every]
    for ax, i in zip(axes, places, strict=False):
        shown, mine = parameters[i].label, draws[:, ::every, :, i] * parameters[i].label.factor
        for k, ensemble in enumerate(mine):
            colour = _COLOURS[k % len(_COLOURS)]
            ax.plot(steps, ensemble[:, 0], color=colour, lw=0.4, alpha=0.35)
            ax.plot(steps, ensemble.mean(axis=1), color=colour, lw=1.0)
        ax.set_ylabel(shown.axis, fontsize=8, rotation=0, ha="right", va="center")
        ax.tick_params(labelsize=7)
        ax.locator_params(axis="y", nbins=3)
    for ax in axes[len(places) :]:
        ax.set_visible(False)
    for ax in axes[rows - 1 :: rows]:
        ax.set_xlabel(phrase("step"))
    said = phrase("bold: mean of an ensemble; faint: one of its walkers")
    if len(places) < len(parameters):
        said = f"{said}; {phrase('{n} of {of} parameters', n=len(places), of=len(parameters))}"
    figure.suptitle(said, fontsize=8)
    return figure
