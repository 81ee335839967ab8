"""Observations whose density a user defines: the curve is the logarithm of the density of each one.

`LogDensity` is the noise.  Nothing is known of residuals here, so that nothing tests the density;
there are no readings and no errors, and y are 0.  Least squares run on roots of what each log
density lacks to one that none is likely to exceed, and creep; steps by the curvature of the
log-likelihood finish, whose inverse is the covariance.  Intervals are profiles, priors flat where
none are stated, as those of counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, Named, all_finite, diagonal_scale
from estim.common import phrase
from estim.problem.curve import Wording
from estim.problem.errors_in_x import ROOTED, rooted
from estim.problem.likelihood import Likelihood, Noise, Points, n_draws
from estim.problem.noise_variance import NoiseVariance, Scale

_ROOM = 5.0  # of a log density above the highest of all
_STEP = 1e-3  # conditional standard deviations, of differences of the slopes
_BENT = 1e-4  # of the largest curvature, that a negative one may be by the errors of differences


@dataclass(frozen=True, eq=False)
class DensityErrors(Likelihood):
    """highest : what no log density of an observation exceeds."""

    points: Points
    highest: float

    creeps, resolved = True, ROOTED

    def pointwise(self, named: Named) -> FloatArray:
        return np.broadcast_to(self.points.value(named), (n_draws(named), self.y.size))

    def residuals(self, named: Named) -> FloatArray:
        return np.sqrt(2.0 * np.maximum(self.highest - self.pointwise(named), 0.0))

    def information_root(self, named: Named, names: Sequence[str]) -> FloatArray:
        return self.scoring(named, names)[0]

    def scoring(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        scores = self.points.gradient(named, names)
        return rooted(self._curvature(named, names, scores), np.sum(scores, axis=0), self.y.size)

    def sd(self, named: Named) -> FloatArray:
        return np.ones(self.y.size)

    def _curvature(self, named: Named, names: Sequence[str], scores: FloatArray) -> FloatArray:
        """(n_par, n_par) minus the second derivatives of the log-likelihood; where they are not
        those of a maximum, the sum of the squared slopes (Berndt, Hall, Hall and Hausman, 1974).
        """
        outer = scores.T @ scores
        size = diagonal_scale(outer)
        rows = []
        for name, step in zip(names, _STEP / size, strict=True):
            below, above = (
                np.sum(self.points.gradient({**named, name: named[name] + by}, names), axis=0)
                for by in (-step, step)
            )
            rows.append((below - above) / (2.0 * step))
        bent = 0.5 * (np.array(rows) + np.transpose(rows))
        if not (names and all_finite(bent)):
            return outer
        curvatures = np.linalg.eigvalsh(bent / np.outer(size, size))
        return bent if curvatures[0] > -_BENT * curvatures[-1] else outer


@dataclass(frozen=True, eq=False)
class OwnDensity(Noise):
    """n_obs : how many observations there are."""

    n_obs: int

    size = NoiseVariance(Scale(1.0))
    own_density = holds_slopes = True

    def reading_gain(self) -> FloatArray:
        return np.zeros(self.n_obs)

    def likelihood(self, points: Points, named: Named) -> Likelihood:
        known = points.value(named)
        return DensityErrors(
            points, _ROOM + float(np.max(known[np.isfinite(known)], initial=-1e300))
        )

    def read(
        self, true: FloatArray, gain: FloatArray, named: Named, rng: np.random.Generator
    ) -> FloatArray:
        return true

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        return phrase("a user-defined log density of {n} observations", n=self.n_obs)
