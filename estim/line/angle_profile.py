"""Points of a straight line, checked, and S as a function of the line's angle.

``regression.py``, ``interval.py`` and ``posterior.py`` are built on this file; call those.
With theta the line's angle and (across, along) the coordinates normal to the line and in it,

    across_i = y_i cos theta - x_i sin theta
    v_i      = u_x^2 sin^2 theta - 2 r u_x u_y sin theta cos theta + u_y^2 cos^2 theta
    S(theta) = min over c of sum (across_i - c)^2 / v_i

so that a steep line is treated as a flat one is, and x and y may be exchanged.  S is scanned over
all directions and the root of dS/dtheta polished in every bracket that holds a minimum; the lowest
is the fit.  It needs no starting value and cannot diverge.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, sds_of
from estim.common import InputError
from estim.given_numbers import (
    check_lengths,
    check_size,
    finite_numbers,
    real_numbers,
    require_each,
)
from estim.line.joint_covariance import check_joint

# of the mean variance of all readings, and of a point's own: what is exact across a line has the
# variance of rounding
_FLOOR, _FLOOR_OF_POINT = 1e-14, 1e-30


@dataclass(frozen=True, eq=False)
class LineData:
    """Checked points of a line, each array (n_obs,) and read-only."""

    x: FloatArray  # abscissas as read
    y: FloatArray  # ordinates as read
    u_x: FloatArray  # standard uncertainties of x; 0 where x is exact
    u_y: FloatArray  # standard uncertainties of y; all 1 for "ols", where only their ratios count
    r_xy: FloatArray  # correlation of the x and y errors of one point
    method: str  # "ols", "weighted", "york" or "correlated": which uncertainties were given
    # (2 n_obs, 2 n_obs) covariance of x, then y, where errors of points are correlated
    cov: FloatArray | None = None


def line_data(
    x: ArrayLike,
    y: ArrayLike,
    *,
    u_x: ArrayLike | None = None,
    u_y: ArrayLike | None = None,
    r_xy: ArrayLike = 0.0,
    cov: ArrayLike | None = None,
) -> LineData:
    """The points of a line, checked once; arguments and rules as in ``fit_line``.  Raises
    InputError.
    """
    if cov is not None:
        if u_x is not None or u_y is not None or np.any(np.asarray(r_xy) != 0.0):
            raise InputError("holds all uncertainties: leave out u_x, u_y and r_xy", field="cov")
        return _correlated_data(x, y, cov)
    x_, y_ = _vector(x, "x", None), _vector(y, "y", None)
    n_obs = len(x_)
    check_lengths(x_, y_)
    if n_obs < 3:
        raise InputError("must have at least 3 points", field="x", value=n_obs)
    method = "york" if u_x is not None else "weighted" if u_y is not None else "ols"
    ux = _vector(0.0 if u_x is None else u_x, "u_x", n_obs)
    uy = _vector((1.0 if u_x is None else 0.0) if u_y is None else u_y, "u_y", n_obs)
    r = _vector(r_xy, "r_xy", n_obs)
    for field, values in (("u_x", ux), ("u_y", uy)):
        require_each(values >= 0.0, values, "must be >= 0", field, of_many=False)
        check_size(values, field, each=True)
    require_each(np.abs(r) < 1.0, r, "must lie between -1 and 1", "r_xy", of_many=False)
    if np.any(r != 0.0) and (u_x is None or u_y is None):
        raise InputError("needs both u_x and u_y", field="r_xy")
    require_each((ux > 0.0) | (uy > 0.0), uy, "and u_x must not both be 0", "u_y")
    if np.ptp(x_) == 0.0 and (np.ptp(y_) == 0.0 or not np.any(ux)):
        raise InputError("must not all be equal", field="x", value=float(x_[0]))
    if np.ptp(y_) == 0.0 and not np.any(uy):
        raise InputError("must not all be equal where y is exact", field="y", value=float(y_[0]))
    return LineData(x_, y_, ux, uy, r, method)


def _correlated_data(x: ArrayLike, y: ArrayLike, cov: ArrayLike) -> LineData:
    n = np.size(x)
    joint = check_joint(real_numbers(cov, "cov"), n)
    u = sds_of(joint)
    uncorrelated = line_data(x, y, u_x=u[:n], u_y=u[n:])
    size = np.where(
        uncorrelated.u_x * uncorrelated.u_y > 0.0, uncorrelated.u_x * uncorrelated.u_y, 1.0
    )
    return LineData(
        uncorrelated.x,
        uncorrelated.y,
        uncorrelated.u_x,
        uncorrelated.u_y,
        np.diag(joint[:n, n:]) / size,
        "correlated",
        joint,
    )


def _vector(values: ArrayLike, field: str, n_obs: int | None) -> FloatArray:
    """``values`` as a finite read-only (n_obs,) array of its own; one number is repeated where
    n_obs is known.
    """
    array = finite_numbers(values, field)
    if n_obs is not None and array.ndim == 0:
        array = np.full(n_obs, array)
    if array.ndim != 1 or (n_obs is not None and len(array) != n_obs):
        rule = (
            "must be one-dimensional" if n_obs is None else f"must be one number or {n_obs} values"
        )
        raise InputError(rule, field=field, value=array.shape)
    array.flags.writeable = False
    return array


class ScaledPoints(NamedTuple):
    """Points shifted to their mean and divided by their spread, so that an angle means the same in
    all units.

    Covariances are (n_obs,) where the errors of different points are independent, else (n_obs,
    n_obs); the formulas are the same.
    """

    x: FloatArray  # (n_obs,)
    y: FloatArray  # (n_obs,)
    var_x: FloatArray  # covariance of the errors of x
    var_y: FloatArray  # the same of y
    cov_xy: FloatArray  # covariance of the errors of x (rows) and y
    origin: tuple[float, float]  # mean of x and y in their own units
    scale: tuple[float, float]  # spread of x and y in their own units

    @property
    def dense(self) -> bool:
        """Whether errors of different points are correlated."""
        return self.var_x.ndim == 2

    def times(self, cov: FloatArray, values: FloatArray) -> FloatArray:
        """A covariance times values (n_obs,)."""
        return cov @ values if self.dense else cov * values

    def solve(self, cov: FloatArray, values: FloatArray) -> FloatArray:
        """The inverse of a covariance times values (n_obs,)."""
        return np.asarray(np.linalg.solve(cov, values) if self.dense else values / cov)

    @property
    def twice_cov_xy(self) -> FloatArray:
        """Covariance of the errors of x and y, and of y and x."""
        return self.cov_xy + self.cov_xy.T

    def across(self, b: float) -> FloatArray:
        """Covariance of y - b x."""
        return self.var_y - b * self.twice_cov_xy + b * b * self.var_x

    def line(self, angle: float, offset: float) -> tuple[float, float]:
        """Intercept and slope in the units of the data, of the line with that angle and distance
        from the origin.
        """
        (x0, y0), (scale_x, scale_y) = self.origin, self.scale
        slope = float(np.tan(angle)) * scale_y / scale_x
        return y0 + scale_y * offset / float(np.cos(angle)) - slope * x0, slope


def scaled_points(data: LineData) -> ScaledPoints:
    """Points in units of their own spread (standard deviation; the uncertainty where all values are
    equal).
    """
    x0, y0 = float(np.mean(data.x)), float(np.mean(data.y))
    scale_x, scale_y = _spread(data.x, data.u_x), _spread(data.y, data.u_y)
    n, u_x, u_y = data.x.size, data.u_x / scale_x, data.u_y / scale_y
    if data.cov is None:
        floor = _FLOOR_OF_POINT * (u_x**2 + u_y**2)
        var_x, var_y, cov_xy = u_x**2 + floor, u_y**2 + floor, data.r_xy * u_x * u_y
    else:
        units = np.repeat([scale_x, scale_y], n)
        cov = data.cov / np.outer(units, units)
        cov += _FLOOR * float(np.trace(cov)) / n * np.eye(2 * n)
        var_x, var_y, cov_xy = cov[:n, :n], cov[n:, n:], cov[:n, n:]
    return ScaledPoints(
        (data.x - x0) / scale_x,
        (data.y - y0) / scale_y,
        var_x,
        var_y,
        cov_xy,
        (x0, y0),
        (scale_x, scale_y),
    )


def _spread(values: FloatArray, u: FloatArray) -> float:
    return (
        float(np.std(values))
        if np.ptp(values) > 1e-14 * np.max(np.abs(values))
        else float(np.max(u))
    )


class AngleProfile(NamedTuple):
    """S and its derivatives along the angle, each shaped like the angle."""

    chi2: FloatArray  # S(theta), least over the offset
    score: FloatArray  # -dS/dtheta / 2
    # variance of the score given the adjusted points; its inverse is York's variance of the angle
    information: FloatArray
    offset: FloatArray  # distance of the best line of that angle from the origin
    weight: FloatArray  # 1 / variance of the offset
    centre: FloatArray  # weighted mean of the adjusted points, along the line


def profile(angle: FloatArray, points: ScaledPoints) -> AngleProfile:
    """S(theta) and the score of the angle.

    With d_i = across_i - c and w_i = 1/v_i, the score is sum w_i d_i z_i, where z_i = along_i +
    (v_i'/2 v_i) d_i is the position along the line of York's adjusted point.  Each d_i is
    independent of its z_i if theta is true (z is along with its regression on d removed), hence
    given z the score is exactly normal with variance sum w (z - mean z)^2, however few the points.

    angle : (n_angle,) or one, rad, in scaled units.  Source: York et al. 2004, eqs. (3)-(5),
        rotated; the score as in Kleibergen 2002, Econometrica 70, 1781.
    """
    if points.dense and angle.ndim:
        rows = [profile(direction, points) for direction in angle]
        return AngleProfile(*(np.array(values) for values in zip(*rows, strict=True)))
    s, c = np.sin(angle), np.cos(angle)
    if not points.dense:
        s, c = s[..., None], c[..., None]
    variance = s * s * points.var_x - s * c * points.twice_cov_xy + c * c * points.var_y
    shared = s * c * (points.var_y - points.var_x) + c * c * points.cov_xy - s * s * points.cov_xy.T
    across = c * points.y - s * points.x
    w = points.solve(variance, np.ones(points.x.size))
    total = w.sum(axis=-1)
    offset = (w * across).sum(axis=-1) / total
    d = across - offset[..., None]
    wd = points.solve(variance, d)
    z = c * points.x + s * points.y - points.times(shared, wd)
    centre = (w * z).sum(axis=-1) / total
    deviations = z - centre[..., None]
    information = (deviations * points.solve(variance, deviations)).sum(axis=-1)
    return AngleProfile(
        (d * wd).sum(axis=-1), (wd * deviations).sum(axis=-1), information, offset, total, centre
    )


def best_angle(points: ScaledPoints) -> tuple[float, float]:
    """Angle of the least S over all lines, and by how much S varies over the angle.

    Directions repeat after pi: on that circle every minimum lies between two scanned angles where
    the score changes from plus to minus.
    """
    from scipy.optimize import brentq

    fine = np.geomspace(1e-8, 1e-2, 13)
    even = (np.arange(180) + 0.5) * np.pi / 180.0
    scan = np.unique(
        np.concatenate([-even / 2, even / 2, fine, -fine, np.pi / 2 - fine, fine - np.pi / 2])
    )
    scan = np.append(scan, scan[0] + np.pi)
    at = profile(scan, points)
    contrast = float(np.ptp(at.chi2))

    def score(angle: float) -> float:
        return float(profile(np.asarray(angle), points).score)

    brackets = np.flatnonzero((at.score[:-1] > 0.0) & (at.score[1:] <= 0.0))
    roots = [brentq(score, scan[k], scan[k + 1], xtol=1e-300, rtol=1e-15) for k in brackets]
    # the scanned one only where S does not depend on the angle
    candidates = np.array([*roots, scan[int(np.argmin(at.chi2))]])
    angle = float(candidates[np.argmin(profile(candidates, points).chi2)])
    return (angle - np.pi if angle > np.pi / 2 else angle), contrast
