"""Are there several separate solutions?  Optima that other starts of the fit found, weighed by the draws.

Two optima are separate modes where the density between them falls well below the lower of the two (along the straight
line that joins them, which can only make a bent ridge look separate, never hide a second mode), and each holds a share of
the posterior that matters.  A mode that no start and no walker has met stays unknown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.fitting import Fit

FloatArray = NDArray[np.float64]

_VALLEY = 2.0  # drop of the log density between two modes
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
    kept = [fit.values]
    for other in fit.others:
        if all(_separate(fit, mode, other) for mode in kept):
            kept.append(other)
    values = np.array(kept)
    scale = np.sqrt(np.diag(fit.cov))
    scale = np.where(scale > 0.0, scale, 1.0)
    distance = np.sum(((draws[:, None, :] - values) / scale) ** 2, axis=2)
    shares = np.bincount(np.argmin(distance, axis=1), minlength=len(values)) / draws.shape[0]
    matters = (shares >= _SHARE) | (np.arange(len(values)) == 0)
    return Modes(values[matters], shares[matters])


def _separate(fit: Fit, a: FloatArray, b: FloatArray) -> bool:
    path = a + np.linspace(0.0, 1.0, 65)[:, None] * (b - a)
    log_p = fit.posterior.log_density(path)
    return bool(np.min(log_p) < min(log_p[0], log_p[-1]) - _VALLEY)
