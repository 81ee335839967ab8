"""The posterior of a straight line with errors in both variables, intrinsic scatter and common zero
offsets.

Model of a point:  x_i = xi_i + zero_x + error,  y_i = intercept + slope xi_i + zero_y + scatter +
error,  with the true abscissas xi_i from a normal distribution N(mu_x, tau^2) that is fitted too
and integrated out.  What to use when:

- the stated uncertainties explain the scatter (``LineFit.p_value``): no ``scatter``.
- they do not, or none are known for y: ``scatter``, the sd of a half-normal prior on an extra
  normal scatter in y.
- all readings of an instrument share a zero error: ``u_zero_x``, ``u_zero_y``.  Where it moves
  all points equally they determine only intercept + zero_y - slope zero_x: with a flat intercept
  they do not constrain the zeros, whose uncertainty then simply widens the intercept.  Where it
  moves them by different amounts (an angle whose sine is y) it turns the line too.
- the line is known to pass through the origin: ``through_origin``.

Why tau: with d_i = y_i - a - b x_i of variance v_i, and z_i the abscissa with its regression on d_i
removed (York's adjusted point), the two are independent and the likelihood is

    prod N(d_i; 0, v_i) N(z_i; mu_x, tau^2 + (u_x^2 u_y^2 - cov^2)/v_i).

The first factor alone is the tempting N(y | a + b x, u_y^2 + b^2 u_x^2).  Its 1/sqrt(v_i) rewards
small slopes.  The second takes that reward back: a smaller slope spreads the adjusted points wider,
and a fitted tau charges for that.  Without it the slope is biased by an amount that more points do
not reduce.

Priors: flat in the line's angle, with x and y in units of their standard deviations, and in mu_x
and the intercept (or a normal intercept); half-Cauchy with scale sqrt(2) for the spread of the true
points along the line, tau sqrt(1 + slope^2) in the same units, which is what two coordinates of
unit sd have.  Exchanging x and y leaves that prior as it is.  Source: Gull 1989, in Maximum Entropy
and Bayesian Methods (Kluwer), p. 511; Kelly 2007, Astrophys. J. 665, 1489, eqs. (13)-(24).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, root_mean_square
from estim.common import InputError
from estim.given_numbers import real_numbers
from estim.line.angle_profile import LineData, line_data, scaled_points
from estim.line.regression import fit_line
from estim.problem import HalfNormal, Normal, Prior


@dataclass(frozen=True, eq=False)
class LinePosterior:
    """A line's posterior density; a sampler (`estim.sample_posterior`) takes it with ``start`` and
    the squares of ``step``.
    """

    # "intercept", "slope", "mu_x", "log_tau", "log_scatter", "zero_x", "zero_y": those that are
    # free
    names: tuple[str, ...]
    start: FloatArray  # (n_par,) a rough guess
    step: FloatArray  # (n_par,) rough sds
    data: LineData  # the points
    scale: tuple[float, float]  # sd of x and of y, the units of the prior on the angle
    # "intercept", "scatter" (in y), "zero_x", "zero_y" (offsets common to all points): those that
    # have one; a free intercept without one has a flat prior of density 1
    priors: Mapping[str, Prior]
    # "zero_x", "zero_y" -> (n_obs,) what of such an offset each point has, 1 where it has most
    gains: Mapping[str, FloatArray]

    def log_density(self, draws: ArrayLike) -> FloatArray:
        """log of likelihood times prior (n_draw,); -inf where it vanishes.

        draws : (n_draw, n_par) in the order of ``names``; log_tau is log(tau / unit of x),
            log_scatter log(sd / unit of y).  Normalised but for the flat priors of mu_x and, if
            flat, of the intercept.
        """
        values = np.asarray(draws, dtype=np.float64)
        column = {name: values[:, k] for k, name in enumerate(self.names)}
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            total = self._log_likelihood(column) + self._log_prior(column)
        # 0/0 and inf - inf arise only at the edge (a variance of zero, an infinite tau), where the
        # density vanishes
        return np.where(np.isnan(total), -np.inf, total)

    def _log_likelihood(self, column: dict[str, FloatArray]) -> FloatArray:
        data, zero = self.data, np.zeros(1)
        b = column["slope"][:, None]
        tau2 = np.exp(2.0 * column["log_tau"])[:, None]
        extra = np.exp(2.0 * column["log_scatter"])[:, None] if "scatter" in self.priors else 0.0
        x, y = (
            read - column.get(name, zero)[:, None] * self.gains.get(name, 1.0)
            for name, read in (("zero_x", data.x), ("zero_y", data.y))
        )
        var_x, cov_xy = data.u_x**2, data.r_xy * data.u_x * data.u_y
        var_y = extra + (0.0 if data.method == "ols" else data.u_y**2)
        d = y - column.get("intercept", zero)[:, None] - b * x
        b_var_x = b * var_x
        v = var_y + b * (b_var_x - 2.0 * cov_xy)
        z = x - column["mu_x"][:, None] + (b_var_x - cov_xy) / v * d
        determinant = tau2 * v + (var_x * var_y - cov_xy**2)
        chi2 = (d * d + (z * v) ** 2 / determinant) / v
        return -0.5 * np.sum(chi2 + np.log(determinant), axis=1) - len(data.x) * np.log(2.0 * np.pi)

    def _log_prior(self, column: dict[str, FloatArray]) -> FloatArray:
        ratio = self.scale[0] / self.scale[1]
        log_secant2 = np.log1p((column["slope"] * ratio) ** 2)
        log_spread = column["log_tau"] - np.log(self.scale[0]) + 0.5 * log_secant2
        total = (
            np.log(ratio / np.pi) - log_secant2 + np.log(2.0 * np.sqrt(2.0) / np.pi) + log_spread
        )
        total = total - np.logaddexp(np.log(2.0), 2.0 * log_spread)
        for name, prior in self.priors.items():
            if name == "scatter":
                log_scatter = column["log_scatter"]
                total = total + prior.log_density(np.exp(log_scatter)) + log_scatter
            else:
                total = total + prior.log_density(column[name])
        return total


def line_posterior(
    x: ArrayLike,
    y: ArrayLike,
    *,
    u_x: ArrayLike | None = None,
    u_y: ArrayLike | None = None,
    r_xy: ArrayLike = 0.0,
    scatter: float | None = None,
    u_zero_x: ArrayLike = 0.0,
    u_zero_y: ArrayLike = 0.0,
    intercept_sd: float | None = None,
    through_origin: bool = False,
) -> LinePosterior:
    """The posterior of the line through the points.

    y_i = intercept + slope xi_i + error,    x_i = xi_i + error,    xi_i of N(mu_x, tau^2)
    (Kelly 2007, Astrophys. J. 665, 1489)

    through_origin : the intercept is exactly 0.
    x, y, u_x, u_y, r_xy : as in ``fit_line``; without both uncertainties ``scatter`` must be given.
    scatter : unit of y, sd of the half-normal prior on the scatter.
    u_zero_x, u_zero_y : unit of x, y; of all points, or (n_obs,) where one error moves points by
        different amounts.
    intercept_sd : unit of y, sd of a normal prior on the intercept; needed for
        ``intercept_evidence``.  Raises InputError.

    >>> from estim import line_posterior
    >>> found = line_posterior([1.0, 2.0, 3.0, 4.0], [2.1, 3.9, 6.2, 7.8], u_y=0.2)
    >>> found.names, found.start.shape
    (('intercept', 'slope', 'mu_x', 'log_tau'), (4,))
    """
    data = line_data(x, y, u_x=u_x, u_y=u_y, r_xy=r_xy)
    if data.method == "ols" and scatter is None:
        raise InputError("must be given where neither u_x nor u_y is", field="scatter")
    for field, value in (("scatter", scatter), ("intercept_sd", intercept_sd)):
        if value is not None and not 0.0 < value < np.inf:
            raise InputError("must be > 0 and finite", field=field, value=value)
    zeros: dict[str, FloatArray] = {}
    for name, stated in (("zero_x", u_zero_x), ("zero_y", u_zero_y)):
        u = real_numbers(stated, f"u_{name}")
        if u.shape not in ((), data.x.shape) or not np.all((u >= 0.0) & np.isfinite(u)):
            rule = "must be >= 0 and finite, one or as many as points"
            raise InputError(rule, field=f"u_{name}", value=stated)
        if np.any(u > 0.0):
            zeros[name] = np.broadcast_to(u, data.x.shape)
    if through_origin and intercept_sd is not None:
        raise InputError(
            "has no meaning for a line through the origin", field="intercept_sd", value=intercept_sd
        )
    priors: dict[str, Prior] = {}
    if intercept_sd is not None:
        priors["intercept"] = Normal(0.0, intercept_sd)
    if scatter is not None:
        priors["scatter"] = HalfNormal(scatter)
    priors |= {name: Normal(0.0, float(np.max(u))) for name, u in zeros.items()}
    gains = {name: u / np.max(u) for name, u in zeros.items()}
    return _posed(data, priors, gains, through_origin=through_origin)


def without_intercept(posterior: LinePosterior) -> LinePosterior:
    """The same posterior with the intercept fixed at 0."""
    priors = {name: prior for name, prior in posterior.priors.items() if name != "intercept"}
    return _posed(posterior.data, priors, posterior.gains, through_origin=True)


def _posed(
    data: LineData,
    priors: Mapping[str, Prior],
    gains: Mapping[str, FloatArray],
    *,
    through_origin: bool,
) -> LinePosterior:
    """The posterior with its guess, which comes from the least-squares line."""
    # the points and their mirror images: the best line of both goes through the origin
    signs = (1.0, -1.0) if through_origin else (1.0,)
    fit = fit_line(
        np.outer(signs, data.x).ravel(),
        np.outer(signs, data.y).ravel(),
        u_x=None if data.method == "ols" else np.tile(data.u_x, len(signs)),
        u_y=None if data.method == "ols" else np.tile(data.u_y, len(signs)),
        r_xy=np.tile(data.r_xy, len(signs)),
    )
    error = fit.standard_errors["scaled"]
    stated = fit.standard_errors.get("propagated", fit.standard_errors["scaled"])
    if not np.isfinite(error.u_slope):
        raise InputError("must not lie on a vertical line; exchange x and y", field="x")
    scale = scaled_points(data).scale
    # rough sds may not be zero where the points lie exactly on a line, nor far below what is stated
    floor = 1e-6 * scale[1]
    start = {
        "intercept": (fit.intercept, max(error.u_intercept, 0.1 * stated.u_intercept, floor)),
        "slope": (fit.slope, max(error.u_slope, 0.1 * stated.u_slope, floor / scale[0])),
        "mu_x": (float(np.mean(data.x)), scale[0] * len(data.x) ** -0.5),
        "log_tau": (float(np.log(scale[0])), len(data.x) ** -0.5),
    }
    if through_origin:
        del start["intercept"]
    scatter = priors.get("scatter")
    if isinstance(scatter, HalfNormal):
        most = scatter.scale
        rms = root_mean_square(data.y - fit.intercept - fit.slope * data.x)
        start["log_scatter"] = (float(np.log(min(max(rms, 1e-3 * most), most))), 0.5)
    for name in ("zero_x", "zero_y"):
        if name in priors:
            start[name] = (0.0, priors[name].sd)
    values = np.array(list(start.values()))
    values.flags.writeable = False
    return LinePosterior(
        names=tuple(start),
        start=values[:, 0],
        step=values[:, 1],
        data=data,
        scale=scale,
        priors=MappingProxyType(dict(priors)),
        gains=MappingProxyType(dict(gains)),
    )
