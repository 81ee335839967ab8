"""Coordinates of parameters in which a density is nearly normal.

The constant of Arrhenius' law, or of an exponential that begins far from the data, may be known to
a few powers of ten: others make up for it, so that it is highly correlated with them, along a bent
valley.  With its logarithm the valley is nearly straight.

The size of errors enters a likelihood by its square.  A density is therefore level in a size of 0,
even where it rises beside it, and steps from there lead nowhere; in the square it is not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import BoolArray, FloatArray, sds_of

WIDE = 0.2  # standard deviation over value, beyond which a parameter may be known by its size
_TIED = 0.95  # correlation
_LEAST = 1e-6  # of the unit of a square: a smaller value counts as this one


def compensated(values: FloatArray, cov: FloatArray) -> BoolArray:
    """(n_par,) which parameters are hardly known, because others compensate for them, about a fit
    `values` (n_par,) of covariance `cov`.
    """
    sds = sds_of(cov)
    with np.errstate(all="ignore"):
        together = np.abs(cov) / np.outer(sds, sds) - np.eye(sds.size)
    wide = (sds > WIDE * np.abs(values)) & (values != 0.0)
    return wide & (np.max(together, axis=1, initial=0.0) > _TIED)


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Values, or logarithms of their ratio to `centre`, signed so that both increase together, or
    squares.

    centre : (n_par,) values that are not 0 where the logarithm is taken.
    by_size : (n_par,) whether it is.
    unit : (n_par,) whose square a square is divided by, 0 where none is taken.
    """

    centre: FloatArray
    by_size: BoolArray
    unit: FloatArray | float = 0.0

    def values(self, coordinates: FloatArray) -> FloatArray:
        """Values (..., n_par) at coordinates."""
        with np.errstate(all="ignore"):
            sizes = self.centre * np.exp(np.sign(self.centre) * coordinates)
            roots = np.sqrt(np.maximum(coordinates, 0.0)) * self.unit
        return np.where(self.by_size, sizes, np.where(self.squared, roots, coordinates))

    def of(self, values: FloatArray) -> FloatArray:
        """Coordinates (..., n_par) of values; infinite where a sign is not that of the centre."""
        with np.errstate(all="ignore"):
            logs = np.sign(self.centre) * np.log(np.maximum(values / self.centre, 0.0))
            squares = np.square(values / self.unit)
        return np.where(self.by_size, logs, np.where(self.squared, squares, values))

    def values_of(self, i: int, coordinates: ArrayLike) -> FloatArray:
        """Values (n,) of parameter i at coordinates (n,) of it."""
        rows = np.zeros((np.size(coordinates), self.centre.size))
        rows[:, i] = coordinates
        return self.values(rows)[:, i]

    def away_from_zero(self, values: FloatArray) -> FloatArray:
        """Values (..., n_par) with none so small that its slope has no bound."""
        return np.where(self.squared, np.maximum(values, _LEAST * self.unit), values)

    def slopes(self, values: FloatArray) -> FloatArray:
        """Derivatives (..., n_par) of the values in the coordinates."""
        with np.errstate(all="ignore"):
            roots = 0.5 * np.square(self.unit) / self.away_from_zero(values)
        return np.where(self.by_size, np.abs(values), np.where(self.squared, roots, 1.0))

    @property
    def squared(self) -> BoolArray:
        """(n_par,) whether a square is taken."""
        return np.greater(self.unit, 0.0)

    def log_volume(self, values: FloatArray) -> FloatArray:
        """(...) logarithm of the volume of values that a unit of coordinates takes, at values (...,
        n_par).
        """
        with np.errstate(divide="ignore"):
            return np.sum(np.log(self.slopes(values)), axis=-1)
