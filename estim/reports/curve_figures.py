"""Figures of a fit: data and curve with its bands above what is left of the data, whitened
residuals, and those of all runs over each other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import cycle
from typing import Any

import numpy as np

from estim.arrays import BoolArray, FloatArray
from estim.campaign import way_back
from estim.checks import Goodness, Outliers
from estim.common import bracketed, later, phrase
from estim.discrepancy import FoundForce
from estim.distributions import normal_log_density
from estim.drawing import (
    BLUE,
    GREY,
    INK,
    MARKS,
    MOST_BARS,
    RUN_COLOURS,
    VERMILION,
    Axes,
    Figure,
    draw_pulls,
    fill,
    grid,
    legend_below,
    logarithmic,
    new_figure,
    whole_ticks,
)
from estim.pipeline import Analysis
from estim.problem import Observations, Problem, reading_sd
from estim.sampling import Bands, curve_draws, motion_end
from estim.studies.paper_band import PropagatedBand

_BAR: dict[str, Any] = {"fmt": "o", "color": INK, "elinewidth": 0.7, "zorder": 5}
_RING: dict[str, Any] = {"mfc": "none", "mec": VERMILION, "mew": 1.6, "ls": "", "zorder": 6}
MOST_DRAWN = 15  # runs
_ROOMY = 6  # runs beyond which there are three columns
_HIDING = 300  # points that hide each other, and a line between them all
_NAMED = len(RUN_COLOURS)  # runs beyond which single ones are grey


def phase_figure(analysis: Analysis) -> Figure:
    """Speed against position: data, median curve, credible and predictive bands, turning point;
    below it data less curve in the unit of y.
    """
    drawn, all_residuals = drawn_runs(analysis.goodness), residuals_of(analysis)
    figure, pairs = panel_pairs(len(drawn), height=4.9 if len(drawn) == 1 else 3.5)
    trusted = analysis.diagnosis.ok
    for (ax, low), i in zip(pairs, drawn, strict=True):
        bands, residuals = analysis.bands[i], all_residuals[i]
        run = residuals.run
        x, curve = bands.x, run.x if run.numbered else _curve(analysis, run, bands, bands.x)
        if run.numbered:
            x, label = run.x, phrase("data equal to the fitted value")
        elif trusted:
            _draw_bands(ax, bands, _new_reading(analysis, run, bands))
            label = phrase("posterior median")
        else:
            label = phrase(
                "most probable curve, without the force"
                if bands.completed
                else "most probable curve"
            )
        ax.plot(x, curve, color=BLUE, label=label)
        _draw_points(ax, run, residuals)
        _draw_outliers(ax, run, analysis.outliers, residuals.far)
        _draw_bad_frames(ax, run, analysis.fit.forces)
        draw_residuals(low, residuals, bands if trusted and not run.numbered else None)
        stops = bands.end[np.isfinite(bands.end)]
        if trusted and stops.size > 0.5 * bands.end.size and np.median(stops) < 1.25 * run.x.max():
            left, middle, right = np.quantile(stops, [0.025, 0.5, 0.975])
            ends = [[middle - left], [right - middle]]
            bar = ax.errorbar(
                middle,
                0.0,
                xerr=ends,
                fmt="^",
                color=BLUE,
                mec=INK,
                ms=8,
                lw=3,
                label=phrase("turning point, 95 %"),
                zorder=6,
            )
            for part in (bar.lines[0], *bar.lines[2]):
                part.set_clip_on(False)
        ax.set_ylabel(run.y_label)
        ax.set_title(run.name + ("" if trusted else f" — {analysis.diagnosis.status}"))
        if run.words.from_release:
            ax.set_xlim(left=_low_end(run.x))
            ax.set_ylim(bottom=_low_end(run.y))
        else:
            logarithmic(
                ax, run.spread_in_decades, run.y[~residuals.far], residuals.sd[~residuals.far]
            )
    legend_below(figure)
    tidy_labels(pairs)
    figure.align_ylabels()
    return figure


def abscissas_figure(analysis: Analysis) -> Figure:
    """Residuals (data minus curve) against each abscissa, of the runs whose curve has several."""
    every = residuals_of(analysis)
    drawn = [every[i] for i in drawn_runs(analysis.goodness)]
    panels = [
        (residuals, *place) for residuals in drawn for place in (residuals.run.places or {}).items()
    ]
    figure, axes = grid(len(panels), height=2.3, columns=2)
    for ax, (residuals, name, x) in zip(axes, panels, strict=True):
        draw_residuals(
            ax, replace(residuals, run=replace(residuals.run, x=x, x_name=name, x_unit="1")), None
        )
        ax.set_title(residuals.run.name)
    return figure


def phase_plane_figure(
    analysis: Analysis, propagated: Sequence[PropagatedBand], names: Mapping[str, str]
) -> Figure:
    """Speed against position of all runs in one pair of axes, each in a colour of its own: data,
    curve and its credible bands, and paler the band of its stated inputs.

    propagated : of the stated inputs, for those runs that have one.  names : run -> its name in
        the legend.  Runs in other units have axes of their own.
    """
    runs = [analysis.problem.runs[i] for i in drawn_runs(analysis.goodness)]
    units = list(dict.fromkeys((run.x_label, run.y_label) for run in runs))
    figure, axes = grid(len(units), height=4.6)
    stated = {band.run: band for band in propagated}
    all_bands = {bands.run: bands for bands in analysis.bands}
    residuals = {entry.run.name: entry for entry in residuals_of(analysis)}
    for run, colour, mark in zip(runs, cycle(RUN_COLOURS), cycle(MARKS), strict=False):
        ax, bands = axes[units.index((run.x_label, run.y_label))], all_bands[run.name]
        if (band := stated.get(run.name)) is not None:
            fill(ax, band.x, band.mc_low, band.mc_high, colour, 0.15)
        if analysis.diagnosis.ok:
            for p, alpha in ((0.95, 0.30), (0.68, 0.55)):
                low, high = bands.credible[p]
                fill(ax, bands.x, low, high, colour, alpha)
        ax.plot(bands.x, _curve(analysis, run, bands, bands.x), color=colour)
        name, rest = names[run.name], residuals[run.name]
        draw_points_with_bars(ax, rest, label=name, colour=colour, mark=mark)
        _draw_outliers(ax, run, analysis.outliers, rest.far)
        _draw_bad_frames(ax, run, analysis.fit.forces)
    for ax, (x_label, y_label) in zip(axes, units, strict=True):
        panel_runs = [run for run in runs if run.x_label == x_label]
        ax.set(xlabel=x_label, ylabel=y_label)
        ax.set_xlim(left=min(_low_end(run.x) for run in panel_runs))
        ax.set_ylim(bottom=min(_low_end(run.y) for run in panel_runs))
    legend_below(figure, ncols=2)
    return figure


def _low_end(values: FloatArray) -> float:
    """0 where an axis may begin there without cutting a point."""
    lowest = float(values.min())
    return 0.0 if lowest > 0.0 else lowest - 0.03 * float(np.ptp(values))


def _curve(analysis: Analysis, run: Observations, bands: Bands, x: FloatArray) -> FloatArray:
    """(n_x,) the curve of a run that is drawn: the median of the draws where the status is ok, else
    the most probable one.
    """
    if analysis.diagnosis.ok and not run.numbered:
        return np.interp(x, bands.x, bands.median)
    problem, values = analysis.problem, analysis.fit.values[None, :]
    return curve_draws(problem, run, x, values, motion_end(problem, run, values))[0]


def _new_reading(analysis: Analysis, run: Observations, bands: Bands) -> str:
    """What the outer band is of, which is without what the curve lacks unless it is `completed`."""
    new = phrase(run.words.new, y=run.y_name)
    incomplete = [deviation.run for deviation in analysis.fit.deviations]
    incomplete += [name for force in analysis.fit.forces for name in force.runs]
    if bands.completed or run.name not in incomplete:
        return new
    return phrase("{new} without the deviation", new=new)


def _draw_bands(ax: Axes, bands: Bands, new: str = "", *, less: FloatArray | float = 0.0) -> None:
    """A new reading, and the curve, all `less` something; with names where a `new` reading has
    one.
    """
    curve = later(
        "the curve including the force, {p:.0f} %" if bands.completed else "the curve, {p:.0f} %"
    )
    for intervals, p, colour, alpha in (
        (bands.predictive, 0.95, GREY, 0.22),
        (bands.credible, 0.95, BLUE, 0.30),
        (bands.credible, 0.68, BLUE, 0.55),
    ):
        name = f"{new}, {100 * p:.0f} %" if colour == GREY else phrase(curve, p=100 * p)
        low, high = intervals[p]
        fill(ax, bands.x, low - less, high - less, colour, alpha, label=name if new else None)


def _draw_points(ax: Axes, run: Observations, residuals: DrawnResiduals) -> None:
    draw_points_with_bars(
        ax,
        residuals,
        label=phrase("data used")
        if run.noise.counted is None
        else phrase(run.noise.counted.law.used),
    )
    if run.excluded_points.size:
        excluded = run.excluded_points
        near = (
            (excluded[:, 0] >= _low_end(run.x))
            & (excluded[:, 0] <= 1.1 * run.x.max())
            & (excluded[:, 1] >= _low_end(run.y))
        )
        if not run.words.from_release:
            ends = np.array([(v.min(), v.max()) for v in (run.x, run.y[~residuals.far])])
            # others would press the data flat
            near = np.all(
                np.abs(excluded - ends.mean(axis=1)) <= 0.6 * np.ptp(ends, axis=1), axis=1
            )
        if np.any(near):
            ax.plot(
                excluded[near, 0],
                excluded[near, 1],
                "x",
                color=GREY,
                label=phrase("excluded data"),
                zorder=3,
                clip_on=not run.words.from_release,
            )
        if hidden := way_back(run.excluded):
            text = phrase("{n} frames of the way back (v < 0) are not shown", n=hidden)
            ax.text(0.99, 0.97, text, transform=ax.transAxes, ha="right", va="top")


def _draw_outliers(
    ax: Axes, run: Observations, outliers: Sequence[Outliers], far: BoolArray
) -> None:
    """A ring about each outlier; one that is far off is an arrow at the edge, with its y."""
    for group in outliers:
        at = group.frames[~far[group.frames]] if group.run == run.name else group.frames[:0]
        if at.size:
            ax.plot(run.x[at], run.y[at], "o", ms=9, label=phrase("outlier"), **_RING)
    label, place = phrase("distant outlier"), ax.get_xaxis_transform()
    for x, y in zip(run.x[far], run.y[far], strict=True):
        edge, up, mark, side = (
            (0.03, 9, "v", "bottom") if y < run.y[~far].min() else (0.97, -9, "^", "top")
        )
        ax.plot(x, edge, mark, ms=8, label=label, transform=place, **_RING)
        ax.annotate(
            f"{y:.4g}",
            (x, edge),
            (0, up),
            xycoords=place,
            textcoords="offset points",
            ha="center",
            va=side,
        )
        label = ""


def _draw_bad_frames(ax: Axes, run: Observations, forces: Sequence[FoundForce]) -> None:
    """A ring about the point of each bad frame, or the nearest in time."""
    times = run.t if run.t is not None else run.x
    jumps = [jump for force in forces if force.run == run.name for jump in force.bad.jumps]
    at = sorted(
        {int(np.argmin(np.abs(times - (jump.x if run.t is None else jump.t)))) for jump in jumps}
    )
    if at:
        ax.plot(run.x[at], run.y[at], "o", ms=9, label=phrase("bad frame"), **_RING)


@dataclass(frozen=True, eq=False)
class DrawnResiduals:
    """Data less the curve that is drawn, and standard deviations of the readings, (n_obs,) each in
    the unit of y.

    far : (n_obs,) which points would press all others flat, and are not drawn to scale.
    """

    run: Observations
    rest: FloatArray
    sd: FloatArray
    far: BoolArray


def drawn_runs(goodness: Sequence[Goodness]) -> list[int]:
    """Places of the runs that have panels of their own: all, or where they are too many those that
    the curve explains worst, in their order.
    """
    if len(goodness) <= MOST_DRAWN:
        return list(range(len(goodness)))
    worst = [
        min((check.p_value for check in good.checks.values()), default=1.0) for good in goodness
    ]
    return sorted(np.argsort(worst, kind="stable")[:MOST_DRAWN].tolist())


def residuals_of(analysis: Analysis) -> list[DrawnResiduals]:
    """Of every run, from the median of the draws where the status is ok, else from the most
    probable curve, as of several abscissas, whose points have the fitted values as x.
    """
    named, residuals = analysis.problem.named(analysis.fit.values[None, :]), []
    for run, bands in zip(analysis.problem.runs, analysis.bands, strict=True):
        curve = _curve(analysis, run, bands, run.x)
        if run.noise.counted is not None:
            low, high = bands.predictive[0.68]
            sd = np.maximum(0.5 * np.interp(run.x, bands.x, high - low), 1e-300)
        else:
            sd = np.broadcast_to(
                np.hypot(reading_sd(run.noise, named, curve), run.noise.size.scatter.at(named)),
                (1, run.n_obs),
            )[0]
        run = run.against_fit(curve) if run.numbered else run
        residuals.append(DrawnResiduals(run, run.y - curve, sd, far_off(run, analysis.outliers)))
    return residuals


def far_off(run: Observations, outliers: Sequence[Outliers]) -> BoolArray:
    """(n_obs,) which points would press all others flat: outliers of a user's own curve, some
    heights of the rest away from it.
    """
    named = np.zeros(run.n_obs, dtype=bool)
    for group in outliers:
        if group.run == run.name and not run.words.from_release:
            named[group.frames] = True
    rest = run.y[~named]
    distance = (
        np.maximum(rest.min() - run.y, run.y - rest.max()) if rest.size > 1 else np.zeros(run.n_obs)
    )
    # heights of all other points that an outlier is away from them, and is no longer drawn to
    # scale
    return named & (distance > 3.0 * np.ptp(rest))


def panel_pairs(n: int, *, height: float) -> tuple[Figure, list[tuple[Axes, Axes]]]:
    """A figure with `n` pairs of panels, residuals below their curve; in columns where there are
    several.  height : inches of one pair.
    """
    columns = 1 if n == 1 else 2 if n <= _ROOMY else 3
    rows = -(-n // columns)
    figure = new_figure(rows * height * (1.0 if columns < 3 else 0.8) + 0.5)
    axes = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=[2.6, 1.0] * rows)
    pairs = list(zip(axes[::2].ravel(), axes[1::2].ravel(), strict=True))
    for extra in pairs[n:]:
        for ax in extra:
            ax.set_visible(False)
    for top, low in pairs[:n]:
        low.sharex(top)
        top.tick_params(labelbottom=False)
    return figure, pairs[:n]


def tidy_labels(pairs: Sequence[tuple[Axes, Axes]]) -> None:
    """Where there are many panels, what all of them share stands at the left alone."""
    for k, pair in enumerate(pairs if len(pairs) > _ROOMY else ()):
        for ax, first in zip(pair, pairs[0], strict=True):
            if k % 3 and ax.get_ylabel() == first.get_ylabel():
                ax.set_ylabel("")


def draw_points_with_bars(
    ax: Axes, residuals: DrawnResiduals, *, label: str, colour: str = INK, mark: str = "o"
) -> None:
    """The data used, with one standard deviation of a reading; without bars where there are so many
    that they would hide the curve.
    """
    run, near = residuals.run, ~residuals.far
    if run.n_obs > MOST_BARS:
        ax.plot(run.x[near], run.y[near], mark, color=colour, ms=1.5, label=label, zorder=1.9)
    else:
        style = {**_BAR, "fmt": mark, "color": colour}
        ax.errorbar(run.x[near], run.y[near], residuals.sd[near], label=label, **style)


def draw_residuals(ax: Axes, residuals: DrawnResiduals, bands: Bands | None) -> None:
    """Data less curve: points with their bars, and the bands about the curve; none where `bands` is
    None.
    """
    run, near = residuals.run, ~residuals.far
    rest, sd = residuals.rest[near], residuals.sd[near]
    if bands is not None:
        _draw_bands(ax, bands, less=bands.median)
    ax.axhline(0.0, color=BLUE)
    if run.n_obs > MOST_BARS:
        ax.plot(run.x[near], rest, "o", color=INK, ms=1.2, alpha=0.6, zorder=1.9)
    else:
        ax.errorbar(run.x[near], rest, sd, ms=2.5, **_BAR)
    top = max(
        1.15 * float(np.max(np.abs(rest) + (sd if run.n_obs <= MOST_BARS else 0.0))),
        2.5 * float(np.median(sd)),
    )
    ax.set_ylim(-top, top)
    symbol = _symbol(run)
    ax.set(
        xlabel=run.x_label,
        ylabel=phrase("{symbol} − fit" if symbol else "data − fit", symbol=symbol)
        + bracketed(run.y_unit),
    )


def _symbol(run: Observations) -> str:
    """The v of "speed v", or a user's own name of one letter; else "": a longer name is no symbol,
    and may end in a unit.
    """
    name = run.y_name if run.motion is None else run.y_name.split(" ")[-1]
    return name if len(name) == 1 else ""


def residual_figure(runs: Sequence[Observations], goodness: Sequence[Goodness]) -> Figure:
    """Whitened residuals along each run, and how they are distributed."""
    figure = new_figure(2.5 * len(runs))
    axes = figure.subplots(len(runs), 2, squeeze=False, width_ratios=(3, 1), sharey="row")
    for (left, right), run, good in zip(axes, runs, goodness, strict=True):
        reach = draw_pulls(left, good.whitened)
        size, alpha = (1.2, 0.6) if run.n_obs > _HIDING else (3.0, 1.0)
        if run.n_obs <= _HIDING:
            left.plot(run.x, good.whitened, "-", color=BLUE, lw=0.6, alpha=0.6)
        left.plot(run.x, good.whitened, "o", color=INK, ms=size, alpha=alpha)
        edges = np.linspace(-reach, reach, 15)
        right.hist(good.whitened, bins=edges, orientation="horizontal", color=BLUE, alpha=0.55)
        z = np.linspace(-reach, reach, 200)
        right.plot(run.n_obs * (edges[1] - edges[0]) * np.exp(normal_log_density(z)), z, color=INK)
        left.set(xlabel=run.x_label, ylabel=phrase("residual in standard deviations"))
        left.set_title(run.name)
        right.set(xlabel=phrase(run.words.rows))
        whole_ticks(right.xaxis)
    axes[0, 1].set_title(phrase("line: expected"))
    return figure


def together_figure(problem: Problem, goodness: Sequence[Goodness]) -> Figure:
    """Data less curve and whitened residuals, a row for each group of runs that share a force, and
    one for runs that share none.
    """
    by_run = {good.run: good for good in goodness}
    rows = [group.runs for group in problem.groups if len(group.runs) > 1]
    if alone := [group.runs[0] for group in problem.groups if len(group.runs) == 1]:
        rows.append(tuple(alone))
    figure = new_figure(3.2 * len(rows))
    parts = np.ravel(figure.subfigures(len(rows), 1, squeeze=False))
    for part, runs in zip(parts, rows, strict=True):
        left, right = part.subplots(1, 2)
        _overlay(left, runs, [by_run[run.name].raw for run in runs])
        _overlay(right, runs, [by_run[run.name].whitened for run in runs])
        left.set_ylabel(phrase("data − curve") + bracketed(runs[0].y_unit))
        right.set_ylabel(phrase("residual in standard deviations"))
        left.set_title(phrase("{n} runs" if len(runs) > 1 else "1 run", n=len(runs)))
        right.set_title(phrase("remaining residual"))
        legend_below(part)
    return figure


def binned_mean(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means of x and y, and the standard error of the latter, (n_bin,) each, in bins of as many
    points of (x, y), (n_obs,).
    """
    # points of all runs in a bin of the mean at least, and bins at most
    n_bin = int(np.clip(x.size // 8, 1, 24))
    parts = np.array_split(np.argsort(x, kind="stable"), n_bin)
    errors = [
        np.std(y[part], ddof=1) / np.sqrt(part.size) if part.size > 1 else np.nan for part in parts
    ]
    return (
        np.array([x[part].mean() for part in parts]),
        np.array([y[part].mean() for part in parts]),
        np.array(errors),
    )


def _overlay(ax: Axes, runs: Sequence[Observations], residuals: Sequence[FloatArray]) -> None:
    several = len(runs) <= _NAMED
    for run, rest, colour in zip(
        runs, residuals, (RUN_COLOURS if several else (GREY,)) * len(runs), strict=False
    ):
        ax.plot(
            run.x,
            rest,
            "-o",
            color=colour,
            lw=0.6,
            ms=2,
            alpha=0.8 if several else 0.4,
            label=run.name if several else None,
        )
    x, mean, error = binned_mean(np.concatenate([run.x for run in runs]), np.concatenate(residuals))
    ax.errorbar(
        x,
        mean,
        error,
        fmt="-",
        color=INK,
        lw=1.8,
        elinewidth=1.0,
        label=phrase("mean of the runs"),
        zorder=5,
    )
    ax.axhline(0.0, color=GREY)
    ax.set_xlabel(runs[0].x_label)
