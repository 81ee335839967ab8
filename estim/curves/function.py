"""A Python function `curve(x, **parameters)` as a curve.

Derivatives come from the best of three ways that the function allows, found out once: dual numbers
(exact; any function made of NumPy's elementwise functions), a complex step (exact to rounding;
Squire and Trapp, SIAM Review 40 (1998) 110), or extrapolated central differences (about eleven
digits) with steps that are shares of how far a parameter goes before the curve bends: a line 0.05
nm wide at 780 nm bends long before its place has changed by a percent.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.exceptions import ComplexWarning
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, Named
from estim.common import InputError
from estim.curves.differences import HALVED, extrapolated
from estim.curves.dual_numbers import Dual, plain
from estim.curves.formula import local_of
from estim.curves.several_abscissas import OfPoints
from estim.given_numbers import real_numbers
from estim.problem import EXACT, LocalCurve, n_draws

Function = Callable[..., Any]
Move = Callable[[float], FloatArray]  # a step -> the curve (n_obs,)

# raised where a curve has no value: by math.log(0.0), by an index beyond a table, by a search for a
# root that does not converge
_NO_VALUE = (ArithmeticError, LookupError, RuntimeError, ValueError)
_COMPLEX_STEP = 1e-30
_DIFFERENCES = 5e-13  # relative error of the best differences
_BENT = 0.2  # second difference over first one, and change of slope, from which on a curve bends
_DECADES = 12  # either way from a parameter's size, in search of its reach


@dataclass(frozen=True, eq=False)
class PythonCurve:
    """A user's function; it keeps to `estim.problem.curve.Curve`, and x may differ from draw to
    draw.

    names : its parameters.
    broadcasts : whether it takes parameters shaped (n_draw, 1); else it is called draw by draw.
    derivatives : "dual", "complex" or "differences".
    """

    function: Function
    names: tuple[str, ...]
    broadcasts: bool
    derivatives: str

    @property
    def precision(self) -> float:
        """Relative error of the derivatives."""
        return max(
            _DIFFERENCES if self.derivatives == "differences" else EXACT,
            _own_precision(self.function),
        )

    def value(self, x: FloatArray, arguments: Named) -> FloatArray:
        n_draw, n_obs = np.broadcast_shapes(
            np.atleast_2d(x).shape, *(np.shape(arguments[name]) for name in self.names)
        )
        if self.broadcasts or n_draw == 1:
            scalars = {name: _scalar(arguments[name]) for name in self.names}
            called = _called(self.function, x if n_draw > 1 else np.ravel(x), scalars)
            return called.reshape(n_draw, n_obs)
        rows = [
            _called(self.function, at, values)
            for at, values in zip(
                np.broadcast_to(x, (n_draw, n_obs)), self._each(arguments, n_draw), strict=True
            )
        ]
        return np.array(rows).reshape(n_draw, n_obs)

    def _each(self, arguments: Named, n_draw: int) -> list[dict[str, float]]:
        """The parameters of each draw."""
        columns = {name: np.broadcast_to(arguments[name], (n_draw, 1))[:, 0] for name in self.names}
        return [{name: column[i] for name, column in columns.items()} for i in range(n_draw)]

    def local(self, x: FloatArray, arguments: Named) -> LocalCurve:
        if (n_draw := n_draws(arguments)) > 1:
            rows = [self.local(x, values) for values in self._each(arguments, n_draw)]
            gradient = {
                name: np.concatenate([row.gradient[name] for row in rows]) for name in self.names
            }
            return LocalCurve(
                np.concatenate([row.value for row in rows]),
                np.concatenate([row.slope for row in rows]),
                gradient,
            )
        values = {name: _scalar(arguments[name]) for name in self.names}
        try:
            return _METHODS[self.derivatives](self.function, x, values)
        except TypeError:  # a branch that was not taken at the start
            return _by_differences(self.function, x, values)
        except _NO_VALUE:
            nothing = np.full((1, x.size), np.nan)
            return LocalCurve(nothing, nothing, dict.fromkeys(self.names, nothing))


def wrap_function(
    function: Function,
    names: tuple[str, ...],
    x: FloatArray,
    start: Mapping[str, float],
    *,
    summed: bool = False,
) -> PythonCurve:
    """The curve of `function`, tried at the points x (n_obs,) and the values `start`.

    summed : whether its values are added up, so that one number would count for each x.

    Raises InputError where it fails there, gives another shape than x, or no finite number.
    """
    try:
        with np.errstate(all="ignore"):
            returned = function(x, **start)
    except Exception as error:  # whatever the user's function raises
        raise InputError(
            f"fails at the starting values: {type(error).__name__}: {error}", field="curve"
        ) from error
    if isinstance(returned, np.ma.MaskedArray):
        raise InputError(
            "must return a plain array, with nan where it has no value: masks are not read",
            field="curve",
        )
    value = real_numbers(returned, "curve", "must return numbers")
    if value.shape not in ((), (x.size,)):
        raise InputError(
            f"must return one value for each x, shape ({x.size},)", field="curve", value=value.shape
        )
    if summed and value.shape != (x.size,):
        rule = (
            f"must return the log density of each of the {x.size} observations, not one number: it "
            "would count for each of them"
        )
        raise InputError(rule, field="curve", value=float(value))
    if not np.any(np.isfinite(value)):
        raise InputError("is not finite at any x for the starting values", field="curve")
    return PythonCurve(
        function, names, _broadcasts(function, x, start), _derivatives(function, x, start)
    )


def _called(function: Function, x: Any, parameters: Mapping[str, Any]) -> FloatArray:
    """The curve at every place and draw; nan where it has no value, or none that is real."""
    shape = np.broadcast_shapes(np.shape(x), *map(np.shape, parameters.values()))
    with np.errstate(all="ignore"):
        try:
            # no array of this shape: an integration may have ended too early
            returned = np.broadcast_to(function(x, **parameters), shape)
        except _NO_VALUE:
            return np.full(shape, np.nan)
        if np.iscomplexobj(returned):
            returned = np.where(returned.imag == 0.0, returned.real, np.nan)
        return np.array(returned, dtype=float)


def _own_precision(function: Function) -> float:
    """Relative error that a function states (`estim.curves.differential`); 0 for rounding
    errors.
    """
    return float(getattr(function, "precision", 0.0))


def _scalar(value: ArrayLike) -> Any:
    """A number for one draw, else the column of draws; one of NumPy, of which 0.0 ** -1 is inf."""
    array = np.asarray(value, dtype=float)
    return array.ravel()[0] if array.size == 1 else array


def _broadcasts(function: Function, x: FloatArray, start: Mapping[str, float]) -> bool:
    """Whether columns of draws give the same as one call a draw."""
    draws = {
        name: value * np.array([1.0, 1.01, 0.98]) + (value == 0.0) * np.array([0.0, 1e-3, -1e-3])
        for name, value in start.items()
    }
    try:
        together = _called(function, x, {name: column[:, None] for name, column in draws.items()})
        single = [
            _called(function, x, {name: column[i] for name, column in draws.items()})
            for i in range(3)
        ]
        tolerance = max(1e-12, 1e4 * _own_precision(function))
        return bool(
            np.allclose(together, single, rtol=tolerance, atol=tolerance - 1e-12, equal_nan=True)
        )
    # whatever the user's function raises on columns: then it is called draw by draw
    except Exception:
        return False


def _derivatives(function: Function, x: FloatArray, start: Mapping[str, float]) -> str:
    """The best method of differentiation that works and agrees with differences, both at the start
    and at a point where no parameter is 0, which may switch a term off.
    """
    moves = [_moves(function, x, start)]
    points, on = [start], _switched_on(moves[0], start)
    if on != start:
        points.append(on)
        moves.append(_moves(function, x, on))
    references = [
        [_difference(function, x, point, name, shifted) for name, shifted in moved.items()]
        for point, moved in zip(points, moves, strict=True)
    ]
    for method in ("dual", "complex"):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", ComplexWarning)  # the derivative would be lost
                local_curves = [_METHODS[method](function, x, point) for point in points]
        # whatever the user's function raises on unusual numbers: then another method is taken
        except Exception:
            continue
        if all(
            np.allclose(local.value, _called(function, x, point), rtol=1e-12, equal_nan=True)
            and all(
                _agree(derivative, *theirs)
                for derivative, theirs in zip(
                    (local.slope, *(local.gradient[name] for name in start)), reference, strict=True
                )
            )
            for local, point, reference in zip(local_curves, points, references, strict=True)
        ):
            return method
    return "differences"


def _moves(
    function: Function, x: FloatArray, values: Mapping[str, float]
) -> dict[str | None, Move]:
    """x (None) or parameter -> the curve where it is moved."""
    return {name: _shifted(function, x, values, name) for name in (None, *values)}


def _switched_on(
    moved: Mapping[str | None, Move], start: Mapping[str, float]
) -> Mapping[str, float]:
    """`start`, with parameters that are 0 or nearly so moved by a part of their reach."""
    with np.errstate(all="ignore"):
        reaches = {name: _reach(moved[name], abs(value) or 1.0) for name, value in start.items()}
    return {
        name: value + 0.1 * reaches[name] if reaches[name] > abs(value) else value
        for name, value in start.items()
    }


def _agree(ours: FloatArray, theirs: FloatArray, error: FloatArray) -> bool:
    """Whether derivatives agree at nearly all points (differences fail at a kink), within the error
    of the differences.
    """
    good = np.isfinite(theirs)
    size = float(np.max(np.abs(theirs[good]), initial=1e-300))
    # how much the error of a difference may exceed its estimate
    differs = np.abs(np.ravel(ours)[good] - theirs[good]) > 1e-5 * size + 10.0 * error[good]
    return bool(np.mean(differs) <= 0.1) if np.any(good) else True


def _by_dual(function: Function, x: FloatArray, values: Mapping[str, float]) -> LocalCurve:
    symbols = {name: Dual(value, {name: 1.0}) for name, value in values.items()}
    with np.errstate(all="ignore"):
        result = function(Dual(x, {"x": 1.0}), **symbols)
    if np.iscomplexobj(plain(result)):
        raise TypeError("a curve has real values")
    return local_of(result, x, {}, values)


def _by_complex_step(function: Function, x: FloatArray, values: Mapping[str, float]) -> LocalCurve:
    def derivative(position: Any, parameters: Mapping[str, Any]) -> FloatArray:
        with np.errstate(all="ignore"):
            result = np.asarray(function(position, **parameters))
        return np.array(np.broadcast_to(result.imag / _COMPLEX_STEP, (1, x.size)))

    gradient = {
        name: derivative(x, {**values, name: value + 1j * _COMPLEX_STEP})
        for name, value in values.items()
    }
    slope = derivative(x + 1j * _COMPLEX_STEP, values)
    return LocalCurve(np.atleast_2d(_called(function, x, values)), slope, gradient)


def _by_differences(function: Function, x: FloatArray, values: Mapping[str, float]) -> LocalCurve:
    def along(name: str | None) -> FloatArray:
        shifted = _shifted(function, x, values, name)
        return _difference(function, x, values, name, shifted)[0][None, :]

    gradient = {name: along(name) for name in values}
    return LocalCurve(np.atleast_2d(_called(function, x, values)), along(None), gradient)


def _difference(
    function: Function, x: FloatArray, values: Mapping[str, float], name: str | None, shifted: Move
) -> tuple[FloatArray, FloatArray]:
    """The derivative in a parameter, or in x where `name` is None, and its estimated error,
    (n_obs,) both.  shifted : the curve where it is moved.
    """
    if name is None and isinstance(function, OfPoints):
        return np.zeros(x.size), np.zeros(x.size)
    centre, size = (x, float(np.ptp(x))) if name is None else (values[name], abs(values[name]))
    with np.errstate(all="ignore"):
        steps = _reach(shifted, size or 1.0) * HALVED
        right, left = (np.array([shifted(sign * step) for step in steps]) for sign in (1.0, -1.0))
        # as the machine rounds it
        distance = np.array([np.subtract(centre + step, centre - step) for step in steps])
        return extrapolated(right, left, distance.reshape(len(steps), -1))


def _shifted(
    function: Function, x: FloatArray, values: Mapping[str, float], name: str | None
) -> Move:
    """The curve (n_obs,) where a parameter, or x where `name` is None, is moved by a step."""

    @cache
    def shifted(step: float) -> FloatArray:
        if name is None:
            return _called(function, x + step, values)
        return _called(function, x, {**values, name: values[name] + step})

    return shifted


def _reach(shifted: Move, size: float) -> float:
    """How far a parameter goes before the curve bends much: its own size, or less where steps of
    that size do not agree on one slope.

    Where they move the curve too little to be distinguished from rounding errors, a parameter may
    happen to be nearly 0, and goes further than its size.
    """
    centre = shifted(0.0)

    def moved(step: float) -> tuple[FloatArray, float, float]:
        """What a step to the right and one to the left change (n_obs,), and the sizes of that and
        of the bending.
        """
        right, left = shifted(step), shifted(-step)
        odd, even = right - left, right + left - 2.0 * centre
        within = 2 * np.count_nonzero(np.isfinite(even)) >= np.count_nonzero(np.isfinite(centre))
        return odd, _norm(odd), _norm(even) if within else np.inf

    def have_one_slope(reach: float) -> bool:
        """All of the steps: one alone may seem straight by chance, where a period is over."""
        slope: FloatArray | None = None
        for relative in HALVED:
            odd, far, bent = moved(relative * reach)
            if not bent < _BENT * far or (
                slope is not None and not _norm(odd / relative - slope) < _BENT * _norm(slope)
            ):
                return False
            slope = odd / relative if slope is None else slope
        return True

    _, far, bent = moved(HALVED[0] * size)
    # a step that moves the curve less shows rounding errors
    unmoved = max(far, bent) < 1e-6 * _norm(centre)
    for decade in range(_DECADES if unmoved else 0, -_DECADES, -1):
        if have_one_slope(size * 10.0**decade):
            return size * 10.0**decade
    return size


def _norm(changes: FloatArray) -> float:
    """Root of the sum of squares of what is finite."""
    return float(np.linalg.norm(changes[np.isfinite(changes)]))


_METHODS: Mapping[str, Callable[[Function, FloatArray, Mapping[str, float]], LocalCurve]] = {
    "dual": _by_dual,
    "complex": _by_complex_step,
    "differences": _by_differences,
}
