"""The shape of errors that the word `robust` of a noise table asks for, and what is unknown of
it.
"""

from __future__ import annotations

import math

from estim.common import Notation, phrase
from estim.problem.observations import Parameter
from estim.problem.priors import TruncatedNormal, Uniform
from estim.problem.tails import GAUSSIAN, Mixture, StudentT, Tails


def shape_of(robust: str | None, suffix: str) -> tuple[Tails, tuple[Parameter, ...]]:
    """The shape of the errors that the word `robust` asks for, and its unknowns."""
    if robust == "student-t":
        return StudentT(), ()
    if robust == "mixture":
        fraction, width = f"outlier_fraction{suffix}", f"log_outlier_width{suffix}"
        return Mixture(fraction, width), (
            Parameter(
                fraction,
                "1",
                Uniform(0.0, 0.5),
                phrase("fraction of the readings that are outliers"),
                Notation(phrase("outlier fraction")),
            ),
            Parameter(
                width,
                "1",
                TruncatedNormal(math.log(20.0), 1.0, math.log(3.0), math.inf),
                phrase(
                    "ln of the ratio of the standard deviation of an outlier to that of a "
                    "good reading"
                ),
                Notation(phrase("ln outlier width")),
            ),
        )
    return GAUSSIAN, ()
