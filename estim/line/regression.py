"""A straight line y = intercept + slope x through measured points, and every published standard
error of it.

What to use when:

- no uncertainties known: ``fit_line(x, y)``, ordinary least squares ("ols").  The scatter of the
  residuals is the only information on the uncertainty, so intervals use Student's t.
- only y uncertain: give ``u_y`` ("weighted", ISO/TS 28037 clause 6).
- x and y uncertain: give ``u_x`` and ``u_y``, and ``r_xy`` if the two errors of a point are
  correlated ("york").
- errors of different points correlated: give ``cov``, the covariance matrix of all x, then all y
  ("correlated", ISO/TS 28037 clauses 9 and 10).

``u_x``, ``u_y`` are standard uncertainties (one sd) of the readings of each point, independent
between points.  An error of the zero of an axis is part of ``cov`` (`joint_covariance`), one of
its scale is added to the result (`stated_errors`); scatter beyond the stated uncertainties is for
``posterior.py``.

All three methods are one computation, described in ``angle_profile.py``; it needs no starting
values and cannot diverge.

Standard errors: ``fit.standard_errors`` holds every convention in print, ``CONVENTIONS`` names
their papers.  For errors in both variables "propagated" is recommended: it holds its probability in
simulation (``benchmarks/line_coverage.py``).  "york" is too small where both uncertainties are a
tenth of the range or more: York's adjusted points still scatter along the line, so they seem to
span a wider range than the true ones do; with many points u_slope is too small by the factor 1 +
(variance of an adjusted abscissa about the true one)/(variance of the true abscissas).  For a slope
that is not well known, ``slope_interval`` in ``interval.py`` is exact and not forced to be
symmetric.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.checks import P_POOR_FIT
from estim.common import (
    InputError,
    Shown,
    Tabled,
    format_p,
    format_quantity,
    later,
    phrase,
    require_one_of,
)
from estim.distributions import chi2_quantile, chi2_tail, student_quantile
from estim.given_numbers import check_probability, real_number, real_numbers
from estim.line.angle_profile import (
    AngleProfile,
    LineData,
    ScaledPoints,
    best_angle,
    line_data,
    profile,
    scaled_points,
)
from estim.line.conventions import recommendation


class StandardError(NamedTuple):
    """Standard uncertainties of a line; intercept and slope follow from the last two, which lose no
    digits far from x = 0.
    """

    u_intercept: float  # unit of y
    u_slope: float  # unit of y / unit of x
    cov: float  # covariance of intercept and slope, = -x_pivot u_slope^2
    x_pivot: float  # abscissa where the line's height is uncorrelated with its slope
    u_pivot: float  # standard uncertainty of the height there

    @classmethod
    def of(
        cls, cov: FloatArray, x0: float, scale: tuple[float, float] = (1.0, 1.0)
    ) -> StandardError:
        """From the covariance (2, 2) of height at x0 and slope, in units `scale` of x and y."""
        pivot = -float(cov[0, 1] / cov[1, 1]) if cov[1, 1] > 0.0 else 0.0
        u_pivot = scale[1] * math.sqrt(max(cov[0, 0] + pivot * cov[0, 1], 0.0))
        u_slope, x_pivot = scale[1] / scale[0] * math.sqrt(cov[1, 1]), x0 + scale[0] * pivot
        u_intercept = math.hypot(u_pivot, x_pivot * u_slope)
        return cls(u_intercept, u_slope, -x_pivot * u_slope**2, x_pivot, u_pivot)


@dataclass(frozen=True, eq=False, repr=False)
class LineFit(Tabled):
    """The best line, its standard errors by every convention, and the diagnostics of the fit.

    intercept : unit of y; nan for a vertical line.
    slope : unit of y / unit of x; inf for a vertical line.
    chi2 : S at the minimum; for "ols" the sum of squared residuals (unit of y^2).
    dof : n_obs - 2.
    p_value : chance of a larger S if line and uncertainties are right; nan for "ols", which cannot
        know.
    method : "ols", "weighted" or "york".
    standard_errors : convention -> its standard errors; CONVENTIONS names the sources.
    recommended : the convention to quote.  reason : why that one, a sentence.
    message : what went wrong, a sentence; "" if nothing.
    data : the points.

    >>> from estim import fit_line
    >>> line = fit_line([1.0, 2.0, 3.0, 4.0], [2.1, 3.9, 6.2, 7.8], u_y=0.2)
    >>> line.recommended, round(line.slope, 2), line.dof
    ('propagated', 1.94, 2)
    """

    intercept: float
    slope: float
    chi2: float
    dof: int
    p_value: float
    method: str
    standard_errors: Mapping[str, StandardError]
    recommended: str
    reason: str
    message: str
    data: LineData

    def shown(self) -> Shown:
        """The line by every convention, and what to know before using it."""
        rows = [
            (
                phrase(name),
                *map(format_quantity, (self.intercept, self.slope), (u.u_intercept, u.u_slope)),
            )
            for name, u in self.standard_errors.items()
        ]
        if self.method == "ols":
            scatter = math.sqrt(self.chi2 / self.dof)
            fit = phrase(
                "scatter {scatter:.3g}, {dof} degrees of freedom", scatter=scatter, dof=self.dof
            )
        else:
            fit = phrase("S = {chi2:.4g}, {dof} degrees of freedom", chi2=self.chi2, dof=self.dof)
            fit += "" if math.isnan(self.p_value) else f", {format_p(self.p_value)}"
        quoted = phrase(
            "Quote {name}: {reason}.", name=phrase(self.recommended), reason=self.reason
        )
        known = math.isfinite(self.slope)
        return Shown(
            phrase("Line, method {method}: {fit}", method=self.method, fit=fit),
            (phrase("convention"), phrase("intercept"), phrase("slope")),
            rows,
            [*filter(None, (self.message,)), *([quoted] if known else [])],
            phrase(self.recommended) if known else "",
        )


def fit_line(
    x: ArrayLike,
    y: ArrayLike,
    *,
    u_x: ArrayLike | None = None,
    u_y: ArrayLike | None = None,
    r_xy: ArrayLike = 0.0,
    cov: ArrayLike | None = None,
) -> LineFit:
    """The line of least S = sum (y_i - a - b x_i)^2 / (u_y^2 - 2 b r u_x u_y + b^2 u_x^2), the
    global minimum over a and b.

    x, y : (n_obs,), n_obs >= 3 (two points leave nothing to check).
    u_x, u_y : (n_obs,) or one number, unit of x, y; None means exact if the other is given.
    r_xy : (n_obs,) or one number in (-1, 1).
    cov : (2 n_obs, 2 n_obs) covariance of all x, then all y, in place of the three; S is then d^T
        C^-1 d with C the covariance of y - b x.  Standard errors: "york", "propagated", "scaled"
        for methods "york" and "correlated"; the first two are the same for "weighted", which has
        "propagated" and "scaled"; "ols" has "scaled".  Raises InputError for data that break a
        rule.  Source: York, Evensen, Lopez Martinez and De Basabe Delgado 2004, Am. J. Phys. 72,
        367, eq. (1) for S.

    >>> from estim import fit_line
    >>> line = fit_line([1.0, 2.0, 3.0, 4.0], [2.1, 3.9, 6.2, 7.8], u_y=0.2)
    >>> round(line.slope, 2), line.recommended
    (1.94, 'propagated')
    """
    data = line_data(x, y, u_x=u_x, u_y=u_y, r_xy=r_xy, cov=cov)
    points = scaled_points(data)
    angle, contrast = best_angle(points)
    best = profile(np.asarray(angle), points)
    chi2, dof = float(best.chi2), len(data.x) - 2
    p_value = float("nan") if data.method == "ols" else float(chi2_tail(chi2, dof))
    intercept, slope = points.line(angle, float(best.offset))
    vertical = abs(np.cos(angle)) < 1e-12
    if vertical:
        intercept, slope = float("nan"), float("inf")
    if vertical or best.information <= 0.0:
        errors = dict.fromkeys(_names(data.method), StandardError(*[float("nan")] * 5))
    else:
        errors = _standard_errors(
            points, angle, best, method=data.method, scale=float(np.sqrt(chi2 / dof))
        )
    recommended, reason = recommendation(data, chi2, dof, p_value)
    return LineFit(
        intercept=intercept,
        slope=slope,
        chi2=chi2,
        dof=dof,
        p_value=p_value,
        method=data.method,
        standard_errors=MappingProxyType(errors),
        recommended=recommended,
        reason=reason,
        message=_message(
            vertical, contrast if data.method != "ols" else np.inf, chi2, dof, p_value, errors
        ),
        data=data,
    )


def _names(method: str) -> tuple[str, ...]:
    return {"ols": ("scaled",), "weighted": ("propagated", "scaled")}.get(
        method, ("york", "propagated", "scaled")
    )


def _standard_errors(
    points: ScaledPoints, angle: float, best: AngleProfile, *, method: str, scale: float
) -> dict[str, StandardError]:
    """All conventions that make sense for the method, in the units of the data."""
    slope = float(np.tan(angle))
    cos = float(np.cos(angle))
    # adjusted points: variances of the angle, and of the offset at the points' centre, are
    # independent there; far from it one very precise point would leave rounding errors
    x_mean = float(best.centre) * cos - float(best.offset) * float(np.sin(angle))
    york = np.diag([1.0 / (float(best.weight) * cos**2), 1.0 / (float(best.information) * cos**4)])
    propagated = _propagated(points, slope, float(best.offset) / cos, x_mean)
    cov = {"york": york, later("propagated"): propagated, later("scaled"): scale**2 * york}
    x0 = points.origin[0] + points.scale[0] * x_mean
    return {name: StandardError.of(cov[name], x0, points.scale) for name in _names(method)}


def _propagated(points: ScaledPoints, b: float, a: float, x0: float) -> FloatArray:
    """Covariance (2, 2) of (a + b x0, b): H^-1 J V J^T H^-1, H and J the derivatives of grad S by
    them and by all data.

    Source: Krystek and Anton 2007, Meas. Sci. Technol. 18, 3438, section 4.
    """
    x, d, across = points.x - x0, points.y - a - b * points.x, points.across(b)
    turned = 2.0 * b * points.var_x - points.twice_cov_xy  # d across / d b
    w, wx, wd = (points.solve(across, values) for values in (np.ones(x.size), x, d))
    turned_wd = points.times(turned, wd)
    bent = points.solve(across, turned_wd)
    h_ab = float(w @ x + bent.sum())
    h_bb = float(wx @ x + 2.0 * x @ bent + turned_wd @ bent - wd @ points.times(points.var_x, wd))
    by_x = np.array([b * w, b * wx - wd + b * bent])
    by_y = np.array([-w, -wx - bent])

    def spread(cov: FloatArray, rows: FloatArray) -> FloatArray:
        return np.array([points.times(cov, row) for row in rows])

    cross = by_x @ spread(points.cov_xy, by_y).T
    middle = by_x @ spread(points.var_x, by_x).T + by_y @ spread(points.var_y, by_y).T
    inverse = np.linalg.inv(np.array([[float(w.sum()), h_ab], [h_ab, h_bb]]))
    return inverse @ (middle + cross + cross.T) @ inverse


def _message(
    vertical: bool,
    contrast: float,
    chi2: float,
    dof: int,
    p_value: float,
    errors: Mapping[str, StandardError],
) -> str:
    """What a reader must know before using the numbers; "" if nothing."""
    sentences = []
    if vertical:
        sentences.append(
            phrase("The best line is vertical: it has no slope and no intercept; exchange x and y.")
        )
    elif not all(np.isfinite(value) for error in errors.values() for value in error):
        sentences.append(
            phrase("The points coincide along the line, so there are no standard errors.")
        )
    if contrast < chi2_quantile(0.95, 1):
        sentences.append(
            phrase(
                "The data do not determine the direction of the line: S varies by only "
                "{contrast:.2g} over all directions.",
                contrast=contrast,
            )
        )
    if p_value < P_POOR_FIT:
        sentences.append(
            phrase(
                "Poor fit: S = {chi2:.4g} with {dof} degrees of freedom ({p}).",
                chi2=chi2,
                dof=dof,
                p=format_p(p_value),
            )
        )
    return " ".join(sentences)


class LineValues(NamedTuple):
    """The line at chosen abscissas."""

    values: FloatArray  # (n_x,) intercept + slope x, unit of y
    u: FloatArray  # (n_x,) their standard uncertainties


@dataclass(frozen=True, eq=False)
class LineBand:
    """An interval of y at each abscissa, arrays (n_x,) and read-only; each holds pointwise, not for
    the whole line at once.
    """

    x: FloatArray
    centre: FloatArray  # the line
    low: FloatArray
    high: FloatArray
    probability: float


class InversePrediction(NamedTuple):
    """The abscissa at which the line reaches a measured y."""

    x0: float  # unit of x
    u_x0: float  # its standard uncertainty, linear propagation
    low: float  # symmetric interval x0 -+ k u_x0
    high: float


def line_values(fit: LineFit, x: ArrayLike, *, convention: str | None = None) -> LineValues:
    """The line at x and its standard uncertainty: u^2 = u_a^2 + x^2 u_b^2 + 2 x cov = u_pivot^2 +
    (x - x_pivot)^2 u_b^2.

    x : (n_x,) or one number.
    convention : a name in ``fit.standard_errors``; None is the recommended one.  Source: GUM H.3.4.
    """
    at = np.atleast_1d(real_numbers(x, "x"))
    error = standard_error(fit, convention)
    return LineValues(
        fit.intercept + fit.slope * at,
        np.hypot(error.u_pivot, (at - error.x_pivot) * error.u_slope),
    )


def confidence_band(
    fit: LineFit, x: ArrayLike, *, probability: float = 0.95, convention: str | None = None
) -> LineBand:
    """Where the line is, pointwise: line -+ k u, k normal, or Student's t for "scaled".

    fit : the line.  x : (n_x,) where, unit of x.
    probability : that the line is within, at each x by itself.
    convention : a name in ``fit.standard_errors``; None is the recommended one.

    Raises InputError.  Source: GUM H.3.4.

    >>> from estim import confidence_band, fit_line
    >>> line = fit_line([1.0, 2.0, 3.0, 4.0], [2.1, 3.9, 6.2, 7.8], u_y=0.2)
    >>> band = confidence_band(line, [2.5], probability=0.68)
    >>> band.low.round(2).tolist(), band.high.round(2).tolist()
    ([4.9], [5.1])
    """
    values, u = line_values(fit, x, convention=convention)
    return _band(
        x,
        values,
        coverage_factor(fit, probability=probability, convention=convention) * u,
        probability,
    )


def prediction_band(
    fit: LineFit,
    x: ArrayLike,
    *,
    probability: float = 0.95,
    u_y: ArrayLike | None = None,
    u_x: ArrayLike = 0.0,
    convention: str | None = None,
) -> LineBand:
    """Where one more reading of y will fall: line -+ k sqrt(u^2 + u_y^2 + slope^2 u_x^2).

    fit : the line.  x : (n_x,) where, unit of x.  probability : that the reading is within.
    u_y : standard uncertainty of the new reading, (n_x,) or one number; None is the scatter of the
        residuals, for "ols" only.
    u_x : of the abscissa at which it is taken.
    convention : a name in ``fit.standard_errors``; None is the recommended one.

    Raises InputError.

    >>> from estim import fit_line, prediction_band
    >>> line = fit_line([1.0, 2.0, 3.0, 4.0], [2.1, 3.9, 6.2, 7.8], u_y=0.2)
    >>> band = prediction_band(line, [2.5], probability=0.68, u_y=0.2)
    >>> band.low.round(2).tolist(), band.high.round(2).tolist()
    ([4.78], [5.22])
    """
    values, u = line_values(fit, x, convention=convention)
    reading = np.sqrt(
        _reading_uncertainty(fit, u_y, "u_y") ** 2 + (fit.slope * real_numbers(u_x, "u_x")) ** 2
    )
    factor = coverage_factor(fit, probability=probability, convention=convention)
    return _band(x, values, factor * np.hypot(u, reading), probability)


def inverse_prediction(
    fit: LineFit,
    y0: float,
    *,
    u_y0: float | None = None,
    probability: float = 0.95,
    convention: str | None = None,
) -> InversePrediction:
    """x0 = (y0 - a)/b for a new reading y0, u^2(x0) = (u_y0^2 + u_a^2 + x0^2 u_b^2 + 2 x0 cov)/b^2.

    fit : the line.  probability : of the interval.
    convention : a name in ``fit.standard_errors``; None is the recommended one.
    u_y0 : standard uncertainty of y0; None is the scatter of the residuals, for "ols" only.  Linear
        in the uncertainties: not for a slope that is uncertain by more than about 10 %.  Raises
        InputError.  Source: ISO/TS 28037:2010, 11.1.

    >>> from estim import fit_line, inverse_prediction
    >>> line = fit_line([1.0, 2.0, 3.0, 4.0], [2.1, 3.9, 6.2, 7.8], u_y=0.2)
    >>> found = inverse_prediction(line, 5.0, u_y0=0.2)
    >>> round(found.x0, 3), round(found.u_x0, 3)
    (2.5, 0.115)
    """
    if not np.isfinite(fit.slope) or fit.slope == 0.0:
        raise InputError(
            "has no inverse: the line is horizontal or vertical", field="slope", value=fit.slope
        )
    x0 = (real_number(y0, "y0") - fit.intercept) / fit.slope
    u_line = float(line_values(fit, x0, convention=convention).u[0])
    u_x0 = float(np.hypot(u_line, _reading_uncertainty(fit, u_y0, "u_y0"))) / abs(fit.slope)
    half = coverage_factor(fit, probability=probability, convention=convention) * u_x0
    return InversePrediction(x0, u_x0, x0 - half, x0 + half)


def standard_error(fit: LineFit, convention: str | None = None) -> StandardError:
    """The standard errors by that convention, by the recommended one if None.  Raises InputError if
    the fit has none such.
    """
    name = fit.recommended if convention is None else convention
    require_one_of(name, fit.standard_errors, field="convention")
    return fit.standard_errors[name]


def coverage_factor(fit: LineFit, *, probability: float, convention: str | None = None) -> float:
    """k such that estimate -+ k u holds the value with that probability: Student's t where the
    scale is from the residuals.
    """
    check_probability(probability)
    tail = 0.5 * (1.0 - probability)
    standard_error(fit, convention)
    scaled = (fit.recommended if convention is None else convention) == "scaled"
    return -float(student_quantile(tail, fit.dof if scaled else math.inf))


def _reading_uncertainty(fit: LineFit, u: ArrayLike | None, field: str) -> FloatArray:
    if u is None and fit.method != "ols":
        raise InputError(
            "must be given: the fit contains the uncertainty of its points, but not that "
            "of the new reading",
            field=field,
        )
    values = real_numbers(np.sqrt(fit.chi2 / fit.dof) if u is None else u, field)
    if not np.all(values >= 0.0):
        raise InputError("must be >= 0", field=field, value=u)
    return values


def _band(x: ArrayLike, centre: FloatArray, half: FloatArray, probability: float) -> LineBand:
    band = LineBand(
        np.atleast_1d(np.array(x, dtype=np.float64)),
        centre,
        centre - half,
        centre + half,
        probability,
    )
    for array in (band.x, band.centre, band.low, band.high):
        array.flags.writeable = False
    return band
