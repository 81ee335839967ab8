"""Counted readings: how many events fell into each bin, or what fraction of trials succeeded.

`Counts` is the noise, `CountErrors` what it makes of points and the curve of their expectations
(`estim.problem.count_distributions` has the laws).  Residuals are signed roots of the
deviance, so that least squares on them are the maximum of the likelihood; where counts are few they
are far from linear, and steps by the Fisher information (`scoring`) finish: iteratively reweighted
least squares (McCullagh and Nelder, Generalized Linear Models, 2nd ed., 1989, section 2.5).  Tests
see the same residuals against counts that are drawn at the fit.

The likelihood of a count of 0 still rises where it ends, at an expectation of 0.  It goes on beyond
with a quadratic penalty of the same slope there, so that a search may move along the end (Nocedal
and Wright, Numerical Optimization, 2nd ed., 2006, chapter 17); this adds a millionth to the
deviance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estim.arrays import FloatArray, Named
from estim.common import phrase
from estim.problem.count_distributions import Counted, Law, deviance_residual
from estim.problem.curve import POINTS, Wording
from estim.problem.curve_noise import Readings
from estim.problem.likelihood import Likelihood, Noise, Points
from estim.problem.noise_variance import NoiseVariance, Scale
from estim.problem.whitened_residuals import CountedResiduals

# standard deviation, in counts, of the penalty where a single count of 0 is expected to be less
_PENALTY = 1e-3


@dataclass(frozen=True, eq=False)
class CountErrors(Likelihood):
    """Independent counts y (n_obs,) about the curve; trials : (n_obs,), 1 where the law has
    none.
    """

    points: Points
    law: Law
    trials: FloatArray

    creeps = True

    @cached_property
    def penalty(self) -> float:
        """Standard deviation, in counts, of the penalty of each point: of many that end the
        likelihood together as narrow, beside what they tell, as that of one.
        """
        ends = np.isfinite(self.law.unseen(self.y, self.y, self.trials))
        return _PENALTY / math.sqrt(max(1, int(np.sum(ends))))

    def pointwise(self, named: Named) -> FloatArray:
        mean, none = self._expected(named)
        penalty = np.where(none < 0.0, none + 0.5 * np.square(none / self.penalty), 0.0)
        return self.law.log_density(self.y, mean, self.trials) - penalty

    def residuals(self, named: Named) -> FloatArray:
        """Signed roots of the deviance, which are closer to normal than (y - m)/sd."""
        mean, none = self._expected(named)
        root = deviance_residual(self.law, self.y, mean, self.trials)
        unseen = np.where(
            none < 0.0, none / self.penalty + self.penalty, np.sqrt(root**2 + self.penalty**2)
        )
        return np.where(np.isfinite(none), np.where(self.y > 0.0, unseen, -unseen), root)

    def scoring(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        return self.information_root(named, names), self._score(named) * self.sd(named)

    def whitened(self, named: Named, names: Sequence[str]) -> CountedResiduals:
        mean = self._expected(named)[0][0]
        return CountedResiduals(
            self.law,
            self.y,
            mean,
            self.trials,
            CountErrors.information_root(self, named, names),
            self.sd(named),
        )

    def sd(self, named: Named) -> FloatArray:
        variance = self.law.variance(self._expected(named)[0][0], self.trials)
        return np.sqrt(np.maximum(variance, np.square(self.penalty / self.trials)))

    def _expected(self, named: Named) -> tuple[FloatArray, FloatArray]:
        """(n_draw, n_obs) expectations, and how many the curve expects of what was never observed:
        inf at all other points.

        Of what was never observed, expectations below 0 (or above the ceiling) are at that limit.
        """
        mean = self.points.value(named)
        none = self.law.unseen(self.y, mean, self.trials)
        return np.where(none < 0.0, np.clip(mean, 0.0, self.law.ceiling), mean), none

    def _score(self, named: Named) -> FloatArray:
        """(n_obs,) derivatives of minus the log likelihood by the expectation."""
        mean, none = self._expected(named)
        with np.errstate(all="ignore"):
            score = (mean - self.y) / self.law.variance(mean, self.trials)
        edge = self.trials * (1.0 + np.minimum(none, 0.0) / self.penalty**2)
        edge = np.where(self.y > 0.0, -edge, edge)
        return np.where(none > 0.0, score, edge)[0]

    def information_root(self, named: Named, names: Sequence[str]) -> FloatArray:
        """Derivatives of the expectations over the standard deviations."""
        return self.points.gradient(named, names) / self.sd(named)[:, None]


@dataclass(frozen=True, eq=False)
class Counts(Counted, Noise):
    """Counted readings."""

    size = NoiseVariance(Scale(1.0))

    @property
    def counted(self) -> Counts:
        return self

    @cached_property
    def typical(self) -> FloatArray:
        """(n_obs,) standard deviation of each reading, as far as it shows by itself."""
        return self.law.guess(self.seen, self.trials)

    def likelihood(self, points: Points, named: Named) -> Likelihood:
        return CountErrors(points, self.law, self.trials)

    def for_search(self) -> Noise:
        """Readings about as precise: there linear parameters can be solved for."""
        return Readings(Scale(1.0), Scale(0.0), self.typical, what=self.what)

    def reading_gain(self) -> FloatArray:
        return self.typical

    def read(
        self, true: FloatArray, gain: FloatArray, named: Named, rng: np.random.Generator
    ) -> FloatArray:
        return self.law.draw(true, self.trials, rng)

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        """The noise in words."""
        where = "" if self.bins is None else phrase(", the curve integrated over each bin")
        if self.law.word == "counts":
            return (
                phrase("Poisson counts of {what}, whose expectation is the curve", what=self.what)
                + where
            )
        return (
            phrase(
                "binomial {law} of {what}, whose expectation is the curve",
                law=phrase(self.law.word),
                what=self.what,
            )
            + where
        )


def counted_words(what: str, new: str) -> Wording:
    """The words for counts: what they are, and one more of them."""
    return replace(POINTS, what=what, new=new, rows=what)
