"""Smooth lines and smooth histograms for figures, a few lines each: the packages of SciPy that have them take longer to load than figures to draw."""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray

_REACH = 4.0  # standard deviations, beyond which a kernel is cut off


def monotone(x: FloatArray, y: FloatArray, places: FloatArray) -> FloatArray:
    """The curve through points (n,), n > 1, at `places` between them: cubic from point to point, rising and falling only where the points do.

    The slope at a point is the harmonic mean of those on either side, weighted by their lengths, and 0 at an extremum (Fritsch and Butland,
    SIAM J. Sci. Stat. Comput. 5 (1984) 300); at an end it is that of a parabola, kept from overshooting.  x increases.
    """
    step = np.diff(x)
    secant = np.diff(y) / step
    slope = np.empty(x.size)
    if x.size == 2:
        slope[:] = secant[0]
    else:
        before, behind = secant[:-1], secant[1:]
        near, far = 2.0 * step[1:] + step[:-1], step[1:] + 2.0 * step[:-1]
        alike = before * behind > 0.0
        divisor = near * behind + far * before
        slope[1:-1] = np.where(alike, (near + far) * before * behind / np.where(alike, divisor, 1.0), 0.0)
        slope[0], slope[-1] = _end_slope(*step[:2], *secant[:2]), _end_slope(*step[:-3:-1], *secant[:-3:-1])
    i = np.clip(np.searchsorted(x, places, side="right") - 1, 0, step.size - 1)
    h = step[i]
    t = (places - x[i]) / h
    back = 1.0 - t
    values = back**2 * (1.0 + 2.0 * t) * y[i] + t**2 * (1.0 + 2.0 * back) * y[i + 1]
    return np.asarray(values + h * t * back * (back * slope[i] - t * slope[i + 1]))


def _end_slope(step: float, next_step: float, secant: float, next_secant: float) -> float:
    slope = ((2.0 * step + next_step) * secant - step * next_secant) / (step + next_step)
    if slope * secant <= 0.0:
        return 0.0
    return 3.0 * secant if secant * next_secant < 0.0 and abs(slope) > 3.0 * abs(secant) else slope


def blurred(counts: FloatArray, sd: float) -> FloatArray:
    """A histogram (n, n) smoothed by a normal kernel of `sd` cells, the counts beyond its edges those inside mirrored."""
    n = len(counts)
    reach = int(_REACH * sd + 0.5)
    steps = np.arange(-reach, reach + 1)
    weights = np.exp(-0.5 * np.square(steps / sd))
    weights /= np.sum(weights)
    kernel = np.zeros((n, n))
    mirrored = np.add.outer(np.arange(n), steps) % (2 * n)
    mirrored = np.minimum(mirrored, 2 * n - 1 - mirrored)
    np.add.at(kernel, (np.arange(n)[:, None], mirrored), weights)
    return np.asarray(kernel @ counts @ kernel.T)
