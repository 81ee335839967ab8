"""What a density is multiplied by so that readings of many runs do not pull what the runs share
(`estim.fitting.readings` says why, and makes it).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, IntArray

# posterior standard deviations beyond which a measure that is known about the fit grows no further
_REACH = 4.0


@dataclass(frozen=True, eq=False)
class Measure:
    """exp(slope^T (s - centre)) of the parameters s that several runs share.

    columns : (n_shared,) their places among the parameters.
    centre, slope : (n_shared,).
    spread : posterior standard deviation of the exponent.
    felt : by how many standard deviations it moves the mean of the shared parameter that it moves
        most.
    n_run : runs whose readings it is of.
    """

    columns: IntArray
    centre: FloatArray
    slope: FloatArray
    spread: float
    felt: float
    n_run: int

    def log(self, shared: FloatArray) -> FloatArray:
        """(n_draw,) its logarithm at shared (n_draw, n_shared), 0 at the fit."""
        return np.clip(
            (shared - self.centre) @ self.slope, -_REACH * self.spread, _REACH * self.spread
        )
