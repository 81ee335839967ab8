"""The terms of the next order in the GUM's law of propagation, from exact second and third
derivatives of the formulas.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from estim.arrays import FloatArray
from estim.curves import Dual
from estim.measurement_model.model_file import MeasurementModel

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
