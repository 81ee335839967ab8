"""Figures of what the data can tell: directions against the prior, the ridge, and profiles.  Style and colours as in `estim.reports.figures`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estim.arrays import FloatArray
from estim.checks import Identifiability
from estim.common import phrase, signed
from estim.distributions import chi2_quantile, normal_below
from estim.drawing import BLUE, GREEN, GREY, INK, ORANGE, PALE, name_ticks, new_figure
from estim.fitting import Fit, ProfileInterval
from estim.problem import Prior, Problem
from estim.reports.contours import density_of, draw_contours
from estim.reports.smoothing import monotone

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_FLOOR = 1e-4  # of the axis of information: what is smaller is as good as nothing
_TOP_RISE = 5.0
_MIXED = 1e-4  # product of two components and their correlation, below which a direction is that of one parameter
_PRIOR_DRAWS = 100_000
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def direction_figure(problem: Problem, found: Identifiability) -> Figure:
    """Information of the data along each direction, in units of the prior's, and what each direction is made of."""
    n = len(found.directions)
    single = len(problem.runs) == 1
    labels = [p.bare_label if single else p.label for p in problem.parameters]
    figure = new_figure(1.5 + 0.30 * n + (0.0 if single else 0.6))
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.25 if n < 8 else 1.7))
    information = np.array([d.information for d in found.directions])
    places = np.arange(n)
    colours = [BLUE if d.held_by == "data" else ORANGE if d.held_by == "prior" else INK for d in found.directions]
    top = 10.0 * max(10.0, float(information.max()))
    left.barh(places, np.maximum(information, 2.0 * _FLOOR) - _FLOOR, left=_FLOOR, color=colours, height=0.62)
    left.axvline(1.0, color=INK, lw=1)
    left.set_xscale("log")
    left.set_xlim(_FLOOR, top)
    first, last = math.ceil(math.log10(_FLOOR)), math.floor(math.log10(top))
    powers = range(first, last + 1, 1 if last - first < 9 and n < 8 else 2 * -(-(last - first) // 18))
    left.xaxis.set_ticks([], minor=True)
    name_ticks(left.xaxis, [10.0**power for power in powers], ["10" + f"{power}".translate(_RAISED) for power in powers], fontsize=8)
    left.set_ylim(n - 0.5, -0.5)
    name_ticks(left.yaxis, places, [f"{k + 1}" for k in places], fontsize=8)
    left.set_xlabel(phrase("information of the data / of the prior"), fontsize=8.5)
    left.set_ylabel(phrase("direction"), fontsize=8.5)
    left.text(0.8, -0.6, phrase("only the prior"), color=ORANGE, ha="right", va="bottom", fontsize=8)
    left.text(1.25, -0.6, phrase("the data"), color=BLUE, ha="left", va="bottom", fontsize=8)
    for place, value in zip(places, information, strict=True):
        if value < _FLOOR:
            left.text(3.0 * _FLOOR, place, f"< {_FLOOR:.0e}".replace("e-0", "e-"), va="center", fontsize=7, color=INK)
    upright = not single or max(len(shown.symbol) for shown in labels) > 8
    _components(right, np.array([d.vector for d in found.directions]), [shown.tex for shown in labels], upright=upright)
    return figure


def _components(ax: Axes, vectors: FloatArray, symbols: list[str], *, upright: bool) -> None:
    """A heat map of unit directions (n, n), rows as in the bars beside it."""
    n = len(vectors)
    ax.imshow(vectors, cmap="PuOr_r", vmin=-1.0, vmax=1.0, aspect="auto")
    for row, column in np.ndindex(n, n):
        if abs(vectors[row, column]) >= 0.15:
            colour = "white" if abs(vectors[row, column]) > 0.7 else INK
            text = signed(f"{vectors[row, column]:+.1f}")
            ax.text(column, row, text, ha="center", va="center", fontsize=7 if n < 10 else 6, color=colour)
    name_ticks(ax.xaxis, np.arange(n), symbols, fontsize=7 if upright else 9, rotation=90 if upright else 0)
    ax.set_yticks([])
    ax.tick_params(axis="x", length=0)
    ax.set_title(phrase("components, in prior standard deviations"), fontsize=8.5)


def ridge_figure(fit: Fit, found: Identifiability, draws: FloatArray, pair: tuple[str, str]) -> Figure:
    """Posterior and prior of two parameters (those of `ridge_pair`) with the weakest direction between them.

    draws : (n_draw, n_par) of the posterior, 20 000 for smooth contours.
    """
    from matplotlib.lines import Line2D

    problem, weakest = fit.problem, found.directions[0]
    i, j = (fit.names.index(name) for name in pair)
    single = len(problem.runs) == 1
    shown = [problem.parameters[k].bare_label if single else problem.parameters[k].label for k in (i, j)]
    factors = np.array([s.factor for s in shown])
    points = draws[:, [i, j]] * factors
    proper = [bool(np.isfinite(problem.parameters[k].prior.sd)) for k in (i, j)]
    priors = _prior_draws(problem, (i, j), draws) * factors
    low = np.minimum(np.quantile(points, 0.001, axis=0), np.quantile(priors, 0.004, axis=0))
    high = np.maximum(np.quantile(points, 0.999, axis=0), np.quantile(priors, 0.996, axis=0))
    span = high - low
    low, high = low - 0.04 * span, high + 0.04 * span
    figure = new_figure(4.2, width=5.6)
    ax = figure.subplots()
    draw_contours(ax, density_of(points[:, 0], points[:, 1], ((low[0], high[0]), (low[1], high[1])), n_bin=40, smooth=1.3), BLUE, PALE, lw=0.8)
    for probability, width in ((0.68, 1.8), (0.95, 1.2)):
        _draw_prior(ax, [problem.parameters[k].prior for k in (i, j)], priors, probability, width)
    centre = fit.values[[i, j]] * factors
    arrow = weakest.vector[[i, j]] * found.prior_sds[[i, j]] * factors
    if np.any((centre + arrow < low) | (centre + arrow > high)):  # matplotlib leaves out an arrow that ends outside: the other way, then
        arrow = -arrow
    if not np.all(np.isclose(centre, centre + arrow)):  # matplotlib draws no line through points it takes for one
        ax.axline(tuple(centre), tuple(centre + arrow), color=GREEN, lw=1.0, ls=(0, (5, 3)), zorder=4)
    if all(proper):  # a flat prior without limits has no standard deviation to show the size of
        ax.annotate("", xy=tuple(centre + arrow), xytext=tuple(centre), arrowprops={"arrowstyle": "-|>", "color": GREEN, "lw": 2.0}, zorder=6)
    ax.plot(*centre, "o", color=INK, ms=4, zorder=7)
    edges = np.array([[problem.parameters[k].prior.low, problem.parameters[k].prior.high] for k in (i, j)]) * factors[:, None]
    first, last = np.maximum(low, edges[:, 0]), np.minimum(high, edges[:, 1])  # smoothed contours would spill over the edge of a prior
    ax.set_xlim(first[0], last[0])
    ax.set_ylim(first[1], last[1])
    ax.set(xlabel=shown[0].axis, ylabel=shown[1].axis)
    handles = [
        Line2D([], [], color=BLUE, lw=4, alpha=0.6, label=phrase("posterior, 68 and 95 %")),
        *([Line2D([], [], color=ORANGE, lw=1.6, label=phrase("prior, 68 and 95 %"))] if any(proper) else []),
        *([Line2D([], [], color=GREEN, lw=2, label=phrase("weakest direction, one prior sd"))] if all(proper) else []),
        Line2D([], [], color=GREEN, lw=1, ls="--", label=phrase("the data tell least along this line")),
        Line2D([], [], color=INK, marker="o", ms=4, ls="", label=phrase("fit")),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, fontsize=7.5, frameon=False)
    return figure


def ridge_pair(found: Identifiability, draws: FloatArray) -> tuple[str, str] | None:
    """The two parameters between which the weakest direction is a visible ridge: both move along it, and the posterior correlates them.

    None where it is that of one parameter alone.
    """
    spread = draws.std(axis=0)
    correlation = np.atleast_2d(np.cov(draws.T)) / np.outer(spread, spread)
    along = found.directions[0].vector
    mixed = np.triu(np.abs(np.outer(along, along) * correlation), k=1)
    if not np.max(mixed) > _MIXED:
        return None
    i, j = np.unravel_index(int(np.argmax(mixed)), mixed.shape)
    return found.names[i], found.names[j]


def _prior_draws(problem: Problem, pair: tuple[int, int], draws: FloatArray) -> FloatArray:
    """(100 000, 2) draws of two priors, to place contours and axes; the seed is fixed so that a figure does not change.

    A flat prior without limits has no draws: values spread evenly over the posterior `draws` (n_draw, n_par) stand for it.
    """
    rng = np.random.default_rng(0)
    columns = []
    for k in pair:
        prior = problem.parameters[k].prior
        columns.append(prior.draw(rng, _PRIOR_DRAWS) if np.isfinite(prior.sd) else rng.uniform(draws[:, k].min(), draws[:, k].max(), _PRIOR_DRAWS))
    return np.column_stack(columns)


def _draw_prior(ax: Axes, pair: Sequence[Prior], draws: FloatArray, probability: float, width: float) -> None:
    """The line inside which two independent priors are with `probability`; a prior without a standard deviation has no end.

    draws : (n_draw, 2) of both.
    """
    x, y = prior_contour(draws, probability)
    proper = [bool(np.isfinite(prior.sd)) for prior in pair]
    if all(proper):
        ax.plot(x, y, color=ORANGE, lw=width, zorder=5)
    for column, known, line in zip(draws.T, proper, (ax.axvline, ax.axhline), strict=True):
        if known and not all(proper):
            for end in np.quantile(column, [0.5 - 0.5 * probability, 0.5 + 0.5 * probability]):
                line(float(end), color=ORANGE, lw=width, zorder=5)


def prior_contour(draws: FloatArray, probability: float) -> tuple[FloatArray, FloatArray]:
    """A closed line, (400,) x and y, that holds `probability` of two independent priors, from their draws (n_draw, 2).

    The circle z_x^2 + z_y^2 = chi-squared quantile, each z carried to its prior through equal probabilities: for two normal
    priors the ellipse of equal density.  A flat prior gets as wide as it would with a posterior that says nothing, not as
    narrow as one standard deviation of the other.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    z = math.sqrt(chi2_quantile(probability, 2)) * np.array([np.cos(angle), np.sin(angle)])
    x, y = (np.quantile(column, p) for column, p in zip(draws.T, normal_below(z), strict=True))
    return x, y


def profile_figure(problem: Problem, intervals: Sequence[ProfileInterval], draws: FloatArray) -> Figure:
    """How the objective rises with each parameter, all others re-optimised, with posterior quantiles below.

    draws : (n_draw, n_par) of the posterior.
    """
    from matplotlib.lines import Line2D

    columns = min(3, len(intervals))
    rows = -(-len(intervals) // columns)
    figure = new_figure(1.75 * rows + 0.35)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for extra in axes[len(intervals) :]:
        extra.set_visible(False)
    for k, (ax, interval) in enumerate(zip(axes, intervals, strict=False)):
        index = problem.names.index(interval.name)
        parameter = problem.parameters[index]
        shown = parameter.label if len(problem.runs) > 1 else parameter.bare_label
        _draw_profile(ax, interval, draws[:, index] * shown.factor, shown.factor)
        ax.set_xlabel(shown.axis, fontsize=8.5, labelpad=1.5)
        ax.tick_params(labelsize=7)
        if k % columns == 0:
            ax.set_ylabel(phrase("rise of −2 ln p"), fontsize=8)
    handles = [
        Line2D([], [], color=BLUE, lw=1.4, label=phrase("profile")),
        Line2D([], [], color=GREY, lw=0.9, ls="--", label=phrase("68 and 95 % levels")),
        Line2D([], [], color=INK, lw=3, marker="|", ms=7, label=phrase("posterior: median, 68 and 95 %")),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, fontsize=7.5, frameon=False)
    return figure


def _draw_profile(ax: Axes, interval: ProfileInterval, draws: FloatArray, factor: float) -> None:
    sides = ((interval.open_low, interval.low), (interval.open_high, interval.high))
    x, kept = np.unique(interval.x * factor, return_index=True)
    # the signed square root of a rise is nearly a straight line: smooth in between
    root = np.sqrt(np.maximum(interval.rise[kept], 0.0)) * np.where(x < interval.value * factor, -1.0, 1.0)
    if x.size > 1:
        fine = np.linspace(x[0], x[-1], 300)
        ax.plot(fine, monotone(x, root, fine) ** 2, color=BLUE, lw=1.4)
    levels = {p: float(chi2_quantile(p, 1)) for p in interval.low}
    ax.hlines(list(levels.values()), 0.0, 1.0, color=GREY, lw=0.7, ls="--", zorder=1, transform=ax.get_yaxis_transform())
    closed = [(ends[p] * factor, level) for p, level in levels.items() for opened, ends in sides if not opened[p]]
    ax.vlines([end for end, _ in closed], 0.0, [level for _, level in closed], color=BLUE, lw=0.7, alpha=0.6)
    for (opened, ends), anchor in zip(sides, ("left", "right"), strict=True):
        for place in {ends[p] * factor for p in opened if opened[p]}:
            ax.axvline(place, color=ORANGE, lw=1.6)
            ax.annotate(
                phrase("open"), (place, 0.97), (3 if anchor == "left" else -3, 0), xycoords=("data", "axes fraction"), textcoords="offset points",
                ha=anchor, va="top", fontsize=6.5, color=ORANGE,
            )
    q025, q16, median, q84, q975 = np.quantile(draws, [0.025, 0.16, 0.5, 0.84, 0.975])
    ax.plot([q025, q975], [-0.55, -0.55], color=INK, lw=1, solid_capstyle="butt")
    ax.plot([q16, q84], [-0.55, -0.55], color=INK, lw=3, solid_capstyle="butt")
    ax.plot(median, -0.55, "|", color=INK, ms=7)
    shown = np.concatenate([x[np.square(root) <= _TOP_RISE], [q025, q975]])
    margin = 0.06 * float(np.ptp(shown)) if math.isfinite(np.ptp(shown)) and np.ptp(shown) > 0.0 else 1.0
    ax.set_xlim(shown.min() - margin, shown.max() + margin)
    ax.set_ylim(-1.1, _TOP_RISE)
    ax.set_yticks([0, 1, 2, 3, 4])
    ax.locator_params(axis="x", nbins=4)
