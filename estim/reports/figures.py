"""The figure of the residuals of an analysis.  `estim.drawing` has what all figures share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estim.checks import Goodness
from estim.common import phrase
from estim.drawing import BLUE, GREY, INK, new_figure
from estim.problem import Observations

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MANY = 300  # points that hide each other, and a line between them all


def residual_figure(runs: Sequence[Observations], goodness: Sequence[Goodness]) -> Figure:
    """Whitened residuals along each run, and how they are distributed."""
    figure = new_figure(2.5 * len(runs))
    axes = figure.subplots(len(runs), 2, squeeze=False, width_ratios=(3, 1), sharey="row")
    for (left, right), run, good in zip(axes, runs, goodness, strict=True):
        for sigma, shade in ((1.0, 0.20), (2.0, 0.10)):
            left.axhspan(-sigma, sigma, color=GREY, alpha=shade, lw=0)
        left.axhline(0.0, color=GREY, lw=0.8)
        if run.n_obs <= _MANY:
            left.plot(run.x, good.whitened, "-", color=BLUE, lw=0.6, alpha=0.6)
        left.plot(run.x, good.whitened, "o", color=INK, **({"ms": 3.0} if run.n_obs <= _MANY else {"ms": 1.2, "alpha": 0.6}))
        reach = max(3.3, 1.1 * float(np.max(np.abs(good.whitened))))
        edges = np.linspace(-reach, reach, 15)
        right.hist(good.whitened, bins=edges, orientation="horizontal", color=BLUE, alpha=0.55)
        z = np.linspace(-reach, reach, 200)
        right.plot(run.n_obs * (edges[1] - edges[0]) * np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi), z, color=INK, lw=1)
        left.set_ylim(-reach, reach)
        left.set(xlabel=run.x_label, ylabel=phrase("whitened residual"))
        left.set_title(run.name, fontsize=10)
        right.set(xlabel=phrase(run.words.rows))
        right.set_title(phrase("line: expected"), fontsize=8)
    return figure
