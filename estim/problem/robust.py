"""The shape of errors that the word `robust` of a noise table selects, and what is unknown of
it; weights of readings that may be outliers.
"""

from __future__ import annotations

import math

import numpy as np

from estim.arrays import FloatArray
from estim.common import Notation, phrase
from estim.problem.installed_tails import tails_called
from estim.problem.observations import Parameter
from estim.problem.priors import DefaultNormal, DefaultUniform
from estim.problem.tails import GAUSSIAN, OutlierMixture, StudentT, Tails

# Cauchy's weights are 95 % efficient where an error this many standard deviations off is taken to
# be 1.4 times as wide
_CAUCHY = 2.385
MOST_REWEIGHTED = 12


def typical_size(residuals: FloatArray) -> float:
    """Standard deviation of most of the `residuals` (n_obs,); of normal ones half are below 0.6745
    of it.
    """
    return max(
        float(np.median(np.abs(residuals))) / 0.6745, 1e-9 * float(np.max(np.abs(residuals)))
    )


def errors_widened(residuals: FloatArray) -> FloatArray:
    """(n_obs,) how much wider the errors of readings are to be taken with `residuals` (n_obs,) from
    a curve, so that least squares are not decided by a few of them: Cauchy's weights, of
    iteratively reweighted least squares (Holland and Welsch, Commun. Stat. A 6 (1977) 813).
    """
    size = _CAUCHY * typical_size(residuals)
    return np.hypot(1.0, residuals / size) if size else np.ones(residuals.size)


def shape_of(robust: str | None, suffix: str) -> tuple[Tails, tuple[Parameter, ...]]:
    """The shape of the errors that the word `robust` selects, or that an installed package has by
    that name, and its unknowns.  Raises InputError.
    """
    if robust is None:
        return GAUSSIAN, ()
    if robust == "student-t":
        return StudentT(), ()
    if robust == "mixture":
        fraction, width = f"outlier_fraction{suffix}", f"log_outlier_width{suffix}"
        return OutlierMixture(fraction, width), (
            Parameter(
                fraction,
                "1",
                DefaultUniform(0.0, 0.5),
                phrase("fraction of the readings that are outliers"),
                Notation(phrase("outlier fraction")),
            ),
            Parameter(
                width,
                "1",
                DefaultNormal(math.log(20.0), 1.0, math.log(3.0), math.inf),
                phrase(
                    "ln of the ratio of the standard deviation of an outlier to that of a "
                    "good reading"
                ),
                Notation(phrase("ln outlier width")),
            ),
        )
    return tails_called(robust), ()
