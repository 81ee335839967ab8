"""The likelihood of points about a curve that lacks something: a mixture of normal errors with
covariances C_k, weights w_k (`mixture_likelihood`).

    log L(r) = log sum_k w_k N(r | 0, C_k),    r: `estim.discrepancy.residuals`

The mixture was made once, at the fit with white errors and a free start.  Tests whiten with its
most probable covariance alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.discrepancy.mixture_likelihood import Mixture
from estim.discrepancy.residuals import Residuals
from estim.problem import ROOTED, Likelihood, Linear, Named, Points, Root, StackedPoints, rooted


@dataclass(frozen=True, eq=False)
class MixtureErrors(Likelihood):
    """Points of a run, or of several below each other, whose errors are a mixture.

    formed : how the residuals are formed.
    likely : the root of the most probable covariance, which whitens in the order of the points.
    """

    points: Points | StackedPoints
    mixture: Mixture
    likely: Root
    formed: Residuals

    creeps, resolved = True, ROOTED

    @property
    def y(self) -> FloatArray:
        return self.points.y - self.formed.shift

    def log_likelihood(self, named: Named) -> FloatArray:
        return self.mixture.log_likelihood(
            self.raw(named), weight=self.formed.weight(self.points, named)
        )

    def pointwise(self, named: Named) -> FloatArray:
        return self.mixture.pointwise(self.raw(named))

    def standardised(self, named: Named) -> FloatArray:
        return self.likely.whiten(self.raw(named))

    def residuals(self, named: Named) -> FloatArray:
        """z times what makes their squares sum to the loss of log likelihood; 1 where nothing is
        lost but rounding.
        """
        raw = self.raw(named)
        z = self.likely.whiten(raw)
        loss = 2.0 * (self.mixture.highest - self.mixture.log_likelihood(raw))
        square = np.sum(z**2, axis=1)
        lost = (loss > 1e-9) & (square > 0.0)
        return z * np.sqrt(np.divide(loss, square, out=np.ones_like(loss), where=lost))[:, None]

    def scoring(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """With the precision Q that the components have together at the point (`Mixture.pulls`)."""
        raw, whiten = self.raw(named)[0], self.mixture.deviation.whiten
        slopes = whiten(self.gradient(named, names).T)
        pulls = self.mixture.pulls(slopes, raw)
        return rooted(pulls @ slopes.T, pulls @ whiten(raw), raw.size)

    def information_root(self, named: Named, names: Sequence[str]) -> FloatArray:
        """Of errors with the covariance that the components have together at the point."""
        return self.mixture.likely(self.raw(named)[0]).whiten(-self.gradient(named, names).T).T

    def whitened(self, named: Named, names: Sequence[str]) -> Linear:
        return Linear(
            self.likely.whiten(self.raw(named)[0]),
            self.likely.whiten(self.gradient(named, names).T).T,
        )

    def sd(self, named: Named) -> FloatArray:
        return np.sqrt(self.mixture.likely(self.raw(named)[0]).variances)

    def residuals_at(self, named: Named) -> FloatArray:
        """(n_obs,) for single values."""
        return self.raw(named)[0]

    def gradient(self, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_obs, n) minus their derivatives in the parameters `names`, for single values."""
        return self.formed.gradient(self.points, named, names)

    def raw(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) the residuals."""
        return self.formed.at(self.points, named)
