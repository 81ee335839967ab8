"""Figures of a measurement model: the draws of each output beside the GUM's distribution, budgets, regions of two outputs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy import special

from estim.arrays import FloatArray
from estim.common import later, phrase
from estim.drawing import BLUE, GREEN, GREY, INK, ORANGE, PALE, grid, name_ticks, new_figure
from estim.measurement import Propagation, Region, ellipse

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BINS, _CELLS, _MOST_CELL_DRAWS = 120, 70, 400_000
_LEAST_SHARE, _MOST_ROWS, _MOST_PANELS = 0.5, 16, 6
_INTERVALS = {
    "symmetric": later("{percent} interval of the draws, symmetric"), "shortest": later("{percent} interval of the draws, shortest"),
}


def axis_name(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} ({unit})"


def _density_name(unit: str) -> str:
    if unit == "1":
        return phrase("density")
    return f"{phrase('density')} (1/({unit}))" if set(unit) & set(" /*·") else f"{phrase('density')} (1/{unit})"


def distribution_figure(propagation: Propagation) -> Figure:
    """A histogram of the draws of each output, the distribution that the GUM's interval assumes over it, and both intervals."""
    outputs = propagation.model.outputs
    figure, axes = grid(len(outputs), height=3.1)
    for i, (ax, output) in enumerate(zip(axes, outputs, strict=True)):
        _distribution(ax, propagation, i)
        ax.set(xlabel=axis_name(output.name, output.unit), ylabel=_density_name(output.unit))
        ax.ticklabel_format(axis="both", style="sci", scilimits=(-4, 5), useMathText=True)
        ax.locator_params(axis="x", nbins=6)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    return figure


def _distribution(ax: Axes, propagation: Propagation, i: int) -> None:
    linear, sampled = propagation.linear, propagation.sampled
    draws = sampled.draws[:, i]
    draws = draws[np.isfinite(draws)]
    value, u = float(linear.value[i]), float(linear.u[i])
    percent = f"{100.0 * sampled.probability:g} %"
    if draws.size:
        tail = 0.1 * (1.0 - sampled.probability)
        low, high = np.quantile(draws, [tail, 1.0 - tail])
        counts, edges = np.histogram(draws, bins=_BINS, range=(low, high if high > low else low + 1.0))
        ax.stairs(counts / (draws.size * np.diff(edges)), edges, fill=True, color=PALE, label=phrase("draws (Monte Carlo)"))
        interval = propagation.interval
        said = phrase(_INTERVALS[propagation.model.interval], percent=percent)
        for j, end in enumerate((interval.low[i], interval.high[i])):
            ax.axvline(float(end), color=BLUE, lw=1.4, label=said if j == 0 else None)
    if u > 0.0 and math.isfinite(value):
        left, right = ax.get_xlim()
        room = 0.25 * float(linear.high[i] - linear.low[i])
        x = np.linspace(min(left, float(linear.low[i]) - room), max(right, float(linear.high[i]) + room), 400)
        ax.plot(x, _density((x - value) / u, float(linear.dof[i])) / u, color=ORANGE, lw=1.6, label=phrase("the GUM's normal or t distribution"))
        for j, end in enumerate((linear.low[i], linear.high[i])):
            ax.axvline(float(end), color=ORANGE, lw=1.4, ls="--", label=phrase("{percent} interval of the GUM", percent=percent) if j == 0 else None)
    ax.set_ylim(bottom=0.0)


def _density(z: FloatArray, dof: float) -> FloatArray:
    if math.isinf(dof) or dof > 1e6:
        return np.asarray(np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi))
    log_norm = special.gammaln(0.5 * (dof + 1.0)) - special.gammaln(0.5 * dof) - 0.5 * math.log(dof * math.pi)
    return np.asarray(np.exp(log_norm - 0.5 * (dof + 1.0) * np.log1p(z**2 / dof)))


def budget_figure(propagation: Propagation) -> Figure:
    """Share of each input in the linear variance of each output, largest first, and that of the correlations."""
    budgets, outputs = propagation.budgets, propagation.model.outputs
    shares = {one.name: [next(r.share for r in b.rows if r.input.name == one.name) for b in budgets] for one in propagation.linear.inputs}
    known = {name: np.nan_to_num(np.array(row)) for name, row in shares.items()}
    names = sorted((n for n, row in known.items() if row.max() >= _LEAST_SHARE), key=lambda name: -known[name].max())[:_MOST_ROWS]
    rest = [name for name in known if name not in names]
    rows: list[tuple[str, FloatArray, str]] = [(name, known[name], BLUE) for name in names]
    if sum(known[name].max() for name in rest) > 0.0:
        rows.append((phrase("{n} more", n=len(rest)) if len(rest) > 1 else rest[0], np.sum([known[name] for name in rest], axis=0), BLUE))
    correlated = np.nan_to_num(np.array([b.correlation_share for b in budgets]))
    if np.any(correlated != 0.0):
        rows.append((phrase("correlations"), correlated, GREY))
    columns = min(3, len(outputs))
    lines = -(-len(outputs) // columns)
    figure = new_figure(lines * (0.27 * max(len(rows), 2) + 0.9))
    panels = figure.subplots(lines, columns, squeeze=False, sharey=True).ravel()
    places = np.arange(len(rows))
    for i, (ax, output) in enumerate(zip(panels, outputs, strict=False)):
        widths = np.array([row[1][i] for row in rows])
        ax.barh(places, widths, color=[row[2] for row in rows], height=0.7)
        ax.axvline(0.0, color=INK, lw=0.8)
        left, right = min(0.0, float(widths.min(initial=0.0))), max(0.0, float(widths.max(initial=0.0)))
        room = 0.28 * ((right - left) or 1.0)
        ax.set_xlim(left - (1.5 * room if left < 0.0 else 0.0), right + room)
        for place, width in zip(places, widths, strict=True):
            text = f"{width:.1f}".replace("-", "−")
            ax.annotate(text, (width, place), xytext=(3 if width >= 0.0 else -3, 0), textcoords="offset points", va="center",
                        ha="left" if width >= 0.0 else "right", fontsize=7.5)
        ax.set_xlabel(phrase("share of u²({name}) (%)", name=output.name), fontsize=9)
        ax.tick_params(axis="x", labelsize=8)
        ax.spines[["top", "right"]].set_visible(False)
    for extra in panels[len(outputs) :]:
        extra.set_visible(False)
    name_ticks(panels[0].yaxis, places, [row[0] for row in rows], fontsize=8.5)
    panels[0].set_ylim(len(rows) - 0.4, -0.6)
    return figure


def region_figure(propagation: Propagation) -> Figure:
    """For each pair of outputs the draws, the ellipses of the GUM and of the draws, the rectangle, and the smallest region."""
    shown = propagation.regions[:_MOST_PANELS]
    figure, axes = grid(len(shown), height=3.9)
    for ax, region in zip(axes, shown, strict=True):
        _region(ax, propagation, region)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    return figure


def _region(ax: Axes, propagation: Propagation, region: Region) -> None:
    draws = propagation.sampled.draws[:_MOST_CELL_DRAWS, list(region.pair)]
    percent = f"{100.0 * region.probability:g} %"
    rings = np.hstack([ellipse(region.value, region.covariance, region.k_ellipse), ellipse(region.mean, region.drawn, region.k_drawn)])
    ends = np.quantile(draws, [0.005, 0.995], axis=0).T
    lows, highs = np.minimum(rings.min(axis=1), ends[:, 0]), np.maximum(rings.max(axis=1), ends[:, 1])
    limits = [(low - 0.08 * (high - low), high + 0.08 * (high - low)) for low, high in zip(lows, highs, strict=True)]
    density, x, y = np.histogram2d(draws[:, 0], draws[:, 1], bins=_CELLS, range=limits)
    ax.pcolormesh(x, y, np.ma.masked_equal(density.T, 0.0), cmap="Greys", vmax=1.6 * density.max(), rasterized=True)
    ordered = np.sort(density.ravel())[::-1]
    level = float(ordered[min(int(np.searchsorted(np.cumsum(ordered), region.probability * len(draws))), ordered.size - 1)])
    middles = [0.5 * (edges[1:] + edges[:-1]) for edges in (x, y)]
    ax.contour(*middles, _smooth(density.T), levels=[max(level, 0.5)], colors=INK, linewidths=0.9, linestyles=":")
    said = phrase("smallest region with {percent} of the draws, roughly", percent=percent)
    ax.plot([], [], color=INK, lw=0.9, ls=":", label=said)
    said = phrase("{percent} ellipse of the GUM", percent=percent)
    ax.plot(*ellipse(region.value, region.covariance, region.k_ellipse), color=ORANGE, lw=1.8, ls="--", label=said)
    ax.plot(*ellipse(region.mean, region.drawn, region.k_drawn), color=BLUE, lw=1.5, label=phrase("{percent} ellipse of the draws", percent=percent))
    half = region.k_rectangle_drawn * np.sqrt(np.diag(region.drawn))
    (a, b), (c, d) = region.mean - half, region.mean + half
    ax.plot([a, c, c, a, a], [b, b, d, d, b], color=GREEN, lw=1.4, ls="-.", label=phrase("{percent} rectangle of the draws", percent=percent))
    one, two = (propagation.model.outputs[k] for k in region.pair)
    ax.set(xlabel=axis_name(one.name, one.unit), ylabel=axis_name(two.name, two.unit))
    ax.ticklabel_format(style="sci", scilimits=(-4, 5), useMathText=True)
    ax.locator_params(nbins=5)


def _smooth(cells: FloatArray) -> FloatArray:
    """Each cell averaged with its neighbours, for a contour that does not follow the noise."""
    padded = np.pad(cells, 1, mode="edge")
    n, m = cells.shape
    return np.asarray(sum(padded[i : i + n, j : j + m] for i in range(3) for j in range(3)) / 9.0)
