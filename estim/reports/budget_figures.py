"""Figure of where uncertainties come from: a bar a quantity, a piece a source.  Style and colours as in `estim.reports.figures`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from estim.common import phrase
from estim.drawing import BLUE, GREEN, GREY, INK, ORANGE, PALE, PURPLE, name_ticks, new_figure
from estim.reports.budget import OTHERS, Shares

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, PALE, "#F0E442", "#D55E00")
_HATCHES = ("", "", "", "///", "", "...", "\\\\\\")
_WRITTEN = 0.07  # share from which a number stands in its piece


def budget_figure(shares: Shares) -> Figure:
    """Shares of the variance, one bar a quantity; sources beyond seven are one piece."""
    n, most = len(shares.labels), len(_COLOURS)
    own = [i for i, source in enumerate(shares.sources) if source != OTHERS][:most]
    rest = 1.0 - np.sum(shares.shares[own], axis=0)
    figure = new_figure(1.3 + 0.36 * n + 0.2 * ((len(own) + 3) // 3))
    ax = figure.subplots()
    left, places = np.zeros(n), np.arange(n)
    pieces = [(shares.sources[i], shares.shares[i], _COLOURS[k], _HATCHES[k]) for k, i in enumerate(own)]
    pieces += [(OTHERS, np.maximum(rest, 0.0), GREY, "")] if np.any(rest > 0.005) else []
    for source, part, colour, hatch in pieces:
        ax.barh(places, part, left=left, color=colour, hatch=hatch, edgecolor="white", linewidth=0.8, height=0.66, label=phrase(source))
        for place, start, width in zip(places.tolist(), left.tolist(), part.tolist(), strict=True):
            if width >= _WRITTEN:
                dark = colour in (BLUE, "#D55E00", GREEN, GREY)
                box = {"boxstyle": "round,pad=0.15", "facecolor": colour, "edgecolor": "none"}
                text = f"{100.0 * width:.0f}"
                ax.text(start + 0.5 * width, place, text, ha="center", va="center", fontsize=7.5, color="white" if dark else INK, bbox=box)
        left = left + part
    name_ticks(ax.yaxis, places, [label.tex for label in shares.labels], fontsize=9)
    ax.set_ylim(n - 0.5, -0.5)
    ax.set_xlim(0.0, 1.0)
    name_ticks(ax.xaxis, np.linspace(0.0, 1.0, 6), [f"{p}" for p in range(0, 101, 20)], fontsize=8)
    ax.set_xlabel(phrase("share of the variance (%)"), fontsize=9)
    figure.legend(loc="outside lower center", ncols=3, fontsize=7.5, frameon=False)
    return figure
