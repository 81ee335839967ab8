"""The exact interval of a straight line's slope, not forced to be symmetric.

Quote it instead of "slope -+ k u_slope" when the slope is not well known: few points, or x
uncertainties that are not small against the range.  Its coverage is the stated one for any number
of points and any size of u_x, if errors are normal and their uncertainties (with "scaled": the
ratios of their uncertainties) are right.  It may be unbounded, as an honest interval must be where
the points do not exclude a vertical line.  For exact x it is the classical symmetric interval.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from estim.arrays import FloatArray
from estim.common import phrase
from estim.line.angle_profile import profile, scaled_points
from estim.line.regression import LineFit, coverage_factor


class SlopeInterval(NamedTuple):
    """Slopes compatible with the points."""

    low: float  # unit of y / unit of x; -inf where unbounded
    high: float  # inf where unbounded
    probability: float
    message: str  # why it is unbounded, a sentence; "" if it is not


def slope_interval(
    fit: LineFit, *, probability: float = 0.95, convention: str | None = None
) -> SlopeInterval:
    """The slopes around the best one with t^2 < k^2, where t = score/sqrt(information) at that
    slope.

    At the true slope t is exactly standard normal (see ``angle_profile.profile``).  Where the scale
    comes from the residuals (convention "scaled") t^2/[(S - t^2)/(n - 2)] is exactly the square of
    Student's t with n - 2 degrees of freedom.  At the best slope the information is York's
    1/u_slope^2: York's "estimate -+ k u" is the linear approximation of this set.  Only the
    connected part of the set that holds the best slope is returned.

    probability : of the interval.
    convention : a name in ``fit.standard_errors``; None is the recommended one.  Raises InputError.
        Source: score test with an orthogonalised instrument, Kleibergen 2002, Econometrica 70,
        1781; for one exact variable Fieller 1954, J. R. Stat. Soc. B 16, 175.

    >>> from estim import fit_line, slope_interval
    >>> line = fit_line([1.0, 2.0, 3.0, 4.0], [2.1, 3.9, 6.2, 7.8], u_y=0.2)
    >>> found = slope_interval(line)
    >>> round(found.low, 2), round(found.high, 2)
    (1.76, 2.12)
    """
    k2 = coverage_factor(fit, probability=probability, convention=convention) ** 2
    scaled = (convention or fit.recommended) == "scaled"
    points = scaled_points(fit.data)

    def excess(angle: FloatArray) -> FloatArray:
        at = profile(angle, points)
        score2 = at.score**2
        return (
            score2 * fit.dof - k2 * (at.chi2 * at.information - score2)
            if scaled
            else score2 - k2 * at.information
        )

    best = float(np.arctan(fit.slope * points.scale[0] / points.scale[1]))
    low, high = _angles_around(best, excess)
    if not np.isfinite(low) or not np.isfinite(high):
        return SlopeInterval(
            -np.inf,
            np.inf,
            probability,
            phrase("The slope is unbounded: the points do not exclude a vertical line."),
        )
    return SlopeInterval(points.line(low, 0.0)[1], points.line(high, 0.0)[1], probability, "")


def _angles_around(best: float, excess: Callable[[FloatArray], FloatArray]) -> tuple[float, float]:
    """Where ``excess``, negative at ``best``, first turns positive on either side before the
    vertical; -inf, inf if not.
    """
    from scipy.optimize import brentq

    def scalar(angle: float) -> float:
        return float(excess(np.asarray(angle)))

    angles: list[float] = []
    for sign, room in ((-1.0, best + np.pi / 2), (1.0, np.pi / 2 - best)):
        steps = np.concatenate([[0.0], np.geomspace(1e-9, 1.0, 500)]) * max(room, 0.0)
        outside = np.flatnonzero(excess(best + sign * steps) > 0.0)
        if len(outside) == 0:
            angles.append(sign * np.inf)
            continue
        first = int(outside[0])
        if first == 0:  # a perfect fit whose scale is zero: the interval has no width
            angles.append(best)
            continue
        inner, outer = best + sign * steps[first - 1], best + sign * steps[first]
        angles.append(float(brentq(scalar, inner, outer, xtol=1e-300, rtol=1e-15)))
    return angles[0], angles[1]
