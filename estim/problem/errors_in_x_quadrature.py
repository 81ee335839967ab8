"""Errors of x: the likelihood of a reading y when the true abscissa is not known, by quadrature.

The true abscissas xi_i come from a normal distribution N(mu, tau^2) and are read as x_i = xi_i +
error of standard deviation s_i.  Given its reading a true abscissa is N(m_i, v_i), and a point
contributes

    L_i = int N(y_i; f(xi), u_i^2) N(xi; m_i, v_i) dxi
    v_i = 1/(1/s_i^2 + 1/tau^2)
    m_i = x_i - lambda_i (x_i - mu),    lambda_i = v_i/tau^2

(N(x_i; mu, s_i^2 + tau^2) does not depend on the curve).  mu and tau^2 are the mean of the x and
their variance less that of the errors; how uncertain they remain moves all points in common and is
integrated out too (`TrueAbscissas.common`, `estim.problem.errors_in_x`).

Quadrature.  N(xi; m, v) is, to 1e-4, a sum of narrower normal densities of standard deviation d
sqrt(v) at nodes h sqrt(v) apart, h = sqrt(2) d.  Within each the curve is replaced by its mean and
variance there, taken from the node and its two neighbours (weights 1/4, 1/2, 1/4): the density of y
is a sum of normal ones.  For a straight line it is exact at any slope, which is where a sum over
bare nodes fails; the next term, of a bend, is right to second order.  It is a density of y for
every curve: a steep or wild one spreads it and loses, no node can be hit by accident.

Source: Carroll, Ruppert, Stefanski, Crainiceanu, Measurement Error in Nonlinear Models (2006),
chapter 8 (structural likelihood); Gull 1989 (see estim.line_posterior) on why the distribution of
the true abscissas must be fitted.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import BoolArray, FloatArray, Named, finite_or, log_sum_exp
from estim.distributions import normal_below, normal_quantile, normal_tail
from estim.problem.tails import Tails

# between nodes, in standard deviations of the true abscissa: halving it moves no log density by
# 0.01 up to u_x f'/u_y = 3
_STEP = 0.3
_REACH = 15  # components on either side: 4.5 standard deviations
_TINY = 1e-300  # variance, so that nothing is divided by 0
_LEAST_SPREAD = 1e-3  # share of the variance of x that is left to the true abscissas at least

NODES: FloatArray = np.asarray(_STEP * np.arange(-_REACH - 1, _REACH + 2), dtype=np.float64)
_WEIGHTS = np.exp(-0.5 * NODES[1:-1] ** 2 / (1.0 - 0.5 * _STEP**2))
LOG_WEIGHTS: FloatArray = np.log(_WEIGHTS / np.sum(_WEIGHTS))


def hide_the_range(x: FloatArray, sd: FloatArray) -> bool:
    """Whether errors of standard deviations sd (n_obs,) explain all that differs between the
    readings x (n_obs,).
    """
    return x.size > 1 and float(np.mean(sd**2)) >= float(np.var(x, ddof=1))


@dataclass(frozen=True, eq=False)
class TrueAbscissas:
    """xi_i ~ N(centre_i, spread_i^2) given the readings.

    centre, spread : (n, n_obs), n the number of draws or 1.
    common : (n, n_obs, 2) how far centre moves for one standard deviation of the estimated mean and
        of the estimated variance of xi.
    """

    centre: FloatArray
    spread: FloatArray
    common: FloatArray

    @property
    def nodes(self) -> FloatArray:
        """(n, n_obs, n_node) where the curve is evaluated; where all x are exact there are three,
        all alike.
        """
        nodes = NODES if np.any(self.spread) else np.zeros(3)
        return self.centre[..., None] + self.spread[..., None] * nodes


def true_abscissas(x: FloatArray, sd: FloatArray) -> TrueAbscissas:
    """What readings x (n_obs,) with errors of standard deviation sd (n, n_obs) tell about the true
    abscissas.
    """
    n_obs = x.size
    error = np.mean(sd**2, axis=1, keepdims=True)
    variance = float(np.var(x, ddof=1)) if n_obs > 1 else np.inf
    tau2 = np.maximum(variance - error, max(_LEAST_SPREAD * variance, _TINY))
    share = sd**2 / (sd**2 + tau2)
    deviations = x - np.mean(x)
    of_mean = share * np.sqrt((tau2 + error) / n_obs) if n_obs > 1 else np.zeros_like(share)
    of_variance = (
        share * (1.0 - share) * deviations * np.sqrt(2.0 / max(1, n_obs - 1)) * (1.0 + error / tau2)
    )
    return TrueAbscissas(
        x - share * deviations, sd * np.sqrt(1.0 - share), np.stack([of_mean, of_variance], axis=-1)
    )


def correlated_abscissas(
    x: FloatArray, cov: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same of readings x (n_obs,) whose errors have the covariance cov (n_obs, n_obs): centre
    (n_obs,) and covariance (n_obs, n_obs) of the true abscissas, and `common` (n_obs, 2).
    """
    n_obs = x.size
    of_mean = np.sum(cov) / n_obs**2
    variance = float(np.var(x, ddof=1))
    error = (np.trace(cov) - n_obs * of_mean) / max(1, n_obs - 1)
    tau2 = max(variance - error, _LEAST_SPREAD * variance, _TINY)
    shares = np.linalg.solve(cov + tau2 * np.eye(n_obs), cov).T
    shrinkage = shares @ (x - np.mean(x))
    common = np.column_stack(
        [
            np.sum(shares, axis=1) * np.sqrt(tau2 / n_obs + of_mean),
            (shrinkage - shares @ shrinkage)
            * np.sqrt(2.0 / max(1, n_obs - 1))
            * (1.0 + error / tau2),
        ]
    )
    return x - shrinkage, tau2 * shares, common


@dataclass(frozen=True, eq=False)
class Predictive:
    """The density of y given x, a sum over components: weight x density of (y -
    mean)/sqrt(variance).

    mean, variance, log_weight : (..., n_obs, n_component); log_weight is -inf where the curve is
        not defined.
    """

    mean: FloatArray
    variance: FloatArray
    log_weight: FloatArray

    @property
    def shares(self) -> FloatArray:
        """Weights whose sum over the components is 1."""
        return np.exp(self.log_weight - log_sum_exp(self.log_weight, axis=-1)[..., None])

    def of(self, part: slice = slice(None)) -> Predictive:
        """Those of some points, of one draw, for many y of each: (n_part, 1, n_component)."""
        return Predictive(
            *(array[0][part][:, None] for array in (self.mean, self.variance, self.log_weight))
        )

    def terms(self, y: FloatArray, tails: Tails, named: Named) -> tuple[FloatArray, FloatArray]:
        """z and the logarithm of each term of the density of y (..., n_obs), shaped like `mean`."""
        z = (y[..., None] - self.mean) / np.sqrt(self.variance)
        return z, (
            self.log_weight
            + tails.log_density(z, deepened(tails, named))
            - 0.5 * np.log(self.variance)
        )

    def log_density(self, y: FloatArray, tails: Tails, named: Named) -> FloatArray:
        """(..., n_obs)."""
        return log_sum_exp(self.terms(y, tails, named)[1], axis=-1)

    def normal_score(self, y: FloatArray, tails: Tails, named: Named) -> FloatArray:
        """(..., n_obs) y mapped to a standard normal variable through its distribution function."""
        z = tails.normal_score(
            (y[..., None] - self.mean) / np.sqrt(self.variance), deepened(tails, named)
        )
        below = np.sum(self.shares * normal_below(z), axis=-1)
        above = np.sum(self.shares * normal_tail(z), axis=-1)
        return np.where(below < above, 1.0, -1.0) * normal_quantile(
            np.maximum(np.minimum(below, above), 1e-300)
        )


def deepened(tails: Tails, named: Named) -> dict[str, FloatArray]:
    """Parameters of the tails with one more axis, for components."""
    return {name: np.asarray(named[name], dtype=float)[..., None] for name in tails.parameters}


def predictive(values: FloatArray, variance: FloatArray, share: float = 0.0) -> Predictive:
    """From the curve at the nodes (..., n_obs, n_node) and the variance of y itself, which
    broadcasts to (..., n_obs); share : standard deviation of a further error of y over the curve.
    """
    defined = _defined(values)
    finite = np.where(defined, values, 0.0)
    up, down = _differences(finite, defined)
    spread = (2.0 * (up**2 + down**2) + (up + down) ** 2) / 16.0
    of_nodes = LOG_WEIGHTS if values.shape[-1] == NODES.size else np.zeros(1)
    log_weight = np.where(defined[..., 1:-1], of_nodes, -np.inf)
    mean = finite[..., 1:-1] + 0.25 * (up - down)
    own = variance[..., None] + np.square(share * mean)
    return Predictive(mean, np.maximum(spread + own, _TINY), log_weight)


def predictive_slopes(values: FloatArray, gradients: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives (n_obs, n_component, n) of the components' means and variances, from those of the
    curve at the nodes (n_obs, n_node, n).
    """
    defined = _defined(values)
    up, down = (side[..., None] for side in _differences(np.where(defined, values, 0.0), defined))
    gradients = np.where(defined[..., None] & np.isfinite(gradients), gradients, 0.0)
    rise, fall = (
        np.moveaxis(side, -2, -1)
        for side in _differences(np.moveaxis(gradients, -1, -2), defined[..., None, :])
    )
    of_mean = gradients[..., 1:-1, :] + 0.25 * (rise - fall)
    return of_mean, 0.5 * (up * rise + down * fall) - 0.125 * (up - down) * (rise - fall)


def slopes_in_x(values: FloatArray, spread: FloatArray) -> FloatArray:
    """df/dxi (..., n_obs, n_node) from the curve at the nodes; 0 where it is not defined on both
    sides.
    """
    with np.errstate(all="ignore"):
        slope = np.gradient(values, _STEP, axis=-1) / spread[..., None]
    return finite_or(slope, 0.0)


def _defined(values: FloatArray) -> BoolArray:
    """Where the curve is a number whose square is one; elsewhere no density is left for y."""
    with np.errstate(invalid="ignore"):
        return np.abs(values) < 1e150


def _differences(values: FloatArray, defined: BoolArray) -> tuple[FloatArray, FloatArray]:
    """To the next node and from the one before, (..., n_component); where a neighbour is not
    defined the other side stands for it.
    """
    up, down = values[..., 2:] - values[..., 1:-1], values[..., 1:-1] - values[..., :-2]
    if np.all(defined):
        return up, down
    above, below = defined[..., 2:], defined[..., :-2]
    return np.where(above, up, np.where(below, down, 0.0)), np.where(
        below, down, np.where(above, up, 0.0)
    )
