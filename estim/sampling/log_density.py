"""What a sampler needs of a posterior, and its evaluation in batches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from estim.arrays import FloatArray, in_blocks
from estim.common import NumericalError
from estim.problem import Coordinates

Support = tuple[FloatArray, FloatArray]  # (n_par,) lowest and highest values

_BATCH = 2000  # draws in one call: a curve of 1000 points needs some 16 MB an array


class Density(Protocol):
    """What can be sampled: names of the parameters and a log density, vectorised over draws."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""

    def log_density(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log density at draws (n_draw, n_par); -inf outside the support."""


@dataclass(frozen=True, eq=False)
class InCoordinates:
    """A density in coordinates in which it is nearly normal."""

    density: Density
    coordinates: Coordinates

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return self.density.names

    def log_density(self, points: FloatArray) -> FloatArray:
        """(n_draw,) log density at points (n_draw, n_par)."""
        values = self.coordinates.values(points)
        volume = self.coordinates.log_volume(values)
        usable = np.isfinite(volume)  # a value may overflow
        log_p = np.full(len(points), -np.inf)
        log_p[usable] = self.density.log_density(values[usable]) + volume[usable]
        return log_p


def log_density_in_batches(density: Density, draws: FloatArray) -> FloatArray:
    """(n_draw,) log density at draws (n_draw, n_par), some thousand at a time so that memory is
    bounded.

    Raises NumericalError where it is not a number or +inf.
    """
    values = in_blocks(density.log_density, draws, _BATCH)
    if not np.all(values < np.inf):
        where = draws[np.flatnonzero(~(values < np.inf))[0]]
        point = ", ".join(
            f"{name} = {value:.4g}" for name, value in zip(density.names, where, strict=True)
        )
        raise NumericalError("the posterior density is not a number or infinite", at=point)
    return values
