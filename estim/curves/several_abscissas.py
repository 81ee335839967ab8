"""A curve of several abscissas, y = f(u, v; parameters), as a curve of the number of a point.

All else then is as for any curve: the numbers 1, 2, 3, ... of the points are the abscissa, and
the curve looks up what belongs to them.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError
from estim.curves.columns import column
from estim.curves.dual_numbers import plain
from estim.curves.formula import Formula, evaluate, read_formula
from estim.curves.variable_projection import linear_in
from estim.given_numbers import finite_numbers
from estim.problem import Curve

Abscissas = Mapping[str, FloatArray] | FloatArray
"""Name -> (n_obs,), or (n_x, n_obs): the abscissas of each point."""


@dataclass(frozen=True, eq=False)
class OfPoints:
    """A function of the numbers of points, which `curve` is called at.

    curve : a formula, or a function curve(abscissas, **parameters).  n_obs : how many points there
        are.
    """

    curve: Formula | Callable[..., Any]
    abscissas: Abscissas
    n_obs: int

    def __call__(self, point: Any, **parameters: Any) -> Any:
        at = np.clip(np.rint(np.real(plain(point))) - 1, 0, self.n_obs - 1).astype(int)
        at_point: Any = (
            {name: values[at] for name, values in self.abscissas.items()}
            if isinstance(self.abscissas, Mapping)
            else self.abscissas[:, at]
        )
        if not isinstance(self.curve, Formula):
            return self.curve(at_point, **parameters)
        numbers = {
            name: np.float64(value) if isinstance(value, float) else value
            for name, value in parameters.items()
        }
        return evaluate(self.curve.tree, {**at_point, **numbers})

    @property
    def __signature__(self) -> inspect.Signature:
        """That of the function; a formula takes whatever it is given."""
        target = self.__call__ if isinstance(self.curve, Formula) else self.curve
        return inspect.signature(target)

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters of a formula; none of a function."""
        names = self.curve.names if isinstance(self.curve, Formula) else ()
        return tuple(name for name in names if name not in self.abscissas)

    @property
    def columns(self) -> Mapping[str, FloatArray]:
        """Name -> (n_obs,): the abscissas, those of an array by their rows."""
        if isinstance(self.abscissas, Mapping):
            return self.abscissas
        return {str(row): values for row, values in enumerate(self.abscissas)}

    @cached_property
    def linear(self) -> tuple[str, ...]:
        """Parameters of a formula in which it is linear, which need no starting value."""
        return linear_in(self.curve, self.names) if isinstance(self.curve, Formula) else ()

    @property
    def text(self) -> str:
        """The formula, or the name of the function."""
        return getattr(self.curve, "text", "") or getattr(self.curve, "__name__", "curve")


def arguments_taken(function: Callable[..., Any]) -> tuple[inspect.Parameter, ...]:
    """What a function of Python takes; nothing of a builtin without a signature."""
    try:
        return tuple(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        return ()


def are_abscissas(x: object) -> bool:
    """Whether x holds several abscissas: a mapping, a data frame or an array of two axes."""
    frame = isinstance(x, np.ndarray) or hasattr(x, "keys")  # a column of a frame has keys too
    return isinstance(x, Mapping) or (frame and getattr(x, "ndim", 1) == 2)


def numbered(curve: Any, x: Any) -> tuple[Any, Any]:
    """The curve of several abscissas `x` as one of the numbers of the points, and these; both as
    they are where there is only one.  Raises InputError.
    """
    if not are_abscissas(x):
        return curve, x
    abscissas, n_obs = _read(x)
    if not callable(curve):
        curve = read_formula(curve, field="curve")
        if not isinstance(abscissas, Mapping):
            rule = "must map the names in the formula to abscissas, like {'u': u, 'v': v}"
            raise InputError(rule, field="x", value=f"an array {abscissas.shape}")
        formula_names = {*curve.names, *(("x",) if curve.uses_x else ())}
        for name in abscissas:
            if name not in formula_names:
                rule = f"names '{name}', which is not in the formula"
                raise InputError(rule, field="x", value=curve.text)
        if curve.uses_x and "x" not in abscissas:
            rule = f"holds x, which is none of its abscissas ({', '.join(abscissas)})"
            raise InputError(rule, field="curve", value=curve.text)
    return OfPoints(curve, abscissas, n_obs), np.arange(1.0, n_obs + 1.0)


def at_abscissas(curve: Curve, x: Any) -> tuple[Curve, FloatArray]:
    """The curve at other points, and their numbers.  Raises InputError."""
    inner = getattr(curve, "curve", None)
    if inner is not None:  # tied parameters, shared errors
        inner, numbers = at_abscissas(inner, x)
        return replace(curve, curve=inner), numbers  # type: ignore[type-var]
    function = getattr(curve, "function", None)
    if not isinstance(function, OfPoints):
        raise InputError("must be numbers along one axis", field="x", value=type(x).__name__)
    known = function.abscissas
    what = ", ".join(known) if isinstance(known, Mapping) else f"an array ({len(known)}, n)"
    rule = f"must hold the abscissas of the fit ({what})"
    if not are_abscissas(x):
        raise InputError(rule, field="x", value=x)
    abscissas, n_obs = _read(x)
    if _kinds(abscissas) != _kinds(known):
        raise InputError(rule, field="x", value=", ".join(map(str, _kinds(abscissas))))
    function = replace(function, abscissas=abscissas, n_obs=n_obs)
    return replace(curve, function=function), np.arange(1.0, n_obs + 1.0)  # type: ignore[type-var]


def _kinds(abscissas: Abscissas) -> set[str | int]:
    """The names of the abscissas, or their number."""
    return {*abscissas} if isinstance(abscissas, Mapping) else {len(abscissas)}


def _read(x: Any) -> tuple[Abscissas, int]:
    """The abscissas, checked, and how many points they have."""
    if isinstance(x, np.ndarray):
        array = finite_numbers(x, "x")
        return array, array.shape[1]
    abscissas = {str(name): column(x[name], f"x[{name}]") for name in x.keys()}  # noqa: SIM118
    sizes = {name: values.size for name, values in abscissas.items()}
    if len(sizes) < 2 or len({*sizes.values()}) > 1:
        rule = "must hold at least two abscissas, as many values of each"
        raise InputError(rule, field="x", value=sizes)
    return abscissas, next(iter(sizes.values()))
