"""A line through points whose errors are correlated with each other: any covariance matrix of all x
and y (ISO/TS 28037, clauses 9 and 10).

With V the covariance matrix (2 n_obs, 2 n_obs) of the errors of x, then of y, the errors across a
line of angle theta have the covariance C = cos^2 V_yy - sin cos (V_xy + V_yx) + sin^2 V_xx, and S =
d^T C^-1 d is what least squares over all true abscissas leave (generalised distance regression).
The formulas are those of `angle_profile.profile` and of `regression`, with matrices in place of
sums over points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError
from estim.problem import check_covariance

MOST_POINTS = 300  # each direction that is tried costs the cube of their number


@dataclass(frozen=True)
class Common:
    """An error that all readings of an axis share.  axis : "x" or "y".  u : standard uncertainty of
    the zero, or of the scale where `relative`.
    """

    axis: str
    u: float
    relative: bool = False


def joint_covariance(
    u_x: FloatArray,
    u_y: FloatArray,
    r_xy: FloatArray,
    *,
    cov_x: FloatArray | None = None,
    cov_y: FloatArray | None = None,
) -> FloatArray:
    """(2 n_obs, 2 n_obs) covariance of x, then y: from each point's own errors (n_obs,), or from
    the matrices (n_obs, n_obs) in their place.
    """
    n = u_x.size
    joint = np.zeros((2 * n, 2 * n))
    joint[:n, :n] = np.diag(u_x**2) if cov_x is None else cov_x
    joint[n:, n:] = np.diag(u_y**2) if cov_y is None else cov_y
    joint[:n, n:] = joint[n:, :n] = np.diag(r_xy * u_x * u_y)
    return joint


def with_zeros(joint: FloatArray, common: Sequence[Common]) -> FloatArray:
    """The same with the errors of zeros that all readings share; those of scales are left out."""
    n, total = len(joint) // 2, joint.copy()
    for error in common:
        part = slice(0, n) if error.axis == "x" else slice(n, 2 * n)
        total[part, part] += 0.0 if error.relative else error.u**2
    return total


def check_joint(cov: FloatArray, n_obs: int) -> FloatArray:
    """The matrix, read-only.  Raises InputError where it is no covariance matrix of x and y."""
    if cov.shape != (2 * n_obs, 2 * n_obs):
        raise InputError(
            f"must have {2 * n_obs} rows and columns: those of all x, then of all y",
            field="cov",
            value="×".join(map(str, cov.shape)),
        )
    if n_obs > MOST_POINTS:
        raise InputError(f"allows at most {MOST_POINTS} points", field="cov", value=n_obs)
    return check_covariance(cov, 2 * n_obs, field="cov", singular=True)
