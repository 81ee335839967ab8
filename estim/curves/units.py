"""Units of a formula's parameters from those of its axes: tau of `a*exp(-x/tau)` is in the unit of
x, a in that of y.
"""

from __future__ import annotations

import ast
import copy
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

from estim.common import (
    InputError,
    in_unit,
    is_angle,
    is_in_degrees,
    powers_in,
    same_unit,
    with_unit,
)
from estim.curves.derived_units import LONGEST, Factors, power_text
from estim.curves.dimensions import (
    angles_of,
    arc_among_terms,
    certain_dimensions,
    is_pure_in_angle,
    pure_angles,
)
from estim.curves.formula import Formula, Renamed


@dataclass(frozen=True)
class AxisNames:
    """What x and y are, for figures and tables; unit "1" for a pure number.

    The units of parameters follow from those of x and y where the curve is a formula.  A fit raises
    InputError for a unit that cannot be read.

    x_name, y_name : what they are called.  x_unit, y_unit : their units, "" where none is shown.

    >>> from estim import AxisNames, fit_curve
    >>> axes = AxisNames("time", "s", "distance", "m")
    >>> fit = fit_curve("v*x", [1, 2, 3], [2.1, 3.9, 6.0], u_y=0.1, axes=axes)
    >>> print(fit.problem.parameters[0].unit)
    m/s
    """

    x_name: str = "x"
    x_unit: str = "1"
    y_name: str = "y"
    y_unit: str = "1"


def units_of(
    curve: object, axes: AxisNames, names: Collection[str], *, density: bool | None = False
) -> dict[str, str]:
    """Name -> unit of those of `names` that a formula `curve` determines, whatever units the
    numbers in it may have.

    density : whether the formula is y per unit of x (counts in bins); None where it has no unit at
        all (single events).
    """
    if (
        not isinstance(curve, Formula)
        or density is None
        or (axes.x_unit, axes.y_unit) == ("1", "1")
    ):
        return {}
    dimensions = certain_dimensions(curve, density=density, x_is=_x_is(axes))
    units = {
        name: _unit(*dimensions[name], axes.x_unit, axes.y_unit)
        for name in names
        if name in dimensions
    }
    return {name: unit for name, unit in units.items() if unit is not None}


def contradiction(
    curve: object,
    axes: AxisNames,
    name: str,
    stated: str | None,
    *,
    density: bool | None,
    number: object = None,
) -> str | None:
    """The rule that the unit stated for a parameter breaks, since the axes and the formula imply
    another; None where nothing shows that.

    number : what was stated in that unit.  An axis in "1" may have a unit that nobody stated:
        nothing follows from it, unless y are counts in bins.
    """
    if stated is None or not isinstance(curve, Formula):
        return None
    power_x, power_y = _powers(curve, axes, name, stated, density)
    counts = bool(density and power_x)
    unknown = (power_x and axes.x_unit == "1") or (power_y and axes.y_unit == "1" and not counts)
    follows = None if unknown else _unit(power_x, power_y, axes.x_unit, axes.y_unit, longest=80)
    if follows is None:
        return None
    of_y = (axes.y_unit, "1") if counts else (axes.y_unit,)
    agreement = [
        same_unit(stated, _product((axes.x_unit, power_x), (unit, power_y))) for unit in of_y
    ]
    if True in agreement or False not in agreement:
        return None
    follows = "rad" if follows == "1" and is_angle(stated) else follows
    what = "a pure number" if follows == "1" else f"in {follows}"
    message = (
        f"must be {what} here, as the formula and the units of the axes say; nothing is converted"
    )
    converted = (
        in_unit(number, stated, follows)
        if isinstance(number, int | float) and not isinstance(number, bool)
        else None
    )
    if converted is not None:
        return (
            f"{message}: write {with_unit(f'{converted:.6g}', follows)} for "
            f"{with_unit(f'{number:g}', stated)}"
        )
    certain = certain_dimensions(curve, density=density, x_is=_x_is(axes), any_number=True).get(
        name
    ) == (power_x, power_y)
    return (
        message
        if certain or is_angle(stated)
        else f"{message} (a number in the formula that has a unit of its own is better a parameter "
        "with a value)"
    )


def _powers(
    curve: Formula, axes: AxisNames, name: str, stated: str, density: bool | None
) -> tuple[float, float]:
    """Powers of the units of x and y that a parameter has for certain, nan where none follow."""
    if is_angle(stated) and name in pure_angles(curve):
        return 0.0, 0.0
    return certain_dimensions(curve, density=density, x_is=_x_is(axes)).get(
        name, (math.nan, math.nan)
    )


def check_units(
    curve: object,
    axes: AxisNames,
    units: Mapping[str, str],
    numbers: Mapping[str, float],
    *,
    density: bool | None,
) -> None:
    """Raises InputError where a stated unit is another than the one that follows.  numbers : starts
    and values.
    """
    for name, unit in units.items():
        rule = contradiction(curve, axes, name, unit, density=density, number=numbers.get(name))
        if rule is not None:
            raise InputError(rule, field=f"units[{name}]", value=unit)


def refuse_degrees(curve: object, axes: AxisNames) -> None:
    """Raises InputError for the sine, cosine or tangent of an angle in degrees, or an arctangent
    that gives them, as the axes state.
    """
    if not isinstance(curve, Formula):
        return
    units = axes.x_unit, axes.y_unit
    in_others = [is_angle(unit) and same_unit(unit, "rad") is False for unit in units]
    if in_others[1] and (arc := arc_among_terms(curve.tree)) is not None:
        written = _as_written(arc, curve.variable)
        cure = (
            f"write degrees({written})"
            if is_in_degrees(axes.y_unit)
            else "write the column in radians"
        )
        raise InputError(
            f"adds {written}, which is in radians, to give y in {axes.y_unit}: {cure}",
            field="curve",
            value=curve.text,
        )
    for function, angle, power in angles_of(curve) if any(in_others) else ():
        of_y = not power[0]
        unit = units[of_y]
        if in_others[of_y] and _turns_nothing(angle):
            written = _as_written(angle, curve.variable)
            cure = (
                f"write {function}(radians({written}))"
                if is_in_degrees(unit)
                else "write the column in radians"
            )
            raise InputError(
                f"takes {function} of an angle in {unit}, but {function} takes radians: {cure}",
                field="curve",
                value=curve.text,
            )


def _as_written(part: ast.expr, variable: str) -> str:
    """Part of a formula as its user would write it, with the name that x has there."""
    renamed = Renamed("x", variable).visit(copy.deepcopy(part))
    return ast.unparse(_Written().visit(renamed))


class _Written(ast.NodeTransformer):
    """Whole numbers without a point, and a power written as such."""

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        is_integer = isinstance(node.value, float) and node.value.is_integer()
        return ast.Constant(int(node.value)) if is_integer else node  # type: ignore[arg-type]

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        power = isinstance(node.func, ast.Name) and node.func.id == "power"
        return ast.BinOp(node.args[0], ast.Pow(), node.args[1]) if power else node


def _turns_nothing(angle: ast.expr) -> bool:
    """Whether no number in an angle turns it into radians."""
    return all(
        is_pure_in_angle(node.value)
        for node in ast.walk(angle)
        if isinstance(node, ast.Constant) and isinstance(node.value, float)
    )


def _x_is(axes: AxisNames) -> Literal["an angle", "like y"] | None:
    if is_angle(axes.x_unit):
        return "an angle"
    return "like y" if axes.x_unit != "1" and same_unit(axes.x_unit, axes.y_unit) else None


def _product(*powers: tuple[str, float]) -> str:
    """A product of units that is read, not shown."""
    return "·".join(f"({unit})^{power:g}" for unit, power in powers if power) or "1"


def _unit(
    power_x: float, power_y: float, x_unit: str, y_unit: str, *, longest: int = LONGEST
) -> str | None:
    """x_unit**power_x * y_unit**power_y as text; None where it cannot be written shortly."""
    if not (power_x.is_integer() and power_y.is_integer()):
        return None
    for power, unit, other, other_unit in (
        (power_x, x_unit, power_y, y_unit),
        (power_y, y_unit, power_x, x_unit),
    ):
        if power == 1.0 and (other == 0.0 or other_unit == "1"):
            return unit
    factors: Factors = {}
    for unit, power in ((y_unit, power_y), (x_unit, power_x)):
        symbols = powers_in(unit)
        for name, exponent in ({f"({unit})": 1} if symbols is None else symbols).items():
            factors[name] = factors.get(name, 0) + exponent * Fraction(power)
    text = power_text({name: power for name, power in factors.items() if power})
    return text if len(text) <= longest else None
