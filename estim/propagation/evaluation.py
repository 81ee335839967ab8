"""Calling a measurement function: at one point, on many draws at once, and its first derivatives.

A measurement function takes a mapping name -> quantity and returns the output quantity.  It is
called with

- numbers, and returns a number (a scalar output) or (n_out,) values (a curve, or a tuple of
  outputs); this is what the linear method uses;
- arrays, for Monte Carlo: shaped (n_draw,) for a scalar output, and (n_draw, 1) for a curve, which
  then broadcasts to (n_draw, n_out).

A tuple or list of outputs, ``lambda q: (q["V"]/q["I"], q["V"]*q["I"])``, is stacked here.
Functions written with NumPy satisfy all this as they stand.  Where the function has no value it
returns NaN (or an infinity); warnings of NumPy about that are silenced, because the callers count
such values, with a note.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import BoolArray, FloatArray
from estim.common import InputError
from estim.curves import HALVED, evaluate, extrapolated, read_formula
from estim.given_numbers import real_numbers
from estim.propagation.inputs import Input

MeasurementFunction = Callable[[Mapping[str, Any]], ArrayLike | Sequence[ArrayLike]]

_SETTLED = 4  # a period of the function may fool larger steps
_LARGEST = 1e150  # its square is a number still, as is that of its inverse


def callable_of(
    function: MeasurementFunction | str, inputs: Sequence[Input]
) -> MeasurementFunction:
    """`function`, or what a formula in text ("g = L/T**2", or without a name) says of the inputs
    that it names.

    Raises InputError where the text is no formula of just these inputs, or a function takes other
    arguments than one.
    """
    if not isinstance(function, str):
        _check_arguments(function, inputs)
        return function
    formula = read_formula(re.sub(r"^\s*\w+\s*=(?!=)", "", function), field="function")
    known = [quantity.name for quantity in inputs]
    named = (*formula.names, *(("x",) if formula.uses_x else ()))
    for name in named:
        if name not in known:
            raise InputError("names no input", field="function", value=name)
    for name in known:
        if name not in named:
            raise InputError("is not in the formula", field=name, value=function)
    return lambda q: evaluate(formula.tree, q)


def _check_arguments(function: MeasurementFunction, inputs: Sequence[Input]) -> None:
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):  # not callable, or written in C
        return
    try:
        signature.bind({})
    except TypeError:
        name = inputs[0].name if inputs else "L"
        rule = (
            "must take one argument, which holds the inputs by their names, as lambda q: "
            f'2*q["{name}"]'
        )
        raise InputError(rule, field="function", value=str(signature)) from None


def evaluate_point(function: MeasurementFunction, point: Mapping[str, float]) -> FloatArray:
    """Output at one point, () or (n_out,).  Raises InputError where the function returns anything
    else.
    """
    if not callable(function):
        raise InputError("must be callable", field="function", value=function)
    with np.errstate(all="ignore"):
        returned = function({name: np.float64(value) for name, value in point.items()})
    output = _as_floats(returned)
    if output.ndim > 1 or output.size == 0:
        raise InputError(
            "must return a number or a list of numbers at one point",
            field="function",
            value=output.shape,
        )
    return output.copy()


def evaluate_draws(
    function: MeasurementFunction, draws: Mapping[str, FloatArray], *, n_out: int | None
) -> FloatArray:
    """Output on every draw: (n_draw,) where `n_out` is None, else (n_draw, n_out).

    draws : name -> (n_draw,).  The first draw is evaluated once more by itself: a function that
        mixes draws is an InputError.
    """
    n_draw = len(next(iter(draws.values())))
    columns = (
        draws if n_out is None else {name: drawn[:, np.newaxis] for name, drawn in draws.items()}
    )
    try:
        with np.errstate(all="ignore"):
            returned = function(dict(columns))
    except TypeError as error:
        raise InputError(
            "must accept arrays (write it with NumPy, or wrap it in numpy.vectorize)",
            field="function",
            value=str(error),
        ) from error
    output = _as_floats(returned)
    if n_out is not None and output.shape == (n_out, n_draw, 1):
        output = np.ascontiguousarray(output[..., 0].T)
    expected = (n_draw,) if n_out is None else (n_draw, n_out)
    if output.shape != expected:
        shape = "(n_draw,)" if n_out is None else "(n_draw, 1)"
        rule = f"must return {expected} for {n_draw} draws shaped {shape}"
        raise InputError(rule, field="function", value=output.shape)
    alone = evaluate_point(function, {name: float(drawn[0]) for name, drawn in draws.items()})
    tolerance = 1e-6 * _largest(output)
    if not np.allclose(alone, output[0], rtol=1e-6, atol=tolerance, equal_nan=True):
        raise InputError(
            "must treat every draw by itself, and give the same value again", field="function"
        )
    return output


def _largest(values: FloatArray) -> float:
    """The largest size of what is finite."""
    return float(np.max(np.abs(values[np.isfinite(values)]), initial=0.0))


def check_size(values: FloatArray, spreads: FloatArray) -> None:
    """Raises InputError where all outputs are so large or so small that squares of them are no
    numbers.

    values : of the outputs.
    spreads : how far they scatter, or what inputs contribute to their uncertainties.
    """
    for sizes in (values, spreads):
        largest = _largest(sizes)
        if largest != 0.0 and not 1.0 / _LARGEST <= largest <= _LARGEST:
            raise InputError(
                f"and its uncertainty must be 0 or between {1.0 / _LARGEST:g} and {_LARGEST:g} "
                "in size: choose other units",
                field="result",
                value=largest,
            )


def check_draws(value: FloatArray, draws: FloatArray) -> None:
    """`check_size` of the outputs at the estimates and the median distance of draws from them,
    whatever their tails.
    """
    with np.errstate(all="ignore"):
        distance = np.abs(draws - value)
    distance = distance[np.isfinite(distance)]
    check_size(value, np.atleast_1d(np.median(distance)) if distance.size else distance)


@dataclass(frozen=True, eq=False)
class Gradient:
    """First derivatives of a measurement function at the estimates.

    value : () or (n_out,) output at the estimates.
    derivative : (n_in,) or (n_in, n_out), in units of output per unit of input; NaN where there is
        none.
    error : same shape; estimated numerical error of `derivative`.
    kink : same shape; slope to the right minus slope to the left: 0 for a smooth function.
    """

    value: FloatArray
    derivative: FloatArray
    error: FloatArray
    kink: FloatArray


def gradient(function: MeasurementFunction, inputs: Sequence[Input]) -> Gradient:
    """First derivatives by extrapolated central differences (Ridders 1982, Adv. Eng. Software 4,
    75).

    D(h) = [f(x + h) - f(x - h)]/(2h) at ten steps h = L/8 ... L/4096 with L = max(u, 1e-6 |x|),
    extrapolated to h = 0 in h^2; the entry of the table with the smallest estimated error is kept,
    output by output.  This is the derivative itself (to about 1e-10 of it, and the error is
    reported), not the difference quotient over +/- u of the note to GUM 5.1.3: that one mixes in
    the third derivative and hides a nonlinearity that `compare` is meant to find.
    """
    point = {quantity.name: quantity.value for quantity in inputs}
    value = evaluate_point(function, point)
    tables = []
    for quantity in inputs:
        scale = (
            max(quantity.u, 1e-6 * abs(quantity.value))
            if quantity.u > 0.0
            else (1e-3 * abs(quantity.value) or 1.0)
        )
        steps = scale * HALVED
        above, below = quantity.value + steps, quantity.value - steps
        right, left = (
            np.array([evaluate_point(function, point | {quantity.name: float(x)}) for x in side])
            for side in (above, below)
        )
        width = (above - below).reshape(-1, *(1,) * value.ndim)
        with np.errstate(all="ignore"):
            slope, error = extrapolated(right, left, width, first_trusted=_SETTLED)
            jumps = _jumps(right, left)
            kink = np.where(jumps, 0.0, _kink(value, right, left, steps))
            tables.append((np.where(jumps, np.nan, slope), error, kink))
    derivative, error, kink = (np.array(column) for column in zip(*tables, strict=True))
    for array in (value, derivative, error, kink):
        array.flags.writeable = False
    return Gradient(value, derivative, error, kink)


def _jumps(right: FloatArray, left: FloatArray) -> BoolArray:
    """() or (n_out,) whether the function is not continuous: its values right and left (n_step,
    ...) settle with the steps, but not on each other.  Those of a function with noise do not
    settle.
    """
    sides = np.maximum(*(np.ptp(side[_SETTLED:], axis=0) for side in (right, left)))
    rounding = 100.0 * np.finfo(float).eps * np.maximum(np.abs(right), np.abs(left))[-1]
    return np.abs(right - left)[-1] > np.maximum(4.0 * sides, rounding)


def _kink(value: FloatArray, right: FloatArray, left: FloatArray, steps: FloatArray) -> FloatArray:
    """Slope to the right minus slope to the left, each to second order from two steps; 0 where it
    shrinks with the steps, as that of a smooth function, or is no more than rounding.
    """
    jumps = []
    for far in (_SETTLED, _SETTLED + 3):
        near = far + 1
        slope_right = (4.0 * right[near] - right[far] - 3.0 * value) / steps[far]
        slope_left = -(4.0 * left[near] - left[far] - 3.0 * value) / steps[far]
        jumps.append(slope_right - slope_left)
    rounding = (
        100.0 * np.finfo(float).eps * np.maximum(np.abs(right), np.abs(left))[near] / steps[near]
    )
    small = (np.abs(jumps[1]) < 0.5 * np.abs(jumps[0])) | (np.abs(jumps[1]) < rounding)
    return np.where(small, 0.0, jumps[0])


def _as_floats(returned: Any) -> FloatArray:
    """What a function returned as floats; the parts of a tuple may be numbers beside arrays only at
    one point.
    """
    return real_numbers(returned, "function", "must return real numbers, all outputs of one shape")
