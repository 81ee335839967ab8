"""Figure of the chains: a strip for each parameter, all strips in one axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from estim.arrays import FloatArray
from estim.common import phrase
from estim.drawing import BLUE, GREEN, INK, ORANGE, PURPLE, name_ticks, new_figure, tick_texts
from estim.pipeline import Analysis

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MARGIN = 0.07  # of the height of a strip, above and below what is drawn
_FONTSIZE, _WIDTH_OF_DIGIT = 7.0, 0.62  # of the numbers of a strip; in font sizes, at most
_MOST_STEPS = 1000
_MOST_STRIPS = 40


def trace_figure(analysis: Analysis) -> Figure:
    """The mean of each ensemble's walkers, and one of its walkers behind, against the step."""
    parameters, draws = analysis.problem.parameters, analysis.chain.draws
    places = analysis.problem.foremost(_MOST_STRIPS)
    columns = 1 if len(places) <= 8 else 2
    rows = -(-len(places) // columns)
    figure = new_figure(0.85 * rows + 0.7)
    every = max(1, draws.shape[1] // _MOST_STEPS)
    steps = (np.arange(draws.shape[1]) + analysis.chain.n_burn)[::every].astype(float)
    for k, ax in enumerate(figure.subplots(1, columns, squeeze=False)[0]):
        here = places[k * rows : (k + 1) * rows]
        shown = [parameters[i].label for i in here]
        walkers = [draws[:, ::every, 0, i] * label.factor for i, label in zip(here, shown, strict=True)]
        means = [draws[..., i].mean(axis=2)[:, ::every] * label.factor for i, label in zip(here, shown, strict=True)]
        _draw_strips(ax, steps, walkers, means, names=[label.axis for label in shown])
        ax.set(xlabel=phrase("step"), ylim=(rows, 0.0))
    said = phrase("bold: mean of an ensemble; faint: one of its walkers")
    if len(places) < len(parameters):
        said = f"{said}; {phrase('{n} of {of} parameters', n=len(places), of=len(parameters))}"
    figure.suptitle(said, fontsize=8)
    return figure


def _draw_strips(ax: Axes, steps: FloatArray, walkers: list[FloatArray], means: list[FloatArray], *, names: list[str]) -> None:
    """walkers, means : for each strip (n_ensemble, n_step).  Strip i lies between i and i + 1, its values upwards."""
    from matplotlib.collections import LineCollection
    from matplotlib.ticker import MaxNLocator

    places, texts, faint, bold = [], [], [], []
    for i, (walker, mean) in enumerate(zip(walkers, means, strict=True)):
        low, high = float(min(walker.min(), mean.min())), float(max(walker.max(), mean.max()))
        scale = (1.0 - 2.0 * _MARGIN) / (high - low) if high > low else 0.0
        faint += [np.column_stack([steps, i + 1.0 - _MARGIN - scale * (one - low)]) for one in walker]
        bold += [np.column_stack([steps, i + 1.0 - _MARGIN - scale * (one - low)]) for one in mean]
        ticks = np.asarray(MaxNLocator(3).tick_values(low, high))
        ticks = ticks[(ticks >= low) & (ticks <= high)]
        places += list(i + 1.0 - _MARGIN - scale * (ticks - low))
        texts += tick_texts(ticks)
    colours = [(BLUE, ORANGE, GREEN, PURPLE)[k % 4] for k in range(len(means[0]))] * len(means)
    ax.add_collection(LineCollection(faint, colors=colours, linewidths=0.4, alpha=0.35))
    ax.add_collection(LineCollection(bold, colors=colours, linewidths=1.0))
    ax.hlines(np.arange(1, len(means)), 0.0, 1.0, color=INK, lw=0.8, transform=ax.get_yaxis_transform())
    ax.margins(x=0.02)
    ax.autoscale_view(scaley=False)
    ax.tick_params(labelsize=_FONTSIZE)
    ax.yaxis.remove_overlapping_locs = False  # of a number beside a name
    ax.yaxis.set_ticks(places, texts, minor=True, fontsize=_FONTSIZE)
    ax.tick_params(axis="y", which="major", length=0.0, pad=10.0 + _WIDTH_OF_DIGIT * _FONTSIZE * max(map(len, texts), default=0))
    name_ticks(ax.yaxis, np.arange(len(names)) + 0.5, names, fontsize=8.0)
