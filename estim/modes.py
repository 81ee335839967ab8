"""Are there several separate solutions?  Optima that other starts of the fit found, weighed by the draws.

Two optima are separate modes where no way leads from one to the other on which the density stays near that of the lower
of the two, and each holds a share of the posterior that matters.  Two ways are tried: the straight line, and the ridge (the
parameter in which they differ most is led from one value to the other, all others re-optimised), for a ridge may be bent.
A mode that no start and no walker has met stays unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.fitting import Fit
from estim.profile_search import Search, search_of

FloatArray = NDArray[np.float64]

_VALLEY = 2.0  # drop of the log density between two modes
_N_RIDGE = 32  # points along a ridge
_SHARE = 0.01  # of the draws


@dataclass(frozen=True, eq=False)
class Modes:
    """Separate modes of a posterior, that of the fit first.

    values : (n_mode, n_par).  shares : (n_mode,) of the posterior draws nearest to each.
    """

    values: FloatArray
    shares: FloatArray

    @property
    def several(self) -> bool:
        return self.values.shape[0] > 1


def find_modes(fit: Fit, draws: FloatArray) -> Modes:
    """Which of the optima of a fit are separate modes, by posterior draws (n_draw, n_par)."""
    kept, search = [fit.values], search_of(fit)
    for other in fit.others:
        if all(_separate(search, mode, other) for mode in kept):
            kept.append(other)
    values = np.array(kept)
    scale = np.sqrt(np.diag(fit.cov))
    scale = np.where(scale > 0.0, scale, 1.0)
    distance = np.sum(((draws[:, None, :] - values) / scale) ** 2, axis=2)
    shares = np.bincount(np.argmin(distance, axis=1), minlength=len(values)) / draws.shape[0]
    matters = (shares >= _SHARE) | (np.arange(len(values)) == 0)
    return Modes(values[matters], shares[matters])


def _separate(search: Search, a: FloatArray, b: FloatArray) -> bool:
    return not (_level(search, a, b) or _ridge(search, a, b) or _ridge(search, b, a))


def _level(search: Search, a: FloatArray, b: FloatArray) -> bool:
    """Whether the density stays up along the straight line."""
    heights = search.objectives(a + np.linspace(0.0, 1.0, 65)[:, None] * (b - a))
    return bool(np.max(heights) <= max(heights[0], heights[-1]) + 2.0 * _VALLEY)


def _ridge(search: Search, a: FloatArray, b: FloatArray) -> bool:
    """Whether it stays up along the ridge that starts at `a`, and that ridge meets `b`."""
    led = int(np.argmax(np.abs(b - a) / search.scale))
    highest = max(search.objective(a), search.objective(b)) + 2.0 * _VALLEY
    before, here = a, a
    for at in np.linspace(a[led], b[led], _N_RIDGE + 1)[1:]:
        guess = 2.0 * here - before  # straight on
        guess[led] = at
        point = search.minimise(guess, held=(led,))
        if not point.objective <= highest:
            return False
        before, here = here, point.values
    return _level(search, here, b)
