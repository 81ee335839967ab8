"""Quantities of the package pint, if a user passes some: numbers in SI base units, and the names of
those.

Nothing of pint is imported: what has `magnitude` and `to_base_units` is a quantity.  All become
numbers in base units, so that a formula means the same whatever mixture of units it is given; what
has no unit stays as it is, but for errors and limits of what has one: there it is refused.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from estim.common import InputError
from estim.curves.data_set import DataSet
from estim.curves.parameter_settings import ParameterSettings
from estim.curves.units import AxisNames

_PLAIN = ("", "1", "dimensionless")


def without_units(
    points: DataSet, settings: ParameterSettings
) -> tuple[DataSet, ParameterSettings]:
    """The points and the settings of the parameters in SI base units; as they are where nothing is
    a quantity.

    Raises InputError where two that belong together differ in kind, or only one has a unit.
    """
    if not any(map(_is_quantity, _all(points, settings))):
        return points, settings
    x, x_unit = _base(points.x)
    y, y_unit = _base(points.y)
    u_x, u_y = _size("u_x", points.u_x, x_unit), _size("u_y", points.u_y, y_unit)
    converted: dict[str, dict[str, Any]] = {"start": {}, "fixed": {}, "units": dict(settings.units)}
    for field in ("start", "fixed"):
        for name, value in getattr(settings, field).items():
            converted[field][name], unit = _base(value)
            if unit is not None:
                converted["units"][name] = unit
    converted["bounds"] = {
        name: tuple(_same(name, end, converted["units"].get(name)) for end in ends)
        if _is_pair(ends)
        else ends
        for name, ends in settings.bounds.items()
    }
    axes = points.axes or AxisNames()
    axes = replace(axes, x_unit=x_unit or axes.x_unit, y_unit=y_unit or axes.y_unit)
    return replace(points, x=x, y=y, u_x=u_x, u_y=u_y, axes=axes), replace(settings, **converted)


def _all(points: DataSet, settings: ParameterSettings) -> Iterator[Any]:
    """Whatever may be a quantity, of arguments that nobody has checked yet."""
    yield from (points.x, points.y, points.u_x, points.u_y)
    for named in (settings.start, settings.fixed, settings.bounds):
        for value in named.values() if isinstance(named, Mapping) else ():
            yield from value if _is_pair(value) else (value,)


def _is_pair(value: object) -> bool:
    return isinstance(value, tuple | list)


def _is_quantity(value: object) -> bool:
    return hasattr(value, "magnitude") and hasattr(value, "to_base_units")


def _base(value: Any) -> tuple[Any, str | None]:
    """Numbers in base units and the name of their unit; the value and None where it is no
    quantity.
    """
    if not _is_quantity(value):
        return value, None
    converted = value.to_base_units()
    name = f"{converted.units:~P}"
    return converted.magnitude, "1" if name in _PLAIN else name


def refuse_quantities(**arguments: object) -> None:
    """Raises InputError for quantities where only plain numbers are taken, which would lose their
    unit.
    """
    for field, value in arguments.items():
        if _is_quantity(value):
            raise InputError(
                "must be plain numbers, in SI base units where x and y have units",
                field=field,
                value=str(value),
            )


def _size(name: str, value: Any, unit: str | None) -> Any:
    """Standard uncertainties, which are differences."""
    if getattr(value, "_is_multiplicative", True) is False:
        raise InputError(
            "must be a difference, as delta_degC is one of temperatures in degC",
            field=name,
            value=str(value),
        )
    return None if value is None else _same(name, value, unit)


def _same(name: str, value: Any, unit: str | None) -> Any:
    number, value_unit = _base(value)
    if (
        value_unit is None
        and unit not in (None, "1")
        and not (value is None or (np.ndim(value) == 0 and value in (0, math.inf, -math.inf)))
    ):
        raise InputError(
            f"must have a unit, since what it belongs to has one ({unit})",
            field=name,
            value=str(value),
        )
    if value_unit is not None and value_unit != (unit or "1"):
        raise InputError(
            f"must be of the same kind as what it belongs to, which is in {unit or '1'}",
            field=name,
            value=str(value),
        )
    return number
