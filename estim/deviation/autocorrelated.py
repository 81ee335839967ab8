"""Stated noise whose errors follow each other: those of successive readings are correlated by a fixed number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.deviation.noise import Stated
from estim.problem import DENSE, CorrelatedErrors, Differences, Named, Points, RootErrors, in_bands


@dataclass(frozen=True, eq=False)
class AutoCorrelated(Stated):
    """Errors of readings with corr(e_i, e_j) = correlation^|i - j| (AR(1)), of the stated size; readings in the order of their times.

    Speeds made of positions: of the positions.  A further scatter stays white.
    """

    correlation: float

    def likelihood(self, points: Points, named: Named) -> CorrelatedErrors | RootErrors:
        stated = self.base.likelihood(points, named)
        matrix = self.base.of_positions(points, named)
        matrix = Differences.of_single(points.x.size).rows_times(self.base.reading_gain()) if matrix is None else matrix
        if points.x.size > DENSE and in_bands(self.base.size):
            return RootErrors.of_bands(points, self.base.size, matrix.covariance(self.correlation), points.y - stated.y)
        lever, steps = matrix.among(matrix.used).dense(), np.flatnonzero(matrix.used)
        covariance = lever @ self.correlation ** np.abs(np.subtract.outer(steps, steps)) @ lever.T
        spectrum, basis = np.linalg.eigh(covariance)
        rounding = np.finfo(float).eps * spectrum.size * spectrum[-1]
        return CorrelatedErrors(points, self.base.size, basis, np.maximum(spectrum, rounding), points.y - stated.y)

    def for_search(self) -> AutoCorrelated:
        return self
