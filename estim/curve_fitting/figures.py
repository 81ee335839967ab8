"""Figures of a fitted curve (`CurveFit.plot`, `CurveFit.contour`): points, curve and residuals; the
region of two parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from estim.arrays import FloatArray, all_finite, finite_or
from estim.common import Label, bracketed, phrase
from estim.drawing import (
    BLUE,
    GREY,
    INK,
    MOST_BARS,
    ORANGE,
    PALE,
    Axes,
    Figure,
    fill,
    handed_out,
    logarithmic,
)
from estim.fitting import Contour
from estim.problem import Observations

if TYPE_CHECKING:
    from matplotlib.artist import Artist

_FINE = 201  # points along each axis of a smoothed contour
_CIRCLE = np.linspace(0.0, 2.0 * np.pi, 181)


@dataclass(frozen=True, eq=False)
class Prediction:
    """The fitted curve at x (n,): value, its standard uncertainty u and the ends of its interval,
    all (n,), unit of y.

    u, low, high : nan where the status is not ok, or a parameter has no standard deviation.
    """

    x: FloatArray
    value: FloatArray
    u: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, eq=False)
class ConfidenceRegion(Contour):
    """Where two parameters of a fit may lie together: the profile of the likelihood (and of
    priors), in the parameters' own units.

    a, b : names.
    x : (n,) values of a.  y : (n,) values of b.  rise : (n, n) how far minus twice the log
        likelihood stands above its minimum at (x[i], y[j]), the other parameters fitted anew at
        each point; inf where the curve or a limit allows none.
    levels : probability -> the rise at its border: chi-squared with two degrees of freedom, 2 F
        where the size of the errors was estimated.
    n_failed : points at which the search over the other parameters did not settle.
    ellipses : probability -> (181, 2) border of the region of the linear theory, nan where there is
        none.
    best : (2,) fitted values.
    labels : how the parameters are written.
    """

    ellipses: dict[float, FloatArray]
    best: FloatArray
    labels: tuple[Label, Label]

    def holds(self, a: float, b: float, *, probability: float = 0.95) -> bool:
        """Whether the region of that probability, one of `levels`, holds the point; nothing outside
        the grid is held.
        """
        inside = self.x[0] <= a <= self.x[-1] and self.y[0] <= b <= self.y[-1]
        return bool(
            inside
            and _refined(self, np.array([a]), np.array([b]))[0, 0] <= self.levels[probability]
        )

    def plot(self, figure: Figure | None = None, *, ax: Axes | None = None) -> Figure:
        """The regions with the ellipses of the linear theory, in a new figure, in the user's own
        (which may be one of pyplot's), or in its axes `ax`.
        """
        return handed_out(figure, lambda own: _draw_region(ax or own.subplots(), self), 4.6, ax)

    def _repr_png_(self) -> bytes:
        from estim.drawing import as_png

        return as_png(self.plot())


def region_of(
    contour: Contour, *, best: FloatArray, cov: FloatArray, labels: tuple[Label, Label]
) -> ConfidenceRegion:
    """`contour` with the ellipses of the covariance matrix cov (2, 2) about best (2,)."""
    values, axes = np.linalg.eigh(cov) if all_finite(cov) else (np.full(2, np.nan), np.eye(2))
    circle = np.stack([np.cos(_CIRCLE), np.sin(_CIRCLE)], axis=1)
    unit = circle * np.sqrt(np.where(values >= 0.0, values, np.nan)) @ axes.T
    ellipses = {p: best + np.sqrt(level) * unit for p, level in contour.levels.items()}
    return ConfidenceRegion(**vars(contour), ellipses=ellipses, best=best, labels=labels)


def curve_figure(
    run: Observations,
    at_points: FloatArray,
    curve: Prediction,
    inner: Prediction,
    *,
    sd: FloatArray,
    sd_x: FloatArray,
    title: str,
    figure: Figure | None,
    ax: Axes | None,
) -> Figure:
    """Points with their errors, the curve with its bands, and the residuals in the unit of y; on
    axes of the user's own without the residuals.

    at_points : (n_obs,) the fitted curve at the points.
    curve, inner : along x, with 95 % and 68 % intervals.
    sd, sd_x : (n_obs,) standard deviations of y and x, 0 for none.
    """

    def draw(own: Figure) -> None:
        upper, lower = ax, None
        if upper is None:
            upper, lower = own.subplots(2, 1, sharex=True, height_ratios=(3, 1.2))
        counts = run.noise.counted
        _draw_curve(upper, curve, inner)
        bars = run.n_obs <= MOST_BARS and counts is None
        errors: dict[str, Any] = {
            "yerr": (sd if run.noise.sides is None else run.noise.sides)
            if bars and np.any(sd > 0.0)
            else None,
            "xerr": sd_x if bars and np.any(sd_x > 0.0) else None,
        }
        style: dict[str, Any] = {
            "fmt": "o",
            "color": INK,
            "ms": 3.5 if run.n_obs <= MOST_BARS else 1.8,
            "elinewidth": 0.9,
            "capsize": 0,
        }
        label = phrase(
            "counts" if counts is not None else "data ± u" if bars and np.any(sd > 0.0) else "data"
        )
        upper.errorbar(run.x, run.y, **errors, **style, label=label, zorder=5 if bars else 1.9)
        upper.set(ylabel=run.y_label)
        if ax is None:
            logarithmic(upper, run.spread_in_decades, run.y, sd)
        (lower or upper).set(xlabel=run.x_label)
        upper.set_title(title, fontsize=10, pad=20 if ax is None else 6)
        above: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "ncols": 4}
        position = above if ax is None else {"loc": "best"}
        upper.legend(fontsize=8, frameon=False, borderaxespad=0.1, **position)
        if lower is None:
            return
        if counts is not None:
            scatter = np.sqrt(counts.law.variance(at_points, counts.trials))
            at = run.x if counts.bins is None else counts.bins.ravel()
            scatter = scatter if counts.bins is None else np.repeat(scatter, 2)
            fill(lower, at, -scatter, scatter, GREY, 0.25, label=phrase("± sd of a count"))
        elif not bars and np.any(sd > 0.0):
            fill(lower, run.x, -sd, sd, GREY, 0.25, label=phrase("± u of a reading"))
        fill(lower, curve.x, curve.low - curve.value, curve.high - curve.value, BLUE, 0.3)
        lower.axhline(0.0, color=BLUE, lw=1.2)
        lower.errorbar(run.x, run.y - at_points, yerr=errors["yerr"], **style, zorder=5)
        if lower.get_legend_handles_labels()[0]:
            lower.legend(fontsize=7.5, frameon=False, loc="best")
        lower.set(ylabel=phrase("residual") + bracketed(run.y_unit))
        own.align_ylabels([upper, lower])

    return handed_out(figure, draw, 5.0, ax)


def _draw_curve(ax: Axes, curve: Prediction, inner: Prediction) -> None:
    if np.any(np.isfinite(curve.low)):
        for band, alpha, p in ((curve, 0.22, 95), (inner, 0.40, 68)):
            label = phrase("the curve, {p:.0f} %", p=p)
            fill(ax, band.x, band.low, band.high, BLUE, alpha, label=label)
    ax.plot(curve.x, curve.value, color=BLUE, lw=1.3, label=phrase("best curve"))


def _refined(region: ConfidenceRegion, a: FloatArray, b: FloatArray) -> FloatArray:
    """(n, m) rise at all pairs of a (n,) and b (m,), by cubic splines between the points of the
    grid; inf beside points without a value.
    """
    from scipy.interpolate import RectBivariateSpline, RegularGridInterpolator

    if all_finite(region.rise):
        return np.asarray(RectBivariateSpline(region.x, region.y, region.rise)(a, b))
    pairs = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1)
    with np.errstate(invalid="ignore"):
        rise = RegularGridInterpolator((region.x, region.y), region.rise)(pairs)
    return finite_or(rise, np.inf)


def _draw_region(ax: Axes, region: ConfidenceRegion) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    a = np.linspace(region.x[0], region.x[-1], _FINE)
    b = np.linspace(region.y[0], region.y[-1], _FINE)
    rise, (first, second) = _refined(region, a, b), region.labels
    levels = sorted(region.levels.values())
    shades = [BLUE, PALE, "#E3F0F7"][: len(levels)]
    top = 1e3 * levels[-1]
    shown, factors = np.minimum(rise.T, top), np.array([first.factor, second.factor])
    drawn = (a * first.factor, b * second.factor, shown)
    ax.contourf(*drawn, levels=[-top, *levels], colors=shades)
    ax.contour(*drawn, levels=levels, colors=INK, linewidths=0.8)
    for ellipse in region.ellipses.values():
        ax.plot(*(ellipse * factors).T, color=ORANGE, lw=1.4, ls="--")
    ax.plot(*(region.best * factors), "o", color="white", mec=INK, ms=5)
    names = [phrase("profile, {p:.0f} %", p=100 * p) for p in sorted(region.levels)]
    handles: list[Artist] = [
        Patch(facecolor=shade, edgecolor=INK, label=name)
        for shade, name in zip(shades, names, strict=False)
    ]
    if any(all_finite(outline) for outline in region.ellipses.values()):
        handles.append(Line2D([], [], color=ORANGE, lw=1.4, ls="--", label=phrase("linear theory")))
    handles.append(
        Line2D([], [], color="white", marker="o", mec=INK, ls="", label=phrase("best values"))
    )
    ax.legend(
        handles=handles,
        fontsize=8,
        frameon=False,
        loc="lower center",
        bbox_to_anchor=(0.5, 1.0),
        ncols=len(handles),
    )
    ax.set(xlabel=first.axis, ylabel=second.axis)
    ax.locator_params(axis="x", nbins=6)
