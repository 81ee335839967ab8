"""A curve with what is left of its data below it: pairs of panels, residuals in the unit of y, and the largest misfit in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.checks import Goodness, Outliers
from estim.common import format_rounded, phrase, with_unit
from estim.drawing import BLUE, GREY, INK, new_figure
from estim.pipeline import Analysis
from estim.problem import Observations, reading_sd
from estim.sampling import Bands, curve_draws

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

VERMILION = "#D55E00"  # what is wrong; orange is what was stated before
_MANY = 200  # points in one panel, beyond which bars hide the points
_BAR = {"fmt": "o", "color": INK, "elinewidth": 0.7, "capsize": 0}
MOST_DRAWN = 15  # runs
_ROOMY = 6  # runs beyond which there are three columns
_FAR = 3.0  # heights of all other points that an outlier is away from them, and is no longer drawn to scale
_STEPS, _FADED = 24, 0.25  # pieces, and share of the way, in which a band fades


@dataclass(frozen=True, eq=False)
class Residuals:
    """Data less the curve that is drawn, and standard deviations of the readings, (n_obs,) each in the unit of y.

    far : (n_obs,) which points would press all others flat, and are not drawn to scale.
    bad : numbers of the points that are named as outliers, which count for no misfit.
    """

    run: Observations
    rest: FloatArray
    sd: FloatArray
    far: NDArray[np.bool_]
    bad: tuple[int, ...] = ()

    @property
    def sds(self) -> FloatArray:
        """(n_obs,) sizes of the misfits in standard deviations of a reading, 0 for outliers."""
        found = np.abs(self.rest) / self.sd
        found[list(self.bad)] = 0.0
        return np.asarray(found)

    @property
    def largest(self) -> float:
        """The largest misfit, in standard deviations of a reading."""
        return float(np.max(self.sds))

    def describe(self) -> str:
        """'largest misfit 0.048 m/s, 2.1 sd, near 0.044 m'."""
        run, sds = self.run, self.sds
        i = int(np.argmax(sds))
        size = with_unit(format_rounded(abs(float(self.rest[i])), float(self.sd[i])), run.y_unit)
        reach = 0.02 * float(np.ptp(run.x)) or 1.0
        place = with_unit(format_rounded(float(run.x[i]), reach), run.x_unit)
        if self.bad:
            return phrase("largest misfit (outliers aside) {size}, {sds:.1f} sd, near {place}", size=size, sds=sds[i], place=place)
        return phrase("largest misfit {size}, {sds:.1f} sd, near {place}", size=size, sds=sds[i], place=place)


def drawn_runs(goodness: Sequence[Goodness]) -> list[int]:
    """Places of the runs that have panels of their own: all, or where they are too many those that the curve explains worst, in their order."""
    if len(goodness) <= MOST_DRAWN:
        return list(range(len(goodness)))
    worst = [min((check.p_value for check in good.checks.values()), default=1.0) for good in goodness]
    return sorted(np.argsort(worst, kind="stable")[:MOST_DRAWN].tolist())


def residuals_of(analysis: Analysis) -> list[Residuals]:
    """Of every run, from the median of the draws where the status is ok, else from the most probable curve."""
    named, found = analysis.problem.named(analysis.fit.values[None, :]), []
    for run, bands in zip(analysis.problem.runs, analysis.bands, strict=True):
        if analysis.diagnosis.ok:
            curve = np.interp(run.x, bands.x, bands.median)
        else:
            curve = curve_draws(analysis.problem, run, run.x, analysis.fit.values[None, :])[0][0]
        if run.noise.counted is not None:
            low, high = bands.predictive[0.68]
            sd = np.maximum(0.5 * np.interp(run.x, bands.x, high - low), 1e-300)
        else:
            sd = np.broadcast_to(np.hypot(reading_sd(run.noise, named), run.noise.size.scatter.at(named)), (1, run.n_obs))[0]
        bad = tuple(int(frame) for one in analysis.outliers if one.run == run.name for frame in one.frames)
        found.append(Residuals(run, run.y - curve, sd, far_off(run, analysis.outliers), bad))
    return found


def far_off(run: Observations, outliers: Sequence[Outliers]) -> NDArray[np.bool_]:
    """(n_obs,) which points would press all others flat: outliers of a user's own curve, some heights of the rest away from it."""
    named = np.zeros(run.n_obs, dtype=bool)
    for found in outliers:
        if found.run == run.name and not run.words.from_release:
            named[found.frames] = True
    rest = run.y[~named]
    away = np.maximum(rest.min() - run.y, run.y - rest.max()) if rest.size > 1 else np.zeros(run.n_obs)
    return named & (away > _FAR * np.ptp(rest))


def panel_pairs(n: int, *, height: float) -> tuple[Figure, list[tuple[Axes, Axes]]]:
    """A figure with `n` pairs of panels, residuals below their curve; in columns where there are several.  height : inches of one pair."""
    columns = 1 if n == 1 else 2 if n <= _ROOMY else 3
    rows = -(-n // columns)
    figure = new_figure(rows * height * (1.0 if columns < 3 else 0.8) + 0.5)
    axes = figure.subplots(2 * rows, columns, squeeze=False, height_ratios=[2.6, 1.0] * rows)
    pairs = [(axes[2 * (k // columns), k % columns], axes[2 * (k // columns) + 1, k % columns]) for k in range(rows * columns)]
    for extra in pairs[n:]:
        for ax in extra:
            ax.set_visible(False)
    for top, low in pairs[:n]:
        low.sharex(top)
        top.tick_params(labelbottom=False)
    return figure, pairs[:n]


def tidy_labels(pairs: Sequence[tuple[Axes, Axes]]) -> None:
    """Where panels are small their words are too, and what all of them share stands at the left alone."""
    if len(pairs) <= _ROOMY:
        return
    for k, pair in enumerate(pairs):
        for ax, first in zip(pair, pairs[0], strict=True):
            ax.tick_params(labelsize=7)
            ax.xaxis.label.set_fontsize(7.5)
            ax.yaxis.label.set_fontsize(7.5)
            ax.title.set_fontsize(8.5)
            if k % 3 and ax.get_ylabel() == first.get_ylabel():
                ax.set_ylabel("")


def draw_points_with_bars(ax: Axes, residuals: Residuals, *, label: str) -> None:
    """The data used, with one standard deviation of a reading; without bars where there are so many that they would hide the curve."""
    run, near = residuals.run, ~residuals.far
    if run.n_obs > _MANY:
        ax.plot(run.x[near], run.y[near], "o", color=INK, ms=1.5, label=label, zorder=1.9)
    else:
        ax.errorbar(run.x[near], run.y[near], yerr=residuals.sd[near], ms=3, label=label, zorder=5, **_BAR)  # type: ignore[arg-type]


def draw_residuals(ax: Axes, residuals: Residuals, bands: Bands | None, *, reach: float = 0.0) -> None:
    """Data less curve: points with their bars, and the bands about the curve; none where `bands` is None.  reach : the axis holds at least that."""
    run, near = residuals.run, ~residuals.far
    rest, sd = residuals.rest[near], residuals.sd[near]
    if bands is not None:
        for probability, colour, alpha in ((0.95, GREY, 0.22),):
            low, high = bands.predictive[probability]
            ax.fill_between(bands.x, low - bands.median, high - bands.median, color=colour, alpha=alpha, lw=0)
        for probability, alpha in ((0.95, 0.30), (0.68, 0.55)):
            low, high = bands.credible[probability]
            ax.fill_between(bands.x, low - bands.median, high - bands.median, color=BLUE, alpha=alpha, lw=0)
    ax.axhline(0.0, color=BLUE, lw=1.0)
    if run.n_obs > _MANY:
        ax.plot(run.x[near], rest, "o", color=INK, ms=1.2, alpha=0.6, zorder=1.9)
    else:
        ax.errorbar(run.x[near], rest, yerr=sd, ms=2.5, zorder=5, **_BAR)  # type: ignore[arg-type]
    top = max(1.15 * float(np.max(np.abs(rest) + (sd if run.n_obs <= _MANY else 0.0))), 2.5 * float(np.median(sd)), reach)
    ax.set_ylim(-top, top)
    unit = "" if run.y_unit == "1" else f" ({run.y_unit})"
    symbol = _symbol(run)
    ax.set(xlabel=run.x_label, ylabel=(phrase("{symbol} − fit", symbol=symbol) if symbol else phrase("data − fit")) + unit)


def _symbol(run: Observations) -> str:
    """The v of "speed v", or a user's own name of one letter; else "": a longer name is no symbol, and may end in a unit."""
    name = run.y_name if run.motion is None else run.y_name.split(" ")[-1]
    return name if len(name) == 1 else ""


def draw_faded(ax: Axes, x: FloatArray, low: FloatArray, high: FloatArray, colour: str, *, alpha: float, label: str = "") -> None:
    """A band (n_x,) that fades out over the last quarter of its way, where it ends because nothing can be said beyond, in place of a wall."""
    known = np.isfinite(low) & np.isfinite(high)
    x, low, high = x[known], low[known], high[known]
    if not x.size:
        return
    start = x[-1] - _FADED * (x[-1] - x[0])
    edges = np.linspace(start, x[-1], _STEPS + 1)
    solid = np.append(x[x < start], start)
    ax.fill_between(solid, np.interp(solid, x, low), np.interp(solid, x, high), color=colour, alpha=alpha, lw=0, label=label)
    for k, (left, right) in enumerate(pairwise(edges)):
        piece = np.linspace(left, right, 5)
        faint = alpha * (1.0 - (k + 0.5) / _STEPS)
        ax.fill_between(piece, np.interp(piece, x, low), np.interp(piece, x, high), color=colour, alpha=faint, lw=0, antialiased=False)


def misfit_words(found: Sequence[Residuals]) -> str:
    """The largest misfit of the run that has the largest."""
    worst = max(found, key=lambda one: one.largest)
    return phrase("{misfit} of {run}", misfit=worst.describe(), run=worst.run.name) if len(found) > 1 else worst.describe()
