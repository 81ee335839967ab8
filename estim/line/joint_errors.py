"""A line through points whose errors are correlated with each other: any covariance matrix of all x
and y (ISO/TS 28037, clauses 9 and 10).

With V the covariance matrix (2 n_obs, 2 n_obs) of the errors of x, then of y, the errors across a
line of angle theta have the covariance C = cos^2 V_yy - sin cos (V_xy + V_yx) + sin^2 V_xx, and S =
d^T C^-1 d is what least squares over all true abscissas leave (generalised distance regression).
The formulas are those of `angle.profile` and of `least_squares`, with matrices in place of sums
over points.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError

MOST_POINTS = 300  # each direction that is tried costs the cube of their number
_FLOOR = 1e-14  # of the mean variance: what is exact across a line has that of rounding


@dataclass(frozen=True)
class Common:
    """An error that all readings of an axis share.  axis : "x" or "y".  u : standard uncertainty, a
    share of the reading where `relative`.
    """

    axis: str
    u: float
    relative: bool = False

    def covariance(self, values: FloatArray) -> FloatArray:
        """(n_obs, n_obs), where the readings are `values` (n_obs,)."""
        pattern = values if self.relative else np.ones(values.size)
        return self.u**2 * np.outer(pattern, pattern)


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


def with_common(
    joint: FloatArray, common: Sequence[Common], x: FloatArray, y: FloatArray
) -> FloatArray:
    """The same with errors that all readings share; relative ones are shares of x and y (n_obs,),
    best the values of a line.
    """
    n, total = x.size, joint.copy()
    for error in common:
        part = slice(0, n) if error.axis == "x" else slice(n, 2 * n)
        total[part, part] += error.covariance(x if error.axis == "x" else y)
    return total


def check_joint(cov: FloatArray, n_obs: int) -> FloatArray:
    """The matrix as floats of its own, read-only.  Raises InputError where it is no covariance
    matrix of x and y.
    """
    matrix = np.array(cov, dtype=np.float64)
    if matrix.shape != (2 * n_obs, 2 * n_obs):
        rule = f"must have {2 * n_obs} rows and columns: those of all x, then of all y"
        raise InputError(rule, field="cov", value="×".join(map(str, matrix.shape)))
    if n_obs > MOST_POINTS:
        raise InputError(f"allows at most {MOST_POINTS} points", field="cov", value=n_obs)
    if not np.all(np.isfinite(matrix)):
        raise InputError("must be finite", field="cov")
    variances = np.diag(matrix)
    size = np.sqrt(np.outer(np.abs(variances), np.abs(variances)))
    if not np.all(np.abs(matrix - matrix.T) <= 1e-9 * size + 1e-300):
        raise InputError("must be symmetric", field="cov")
    scale = np.where(variances > 0.0, np.sqrt(np.abs(variances)), 1.0)
    if (
        np.any(variances < 0.0)
        or float(np.linalg.eigvalsh(matrix / np.outer(scale, scale)).min()) < -1e-9
    ):
        raise InputError(
            "must have no negative variance in any direction (is it a matrix of "
            "covariances, in the squares of units?)",
            field="cov",
        )
    matrix = 0.5 * (matrix + matrix.T)
    matrix.flags.writeable = False
    return matrix


class JointProfile(NamedTuple):
    """What `angle.Profile` holds, each (n_angle,)."""

    chi2: FloatArray
    score: FloatArray
    information: FloatArray
    offset: FloatArray
    weight: FloatArray
    centre: FloatArray


def joint_profile(
    angles: FloatArray, x: FloatArray, y: FloatArray, cov: FloatArray
) -> JointProfile:
    """S and its derivatives for angles (n_angle,); x, y (n_obs,) and cov (2 n_obs, 2 n_obs) in
    scaled units.

    The place of an adjusted point along the line is that read, less its regression on the misfits
    across it, cov(along, across) C^-1 d.
    """
    n = x.size
    v_xx, v_xy, v_yy = cov[:n, :n], cov[:n, n:], cov[n:, n:]
    floor = _FLOOR * float(np.trace(cov)) / n * np.eye(n)
    rows = []
    for s, c in zip(np.sin(angles), np.cos(angles), strict=True):
        across = c * c * v_yy - s * c * (v_xy + v_xy.T) + s * s * v_xx + floor
        shared = c * c * v_xy - s * c * v_xx + s * c * v_yy - s * s * v_xy.T
        solved = np.linalg.solve(across, np.column_stack([np.ones(n), c * y - s * x]))
        ones, weight = solved[:, 0], float(solved[:, 0].sum())
        offset = float(solved[:, 1].sum()) / weight
        misfit, weighted = c * y - s * x - offset, solved[:, 1] - offset * ones
        along = c * x + s * y - shared @ weighted
        centre = float(ones @ along) / weight
        information = float((along - centre) @ np.linalg.solve(across, along - centre))
        rows.append(
            (float(misfit @ weighted), float(weighted @ along), information, offset, weight, centre)
        )
    return JointProfile(*np.array(rows).reshape(-1, 6).T)


def propagated_joint(
    x: FloatArray, y: FloatArray, cov: FloatArray, b: float, a: float
) -> FloatArray:
    """Covariance (2, 2) of intercept and slope: H^-1 J V J^T H^-1, H and J the derivatives of grad
    S / 2 by (a, b) and by all readings.
    """
    n = x.size
    v_xx, v_xy, v_yy = cov[:n, :n], cov[:n, n:], cov[n:, n:]
    across = v_yy - b * (v_xy + v_xy.T) + b * b * v_xx
    turned = 2.0 * b * v_xx - (v_xy + v_xy.T)  # d across / d b
    w = np.linalg.inv(across + _FLOOR * float(np.trace(cov)) / n * np.eye(n))
    wd = w @ (y - a - b * x)
    bent = w @ turned @ wd
    ones = np.ones(n)
    h_ab = float(ones @ w @ x + ones @ bent)
    h_bb = float(x @ w @ x + 2.0 * x @ bent + wd @ turned @ bent - wd @ v_xx @ wd)
    inverse = np.linalg.inv(np.array([[float(ones @ w @ ones), h_ab], [h_ab, h_bb]]))
    by_x = np.vstack([b * (w @ ones), b * (w @ x) - wd + b * bent])
    by_y = np.vstack([-(w @ ones), -(w @ x) - bent])
    slopes = np.hstack([by_x, by_y])
    return np.asarray(inverse @ slopes @ cov @ slopes.T @ inverse)
