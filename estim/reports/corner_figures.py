"""Figure of all pairs of parameters: marginal and joint posteriors.

Everything stands in one axes whose unit is the inch: an axes for each pair takes most of a second, nearly all of it for ticks that nobody sees.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from estim.arrays import FloatArray
from estim.common import Label, Markdown, phrase
from estim.drawing import BLUE, INK, ORANGE, PALE, WIDTH, tick_texts
from estim.pipeline import Analysis
from estim.problem import Prior, Problem, uses_of
from estim.reports.contours import density_of, draw_contours
from estim.reports.derived import sought_draws

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_CORNER, MAX_SOUGHT = 7, 3
_NARROWEST = 1e-11  # part of a value that an axis is wide at least: what is narrower has too few numbers to draw
_BEFORE, _BEHIND, _GAP = 0.85, 0.15, 0.05  # inches left of and below the panels, right of and above them; between two, as a share of a panel
_LABEL, _TICK = 0.55, 3.5 / 72.0  # inches from the panels to the label of an axis; length of a tick
_N_BIN, _SMOOTH = 30, 1.2
_FAR = 4.0  # widths of the 68 % interval, beyond which no tail is drawn


@dataclass(frozen=True, eq=False)
class Column:
    """A parameter of the figure, or what follows from some: draws (n_draw,), ends of its axis and ticks (n_tick,), in the unit that is shown.

    prior : None for what follows from parameters.  true : of synthetic data, in the unit that is shown; None where it is not known.
    """

    prior: Prior | None
    label: Label
    draws: FloatArray
    low: float
    high: float
    ticks: FloatArray
    true: float | None = None

    def place(self, values: FloatArray) -> FloatArray:
        """Where `values` stand along the axis, 0 at its beginning, 1 at its end."""
        return (values - self.low) / (self.high - self.low)


@dataclass(frozen=True)
class _Panel:
    """Left and lower edge and side of a square, in inches."""

    left: float
    bottom: float
    side: float

    def inside(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """(n, 2) points at shares x and y of the side, in inches."""
        return np.column_stack([self.left + self.side * x, self.bottom + self.side * y])

    @property
    def frame(self) -> FloatArray:
        return self.inside(np.array([0.0, 1.0, 1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0, 1.0, 0.0]))


def corner_figure(analysis: Analysis, truth: Mapping[str, float] = MappingProxyType({})) -> Figure:
    """Marginal and joint posteriors of `corner_parameters`, with the prior (orange) beside each marginal.

    truth : parameter -> true value of synthetic data, a dashed line.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure
    from matplotlib.path import Path

    columns = columns_of(analysis, truth)
    n = len(columns)
    size = max(0.75 * WIDTH, 1.35 * n)
    side = (size - _BEFORE - _BEHIND) / (n + _GAP * (n - 1))
    panels = [[_Panel(_BEFORE + j * side * (1.0 + _GAP), _BEFORE + (n - 1 - i) * side * (1.0 + _GAP), side) for j in range(i + 1)] for i in range(n)]
    figure = Figure(figsize=(size, size), facecolor="white")
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, size), ylim=(0.0, size))
    ax.set_axis_off()
    marginals, priors = [], []
    for i, row in enumerate(columns):
        for j, column in enumerate(columns[:i]):
            _draw_pair(ax, panels[i][j], column, row)
        marginal, prior = _densities(row)
        marginals.append(panels[i][i].inside(*marginal))
        priors += [] if prior is None else [panels[i][i].inside(*prior)]
    ax.add_collection(LineCollection(marginals, colors=BLUE, linewidths=1.0))
    lines = LineCollection(priors, colors=ORANGE, linewidths=1.4)
    ax.add_collection(lines)
    lines.set_clip_path(Path.make_compound_path(*(Path(panels[i][i].frame) for i in range(n))), ax.transData)
    ax.add_collection(LineCollection([panel.frame for row in panels for panel in row], colors=INK, linewidths=0.8, zorder=3))
    ax.add_collection(LineCollection(_tick_marks(panels, columns), colors=INK, linewidths=0.8))
    ax.add_collection(LineCollection(_true_lines(panels, columns), colors=INK, linewidths=0.9, linestyles=(0, (3, 2)), zorder=4))
    _write(ax, panels, columns, fontsize=10.0 if len(analysis.problem.runs) == 1 else 8.5)
    return figure


def columns_of(analysis: Analysis, truth: Mapping[str, float] = MappingProxyType({})) -> list[Column]:
    """What a corner figure shows, one entry a parameter.  truth : parameter -> true value."""
    single = len(analysis.problem.runs) == 1
    shown, draws = [analysis.problem.parameters[i] for i in corner_parameters(analysis.problem)], analysis.chain.thinned(20_000)
    names = analysis.problem.names
    columns = [_column(p.prior, p.bare_label if single else p.label, draws[:, names.index(p.name)], truth.get(p.name)) for p in shown]
    return columns + [_column(None, label, values) for label, values in sought_draws(analysis)[:MAX_SOUGHT]]


def _column(prior: Prior | None, label: Label, draws: FloatArray, true: float | None = None) -> Column:
    from matplotlib.ticker import MaxNLocator

    low, high = _reach(prior, draws * label.factor, label.factor)
    ticks = np.asarray(MaxNLocator(4).tick_values(low, high))
    clear = np.abs(ticks - 0.5 * (low + high)) < 0.42 * (high - low)  # of the next panel's
    return Column(prior, label, draws * label.factor, low, high, ticks[clear], None if true is None else true * label.factor)


def _draw_pair(ax: Axes, panel: _Panel, column: Column, row: Column) -> None:
    found = density_of(column.draws, row.draws, [(column.low, column.high), (row.low, row.high)], n_bin=_N_BIN, smooth=_SMOOTH)
    inches = panel.inside(column.place(found.x), row.place(found.y))
    draw_contours(ax, replace(found, x=inches[:, 0], y=inches[:, 1]), BLUE, PALE, lw=1.0)


def _densities(column: Column) -> tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray] | None]:
    """Outline of the histogram and line of the prior, each as x and y in shares of the panel; None for a prior without a height."""
    heights, edges = np.histogram(column.draws, bins=_N_BIN, range=(column.low, column.high), density=True)
    top = 1.1 * float(heights.max())
    x, y = np.linspace(column.low, column.high, 200), None
    if column.prior is not None and np.isfinite(column.prior.sd):
        y = np.exp(column.prior.log_density(x / column.label.factor)) / column.label.factor
        top = max(top, min(1.08 * float(y.max()), 2.0 * top))  # a far narrower prior leaves the panel
    outline = np.concatenate([[0.0], np.repeat(heights, 2), [0.0]])
    return (column.place(np.repeat(edges, 2)), outline / top), None if y is None else (column.place(x), y / top)


def _true_lines(panels: list[list[_Panel]], columns: list[Column]) -> list[FloatArray]:
    """The true values across every panel that they lie in."""
    both, lines = np.array([0.0, 1.0]), []
    for i, row in enumerate(panels):
        for j, panel in enumerate(row):
            for across, column in ((True, columns[j]), (False, columns[i])):
                if column.true is not None and column.low <= column.true <= column.high and (across or j < i):
                    at = np.full(2, float(column.place(np.array(column.true))))
                    lines.append(panel.inside(at, both) if across else panel.inside(both, at))
    return lines


def _tick_marks(panels: list[list[_Panel]], columns: list[Column]) -> list[FloatArray]:
    marks = []
    for i, row in enumerate(panels):
        for j, panel in enumerate(row):
            below = panel.left + panel.side * columns[j].place(columns[j].ticks)
            beside = panel.bottom + panel.side * columns[i].place(columns[i].ticks)
            marks += [np.array([[x, panel.bottom], [x, panel.bottom - _TICK]]) for x in below]
            marks += [np.array([[panel.left, y], [panel.left - _TICK, y]]) for y in beside if j < i]
    return marks


def _write(ax: Axes, panels: list[list[_Panel]], columns: list[Column], *, fontsize: float) -> None:
    """Names and numbers below the lowest panels and beside the leftmost ones."""
    for i, column in enumerate(columns):
        below, beside = panels[-1][i], panels[i][0]
        shares, texts = column.place(column.ticks), tick_texts(column.ticks)
        for share, text in zip(shares, texts, strict=True):
            ax.text(
                below.left + below.side * share + _TICK, below.bottom - 1.6 * _TICK, text, fontsize=7, rotation=45, rotation_mode="anchor",
                ha="right", va="top",
            )
        ax.text(below.left + 0.5 * below.side, below.bottom - _LABEL, column.label.axis, fontsize=fontsize, ha="center", va="top")
        if i:
            for share, text in zip(shares, texts, strict=True):
                ax.text(beside.left - 2.0 * _TICK, beside.bottom + beside.side * share, text, fontsize=7, ha="right", va="center")
            ax.text(
                beside.left - _LABEL, beside.bottom + 0.5 * beside.side, column.label.axis, fontsize=fontsize, rotation=90,
                rotation_mode="anchor", ha="center", va="bottom",
            )


def _reach(prior: Prior | None, draws: FloatArray, factor: float) -> tuple[float, float]:
    """Ends of an axis: all but a thousandth of the draws (n_draw,) and a margin, no farther than the prior allows, yet apart as numbers."""
    low, q16, q84, high = np.quantile(draws, [0.0005, 0.16, 0.84, 0.9995])
    if prior is None:  # a ratio may have tails without end
        low, high = max(low, q16 - _FAR * (q84 - q16)), min(high, q84 + _FAR * (q84 - q16))
    size = max(abs(low), abs(high)) or 1.0
    margin = max(0.08 * (high - low), _NARROWEST * size)
    ends = (-np.inf, np.inf) if prior is None else (prior.low * factor, prior.high * factor)
    return max(float(low - margin), ends[0]), min(float(high + margin), ends[1])


def corner_parameters(problem: Problem) -> list[int]:
    """Places of the parameters that the corner figure shows: all, or where they are too many those that runs share."""
    if problem.n_par <= MAX_CORNER:
        return list(range(problem.n_par))
    uses = uses_of(problem.runs)
    shared = [i for i, name in enumerate(problem.names) if uses[name] > 1]
    return (shared if len(shared) > 1 else list(range(problem.n_par)))[:MAX_CORNER]


def corner_words(problem: Problem, *, truth: bool = False) -> Markdown:
    """The legend of the corner figure, with what it leaves out.  truth : whether true values are drawn."""
    words = [
        phrase("Blue: posterior, contours hold 68 and 95 %. Orange: prior; what is derived from the parameters has none.")
        if any(run.sought for run in problem.runs) else phrase("Blue: posterior, contours hold 68 and 95 %. Orange: prior.")
    ]
    words += [phrase("Dashed: the true values.")] if truth else []
    drawn = [problem.parameters[i].name for i in corner_parameters(problem)]
    n, of = len(drawn), problem.n_par
    uses = uses_of(problem.runs)
    if n < of and all(uses[name] > 1 for name in drawn):
        words.append(phrase("Only {n} of the {of} parameters are drawn, those that runs share; `result.json` has them all.", n=n, of=of))
    elif n < of:
        words.append(phrase("Only {n} of the {of} parameters are drawn, the first ones; `result.json` has them all.", n=n, of=of))
    return Markdown(" ".join(words))
