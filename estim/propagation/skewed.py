"""The normal copula of two inputs of which at least one is not symmetric about its value."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError

_N_TERM = 60


def skewed_coefficient(
    first: Callable[[FloatArray], FloatArray],
    second: Callable[[FloatArray], FloatArray],
    target: float,
    names: tuple[str, str],
) -> float:
    """Correlation of two normal variates whose transforms by the standardised quantile maps `first`
    and `second` have correlation `target`.

    sum_k a_k b_k rho^k over all degrees k of the orthonormal Hermite polynomials; the terms left
    out go to the last odd and even one, so that rho = -1 and 1 are exact.  Raises InputError where
    the two distributions cannot have that correlation.
    """
    from scipy.optimize import brentq

    step = 0.005
    z = step * (np.arange(-2400, 2400, dtype=np.float64) + 0.5)
    weight = np.asarray(step * np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi), dtype=np.float64)
    scores = [map_(z) for map_ in (first, second)]
    scores = [
        (s - np.sum(weight * s)) / math.sqrt(np.sum(weight * s**2) - np.sum(weight * s) ** 2)
        for s in scores
    ]
    product = np.empty(_N_TERM)
    below, here = np.zeros_like(z), np.ones_like(z)
    for degree in range(_N_TERM):
        product[degree] = np.sum(weight * scores[0] * here) * np.sum(weight * scores[1] * here)
        below, here = here, (z * here - math.sqrt(degree) * below) / math.sqrt(degree + 1)
    low = float(np.sum(weight * scores[0] * scores[1][::-1]))
    high = float(np.sum(weight * scores[0] * scores[1]))
    product[-1] += 0.5 * (high - low) - product[1::2].sum()
    product[-2] += 0.5 * (high + low) - product[0::2].sum()
    if not low <= target <= high:
        rule = (
            f"between '{names[0]}' and '{names[1]}' can be {low:.4f} to {high:.4f} with these "
            "distributions"
        )
        raise InputError(rule, field="correlation", value=target)
    powers = np.arange(_N_TERM)
    return float(
        brentq(lambda rho: float(np.sum(product * rho**powers)) - target, -1.0, 1.0, xtol=1e-14)
    )
