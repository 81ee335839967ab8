"""A measurement model propagated by the GUM and by Monte Carlo, and which of them to believe;
coverage regions of two outputs; the GUM's terms of the next order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from estim.arrays import BoolArray, FloatArray, all_finite, sds_of
from estim.common import Status, in_file
from estim.curves import Dual
from estim.distributions import chi2_quantile, normal_quantile
from estim.measurement_model.model_file import MeasurementModel
from estim.propagation import (
    MOST_VALUES,
    BatchProgress,
    Budget,
    Interval,
    LinearResult,
    MonteCarloResult,
    Validation,
    budget,
    compare,
    propagate_linear,
    propagate_monte_carlo,
)


@dataclass(frozen=True, eq=False)
class Propagation:
    """What a measurement model gives; arrays (n_out,) in the order of `model.outputs`.

    validation : of the GUM's interval by the Monte-Carlo one.
    budgets : of the linear result.
    second_order : standard uncertainties with the GUM's terms of the next order, None where inputs
        are correlated.
    regions : of the pairs of outputs.
    """

    model: MeasurementModel
    linear: LinearResult
    sampled: MonteCarloResult
    validation: Validation
    budgets: tuple[Budget, ...]
    second_order: FloatArray | None
    regions: tuple[Region, ...]

    @property
    def gum_holds(self) -> BoolArray:
        """(n_out,) whether the interval of the GUM is that of the draws for certain; else the draws
        are quoted.
        """
        return self.validation.passes & self.validation.decided

    @property
    def interval(self) -> Interval:
        """The Monte-Carlo interval that the model asks for."""
        return (
            self.sampled.symmetric if self.model.interval == "symmetric" else self.sampled.shortest
        )

    @property
    def known(self) -> BoolArray:
        """(n_out,) whether there is an interval that can be quoted."""
        low, high = self.interval.low, self.interval.high
        error = np.maximum(self.interval.low_error, self.interval.high_error)
        # of the interval's length: what both its ends must be known to, to be quoted at all
        return np.isfinite(low) & np.isfinite(high) & (2.0 * error <= 0.05 * (high - low))

    @property
    def statuses(self) -> tuple[Status, ...]:
        """Of each output: not identified where draws have no value, not converged where the ends of
        the interval have not stabilised.
        """
        undefined = self.sampled.undefined > 0.0
        return tuple(
            Status.OK if known else Status.NOT_IDENTIFIED if lost else Status.NOT_CONVERGED
            for known, lost in zip(self.known, undefined, strict=True)
        )

    @property
    def notes(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys((*self.linear.notes, *self.sampled.notes)))


def propagate(
    model: MeasurementModel, *, rng: np.random.Generator, progress: BatchProgress | None = None
) -> Propagation:
    """GUM and Monte Carlo side by side (JCGM 100; JCGM 101, 7.9 and 8; JCGM 102).

    Without a number of draws in the model there are as many as mean, u and interval need to
    stabilise to its digits of u; and where the comparison is then still open, four times as many
    and so on, up to 4 10^6.  Raises InputError where the formulas and the inputs do not go
    together.
    """
    with in_file(model.path):
        linear = propagate_linear(
            model.values, model.inputs, correlation=model.correlation, probability=model.probability
        )
        sampled, validation = _sampled(model, linear, rng, progress)
    budgets = tuple(budget(linear, output=i) for i in range(len(model.outputs)))
    return Propagation(
        model, linear, sampled, validation, budgets, second_order_u(model), regions(linear, sampled)
    )


def _sampled(
    model: MeasurementModel,
    linear: LinearResult,
    rng: np.random.Generator,
    progress: BatchProgress | None,
) -> tuple[MonteCarloResult, Validation]:
    # beyond those that the Monte Carlo needs to stabilise
    most, n_draw = min(4_000_000, MOST_VALUES // len(model.outputs)), model.draws
    while True:
        sampled = propagate_monte_carlo(
            model.values,
            model.inputs,
            rng=rng,
            n_draw=n_draw,
            correlation=model.correlation,
            probability=model.probability,
            n_digits=model.digits,
            watched=model.interval,
            progress=progress,
        )
        validation = compare(linear, sampled, n_digits=model.digits, kind=model.interval)
        undecided = validation.status == "undecided" and sampled.stabilised
        if model.draws is not None or not undecided or sampled.n_draw >= most:
            return sampled, validation
        n_draw = min(4 * sampled.n_draw, most)


_DEPENDENT = 1.0 - 1e-9  # of |r|: one output is a function of the other


@dataclass(frozen=True, eq=False)
class Region:
    """Coverage regions of outputs number `pair`, for the probability of the results.

    value, covariance : (2,), (2, 2) linear.   mean, drawn : of the draws.
    k_ellipse : ellipses are (y - centre)^T covariance^-1 (y - centre) <= k^2, by the GUM; k_drawn :
        by Monte Carlo.
    k_rectangle : rectangles are centre -/+ k u, by the GUM (Bonferroni: holds whatever the
        correlation); k_rectangle_drawn : by Monte Carlo.
    coverage : share of the draws in the ellipse of the GUM.
    """

    pair: tuple[int, int]
    probability: float
    value: FloatArray
    covariance: FloatArray
    mean: FloatArray
    drawn: FloatArray
    k_ellipse: float
    k_drawn: float
    k_rectangle: float
    k_rectangle_drawn: float
    coverage: float

    @property
    def correlation(self) -> tuple[float, float]:
        """Of the two outputs: linear, and of the draws."""
        linear, drawn = (
            float(c[0, 1] / np.sqrt(c[0, 0] * c[1, 1])) for c in (self.covariance, self.drawn)
        )
        return linear, drawn


def regions(linear: LinearResult, sampled: MonteCarloResult) -> tuple[Region, ...]:
    """A region for each pair of outputs with finite, not fully dependent draws; outputs (n_out,),
    n_out > 1.

    Ellipse: k^2 = quantile of chi-squared with 2 degrees of freedom, and the quantile of the draws'
    own distances (JCGM 102, 6.5, 7.7).  Rectangle: k = normal quantile at 1 - (1 - p)/4, and the
    quantile of the larger standardised distance (JCGM 102, 6.5, 7.7).
    """
    results = []
    p = sampled.probability
    for i, j in combinations(range(linear.value.size), 2):
        pair = [i, j]
        covariance, draws = linear.covariance[np.ix_(pair, pair)], sampled.draws[:, pair]
        if np.any(sampled.undefined[pair] > 0.0) or not all_finite(sampled.u[pair]):
            continue
        drawn, mean = np.cov(draws, rowvar=False), draws.mean(axis=0)
        if any(c[0, 1] ** 2 >= _DEPENDENT * c[0, 0] * c[1, 1] for c in (covariance, drawn)):
            continue
        standardised = np.max(np.abs(draws - mean) / sds_of(drawn), axis=1)
        k2 = float(chi2_quantile(p, 2))
        results.append(
            Region(
                (i, j),
                p,
                linear.value[pair],
                covariance,
                mean,
                drawn,
                k2**0.5,
                float(np.quantile(_squares(draws, mean, drawn), p)) ** 0.5,
                float(normal_quantile(1.0 - 0.25 * (1.0 - p))),
                float(np.quantile(standardised, p)),
                float(np.mean(_squares(draws, linear.value[pair], covariance) <= k2)),
            )
        )
    return tuple(results)


def _squares(draws: FloatArray, centre: FloatArray, covariance: FloatArray) -> FloatArray:
    offset = draws - centre
    return np.sum(offset @ np.linalg.inv(covariance) * offset, axis=1)


def ellipse(centre: FloatArray, covariance: FloatArray, k: float) -> FloatArray:
    """(2, 200) points on the ellipse (y - centre)^T covariance^-1 (y - centre) = k^2."""
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = np.stack([np.cos(angle), np.sin(angle)])
    return centre[:, None] + k * np.linalg.cholesky(covariance) @ circle


_ORDERS = ("a", "b", "c")
# input whose fourth power, as third derivatives have it, is a number, as is that of its inverse
_LARGEST = 1e75


def second_order_u(model: MeasurementModel) -> FloatArray | None:
    """Standard uncertainties (n_out,) with the terms of the next order, for independent inputs;
    None where inputs are correlated.

    u^2 = sum_i f_i^2 u_i^2 + sum_ij (f_ij^2/2 + f_i f_ijj) u_i^2 u_j^2, NaN where a derivative does
    not exist, or may be too large or small for a number, or the sum is negative.  Exact to this
    order for inputs that are normal.  Source: GUM 5.1.2, note.
    """
    if model.correlation is not None:
        return None
    uncertain = [quantity for quantity in model.inputs if quantity.u > 0.0]
    n_out = len(model.outputs)
    if any(
        size != 0.0 and not 1.0 / _LARGEST <= size <= _LARGEST
        for quantity in uncertain
        for size in (abs(quantity.value), quantity.u)
    ):
        return np.full(n_out, math.nan)
    variance = np.zeros(n_out)
    with np.errstate(all="ignore"):
        for first in uncertain:
            slopes = first.u * np.array(
                [_derivative(value, "a") for value in _at(model, first.name, first.name)]
            )
            variance += slopes**2
            for second in uncertain:
                results = _at(model, first.name, second.name)
                mixed = (
                    first.u * second.u * np.array([_derivative(value, "ab") for value in results])
                )
                third = (
                    first.u
                    * second.u
                    * (second.u * np.array([_derivative(value, "abc") for value in results]))
                )
                variance += 0.5 * mixed**2 + slopes * third
        return np.where(variance >= 0.0, np.sqrt(np.abs(variance)), math.nan)


def _at(model: MeasurementModel, first: str, second: str) -> list[Any]:
    """The outputs as nested dual numbers: the derivative by `first` is level a, the one by `second`
    is levels b and c.
    """
    symbols: Mapping[str, Any] = {
        quantity.name: np.float64(quantity.value) for quantity in model.inputs
    }
    carried = {
        name: Dual(
            Dual(Dual(value, {"a": float(name == first)}), {"b": float(name == second)}),
            {"c": float(name == second)},
        )
        if name in (first, second)
        else value
        for name, value in symbols.items()
    }
    return model.values(carried)


def _derivative(value: Any, levels: str) -> float:
    """The derivative of a nested dual number by `levels`, the innermost named first; 0 for what
    does not depend on them.
    """
    for level in reversed(_ORDERS):
        if not isinstance(value, Dual):
            return 0.0 if levels else float(value)
        value = value.partials.get(level, 0.0) if level in levels else value.value
    return float(value.value if isinstance(value, Dual) else value)
