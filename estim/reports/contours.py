"""Regions of two quantities that hold a share of the posterior draws, from a smoothed histogram."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from estim.arrays import FloatArray
from estim.reports.smoothing import blurred

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PROBABILITIES = (0.95, 0.68)


@dataclass(frozen=True, eq=False)
class Density:
    """Smoothed number of draws per cell: z (n_bin + 2, n_bin + 2) at x and y (n_bin + 2,), the middles of the cells and the ends of their ranges.

    levels : (2,), increasing; above them lie 95 and 68 % of the density, and a little more of the draws, which smoothing spreads.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    levels: FloatArray


def density_of(x: FloatArray, y: FloatArray, ranges: Sequence[tuple[float, float]], *, n_bin: int, smooth: float) -> Density:
    """The density of draws (n_draw,) between the ends of two `ranges`; smooth : standard deviation of the kernel, in cells."""
    counts, *edges = np.histogram2d(x, y, bins=n_bin, range=ranges)
    middles = [np.concatenate([edge[:1], 0.5 * (edge[1:] + edge[:-1]), edge[-1:]]) for edge in edges]
    smoothed = blurred(counts, smooth)
    return Density(middles[0], middles[1], np.pad(smoothed, 1, mode="edge"), _levels(smoothed))


def _levels(smoothed: FloatArray) -> FloatArray:
    """Not those that hold as many of the draws: across a narrow ridge the smoothed one is too wide, so such a region would be too short along it."""
    ordered = np.sort(smoothed, axis=None)[::-1]
    held = np.cumsum(ordered)
    low, high = ordered[np.searchsorted(held, np.array(PROBABILITIES) * held[-1])]
    return np.array([min(low, high * (1.0 - 1e-4)), high])


def draw_contours(ax: Axes, density: Density, colour: str, pale: str, *, lw: float) -> None:
    """Fill the regions that hold 95 % (pale) and 68 %, each with its line."""
    levels = [*density.levels, 1.01 * float(density.z.max())]
    drawn = ax.contourf(density.x, density.y, density.z.T, levels=levels, colors=[pale, colour], antialiased=True)
    drawn.set(edgecolor=colour, linewidth=lw)
