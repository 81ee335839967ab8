"""Stated noise whose errors follow each other: those of successive readings are correlated by a
fixed number.
"""

from __future__ import annotations

from dataclasses import dataclass

from scipy.sparse import diags_array

from estim.discrepancy.noise_with_discrepancy import Stated
from estim.problem import GaussianErrors, Named, Points


@dataclass(frozen=True, eq=False)
class AutoCorrelated(Stated):
    """Errors of readings with corr(e_i, e_j) = correlation^|i - j| (AR(1)), of the stated size;
    readings in the order of their times.

    Speeds made of positions: of the positions.  A further scatter stays white.
    """

    correlation: float

    def likelihood(self, points: Points, named: Named) -> GaussianErrors:
        stated = self.base.likelihood(points, named)
        matrix = self.base.of_positions(points, named)
        matrix = diags_array(self.base.reading_gain(), format="csr") if matrix is None else matrix
        return GaussianErrors.of_readings(
            points, self.base.size, matrix, points.y - stated.y, correlation=self.correlation
        )
