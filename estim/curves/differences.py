"""Derivatives in all arguments of a curve at once, by central differences of one call with all of
them in it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from estim.arrays import FloatArray, Named

_STEP = 1e-4  # relative: motion under any force is good to 1e-10 or so


def with_gradient(
    function: Callable[[Mapping[str, FloatArray]], tuple[FloatArray, ...]], arguments: Named
) -> tuple[tuple[FloatArray, ...], dict[str, FloatArray]]:
    """What `function` gives at `arguments`, and the derivative of the first of it in each of them,
    (n_draw, n_obs) each.
    """
    columns = {name: np.asarray(value, dtype=float) for name, value in arguments.items()}
    shape = np.broadcast_shapes(*(value.shape for value in columns.values()), (1, 1))
    names, n = tuple(columns), shape[0]
    full = {name: np.broadcast_to(value, shape) for name, value in columns.items()}
    # a smaller argument is moved like one of 0.01
    steps = {name: _STEP * np.maximum(np.abs(value), 1e-2) for name, value in full.items()}
    # the point itself, then a step up and a step down in each argument
    stacked = {name: np.tile(value, (2 * len(names) + 1, 1)) for name, value in full.items()}
    for i, name in enumerate(names):
        stacked[name][(2 * i + 1) * n : (2 * i + 2) * n] += steps[name]
        stacked[name][(2 * i + 2) * n : (2 * i + 3) * n] -= steps[name]
    outputs = function(stacked)
    gradient = {
        name: (
            outputs[0][(2 * i + 1) * n : (2 * i + 2) * n]
            - outputs[0][(2 * i + 2) * n : (2 * i + 3) * n]
        )
        / (2.0 * steps[name])
        for i, name in enumerate(names)
    }
    return tuple(values[:n] for values in outputs), gradient
