"""Residuals as tests see them, and how a fit pulls them: linear in the parameters, or by a table
where x has errors.

With J the Jacobian and J_p that of the priors, the fit turns standard normal errors e of data and
e_p of priors into

    z = e - J (J^T J + J_p^T J_p)^-1 (J^T e + J_p^T e_p)

Where x has errors, z is the normal score of y under its density given x, F^-1(P(Y < y | x)), for
any curve a standard normal variable at the true parameters; the score J^T e and the slope -J are
then functions of e, tabulated point by point.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Linear:
    """Residuals z (n_obs,) that are linear in the parameters, with minus their derivatives `root`
    (n_obs, n_par).
    """

    z: FloatArray
    root: FloatArray

    def drawn(self, n_sim: int, rng: np.random.Generator) -> FloatArray:
        return rng.standard_normal((self.z.size, n_sim))

    def felt(self, errors: FloatArray) -> FloatArray:
        return errors

    def moved(self, errors: FloatArray, shifts: FloatArray) -> FloatArray:
        return errors - self.root @ shifts


@dataclass(frozen=True, eq=False)
class Tabled:
    """Normal scores z (n_obs,) of points with errors of x: what they tell of the parameters is not
    linear in them, a table says what it is.

    root : (n, n_par).
    at : (n_at,) normal scores.  scores, slopes : (n_obs, n_at, n_par) of the log likelihood of a
        point and of its normal score, for a y of that score.
    """

    z: FloatArray
    root: FloatArray
    at: FloatArray
    scores: FloatArray
    slopes: FloatArray

    drawn = Linear.drawn

    def felt(self, errors: FloatArray) -> FloatArray:
        score = np.zeros((self.scores.shape[2], errors.shape[1]))
        for error, table in zip(errors, self.scores, strict=True):
            for row, column in zip(score, table.T, strict=True):
                row += np.interp(error, self.at, column)
        scale = np.linalg.norm(self.root, axis=0)
        scale[scale == 0.0] = 1.0
        return np.linalg.pinv((self.root / scale).T, rcond=1e-9) @ (score / scale[:, None])

    def moved(self, errors: FloatArray, shifts: FloatArray) -> FloatArray:
        moved = errors.copy()
        for row, error, table in zip(moved, errors, self.slopes, strict=True):
            for column, shift in zip(table.T, shifts, strict=True):
                row += np.interp(error, self.at, column) * shift
        return moved
