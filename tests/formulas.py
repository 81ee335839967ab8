"""Curves of a line of NumPy, for tests of what estim does with any curve."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from estim.problem.curve import LocalCurve
from estim.problem.noise import Independent
from estim.problem.noise_variance import Scale
from estim.problem.observations import Observations, Parameter
from estim.problem.posterior import Problem
from estim.problem.priors import Prior


class Formula:
    """y = f(x; arguments), differentiated by the complex step: f must be written in functions that
    take complex numbers.
    """

    mass = None

    def __init__(self, function: Callable[..., np.ndarray]) -> None:
        self.function = function

    def value(self, x: np.ndarray, arguments: Mapping[str, object]) -> np.ndarray:
        return np.atleast_2d(self.function(x, **arguments) + np.zeros_like(x))

    def local(self, x: np.ndarray, arguments: Mapping[str, object]) -> LocalCurve:
        gradient = {}
        for name in arguments:
            moved = {
                k: np.asarray(v) + (1e-30j if k == name else 0.0) for k, v in arguments.items()
            }
            gradient[name] = np.atleast_2d(
                np.imag(self.function(x + 0j, **moved) + np.zeros_like(x)) / 1e-30
            )
        slope = np.atleast_2d(
            np.imag(self.function(x + 1e-30j, **arguments) + np.zeros_like(x)) / 1e-30
        )
        return LocalCurve(self.value(x, arguments), slope, gradient)


def formula_problem(
    function: Callable[..., np.ndarray],
    x: np.ndarray,
    y: np.ndarray,
    sigma: float | str,
    priors: Mapping[str, Prior],
) -> Problem:
    """Fit y = f(x; every parameter but sigma) with independent errors; `sigma` is a number or the
    name of a parameter.
    """
    scale = Scale(parameter=sigma) if isinstance(sigma, str) else Scale(value=sigma)
    observations = Observations(
        name="r",
        x=x,
        y=y,
        t=None,
        curve=Formula(function),
        arguments={name: name for name in priors if name != sigma},
        noise=Independent(scale, Scale(), np.ones_like(x)),
        x_name="x",
        x_unit="1",
        y_name="y",
        y_unit="1",
        excluded=(),
        excluded_points=np.empty((0, 2)),
    )
    return Problem(
        tuple(Parameter(name, "1", prior, name) for name, prior in priors.items()), (observations,)
    )
