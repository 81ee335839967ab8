"""A Python function `curve(x, **parameters)` as a curve.

Derivatives come from the best of three ways that the function allows, found out once: dual numbers (exact; any function
made of NumPy's elementwise functions), a complex step (exact to rounding; Squire and Trapp, SIAM Review 40 (1998) 110),
or central differences of sixth order with a step chosen point by point (about ten digits).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import InputError
from estim.curves.dual import Dual
from estim.curves.formula import local_of, time_derivative_of
from estim.given_numbers import real_numbers
from estim.problem import EXACT, LocalCurve

Function = Callable[..., Any]

_COMPLEX_STEP = 1e-30
_DIFFERENCES = 5e-13  # relative error of the best differences
_STEPS = (3e-2, 1e-2, 3e-3, 1e-3, 1e-4)  # of the parameter's size
_STENCIL = np.array([45.0, -9.0, 1.0]) / 60.0  # on f(+kh) - f(-kh), sixth order
_LOWER = np.array([8.0, -1.0]) / 12.0  # fourth order, to judge the sixth


@dataclass(frozen=True, eq=False)
class PythonCurve:
    """A user's function; it keeps to `estim.problem.curve.Curve`, and x may differ from draw to draw.

    names : its parameters.  broadcasts : whether it takes parameters shaped (n_draw, 1); else it is called draw by draw.
    derivatives : "dual", "complex" or "differences".
    """

    function: Function
    names: tuple[str, ...]
    broadcasts: bool
    derivatives: str

    @property
    def precision(self) -> float:
        """Relative error of the derivatives."""
        return max(_DIFFERENCES if self.derivatives == "differences" else EXACT, _own_precision(self.function))

    def value(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        n_draw, n_obs = np.broadcast_shapes(np.atleast_2d(x).shape, *(np.shape(arguments[name]) for name in self.names))
        if self.broadcasts or n_draw == 1:
            scalars = {name: _scalar(arguments[name]) for name in self.names}
            return np.array(np.broadcast_to(_called(self.function, x if n_draw > 1 else np.ravel(x), scalars), (n_draw, n_obs)))
        columns = {name: np.broadcast_to(arguments[name], (n_draw, 1))[:, 0] for name in self.names}
        positions = np.broadcast_to(x, (n_draw, n_obs))
        rows = [_called(self.function, positions[i], {name: float(column[i]) for name, column in columns.items()}) for i in range(n_draw)]
        return np.array([np.broadcast_to(row, (n_obs,)) for row in rows])

    def local(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        n_draw = max((np.shape(value)[0] for value in arguments.values() if np.ndim(value) == 2), default=1)
        if n_draw > 1:
            columns = {name: np.broadcast_to(arguments[name], (n_draw, 1))[:, 0] for name in self.names}
            rows = [self.local(x, {name: float(column[i]) for name, column in columns.items()}) for i in range(n_draw)]
            gradient = {name: np.concatenate([row.gradient[name] for row in rows]) for name in self.names}
            return LocalCurve(np.concatenate([row.value for row in rows]), np.concatenate([row.slope for row in rows]), gradient)
        return _WAYS[self.derivatives](self.function, x, {name: float(_scalar(arguments[name])) for name in self.names})

    def time_derivative(self, x: FloatArray, arguments: Mapping[str, ArrayLike], order: int) -> FloatArray:
        if self.derivatives != "dual":
            raise InputError("must be made of NumPy functions to be differentiated often enough for differentiated speeds", field="curve")
        scalars = {name: _scalar(arguments[name]) for name in self.names}
        return time_derivative_of(lambda position: self.function(position, **scalars), x, arguments, order)


def wrap_function(function: Function, names: tuple[str, ...], x: FloatArray, start: Mapping[str, float]) -> PythonCurve:
    """The curve of `function`, tried at the points x (n_obs,) and the values `start`.

    Raises InputError where it fails there, gives another shape than x, or no finite number.
    """
    try:
        with np.errstate(all="ignore"):
            returned = function(x, **start)
    except Exception as error:  # whatever the user's function raises
        raise InputError(f"fails at the starting values: {type(error).__name__}: {error}", field="curve") from error
    if isinstance(returned, np.ma.MaskedArray):
        raise InputError("must return a plain array, with nan where it has no value: masks are not read", field="curve")
    value = real_numbers(returned, "curve", "must return numbers")
    if value.shape not in ((), (x.size,)):
        raise InputError(f"must return one value for each x, shape ({x.size},)", field="curve", value=value.shape)
    if not np.any(np.isfinite(value)):
        raise InputError("is not finite at any x for the starting values", field="curve")
    return PythonCurve(function, names, _broadcasts(function, x, start), _derivatives(function, x, start))


def _called(function: Function, x: Any, parameters: Mapping[str, Any]) -> FloatArray:
    with np.errstate(all="ignore"):
        return np.asarray(function(x, **parameters), dtype=float)


def _own_precision(function: Function) -> float:
    """Relative error that a function says it has (`estim.curves.differential`); 0 for rounding errors."""
    return float(getattr(function, "precision", 0.0))


def _scalar(value: ArrayLike) -> Any:
    """A number for one draw, else the column of draws."""
    array = np.asarray(value, dtype=float)
    return array.item() if array.size == 1 else array


def _broadcasts(function: Function, x: FloatArray, start: Mapping[str, float]) -> bool:
    """Whether columns of draws give the same as one call a draw."""
    draws = {name: value * np.array([1.0, 1.01, 0.98]) + (value == 0.0) * np.array([0.0, 1e-3, -1e-3]) for name, value in start.items()}
    try:
        together = _called(function, x, {name: column[:, None] for name, column in draws.items()})
        single = [_called(function, x, {name: float(column[i]) for name, column in draws.items()}) for i in range(3)]
        together = np.broadcast_to(together, (3, x.size))
        alike = max(1e-12, 1e4 * _own_precision(function))
        return bool(np.allclose(together, [np.broadcast_to(row, (x.size,)) for row in single], rtol=alike, atol=alike - 1e-12, equal_nan=True))
    except Exception:  # whatever the user's function raises on columns: then it is called draw by draw
        return False


def _derivatives(function: Function, x: FloatArray, start: Mapping[str, float]) -> str:
    """The best way of differentiation that works and agrees with differences."""
    reference = _by_differences(function, x, start)
    for way in ("dual", "complex"):
        try:
            local = _WAYS[way](function, x, start)
        except Exception:  # whatever the user's function raises on unusual numbers: then another way is taken
            continue
        pairs = [(local.slope, reference.slope), *((local.gradient[name], reference.gradient[name]) for name in start)]
        if np.allclose(local.value, reference.value, rtol=1e-12, equal_nan=True) and all(_alike(ours, theirs) for ours, theirs in pairs):
            return way
    return "differences"


def _alike(ours: FloatArray, theirs: FloatArray) -> bool:
    """Whether derivatives agree at nearly all points (differences fail at a kink)."""
    good = np.isfinite(theirs)
    size = float(np.max(np.abs(theirs[good]), initial=1e-300))
    return bool(np.mean(np.abs(ours[good] - theirs[good]) > 1e-5 * size) <= 0.1) if np.any(good) else True


def _by_dual(function: Function, x: FloatArray, values: Mapping[str, float]) -> LocalCurve:
    symbols = {name: Dual(value, {name: 1.0}) for name, value in values.items()}
    with np.errstate(all="ignore"):
        result = function(Dual(x, {"x": 1.0}), **symbols)
    return local_of(result, x, {}, values)


def _by_complex_step(function: Function, x: FloatArray, values: Mapping[str, float]) -> LocalCurve:
    def derivative(position: Any, parameters: Mapping[str, Any]) -> FloatArray:
        with np.errstate(all="ignore"):
            result = np.asarray(function(position, **parameters))
        return np.array(np.broadcast_to(result.imag / _COMPLEX_STEP, (1, x.size)))

    gradient = {name: derivative(x, {**values, name: value + 1j * _COMPLEX_STEP}) for name, value in values.items()}
    slope = derivative(x + 1j * _COMPLEX_STEP, values)
    return LocalCurve(np.array(np.broadcast_to(_called(function, x, values), (1, x.size))), slope, gradient)


def _by_differences(function: Function, x: FloatArray, values: Mapping[str, float]) -> LocalCurve:
    def along(name: str | None) -> FloatArray:
        centre = float(np.ptp(x)) if name is None else values[name]
        size = abs(centre) if centre else 1.0

        def shifted(step: float) -> FloatArray:
            if name is None:
                return np.broadcast_to(_called(function, x + step, values), (x.size,))
            return np.broadcast_to(_called(function, x, {**values, name: centre + step}), (x.size,))

        best, best_error = np.full(x.size, np.nan), np.full(x.size, np.inf)
        for relative in _STEPS:
            step = relative * size
            steps = [((centre + k * step) - (centre - k * step)) / (2.0 * k) for k in (1, 2, 3)]  # as the machine rounds it
            odd = np.array([(shifted(k * step) - shifted(-k * step)) * (step / exact) for k, exact in zip((1, 2, 3), steps, strict=True)])
            estimate = _STENCIL @ odd / step
            error = np.abs(estimate - _LOWER @ odd[:2] / step)
            better = error < best_error
            best, best_error = np.where(better, estimate, best), np.where(better, error, best_error)
        return best[None, :]

    gradient = {name: along(name) for name in values}
    return LocalCurve(np.array(np.broadcast_to(_called(function, x, values), (1, x.size))), along(None), gradient)


_WAYS: Mapping[str, Callable[[Function, FloatArray, Mapping[str, float]], LocalCurve]] = {
    "dual": _by_dual, "complex": _by_complex_step, "differences": _by_differences,
}
