"""Densities, tails and quantiles of the normal, Student's t and the chi-squared distribution, from
scipy.special: scipy.stats is slow to import.

What to use when: for an interval value ± k u `normal_quantile` where u was stated and
`student_quantile` where it was estimated from `dof` residuals; for the p-value of a chi^2
`chi2_tail`.  A quantile far out is minus the one of the small probability, which keeps its digits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from estim.arrays import FloatArray

_LOG_ROOT_2PI = 0.5 * np.log(2.0 * np.pi)


def normal_log_density(z: ArrayLike) -> FloatArray:
    """log p(z) of Z, normal of mean 0 and variance 1."""
    return -0.5 * np.square(z) - _LOG_ROOT_2PI


def normal_below(z: ArrayLike) -> FloatArray:
    """P(Z <= z)."""
    return special.ndtr(z)


def normal_tail(z: ArrayLike) -> FloatArray:
    """P(Z > z)."""
    return normal_below(-np.asarray(z))


def normal_quantile(probability: ArrayLike) -> FloatArray:
    """z with P(Z <= z) = probability."""
    return np.asarray(special.ndtri(probability))


def student_log_density(t: ArrayLike, dof: float) -> FloatArray:
    """log p(t) of T for finitely many `dof` > 0 degrees of freedom."""
    half = 0.5 * (dof + 1.0)
    norm = special.gammaln(half) - special.gammaln(0.5 * dof) - 0.5 * np.log(dof * np.pi)
    return norm - half * np.log1p(np.square(t) / dof)


def student_tail(t: ArrayLike, dof: ArrayLike) -> FloatArray:
    """P(T > t) for `dof` > 0 degrees of freedom; nan for none."""
    t, dof = np.asarray(t), np.asarray(dof)
    return np.where(
        np.isinf(dof), normal_tail(t), special.stdtr(np.where(np.isinf(dof), 1.0, dof), -t)
    )


def student_quantile(probability: ArrayLike, dof: ArrayLike) -> FloatArray:
    """t with P(T <= t) = probability for `dof` > 0 degrees of freedom, the normal quantile for
    infinitely many; nan for none.
    """
    dof = np.asarray(dof)
    return np.where(
        np.isinf(dof),
        normal_quantile(probability),
        special.stdtrit(np.where(np.isinf(dof), 1.0, dof), probability),
    )


def chi2_tail(chi2: ArrayLike, dof: ArrayLike) -> FloatArray:
    """P(chi^2 of `dof` > 0 degrees of freedom > chi2); 1 for a sum of squares that rounding made
    negative.
    """
    return np.asarray(special.chdtrc(dof, np.maximum(chi2, 0.0)))


def chi2_quantile(probability: ArrayLike, dof: ArrayLike) -> FloatArray:
    """x with P(chi^2 of `dof` degrees of freedom <= x) = probability."""
    return 2.0 * special.gammaincinv(0.5 * np.asarray(dof), probability)
