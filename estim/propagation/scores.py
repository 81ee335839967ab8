"""The distributions of inputs as standardised quantiles: (x - value)/u as a function of the normal
quantile z.

Every map increases with z and has mean 0 and, but for ``t``, variance 1.  Sources: JCGM 101, 6.4
(its trapezoids, with half width 1, in 6.4.3 and 6.4.4); the lognormal and the gamma distribution by
their mean and standard deviation.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from scipy import special

from estim.arrays import FloatArray
from estim.distributions import normal_tail, student_quantile

Distribution = Literal[
    "normal",
    "rectangular",
    "triangular",
    "trapezoidal",
    "curvilinear-trapezoidal",
    "arcsine",
    "t",
    "standardised-t",
    "exponential",
    "lognormal",
    "gamma",
]
SHAPED = {"trapezoidal", "curvilinear-trapezoidal"}
BOUNDED = ("rectangular", "triangular", "trapezoidal", "curvilinear-trapezoidal", "arcsine")
POSITIVE = {"lognormal", "gamma"}
_PLATEAUS = {"rectangular": 1.0, "triangular": 0.0}  # as trapezoids: of their base


def half_width_in_u(distribution: str, shape: float) -> float:
    """Half width of a bounded distribution divided by its standard deviation (GUM 4.3.7, 4.3.9;
    JCGM 101, 6.4.2-6.4.6).
    """
    if distribution == "arcsine":
        return math.sqrt(2.0)
    if distribution == "curvilinear-trapezoidal":
        return 1.0 / math.sqrt(1.0 / 3.0 + shape**2 / 9.0)
    return math.sqrt(6.0 / (1.0 + _PLATEAUS.get(distribution, shape) ** 2))


def score(
    z: FloatArray, distribution: str, *, dof: float, shape: float, relative: float
) -> FloatArray:
    """(x - value)/u at the normal quantiles `z`, any shape.

    dof : of the two t.
    shape : of the two trapezoids, see `Input`.  relative : u/value, of the lognormal and the gamma
        distribution.
    """
    if distribution == "normal":
        return z
    if distribution == "exponential":
        return -special.log_ndtr(-z) - 1.0
    if distribution == "lognormal":
        sigma = math.sqrt(math.log1p(relative**2))
        return np.expm1(sigma * z - 0.5 * sigma**2) / relative
    if distribution == "gamma":
        k = relative**-2
        below = special.gammaincinv(k, special.ndtr(np.minimum(z, 0.0)))
        # the probability in the nearer tail keeps its digits
        above = special.gammainccinv(k, normal_tail(np.maximum(z, 0.0)))
        return (np.where(z < 0.0, below, above) - k) / math.sqrt(k)
    return np.copysign(_magnitude(normal_tail(np.abs(z)), distribution, dof, shape), z)


def _magnitude(tail: FloatArray, distribution: str, dof: float, shape: float) -> FloatArray:
    """Of a symmetric distribution: the score that is exceeded with probability `tail`, at most
    1/2.
    """
    if distribution in ("t", "standardised-t"):
        scale = 1.0 if distribution == "t" else math.sqrt((dof - 2.0) / dof)
        return -scale * student_quantile(tail, dof)
    width = half_width_in_u(distribution, shape)
    if distribution == "arcsine":
        return width * np.cos(math.pi * tail)
    if distribution == "curvilinear-trapezoidal":
        return width * _curvilinear(tail, shape)
    plateau = _PLATEAUS.get(distribution, shape)
    height = 1.0 / (1.0 + plateau)
    slope = 1.0 - np.sqrt(2.0 * tail * (1.0 - plateau) / height)
    return width * np.where(tail <= 0.5 * height * (1.0 - plateau), slope, (0.5 - tail) / height)


def _curvilinear(tail: FloatArray, d: float) -> FloatArray:
    """The curvilinear trapezoid with half width 1, known to +/- d: y with P(Y > y) = tail.

    Y = W V with V uniform on (-1, 1) and W on (1 - d, 1 + d).  Where y < 1 - d, P(|Y| > y) = 1 - y
    ln((1 + d)/(1 - d))/(2 d); beyond, with q = y/(1 + d), (1 + d)(1 - q + q ln q)/(2 d), which
    Newton's method solves from the left.
    """
    flat = math.inf if d == 1.0 else math.log1p(2.0 * d / (1.0 - d)) / (2.0 * d)
    inner = (1.0 - 2.0 * tail) / flat
    target = np.minimum(4.0 * d / (1.0 + d) * tail, 1.0)
    q = np.maximum(1.0 - np.sqrt(2.0 * target), 1e-12)
    for _ in range(8):
        slope = np.log(q)
        q = np.minimum(
            q
            - np.where(
                slope < 0.0, (1.0 - q + q * slope - target) / np.where(slope < 0.0, slope, 1.0), 0.0
            ),
            1.0,
        )
    outer = np.minimum((1.0 + d) * q, 1.0 + d)
    return np.where(inner < 1.0 - d, inner, np.maximum(outer, 1.0 - d))
