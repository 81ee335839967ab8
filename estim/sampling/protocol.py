"""What a sampler asks of a posterior, and how to ask it in batches."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from estim.arrays import FloatArray
from estim.common import NumericalError

Support = tuple[FloatArray, FloatArray]  # (n_par,) lowest and highest values

_BATCH = 2000  # draws in one call: a curve of 1000 points needs some 16 MB an array


class Density(Protocol):
    """What can be sampled: names of the parameters and a log density, vectorised over draws."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""

    def log_density(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log density at draws (n_draw, n_par); -inf outside the support."""


def log_density_in_batches(density: Density, draws: FloatArray) -> FloatArray:
    """(n_draw,) log density at draws (n_draw, n_par), some thousand at a time so that memory is
    bounded.

    Raises NumericalError where it is not a number or +inf.
    """
    values = np.concatenate(
        [density.log_density(draws[i : i + _BATCH]) for i in range(0, draws.shape[0], _BATCH)]
    )
    if not np.all(values < np.inf):
        where = draws[np.flatnonzero(~(values < np.inf))[0]]
        point = ", ".join(
            f"{name} = {value:.4g}" for name, value in zip(density.names, where, strict=True)
        )
        raise NumericalError("the posterior density is not a number or infinite", at=point)
    return np.asarray(values)
