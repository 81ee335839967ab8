"""Figures of an analysis, by matplotlib's object interface (no pyplot state).

White background and dark ink: legible on a light and on a dark page.  Colours are those of Okabe and Ito, which readers
with any colour vision can tell apart.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.arrays import FloatArray
from estim.campaign import way_back
from estim.checks import Goodness, Outliers
from estim.common import mathtext, signed
from estim.deviation import FoundForce
from estim.pipeline import Analysis
from estim.problem import Observations
from estim.sampling import Bands, curve_draws

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure
    from matplotlib.text import Text

BLUE, ORANGE, GREEN, PURPLE, GREY, INK = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#8A8A8A", "#222222"
PALE = "#AAD0E5"  # a third of the blue on white
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, INK, GREY)
_DPI = 150
_COMPRESSION = 4  # of 9; more costs time and saves next to nothing
MARKS = ("o", "s", "^", "D", "v", "P")
WIDTH = 7.2
_MANY = 200  # points in one panel
_LINE = 0.01  # of the height of a curve: what a line hides
_FAR = 3.0  # heights of all other points that an outlier is away from them, and is no longer drawn to scale


def png(draw: Callable[[], Figure]) -> bytes:
    """What `draw` draws, as PNG without a date in it: the same figure gives the same bytes, whatever a user's own style is.

    Every text is shown literally; what matplotlib would take for mathematics is that only where `estim.common.labels` made it so.
    The parts are placed here, once: left to it, `savefig` would draw the whole figure for that and then a second time.
    """
    from matplotlib import style
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    buffer = io.BytesIO()
    with style.context("default"):
        figure = draw()
        for text in _texts(figure):
            text.set_text(mathtext(text.get_text()))
        figure.set_dpi(_DPI)
        canvas = FigureCanvasAgg(figure)
        if (layout := figure.get_layout_engine()) is not None:
            layout.execute(figure)
            figure.set_layout_engine("none")
        canvas.print_png(buffer, metadata={"Software": None}, pil_kwargs={"compress_level": _COMPRESSION})  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def _texts(artist: Artist) -> Iterator[Text]:
    """The texts of a figure but for those of ticks, which are written anew whenever they are drawn (`name_ticks`)."""
    from matplotlib.axis import Axis
    from matplotlib.text import Text

    for part in artist.get_children():
        if isinstance(part, Text):
            yield part
        elif isinstance(part, Axis):
            yield part.label
        else:
            yield from _texts(part)


def name_ticks(axis: Axis, places: ArrayLike, names: Sequence[str], *, fontsize: float = 10.0, rotation: float = 0.0) -> None:
    """Ticks at `places` with `names`, shown literally as `png` shows all other text.  fontsize : points.  rotation : degrees."""
    axis.set_ticks(places, [mathtext(name) for name in names], fontsize=fontsize, rotation=rotation)


def tick_texts(ticks: FloatArray) -> list[str]:
    """Numbers (n_tick,) with as many digits as tell them apart, all alike."""
    largest = float(np.max(np.abs(ticks), initial=0.0))
    apart = float(np.min(np.diff(ticks))) if ticks.size > 1 else largest
    notation = "f" if 1e-4 <= largest < 1e6 or largest == 0.0 else "e"
    for digits in range(17):
        texts = [f"{tick + 0.0:.{digits}{notation}}" for tick in ticks]
        if all(abs(float(text) - tick) <= 1e-3 * apart for text, tick in zip(texts, ticks, strict=True)):
            break
    return [signed(text) for text in texts]


def new_figure(height: float, width: float = WIDTH) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained", facecolor="white")


def grid(n: int, *, height: float) -> tuple[Figure, list[Axes]]:
    """A figure with `n` panels, in two columns if there are more than two."""
    columns = 1 if n <= 2 else 2
    rows = -(-n // columns)
    figure = new_figure(height * rows if n > 1 else 1.25 * height)
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for extra in axes[n:]:
        extra.set_visible(False)
    return figure, list(axes[:n])


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
        far = _far_off(run, analysis.outliers)
        _draw_points(ax, run, far)
        _draw_outliers(ax, run, analysis.outliers, far)
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


def _far_off(run: Observations, outliers: Sequence[Outliers]) -> NDArray[np.bool_]:
    """(n_obs,) which points would press all others flat: outliers of a user's own curve, some heights of the rest away from it."""
    named = np.zeros(run.n_obs, dtype=bool)
    for found in outliers:
        if found.run == run.name and not run.words.from_release:
            named[found.frames] = True
    rest = run.y[~named]
    away = np.maximum(rest.min() - run.y, run.y - rest.max()) if rest.size > 1 else np.zeros(run.n_obs)
    return named & (away > _FAR * np.ptp(rest))


def _draw_points(ax: Axes, run: Observations, far: NDArray[np.bool_]) -> None:
    many = run.n_obs > _MANY  # then points lie over one another, and under the curve
    said = "data used" if run.noise.counted is None else f"{run.noise.counted.law.word} used"
    ax.plot(run.x[~far], run.y[~far], "o", color=INK, ms=1.5 if many else 3, label=said, zorder=1.9 if many else 5, clip_on=False)
    if run.excluded_points.size:
        left = run.excluded_points
        near = (left[:, 0] >= _low_end(run.x)) & (left[:, 0] <= 1.1 * run.x.max()) & (left[:, 1] >= _low_end(run.y))
        if not run.words.from_release:
            ends = np.array([(v.min(), v.max()) for v in (run.x, run.y[~far])])
            near = np.all(np.abs(left - ends.mean(axis=1)) <= 0.6 * np.ptp(ends, axis=1), axis=1)  # others would press the data flat
        if np.any(near):
            ax.plot(left[near, 0], left[near, 1], "x", color=GREY, ms=4, label="data left out", zorder=3, clip_on=not run.words.from_release)
        if hidden := way_back(run.excluded):
            ax.text(0.99, 0.97, f"{hidden} frames of the way back (v < 0) not shown", transform=ax.transAxes, ha="right", va="top", fontsize=7.5)


def _draw_outliers(ax: Axes, run: Observations, outliers: Sequence[Outliers], far: NDArray[np.bool_]) -> None:
    """A ring about each outlier; one that is far off is an arrow at the edge, with its y."""
    for found in outliers:
        at = found.frames[~far[found.frames]] if found.run == run.name else found.frames[:0]
        if at.size:
            ax.plot(run.x[at], run.y[at], "o", mfc="none", mec=ORANGE, mew=1.6, ms=9, ls="", label="outlier", zorder=6)
    said, place = "outlier, far off", ax.get_xaxis_transform()
    for x, y in zip(run.x[far], run.y[far], strict=True):
        edge, up, mark, side = (0.03, 9, "v", "bottom") if y < run.y[~far].min() else (0.97, -9, "^", "top")
        ax.plot(x, edge, mark, mfc="none", mec=ORANGE, mew=1.6, ms=8, ls="", label=said, zorder=6, transform=place)
        ax.annotate(f"{y:.4g}", (x, edge), (0, up), xycoords=place, textcoords="offset points", fontsize=7.5, ha="center", va=side)
        said = ""


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
