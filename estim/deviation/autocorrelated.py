"""Stated noise whose errors follow each other: those of successive readings are correlated by a fixed number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.deviation.noise import Stated
from estim.problem import CorrelatedErrors, Named, Points


@dataclass(frozen=True, eq=False)
class AutoCorrelated(Stated):
    """Errors of readings with corr(e_i, e_j) = correlation^|i - j| (AR(1)), of the stated size; readings in the order of their times.

    Speeds made of positions: of the positions.  A further scatter stays white.
    """

    correlation: float

    def likelihood(self, points: Points, named: Named) -> CorrelatedErrors:
        stated = self.base.likelihood(points, named)
        matrix = self.base.of_positions(points, named)
        lever = np.diag(self.base.reading_gain()) if matrix is None else matrix.dense()
        steps = np.arange(lever.shape[1])
        covariance = lever @ self.correlation ** np.abs(np.subtract.outer(steps, steps)) @ lever.T
        spectrum, basis = np.linalg.eigh(covariance)
        rounding = np.finfo(float).eps * spectrum.size * spectrum[-1]
        return CorrelatedErrors(points, self.base.size, basis, np.maximum(spectrum, rounding), points.y - stated.y)

    def for_search(self) -> AutoCorrelated:
        return self
