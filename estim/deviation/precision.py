"""The precision that the components of a mixture have together at a point: that of white noise,
changed in a few directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Precision:
    """Q = white I + span core span^T of whitened observations; span : (n_obs, n) orthonormal
    columns.
    """

    white: float
    span: FloatArray
    core: FloatArray

    def root_times(self, rows: FloatArray) -> FloatArray:
        """Rows times a symmetric root of Q."""
        spectrum, basis = np.linalg.eigh(self.core)
        lifted = np.sqrt(np.maximum(self.white + spectrum, 0.0)) - np.sqrt(self.white)
        turned = self.span @ basis
        return np.asarray(np.sqrt(self.white) * rows + ((rows @ turned) * lifted) @ turned.T)
