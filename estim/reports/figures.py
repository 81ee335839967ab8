"""Figures of an analysis, by matplotlib's object interface (no pyplot state).

White background and dark ink: legible on a light and on a dark page.  Colours are those of Okabe and Ito, which readers
with any colour vision can tell apart.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from estim.arrays import FloatArray
from estim.campaign import way_back
from estim.checks import Goodness, Outliers
from estim.common import Markdown, mathtext
from estim.deviation import FoundForce
from estim.pipeline import Analysis
from estim.problem import Observations, Prior, Problem, n_uses
from estim.sampling import Bands, curve_draws

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BLUE, ORANGE, GREEN, PURPLE, GREY, INK = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#8A8A8A", "#222222"
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, INK, GREY)
MARKS = ("o", "s", "^", "D", "v", "P")
_WIDTH = 7.2
MAX_CORNER = 7
_MANY = 200  # points in one panel
_NARROWEST = 1e-11  # part of a value that an axis is wide at least: what is narrower has too few numbers to draw
_LINE = 0.01  # of the height of a curve: what a line hides


def png(draw: Callable[[], Figure]) -> bytes:
    """What `draw` draws, as PNG without a date in it: the same figure gives the same bytes, whatever a user's own style is.

    Every text is shown literally; what matplotlib would take for mathematics is that only where `estim.common.labels` made it so.
    """
    from matplotlib import style
    from matplotlib.text import Text

    buffer = io.BytesIO()
    with style.context("default"):
        figure = draw()
        for text in figure.findobj(Text):
            text.set_text(mathtext(text.get_text()))
        figure.savefig(buffer, format="png", dpi=150, metadata={"Software": None})
    return buffer.getvalue()


def new_figure(height: float, width: float = _WIDTH) -> Figure:
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
    ax.plot(run.x, run.y, "o", color=INK, ms=1.5 if many else 3, label="data used", zorder=1.9 if many else 5, clip_on=False)
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


def corner_figure(analysis: Analysis) -> Figure:
    """Marginal and joint posteriors of `corner_parameters`, with the prior (orange) beside each marginal."""
    import corner
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator, ScalarFormatter

    chosen = corner_parameters(analysis.problem)
    parameters = [analysis.problem.parameters[i] for i in chosen]
    single = len(analysis.problem.runs) == 1
    labels = [p.bare_label if single else p.label for p in parameters]
    draws = analysis.chain.thinned(20_000)[:, chosen] * [shown.factor for shown in labels]
    n = len(parameters)
    size = max(0.75 * _WIDTH, 1.35 * n)
    figure = Figure(figsize=(size, size), facecolor="white")
    corner.corner(
        draws, fig=figure, labels=[shown.axis for shown in labels], levels=(0.68, 0.95), color=BLUE, plot_datapoints=False,
        fill_contours=True, smooth=1.2, bins=30, label_kwargs={"fontsize": 10 if single else 8.5}, hist_kwargs={"density": True},
        range=[_reach(p.prior, column, shown.factor) for p, column, shown in zip(parameters, draws.T, labels, strict=True)],
    )
    figure.subplots_adjust(left=0.85 / size, right=1.0 - 0.15 / size, bottom=0.85 / size, top=1.0 - 0.15 / size)
    axes = np.array(figure.axes).reshape(n, n)
    beside = 0.55 / (size * axes[0, 0].get_position().width)  # 0.55 inches, whatever the size of a panel
    for i, (parameter, shown) in enumerate(zip(parameters, labels, strict=True)):
        low, high = axes[i, i].get_xlim()
        grid_points = np.linspace(low, high, 200)
        density = np.exp(parameter.prior.log_density(grid_points / shown.factor)) / shown.factor
        if np.isfinite(parameter.prior.sd):  # an improper prior has no height to draw
            top = axes[i, i].get_ylim()[1]
            axes[i, i].plot(grid_points, density, color=ORANGE, lw=1.4)
            axes[i, i].set_ylim(0.0, max(top, min(1.08 * float(density.max()), 2.0 * top)))  # a far narrower prior leaves the panel
        ticks = MaxNLocator(4).tick_values(low, high)
        ticks = ticks[np.abs(ticks - 0.5 * (low + high)) < 0.42 * (high - low)]  # clear of the next panel's
        for axis in [*(ax.xaxis for ax in axes[i:, i]), *(ax.yaxis for ax in axes[i, :i])]:
            axis.set_ticks(ticks)
            axis.set_tick_params(labelsize=7)
        for axis in (axes[-1, i].xaxis, *([axes[i, 0].yaxis] if i else [])):
            axis.set_major_formatter(ScalarFormatter(useOffset=False))
        axes[-1, i].xaxis.set_label_coords(0.5, -beside)
        axes[i, 0].yaxis.set_label_coords(-beside, 0.5)
    return figure


def _reach(prior: Prior, draws: FloatArray, factor: float) -> tuple[float, float]:
    """Ends of an axis: all but a thousandth of the draws (n_draw,) and a margin, no farther than the prior allows, yet apart as numbers."""
    low, high = np.quantile(draws, [0.0005, 0.9995])
    size = max(abs(low), abs(high)) or 1.0
    margin = max(0.08 * (high - low), _NARROWEST * size)
    return max(float(low - margin), prior.low * factor), min(float(high + margin), prior.high * factor)


def corner_parameters(problem: Problem) -> list[int]:
    """Places of the parameters that the corner figure shows: all, or where they are too many those that runs share."""
    if problem.n_par <= MAX_CORNER:
        return list(range(problem.n_par))
    shared = [i for i, p in enumerate(problem.parameters) if n_uses(p.name, problem.runs) > 1]
    return (shared if len(shared) > 1 else list(range(problem.n_par)))[:MAX_CORNER]


def corner_words(problem: Problem) -> Markdown:
    """The legend of the corner figure, with what it leaves out."""
    words = Markdown("Blue: posterior, contours hold 68 and 95 %. Orange: prior.")
    drawn = [problem.parameters[i].name for i in corner_parameters(problem)]
    if len(drawn) == problem.n_par:
        return words
    which = "those that runs share" if all(n_uses(name, problem.runs) > 1 for name in drawn) else "the first ones"
    return Markdown(f"{words} Only {len(drawn)} of the {problem.n_par} parameters are drawn, {which}; `result.json` has them all.")


def trace_figure(analysis: Analysis) -> Figure:
    """The mean of each ensemble's walkers, and a few single walkers behind, against the step."""
    parameters, draws = analysis.problem.parameters, analysis.chain.draws
    columns = 1 if len(parameters) <= 8 else 2
    rows = -(-len(parameters) // columns)
    figure = new_figure(0.95 * rows + 0.5)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True)
    steps = np.arange(draws.shape[1]) + analysis.chain.n_burn
    every = max(1, draws.shape[1] // 1000)
    for i, parameter in enumerate(parameters):
        ax = axes.ravel(order="F")[i]
        shown = parameter.label
        for ensemble, colour in zip(draws[..., i] * shown.factor, (BLUE, ORANGE, GREEN, PURPLE) * 8, strict=False):
            ax.plot(steps[::every], ensemble[::every, 0], color=colour, lw=0.4, alpha=0.35)
            ax.plot(steps[::every], ensemble.mean(axis=1)[::every], color=colour, lw=1.0)
        ax.set_ylabel(shown.axis, fontsize=8, rotation=0, ha="right", va="center")
        ax.tick_params(labelsize=7)
    for extra in axes.ravel(order="F")[len(parameters) :]:
        extra.set_visible(False)
    for ax in axes[-1]:
        ax.set_xlabel("step")
    figure.suptitle("bold: mean of an ensemble; faint: one of its walkers", fontsize=8)
    return figure
