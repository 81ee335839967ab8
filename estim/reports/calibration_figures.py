"""Figures of a calibration: ranks against uniform ones, and coverage of the intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from estim.calibration import COVERAGE_SDS, Calibration, edges, rank_counts, uniformity_band
from estim.common import percentage, phrase
from estim.drawing import BLUE, GREY, INK, ORANGE, name_ticks, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def rank_figure(calibration: Calibration) -> Figure:
    """Distribution function of the ranks minus that of uniform ranks, one panel a quantity, with the 95 % simultaneous band."""
    names = list(calibration.reported)
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure = new_figure(1.75 * rows + 0.5)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True).ravel()
    z = edges(calibration.n_rank)
    for ax, name in zip(axes, names, strict=False):
        ranks = calibration.ranks_of(name)
        ax.axhline(0.0, color=GREY, lw=0.6)
        ax.set_title(calibration.labels[name].tex, fontsize=8)
        ax.tick_params(labelsize=7)
        if ranks.size == 0:
            continue
        low, high = uniformity_band(ranks.size, calibration.n_rank)
        difference = rank_counts(ranks, calibration.n_rank) / ranks.size - z
        inside = bool(np.all((difference >= low - z) & (difference <= high - z)))
        ax.fill_between(z, low - z, high - z, color=GREY, alpha=0.3, lw=0)
        ax.step(z, difference, where="mid", color=BLUE if inside else ORANGE, lw=1.2 if inside else 1.8)
    for i, extra in enumerate(axes[len(names) :], start=len(names)):
        extra.set_visible(False)
        axes[i - columns].tick_params(labelbottom=True)
    figure.supxlabel(phrase("rank of the truth among posterior draws, as a share"), fontsize=8)
    figure.supylabel(phrase("ECDF − uniform"), fontsize=8)
    return figure


def coverage_figure(calibration: Calibration) -> Figure:
    """Share of the trials whose interval held the truth, with one and three Monte-Carlo standard deviations about the stated probability."""
    names = list(calibration.reported)
    figure = new_figure(0.26 * len(names) + 1.0)
    axes = figure.subplots(1, len(calibration.probabilities), squeeze=False, sharey=True)[0]
    rows = np.arange(len(names))[::-1]
    for i, (ax, p, sd) in enumerate(zip(axes, calibration.probabilities, calibration.share_sd(), strict=True)):
        for width, shade in ((1.0, 0.35), (COVERAGE_SDS, 0.18)):
            ax.axvspan(100 * (p - width * sd), min(100 * (p + width * sd), 100.0), color=GREY, alpha=shade, lw=0)
        ax.axvline(100 * p, color=INK, lw=0.8)
        shares = np.array([calibration.share(name)[i] for name in names])
        off = np.abs(shares - p) > COVERAGE_SDS * sd
        ax.plot(100 * shares[~off], rows[~off], "o", color=BLUE, ms=4)
        ax.plot(100 * shares[off], rows[off], "D", color=ORANGE, ms=5)
        ax.set_xlabel(phrase("covered by the {p} interval (%)", p=percentage(p)), fontsize=8)
        ax.tick_params(labelsize=7)
    name_ticks(axes[0].yaxis, rows, [calibration.labels[name].tex for name in names])
    return figure
