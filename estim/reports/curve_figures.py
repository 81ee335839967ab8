"""The main figure of a report: data and curve with its bands, and below it what is left of the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.campaign import way_back
from estim.checks import Outliers
from estim.common import later, phrase
from estim.deviation import FoundForce
from estim.drawing import BLUE, GREY, INK
from estim.pipeline import Analysis
from estim.problem import Observations
from estim.reports.residual_panels import (
    VERMILION,
    Residuals,
    draw_points_with_bars,
    draw_residuals,
    drawn_runs,
    panel_pairs,
    residuals_of,
    tidy_labels,
)
from estim.sampling import Bands, curve_draws

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_LINE = 0.01  # of the height of a curve: what a line hides


def phase_figure(analysis: Analysis) -> Figure:
    """Speed against position: data, median curve, credible and predictive bands, turning point; below it data less curve in the unit of y."""
    drawn, found = drawn_runs(analysis.goodness), residuals_of(analysis)
    figure, pairs = panel_pairs(len(drawn), height=4.9 if len(drawn) == 1 else 3.5)
    trusted = analysis.diagnosis.ok
    for (ax, low), i in zip(pairs, drawn, strict=True):
        run, bands, residuals = analysis.problem.runs[i], analysis.bands[i], found[i]
        if trusted:
            _draw_bands(ax, bands, phrase(run.words.new, y=run.y_name))
        else:
            mode = curve_draws(analysis.problem, run, bands.x, analysis.fit.values[None, :])[0][0]
            said = phrase("most probable curve, its force left out") if bands.completed else phrase("most probable curve")
            ax.plot(bands.x, mode, color=BLUE, lw=1.2, label=said)
        _draw_points(ax, run, residuals)
        _draw_outliers(ax, run, analysis.outliers, residuals.far)
        _draw_bad_frames(ax, run, analysis.fit.forces)
        draw_residuals(low, residuals, bands if trusted else None)
        stops = bands.end[np.isfinite(bands.end)]
        if trusted and stops.size > 0.5 * bands.end.size and np.median(stops) < 1.25 * run.x.max():
            left, middle, right = np.quantile(stops, [0.025, 0.5, 0.975])
            reach = [[middle - left], [right - middle]]
            bar = ax.errorbar(middle, 0.0, xerr=reach, fmt="^", color=BLUE, mec=INK, ms=8, lw=3, label=phrase("turning point, 95 %"), zorder=6)
            for part in (bar.lines[0], *bar.lines[2]):
                part.set_clip_on(False)
        ax.set_ylabel(run.y_label)
        ax.set_title(run.name + ("" if trusted else f" — {analysis.diagnosis.status}"), fontsize=10)
        if run.words.from_release:
            ax.set_xlim(left=_low_end(run.x))
            ax.set_ylim(bottom=_low_end(run.y))
    named = {text: handle for ax, _ in pairs for handle, text in zip(*ax.get_legend_handles_labels(), strict=True)}
    columns = 4 if len(named) > 6 and max(map(len, named)) < 30 else 3
    figure.legend(list(named.values()), list(named), fontsize=7.5, frameon=False, loc="outside lower center", ncols=columns)
    tidy_labels(pairs)
    figure.align_ylabels()
    return figure


def _low_end(values: FloatArray) -> float:
    """0 where an axis may begin there without cutting a point."""
    lowest = float(values.min())
    return 0.0 if lowest > 0.0 else lowest - 0.03 * float(np.ptp(values))


def _draw_bands(ax: Axes, bands: Bands, new: str) -> None:
    probabilities = sorted(bands.credible, reverse=True)
    widest = probabilities[0]
    ax.fill_between(bands.x, *bands.predictive[widest], color=GREY, alpha=0.22, lw=0, label=f"{new}, {100 * widest:.0f} %")
    for probability, alpha in zip(probabilities, (0.30, 0.55), strict=True):
        low, high = bands.credible[probability]
        thin = np.median(high - low) < _LINE * np.ptp(bands.median)
        curve = later("the curve with its force, {p:.0f} %") if bands.completed else later("the curve, {p:.0f} %")
        name = phrase(curve, p=100 * probability) + (f" ({phrase('mostly under its line')})" if thin else "")
        ax.fill_between(bands.x, low, high, color=BLUE, alpha=alpha, lw=0, label=name)
    ax.plot(bands.x, bands.median, color=BLUE, lw=1.2, label=phrase("posterior median"))


def _draw_points(ax: Axes, run: Observations, residuals: Residuals) -> None:
    said = phrase("data used") if run.noise.counted is None else phrase(run.noise.counted.law.used)
    draw_points_with_bars(ax, residuals, label=said)
    if run.excluded_points.size:
        left = run.excluded_points
        near = (left[:, 0] >= _low_end(run.x)) & (left[:, 0] <= 1.1 * run.x.max()) & (left[:, 1] >= _low_end(run.y))
        if not run.words.from_release:
            ends = np.array([(v.min(), v.max()) for v in (run.x, run.y[~residuals.far])])
            near = np.all(np.abs(left - ends.mean(axis=1)) <= 0.6 * np.ptp(ends, axis=1), axis=1)  # others would press the data flat
        if np.any(near):
            ax.plot(left[near, 0], left[near, 1], "x", color=GREY, ms=4, label=phrase("data left out"), zorder=3, clip_on=not run.words.from_release)
        if hidden := way_back(run.excluded):
            said = phrase("{n} frames of the way back (v < 0) not shown", n=hidden)
            ax.text(0.99, 0.97, said, transform=ax.transAxes, ha="right", va="top", fontsize=7.5)


def _draw_outliers(ax: Axes, run: Observations, outliers: Sequence[Outliers], far: NDArray[np.bool_]) -> None:
    """A ring about each outlier; one that is far off is an arrow at the edge, with its y."""
    for found in outliers:
        at = found.frames[~far[found.frames]] if found.run == run.name else found.frames[:0]
        if at.size:
            ax.plot(run.x[at], run.y[at], "o", mfc="none", mec=VERMILION, mew=1.6, ms=9, ls="", label=phrase("outlier"), zorder=6)
    said, place = phrase("outlier, far off"), ax.get_xaxis_transform()
    for x, y in zip(run.x[far], run.y[far], strict=True):
        edge, up, mark, side = (0.03, 9, "v", "bottom") if y < run.y[~far].min() else (0.97, -9, "^", "top")
        ax.plot(x, edge, mark, mfc="none", mec=VERMILION, mew=1.6, ms=8, ls="", label=said, zorder=6, transform=place)
        ax.annotate(f"{y:.4g}", (x, edge), (0, up), xycoords=place, textcoords="offset points", fontsize=7.5, ha="center", va=side)
        said = ""


def _draw_bad_frames(ax: Axes, run: Observations, forces: Sequence[FoundForce]) -> None:
    """A ring about the point of each bad frame, or the nearest in time."""
    times = run.t if run.t is not None else run.x
    jumps = [jump for found in forces if found.run == run.name for jump in found.bad.jumps]
    at = sorted({int(np.argmin(np.abs(times - (jump.x if run.t is None else jump.t)))) for jump in jumps})
    if at:
        ax.plot(run.x[at], run.y[at], "o", mfc="none", mec=VERMILION, mew=1.6, ms=9, ls="", label=phrase("bad frame"), zorder=6)
