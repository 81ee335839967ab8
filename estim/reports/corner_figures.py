"""Figures of the draws: all pairs of parameters, and the chains."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estim.arrays import FloatArray
from estim.common import PROBABILITIES, Label, Markdown, phrase
from estim.drawing import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PALE,
    PURPLE,
    WIDTH,
    Axes,
    Figure,
    grid,
    name_ticks,
    tick_texts,
)
from estim.pipeline import Analysis
from estim.problem import Prior, Problem, uses_of
from estim.reports.derived import derived_quantity_draws
from estim.reports.records import DRAWS

if TYPE_CHECKING:
    from matplotlib.axis import Axis
    from matplotlib.lines import Line2D

MAX_CORNER, MAX_SOUGHT = 7, 3
_FAR = 4.0  # widths of the 68 % interval, beyond which no tail is drawn
_COLOURS = (BLUE, ORANGE, GREEN, PURPLE)  # of ensembles


@dataclass(frozen=True, eq=False)
class Column:
    """A parameter of the figure, or what follows from some: draws (n_draw,), ends of its axis and
    ticks (n_tick,), in the unit that is shown.

    prior : None for what follows from parameters.
    true : of synthetic data, in the unit that is shown; None where it is not known.
    """

    prior: Prior | None
    label: Label
    draws: FloatArray
    low: float
    high: float
    ticks: FloatArray
    true: float | None = None


@dataclass(frozen=True, eq=False)
class DrawDensity:
    """Smoothed number of draws per cell: z (n_bin + 2, n_bin + 2) at x and y (n_bin + 2,), the
    middles of the cells and the ends of their ranges.

    levels : increasing; above them lie 95 and 68 % of the density, and a little more of the draws,
        which smoothing spreads.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    levels: FloatArray


def corner_figure(analysis: Analysis, truth: Mapping[str, float] = {}) -> Figure:
    """Marginal and joint posteriors of `corner_parameters`, with the prior (orange) beside each
    marginal.

    truth : parameter -> true value of synthetic data, a dashed line.
    """
    from matplotlib.figure import Figure

    columns = columns_of(analysis, truth)
    n, fontsize = len(columns), 10.0 if len(analysis.problem.runs) == 1 else 8.5
    size = max(0.75 * WIDTH, 1.35 * n)
    figure = Figure(figsize=(size, size), facecolor="white")
    before, gap = 0.9 / size, 0.05  # left and below; of a panel, between two
    figure.subplots_adjust(
        left=before,
        bottom=before,
        right=1.0 - 0.15 / size,
        top=1.0 - 0.3 / size,  # the title has room
        wspace=gap,
        hspace=gap,
    )
    for i, row in enumerate(columns):
        for j, column in enumerate(columns[: i + 1]):
            ax = figure.add_subplot(n, n, i * n + j + 1, xlim=(column.low, column.high))
            if i == j:
                _draw_marginal(ax, column)
            else:
                limits = [(column.low, column.high), (row.low, row.high)]
                density = density_of(column.draws, row.draws, limits)
                ax.contourf(  # what holds 95 % pale, and 68 %
                    density.x,
                    density.y,
                    density.z.T,
                    levels=[*density.levels, 1.01 * float(density.z.max())],
                    colors=[PALE, BLUE],
                    antialiased=True,
                ).set(edgecolor=BLUE, linewidth=1.0)
                ax.set_ylim(row.low, row.high)
                _mark_true(ax.axhline, row)
            _mark_true(ax.axvline, column)
            _name(ax.xaxis, column if i == n - 1 else None, fontsize=fontsize, rotation=45.0)
            _name(ax.yaxis, row if j == 0 < i else None, fontsize=fontsize)
    figure.align_labels()
    return figure


def columns_of(analysis: Analysis, truth: Mapping[str, float] = {}) -> list[Column]:
    """What a corner figure shows, one entry a parameter.  truth : parameter -> true value."""
    single = len(analysis.problem.runs) == 1
    parameters = [analysis.problem.parameters[i] for i in corner_parameters(analysis.problem)]
    draws = analysis.chain.thinned(DRAWS)
    names = analysis.problem.names
    columns = [
        _column(
            p.prior,
            p.bare_label if single else p.label,
            draws[:, names.index(p.name)],
            truth.get(p.name),
        )
        for p in parameters
    ]
    return columns + [
        _column(None, label, values)
        for label, values in derived_quantity_draws(analysis)[:MAX_SOUGHT]
    ]


def density_of(
    x: FloatArray,
    y: FloatArray,
    ranges: Sequence[tuple[float, float]],
    *,
    n_bin: int = 30,
    smooth: float = 1.2,
    probabilities: Sequence[float] = PROBABILITIES[::-1],
) -> DrawDensity:
    """The density of draws (n_draw,) between the ends of two `ranges`.

    smooth : standard deviation of the kernel, in cells; what is beyond the edges is what is inside,
        mirrored.
    probabilities : decreasing, of the regions above the levels.
    """
    from scipy.ndimage import gaussian_filter

    counts, *edges = np.histogram2d(x, y, bins=n_bin, range=ranges)
    middles = [
        np.concatenate([edge[:1], 0.5 * (edge[1:] + edge[:-1]), edge[-1:]]) for edge in edges
    ]
    smoothed = gaussian_filter(counts, smooth)
    # not those that hold as many of the draws: across a narrow ridge the smoothed one is too wide,
    # so such a region would be too short along it
    ordered = np.sort(smoothed, axis=None)[::-1]
    cumulative = np.cumsum(ordered)
    levels = ordered[np.searchsorted(cumulative, np.array(probabilities) * cumulative[-1])]
    levels[:-1] = np.minimum(levels[:-1], levels[1:] * (1.0 - 1e-4))
    return DrawDensity(middles[0], middles[1], np.pad(smoothed, 1, mode="edge"), levels)


def _column(
    prior: Prior | None, label: Label, draws: FloatArray, true: float | None = None
) -> Column:
    from matplotlib.ticker import MaxNLocator

    low, high = _reach(prior, draws * label.factor, label.factor)
    ticks = np.asarray(MaxNLocator(4).tick_values(low, high))
    clear = np.abs(ticks - 0.5 * (low + high)) < 0.42 * (high - low)  # of the next panel's
    return Column(
        prior,
        label,
        draws * label.factor,
        low,
        high,
        ticks[clear],
        None if true is None else true * label.factor,
    )


def _draw_marginal(ax: Axes, column: Column) -> None:
    """Histogram of the draws and line of the prior; a prior without a height has none, and one that
    is far narrower leaves the panel.
    """
    heights, edges = np.histogram(
        column.draws, bins=30, range=(column.low, column.high), density=True
    )
    ax.stairs(heights, edges, color=BLUE, lw=1.0)
    top = 1.1 * float(heights.max())
    if column.prior is not None and np.isfinite(column.prior.sd):
        x = np.linspace(column.low, column.high, 200)
        y = np.exp(column.prior.log_density(x / column.label.factor)) / column.label.factor
        ax.plot(x, y, color=ORANGE)
        top = max(top, min(1.08 * float(y.max()), 2.0 * top))
    ax.set_ylim(0.0, top)


def _mark_true(line: Callable[..., Line2D], column: Column) -> None:
    if column.true is not None and column.low <= column.true <= column.high:
        line(column.true, color=INK, ls=(0, (3, 2)))


def _name(axis: Axis, column: Column | None, *, fontsize: float, rotation: float = 0.0) -> None:
    """Numbers and the name of what an axis shows; neither at a panel that is not at the edge of the
    figure.
    """
    ticks = np.empty(0) if column is None else column.ticks
    name_ticks(axis, ticks, tick_texts(ticks), fontsize=7.0, rotation=rotation)
    axis.set_label_text("" if column is None else column.label.axis, fontsize=fontsize)


def _reach(prior: Prior | None, draws: FloatArray, factor: float) -> tuple[float, float]:
    """Ends of an axis: all but a thousandth of the draws (n_draw,) and a margin, no farther than
    the prior allows, yet apart as numbers.
    """
    low, q16, q84, high = np.quantile(draws, [0.0005, 0.16, 0.84, 0.9995])
    if prior is None:  # a ratio may have tails without end
        low, high = max(low, q16 - _FAR * (q84 - q16)), min(high, q84 + _FAR * (q84 - q16))
    size = max(abs(low), abs(high)) or 1.0
    # part of a value that an axis is wide at least: what is narrower has too few numbers to draw
    margin = max(0.08 * (high - low), 1e-11 * size)
    ends = (-np.inf, np.inf) if prior is None else (prior.low * factor, prior.high * factor)
    return max(float(low - margin), ends[0]), min(float(high + margin), ends[1])


def corner_parameters(problem: Problem) -> list[int]:
    """Places of the parameters that the corner figure shows: all, or where they are too many those
    that runs share.
    """
    if problem.n_par <= MAX_CORNER:
        return list(range(problem.n_par))
    uses = uses_of(problem.runs)
    shared = [i for i, name in enumerate(problem.names) if uses[name] > 1]
    return (shared if len(shared) > 1 else list(range(problem.n_par)))[:MAX_CORNER]


def corner_words(problem: Problem, *, truth: bool = False) -> Markdown:
    """The legend of the corner figure, with what it leaves out.  truth : whether true values are
    drawn.
    """
    words = [
        phrase(
            "Blue: posterior, with contours containing 68 and 95 %. Orange: prior; derived "
            "quantities have none."
            if any(run.sought for run in problem.runs)
            else "Blue: posterior, with contours containing 68 and 95 %. Orange: prior."
        )
    ]
    words += [phrase("Dashed: the true values.")] if truth else []
    drawn = [problem.parameters[i].name for i in corner_parameters(problem)]
    n, of = len(drawn), problem.n_par
    uses = uses_of(problem.runs)
    if n < of:
        words.append(
            phrase(
                "Only {n} of the {of} parameters are drawn, those shared by the runs; "
                "`result.json` contains all of them."
                if all(uses[name] > 1 for name in drawn)
                else "Only the first {n} of the {of} parameters are drawn; `result.json` "
                "contains all of them.",
                n=n,
                of=of,
            )
        )
    return Markdown(" ".join(words))


def trace_figure(analysis: Analysis) -> Figure:
    """The mean of each ensemble's walkers, and one of its walkers behind, against the step."""
    parameters, draws = analysis.problem.parameters, analysis.chain.draws
    places = analysis.problem.foremost(40)
    columns = 1 if len(places) <= 8 else 2
    figure, axes = grid(len(places), height=0.9, columns=columns, sharex=True)
    every = max(1, draws.shape[1] // 1000)
    steps = (np.arange(draws.shape[1]) + analysis.chain.n_burn)[::every]
    for ax, i in zip(axes, places, strict=True):
        label, mine = parameters[i].label, draws[:, ::every, :, i] * parameters[i].label.factor
        for k, ensemble in enumerate(mine):
            colour = _COLOURS[k % len(_COLOURS)]
            ax.plot(steps, ensemble[:, 0], color=colour, lw=0.4, alpha=0.35)
            ax.plot(steps, ensemble.mean(axis=1), color=colour)
        ax.set_ylabel(label.axis, rotation=0, ha="right", va="center")
        ax.locator_params(axis="y", nbins=3)
    for ax in axes[-columns:]:
        ax.set_xlabel(phrase("step"))
    title = phrase("bold: mean of an ensemble; faint: one of its walkers")
    if len(places) < len(parameters):
        title = f"{title}; {phrase('{n} of {of} parameters', n=len(places), of=len(parameters))}"
    figure.suptitle(title)
    return figure
