"""Derivatives by differences: extrapolated ones of any function, and one step in all arguments of a
curve at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from estim.arrays import FloatArray, Named

HALVED: FloatArray = 0.5 ** np.arange(3.0, 13.0)
"""Steps of differences that are extrapolated, over a length on which the function is nearly
straight: 1/8 to 1/4096.
"""
_N_COLUMN = 5
_STEP = 1e-4  # relative: motion under any force is good to 1e-10 or so


def extrapolated(
    right: FloatArray, left: FloatArray, distance: FloatArray, *, first_trusted: int = 1
) -> tuple[FloatArray, FloatArray]:
    """The derivative and its estimated error, (...) both, nan and inf where there is none, from the
    function at steps to the right and to the left (n_step, ...), each half as far from each other,
    `distance` (n_step, ... or 1), as the ones before.

    [right - left]/distance is extrapolated to steps of 0 in their squares (Ridders 1982, Adv. Eng.
    Software 4, 75).  Of the extrapolations that end at one step, and then of all steps, the one
    that changed least is kept.  Its change alone would flatter a function with noise, where two
    entries agree by chance, so the error is at least the median distance of the values at the other
    steps.

    first_trusted : extrapolations that end at a step before this one are not trusted.
    """
    column = (right - left) / distance
    rounding = 2.0 * np.finfo(float).eps * np.maximum(np.abs(right), np.abs(left)) / distance
    value, error = np.full((2, *column.shape), np.inf)
    for j in range(1, _N_COLUMN + 1):
        further = (4.0**j * column[1:] - column[:-1]) / (4.0**j - 1.0)
        change = np.maximum(np.abs(further - column[1:]), np.abs(further - column[:-1]))
        change = np.maximum(change, rounding[j:])
        better = change < error[j:]
        np.copyto(value[j:], further, where=better)
        np.copyto(error[j:], change, where=better)
        column = further
    value, error = value[first_trusted:], error[first_trusted:]
    at = np.argmin(error, axis=0)[None]
    best, smallest = (np.take_along_axis(array, at, axis=0)[0] for array in (value, error))
    known = np.isfinite(smallest)
    deviations = np.where(np.isfinite(error), np.abs(value - best), np.inf)
    return np.where(known, best, np.nan), np.where(
        known, np.maximum(smallest, np.median(deviations, axis=0)), np.inf
    )


def with_gradient(
    function: Callable[[Mapping[str, FloatArray]], tuple[FloatArray, ...]], arguments: Named
) -> tuple[tuple[FloatArray, ...], dict[str, FloatArray]]:
    """What `function` gives at `arguments`, and the derivative of the first of it in each of them,
    (n_draw, n_obs) each.
    """
    columns = {name: np.asarray(value, dtype=float) for name, value in arguments.items()}
    shape = np.broadcast_shapes(*(value.shape for value in columns.values()), (1, 1))
    full = {name: np.broadcast_to(value, shape) for name, value in columns.items()}
    # a smaller argument is moved like one of 0.01
    steps = {name: _STEP * np.maximum(np.abs(value), 1e-2) for name, value in full.items()}
    # the point itself, then a step up and a step down in each argument
    n = 2 * len(full) + 1
    stacked = {name: np.tile(value, (n, 1, 1)) for name, value in full.items()}
    for i, name in enumerate(full):
        stacked[name][2 * i + 1] += steps[name]
        stacked[name][2 * i + 2] -= steps[name]
    returned = function({name: value.reshape(-1, shape[1]) for name, value in stacked.items()})
    outputs = [values.reshape(n, shape[0], -1) for values in returned]
    gradient = {
        name: (outputs[0][2 * i + 1] - outputs[0][2 * i + 2]) / (2.0 * steps[name])
        for i, name in enumerate(full)
    }
    return tuple(values[0] for values in outputs), gradient
