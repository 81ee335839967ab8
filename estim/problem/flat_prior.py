"""A flat prior: every value between two limits, or on the whole line, is as probable as any other.

Where a limit is infinite the prior is improper: data make the posterior proper, but nothing can be drawn from the prior
and the evidence (and so a Bayes factor) is not defined.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import InputError, phrase
from estim.problem.priors import Uniform


@dataclass(frozen=True)
class Flat(Uniform):
    """Constant density between low and high, which may be infinite.

    start : where a fit begins.  stated : whether a person said so, or it was found from the points.
    """

    start: float = 0.0
    stated: bool = True

    def __post_init__(self) -> None:
        for field, limit in (("low", self.low), ("high", self.high)):
            if math.isnan(limit):
                raise InputError("must be a number", field=field, value=limit)
        if not self.low < self.high:
            raise InputError("must be below 'high'", field="low", value=self.low)
        if not math.isfinite(self.start):
            raise InputError("must be finite", field="start", value=self.start)
        if not (self.low <= self.start <= self.high):
            raise InputError(f"must lie within [{self.low:.6g}, {self.high:.6g}]", field="start", value=self.start)

    @property
    def proper(self) -> bool:
        """Whether it is a probability density: both limits are finite."""
        return math.isfinite(self.high - self.low)

    @property
    def centre(self) -> float:
        return self.start

    @property
    def expectation(self) -> float:
        return 0.5 * (self.low + self.high) if self.proper else math.nan

    @property
    def sd(self) -> float:
        return (self.high - self.low) / math.sqrt(12.0) if self.proper else math.inf

    def log_density(self, value: ArrayLike) -> FloatArray:
        """Log density, -inf outside the limits; 0 inside where the prior is improper."""
        value = np.asarray(value)
        height = -math.log(self.high - self.low) if self.proper else 0.0
        return np.where((value >= self.low) & (value <= self.high), height, -np.inf)

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        if not self.proper:
            raise InputError("has a flat prior without limits: nothing can be drawn from it", field="prior")
        return rng.uniform(self.low, self.high, size)

    def describe(self) -> str:
        if self.proper:
            return phrase("uniform in [{low:.4g}, {high:.4g}]", low=self.low, high=self.high)
        if math.isfinite(self.low):
            return phrase("flat above {low:.4g}", low=self.low)
        return phrase("flat below {high:.4g}", high=self.high) if math.isfinite(self.high) else phrase("flat, no limits")
