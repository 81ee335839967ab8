"""Figures of an analysis: the curve with its bands, and its residuals.  `estim.drawing` has what all figures share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estim.arrays import FloatArray
from estim.campaign import way_back
from estim.checks import Goodness, Outliers
from estim.deviation import FoundForce
from estim.drawing import BLUE, GREY, INK, ORANGE, grid, new_figure
from estim.drawing import png as png
from estim.pipeline import Analysis
from estim.problem import Observations
from estim.sampling import Bands, curve_draws

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MANY = 200  # points in one panel
_LINE = 0.01  # of the height of a curve: what a line hides


def phase_figure(analysis: Analysis, *, synthetic: bool) -> Figure:
    """Speed against position: data, median curve, credible and predictive bands, turning point."""
    figure, axes = grid(len(analysis.problem.runs), height=3.4)
    trusted = analysis.diagnosis.ok
    for ax, run, bands in zip(axes, analysis.problem.runs, analysis.bands, strict=True):
        if trusted:
            _draw_bands(ax, bands, run.words.new)
        else:
            mode = curve_draws(analysis.problem, run, bands.x, analysis.fit.values[None, :])[0][0]
            ax.plot(bands.x, mode, color=BLUE, lw=1.2, label="most probable curve" + (", its force left out" if bands.completed else ""))
        _draw_points(ax, run)
        _draw_outliers(ax, run, analysis.outliers)
        _draw_bad_frames(ax, run, analysis.fit.forces)
        stops = bands.end[np.isfinite(bands.end)]
        if trusted and stops.size > 0.5 * bands.end.size and np.median(stops) < 1.25 * run.x.max():
            low, middle, high = np.quantile(stops, [0.025, 0.5, 0.975])
            reach = [[middle - low], [high - middle]]
            bar = ax.errorbar(middle, 0.0, xerr=reach, fmt="^", color=ORANGE, mec=INK, ms=8, lw=3, label="turning point, 95 %", zorder=6)
            for part in (bar.lines[0], *bar.lines[2]):
                part.set_clip_on(False)
        ax.set(xlabel=run.x_label, ylabel=run.y_label)
        ax.set_title(run.name + (" (SYNTHETIC data)" if synthetic else "") + ("" if trusted else f" — {analysis.diagnosis.status}"), fontsize=10)
        if run.words.from_release:
            ax.set_xlim(left=_low_end(run.x))
            ax.set_ylim(bottom=_low_end(run.y))
    axes[0].legend(fontsize=7.5, frameon=False, loc="best")
    return figure


def _low_end(values: FloatArray) -> float:
    """0 where an axis may begin there without cutting a point."""
    lowest = float(values.min())
    return 0.0 if lowest > 0.0 else lowest - 0.03 * float(np.ptp(values))


def _draw_bands(ax: Axes, bands: Bands, new: str) -> None:
    probabilities = sorted(bands.credible, reverse=True)
    widest, with_force = probabilities[0], " with its force" if bands.completed else ""
    ax.fill_between(bands.x, *bands.predictive[widest], color=GREY, alpha=0.22, lw=0, label=f"{new}, {100 * widest:.0f} %")
    for probability, alpha in zip(probabilities, (0.30, 0.55), strict=True):
        low, high = bands.credible[probability]
        thin = np.median(high - low) < _LINE * np.ptp(bands.median)
        name = f"the curve{with_force}, {100 * probability:.0f} %" + (" (mostly under its line)" if thin else "")
        ax.fill_between(bands.x, low, high, color=BLUE, alpha=alpha, lw=0, label=name)
    ax.plot(bands.x, bands.median, color=BLUE, lw=1.2, label="posterior median")


def _draw_points(ax: Axes, run: Observations) -> None:
    many = run.n_obs > _MANY  # then points lie over one another, and under the curve
    said = "data used" if run.noise.counted is None else f"{run.noise.counted.law.word} used"
    ax.plot(run.x, run.y, "o", color=INK, ms=1.5 if many else 3, label=said, zorder=1.9 if many else 5, clip_on=False)
    if run.excluded_points.size:
        left = run.excluded_points
        near = (left[:, 0] >= _low_end(run.x)) & (left[:, 0] <= 1.1 * run.x.max()) & (left[:, 1] >= _low_end(run.y))
        if not run.words.from_release:
            near = np.abs(left[:, 0] - np.mean([run.x.min(), run.x.max()])) <= 0.6 * np.ptp(run.x)
        if np.any(near):
            ax.plot(left[near, 0], left[near, 1], "x", color=GREY, ms=4, label="data left out", zorder=3, clip_on=not run.words.from_release)
        if hidden := way_back(run.excluded):
            ax.text(0.99, 0.97, f"{hidden} frames of the way back (v < 0) not shown", transform=ax.transAxes, ha="right", va="top", fontsize=7.5)


def _draw_outliers(ax: Axes, run: Observations, outliers: Sequence[Outliers]) -> None:
    for found in outliers:
        if found.run == run.name and found.frames.size:
            at = found.frames
            ax.plot(run.x[at], run.y[at], "o", mfc="none", mec=ORANGE, mew=1.6, ms=9, ls="", label="outlier", zorder=6)


def _draw_bad_frames(ax: Axes, run: Observations, forces: Sequence[FoundForce]) -> None:
    """A ring about the point of each bad frame, or the nearest in time."""
    times = run.t if run.t is not None else run.x
    jumps = [jump for found in forces if found.run == run.name for jump in found.bad.jumps]
    at = sorted({int(np.argmin(np.abs(times - (jump.x if run.t is None else jump.t)))) for jump in jumps})
    if at:
        ax.plot(run.x[at], run.y[at], "o", mfc="none", mec=ORANGE, mew=1.6, ms=9, ls="", label="bad frame", zorder=6)


def residual_figure(runs: Sequence[Observations], goodness: Sequence[Goodness], *, synthetic: bool) -> Figure:
    """Whitened residuals along each run, and how they are distributed."""
    figure = new_figure(2.5 * len(runs))
    axes = figure.subplots(len(runs), 2, squeeze=False, width_ratios=(3, 1), sharey="row")
    for (left, right), run, good in zip(axes, runs, goodness, strict=True):
        for sigma, shade in ((1.0, 0.20), (2.0, 0.10)):
            left.axhspan(-sigma, sigma, color=GREY, alpha=shade, lw=0)
        left.axhline(0.0, color=GREY, lw=0.8)
        left.plot(run.x, good.whitened, "-", color=BLUE, lw=0.6, alpha=0.6)
        left.plot(run.x, good.whitened, "o", color=INK, ms=3)
        reach = max(3.3, 1.1 * float(np.max(np.abs(good.whitened))))
        edges = np.linspace(-reach, reach, 15)
        right.hist(good.whitened, bins=edges, orientation="horizontal", color=BLUE, alpha=0.55)
        z = np.linspace(-reach, reach, 200)
        right.plot(run.n_obs * (edges[1] - edges[0]) * np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi), z, color=INK, lw=1)
        left.set_ylim(-reach, reach)
        left.set(xlabel=run.x_label, ylabel="whitened residual")
        left.set_title(run.name + (" (SYNTHETIC data)" if synthetic else ""), fontsize=10)
        right.set(xlabel=run.words.rows)
        right.set_title("line: expected", fontsize=8)
    return figure
