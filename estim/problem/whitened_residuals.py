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

import math
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, positive_or
from estim.problem.count_distributions import Law, deviance_residual

_LEAST = 1e-300  # expectation or variance, so that nothing is divided by 0


@dataclass(frozen=True, eq=False)
class Linear:
    """Residuals z (n_obs,) that are linear in the parameters, with minus their derivatives `root`
    (n_obs, n_par).
    """

    z: FloatArray
    root: FloatArray

    def drawn(self, n_sim: int, rng: np.random.Generator) -> FloatArray:
        """(n_obs, n_sim) errors of new data, of variance 1."""
        return rng.standard_normal((self.z.size, n_sim))

    def score_residuals(self, errors: FloatArray) -> FloatArray:
        """(n, n_sim) r with J^T r the derivative of the log likelihood, for errors that were
        `drawn`.
        """
        return errors

    def moved(self, errors: FloatArray, shifts: FloatArray) -> FloatArray:
        """(n_obs, n_sim) the residuals when the parameters are moved by shifts (n_par, n_sim)."""
        moved = self.root @ shifts
        return np.subtract(errors, moved, out=moved)

    @property
    def slopes_at_fit(self) -> FloatArray:
        """(n_obs, n_par) minus the derivatives of each residual."""
        return self.root


@dataclass(frozen=True, eq=False)
class TabulatedScores(Linear):
    """Normal scores z (n_obs,) of points with errors of x: what they tell about the parameters is
    not linear in them, and a table gives it.

    at : (n_at,) normal scores.  scores, slopes : (n_obs, n_at, n_par) of the log likelihood of a
        point and of its normal score, for a y of that score.
    """

    at: FloatArray
    scores: FloatArray
    slopes: FloatArray

    def score_residuals(self, errors: FloatArray) -> FloatArray:
        score = np.zeros((self.scores.shape[2], errors.shape[1]))
        for error, table in zip(errors, self.scores, strict=True):
            for row, column in zip(score, table.T, strict=True):
                row += np.interp(error, self.at, column)
        scale = positive_or(np.linalg.norm(self.root, axis=0), 1.0)
        return np.linalg.pinv((self.root / scale).T, rcond=1e-9) @ (score / scale[:, None])

    def moved(self, errors: FloatArray, shifts: FloatArray) -> FloatArray:
        moved = errors.copy()
        for row, error, table in zip(moved, errors, self.slopes, strict=True):
            for column, shift in zip(table.T, shifts, strict=True):
                row += np.interp(error, self.at, column) * shift
        return moved

    @property
    def slopes_at_fit(self) -> FloatArray:
        """Means over the errors."""
        weights = np.exp(-0.5 * self.at**2)
        return -np.einsum("iaj,a->ij", self.slopes, weights / weights.sum())


@dataclass(frozen=True, eq=False)
class CountedResiduals:
    """Signed roots of the deviance as tests use them, and those of counts drawn at the fit, which
    move its expectations.

    mean, sd : (n_obs,) at the fit.  root : (n_obs, n_par) derivatives of the mean over sd.
    """

    law: Law
    y: FloatArray
    mean: FloatArray
    trials: FloatArray
    root: FloatArray
    sd: FloatArray

    @property
    def z(self) -> FloatArray:
        return deviance_residual(self.law, self.y, self.mean, self.trials)

    @property
    def slopes_at_fit(self) -> FloatArray:
        """(n_obs, n_par) 0: where few were counted, the residual of a bin that a parameter follows
        is not as small as its derivatives say.
        """
        return np.zeros_like(self.root)

    def drawn(self, n_sim: int, rng: np.random.Generator) -> FloatArray:
        mean = np.repeat(self.mean[:, None], n_sim, axis=1)
        counts = self.law.draw(mean, self.trials[:, None], rng)
        return (counts - mean) / self.sd[:, None]

    def score_residuals(self, errors: FloatArray) -> FloatArray:
        return errors

    def moved(self, errors: FloatArray, shifts: FloatArray) -> FloatArray:
        """To first order, and by a factor where that would leave less than half of an expectation
        (of a fraction: of its complement).
        """
        by = self.sd[:, None] * (self.root @ shifts)
        mean = self.mean[:, None]
        trials = self.trials[:, None]
        with np.errstate(all="ignore"):
            slack = np.maximum(self.sd[:, None] ** 2 * trials, _LEAST)  # m, or m (1 - m)
            moved = np.where(
                by > -0.5 * slack,
                mean + by,
                mean - slack * (1.0 - 0.5 * np.exp(2.0 * by / slack + 1.0)),
            )
            if math.isfinite(self.law.ceiling):
                moved = np.where(
                    by > 0.5 * slack,
                    mean + slack * (1.0 - 0.5 * np.exp(1.0 - 2.0 * by / slack)),
                    moved,
                )
        # a difference of what is alike may leave nothing
        moved = np.clip(moved, _LEAST, self.law.ceiling)
        return deviance_residual(self.law, mean + self.sd[:, None] * errors, moved, trials)


Whitened = Linear | CountedResiduals
"""The residuals of a run as tests see them, and how a fit pulls them.

z : (n_obs,) in the order of the points; independent and standard normal at the true parameters.
root : (n, n_par) J with J^T J the information that the run gives about the curve.
"""
