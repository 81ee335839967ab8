"""A measurement model propagated by the GUM and by Monte Carlo, and which of them to believe."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import BoolArray, FloatArray
from estim.common import Status, in_file
from estim.measurement_model.coverage_regions import Region, regions
from estim.measurement_model.model_file import MeasurementModel
from estim.measurement_model.second_order import second_order_u
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
