"""One `[inputs.NAME]` table as inputs of a propagation: the statement itself, and further
components of the uncertainty.

A statement is one of: a quantity "4.999(32)"; `u`; `u_percent` of the value; an expanded
uncertainty `U` with its `k`; a `half_width`; `low` and `high`; `readings`.  Without any of them the
value is exact.
"""

from __future__ import annotations

import math
from typing import Annotated, get_args

import msgspec
from msgspec import Meta

from estim.common import InputError, read_quantity
from estim.propagation import BOUNDED, Distribution, Input

_SIZES = ("u", "u_percent", "U", "k", "half_width")
_OTHER_NAMES = {
    "uniform": "rectangular",
    "student-t": "t",
    "u-shaped": "arcsine",
    "trapezoid": "trapezoidal",
}


class InputComponentTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The keys of one component of an uncertainty."""

    meaning: str = ""
    u: float | None = None
    u_percent: float | None = None
    U: float | None = None
    k: float | None = None
    half_width: float | None = None
    distribution: str | None = None
    dof: float | None = None
    relative_u_of_u: Annotated[float, Meta(gt=0.0, le=1.0)] | None = None
    plateau: float | None = None
    half_width_error: float | None = None


class InputTable(InputComponentTable, frozen=True, kw_only=True):
    """The keys of an input."""

    value: str | float | None = None
    unit: str = "1"
    low: float | None = None
    high: float | None = None
    readings: list[float] | None = None
    components: dict[str, InputComponentTable] = {}


def inputs_of(name: str, table: InputTable) -> tuple[Input, ...]:
    """The input as stated, then its components, each with value 0 and the name "input: component".

    Raises InputError whose field is the key, "NAME.key" where the engine refuses it, for a
    component "components.NAME.key".
    """
    if table.readings is not None:
        others = ("value", *_SIZES, "low", "high", "distribution", "dof", "relative_u_of_u")
        _refuse(table, "readings", *others)
        readings = table.readings
        same = len(readings) > 1 and len(set(readings)) == 1
        if same and not table.components:
            rule = (
                "are all the same, so that their scatter tells no uncertainty: state the "
                "resolution too"
            )
            raise InputError(
                f"{rule}, as components.resolution = {{half_width = 0.5}}",
                field="readings",
                value=readings[0],
            )
        base = (
            Input(name, readings[0], 0.0, "t", len(readings) - 1.0, table.unit)
            if same
            else Input.from_readings(name, readings, unit=table.unit)
        )
        value = base.value
    else:
        value, u, half = _value(table)
        base = _stated(name, table, value, unit=table.unit, u=u, half_width=half, may_be_exact=True)
    inputs = [base]
    for part, component in table.components.items():
        try:
            inputs.append(_stated(f"{name}: {part}", component, 0.0, unit=table.unit, scale=value))
        except InputError as error:
            key = str(error.field).removeprefix(f"{name}: {part}.")
            field = f"components.{part}.{key}"
            raise InputError(error.rule, field=field, value=error.value) from None
    return tuple(inputs)


def _value(table: InputTable) -> tuple[float, float | None, float | None]:
    """The value, and the standard uncertainty or the half width where they stand in `value`, or in
    `low` and `high`.
    """
    if table.low is not None or table.high is not None:
        _refuse(table, "low", *_SIZES)
        if table.low is None or table.high is None or not table.low < table.high:
            raise InputError("requires 'high' and must be smaller", field="low", value=table.low)
        middle = 0.5 * (table.low + table.high)
        half = 0.5 * (table.high - table.low)
        value = middle if table.value is None else read_quantity(table.value, field="value").value
        if abs(value - middle) > 2e-9 * half:
            raise InputError(
                "must be the middle of low and high, or be left out",
                field="value",
                value=table.value,
            )
        return middle, None, half
    if table.value is None:
        raise InputError("is missing (or give 'readings', or 'low' and 'high')", field="value")
    quantity = read_quantity(table.value, field="value")
    if not quantity.exact:
        _refuse(table, "value", *_SIZES, why="an uncertainty stands in 'value' already")
    return quantity.value, None if quantity.exact else quantity.u, None


def _stated(
    name: str,
    table: InputComponentTable,
    value: float,
    *,
    unit: str,
    scale: float | None = None,
    u: float | None = None,
    half_width: float | None = None,
    may_be_exact: bool = False,
) -> Input:
    """scale : the value of the input that a component belongs to, for `u_percent`."""
    keys = ("u", "u_percent", "U", "half_width")
    sizes = {key: size for key in keys if (size := getattr(table, key)) is not None}
    if len(sizes) > 1:
        first, second, *_ = sizes
        raise InputError(f"does not go with '{first}': state the uncertainty once", field=second)
    for key, size in sizes.items():
        if not (math.isfinite(size) and size > 0.0):
            raise InputError("must be > 0 (leave it out for an exact value)", field=key, value=size)
    if (table.U is None) != (table.k is None) or not (table.k or 1.0) > 0.0:
        raise InputError(
            "requires 'U', an expanded uncertainty, and must be > 0", field="k", value=table.k
        )
    dof = _dof(table)
    half_width = table.half_width if half_width is None else half_width
    distribution = _distribution(table, bounded=half_width is not None, dof=dof)
    if table.u_percent is not None:
        u = abs(value if scale is None else scale) * table.u_percent / 100.0
        if u == 0.0:
            raise InputError(
                "is undefined if the value is 0: state u", field="u_percent", value=table.u_percent
            )
    elif table.U is not None:
        u = table.U / (table.k or 1.0)
    elif table.u is not None:
        u = table.u
    shape = _shape(table, distribution, half_width)
    if half_width is not None:
        if distribution not in BOUNDED:
            raise InputError(
                f"must be one of {', '.join(BOUNDED)} where limits are stated",
                field="distribution",
                value=distribution,
            )
        return Input.from_half_width(
            name, value, half_width, distribution=distribution, dof=dof, unit=unit, shape=shape
        )
    if u is None and distribution == "exponential" and value > 0.0:
        u = value
    if u is None:
        if not may_be_exact:
            raise InputError("is missing: state u, u_percent, U with k, or half_width", field="u")
        if table.distribution is not None or not math.isinf(dof):
            raise InputError(
                "also needs an uncertainty",
                field="distribution" if table.distribution is not None else "dof",
            )
        return Input(name, value, 0.0, unit=unit)
    return Input(name, value, u, distribution, dof, unit, shape)


def _dof(table: InputComponentTable) -> float:
    """Degrees of freedom; from the relative uncertainty of u they are 1/(2 r^2) (GUM eq. G.3)."""
    if table.relative_u_of_u is not None:
        _refuse(table, "relative_u_of_u", "dof")
        return 0.5 / table.relative_u_of_u**2
    return math.inf if table.dof is None else table.dof


def _distribution(table: InputComponentTable, *, bounded: bool, dof: float) -> Distribution:
    """As stated; else rectangular between limits (GUM 4.3.7), t where u has degrees of freedom
    (JCGM 101, 6.4.9), normal.
    """
    if table.distribution is None:
        return "rectangular" if bounded else "normal" if math.isinf(dof) else "t"
    named = _OTHER_NAMES.get(table.distribution.lower(), table.distribution.lower())
    for known in get_args(Distribution):
        if named == known:
            return known
    raise InputError(
        f"must be one of {', '.join(get_args(Distribution))}",
        field="distribution",
        value=table.distribution,
    )


def _shape(table: InputComponentTable, distribution: str, half_width: float | None) -> float:
    if (table.plateau is None) != (distribution != "trapezoidal"):
        raise InputError(
            "goes with the trapezoidal distribution, and it with 'plateau' (width of the "
            "plateau / width of the base)",
            field="plateau",
        )
    if (table.half_width_error is None) != (distribution != "curvilinear-trapezoidal"):
        raise InputError(
            "goes with the curvilinear-trapezoidal distribution, and it with 'half_width_error'",
            field="half_width_error",
        )
    if table.half_width_error is not None:
        if half_width is None or not 0.0 < table.half_width_error <= half_width:
            raise InputError(
                "requires a 'half_width' that is not smaller, and must be > 0",
                field="half_width_error",
                value=table.half_width_error,
            )
        return table.half_width_error / half_width
    return table.plateau or 0.0


def _refuse(table: InputComponentTable, key: str, *others: str, why: str = "") -> None:
    for other in others:
        if getattr(table, other, None) is not None:
            raise InputError(f"does not go with '{key}'" + (f": {why}" if why else ""), field=other)
