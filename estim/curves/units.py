"""Units of a formula's parameters from those of its axes: tau of `a*exp(-x/tau)` is in the unit of
x, a in that of y.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from fractions import Fraction
from itertools import product
from typing import Literal

from estim.common import InputError, is_angle, is_in_degrees, powers_in, same_numbers, same_unit
from estim.curves.derived_units import LONGEST, Factors, power_text
from estim.curves.dimensions import (
    ZERO_CELSIUS,
    angles_of,
    certain_dimensions,
    gives_radians,
    is_pure_in_angle,
    named_power,
    number_in_formula,
    parts_of,
    pure_angles,
)
from estim.curves.formula import Formula, names_in

_TEMPERATURES: tuple[dict[str, int], ...] = ({"°C": 1}, {"K": 1})


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
    scales = _scales(curve.tree, axes)
    units = {
        name: _unit(*dimensions[name], *_seen_by(name, scales, axes))
        for name in names
        if name in dimensions
    }
    return {name: unit for name, unit in units.items() if unit is not None}


def contradiction(
    curve: object, axes: AxisNames, name: str, stated: str | None, *, density: bool | None
) -> str | None:
    """The rule that the unit stated for a parameter breaks, since the axes and the formula imply
    another; None where nothing shows that.

    An axis in "1" may have a unit that nobody stated: nothing follows from it, unless y are counts
    in bins.
    """
    if stated is None or not isinstance(curve, Formula):
        return None
    powers = certain_dimensions(curve, density=density, x_is=_x_is(axes))
    power_x, power_y = powers.get(name, (math.nan, math.nan))
    if is_angle(stated) and name in pure_angles(curve):
        power_x = power_y = 0.0
    counts = bool(density and power_x)
    unknown = (power_x and axes.x_unit == "1") or (power_y and axes.y_unit == "1" and not counts)
    scales = _scales(curve.tree, axes)
    x_unit, y_unit = _seen_by(name, scales, axes)
    follows = None if unknown else _unit(power_x, power_y, x_unit, y_unit, longest=80)
    if follows is None:
        return None
    turned = "pi" in names_in(curve.tree) and name not in scales  # cycles into angles
    agreement = [
        same_unit(stated, expected)
        if turned
        else same_numbers(stated, expected, differences=scales.keys().isdisjoint((name, "")))
        for unit in ((y_unit, "1") if counts else (y_unit,))
        for expected in (_product((x_unit, power_x), (unit, power_y)),)
    ]
    if True in agreement or False not in agreement:
        return None
    follows = "rad" if follows == "1" and is_angle(stated) else follows
    what = "a pure number" if follows == "1" else f"in {follows}"
    rule = (
        f"must be {what} here, as the formula and the units of the axes say; nothing is converted"
    )
    numbers = any(isinstance(node, ast.Constant) for node in ast.walk(curve.tree))
    return rule + numbers * (
        " (a number in the formula that has a unit of its own is better a parameter with a value)"
    )


def check_units(
    curve: object, axes: AxisNames, units: Mapping[str, str], *, density: bool | None
) -> None:
    """Raises InputError where a stated unit is another than the one that follows."""
    for name, unit in units.items():
        rule = contradiction(curve, axes, name, unit, density=density)
        if rule is not None:
            raise InputError(rule, field=f"units[{name}]", value=unit)


def refuse_degrees(curve: object, axes: AxisNames) -> None:
    """Raises InputError for the sine, cosine or tangent of an angle in degrees, or an arctangent
    that gives them, as the axes state.
    """
    if not isinstance(curve, Formula):
        return
    units = axes.x_unit, axes.y_unit
    x_in_others, y_in_others = (
        is_angle(unit) and same_unit(unit, "rad") is False for unit in units
    )

    def refused(what: str, unit: str, function: str) -> InputError:
        cure = (
            f"write {function} around it" if is_in_degrees(unit) else "write the column in radians"
        )
        return InputError(f"{what}: {cure}", field="curve", value=curve.text)

    if y_in_others and gives_radians(curve.tree):
        unit = axes.y_unit
        raise refused(f"gives an angle in radians, and y is in {unit}", unit, "degrees(...)")
    for function, angle, power in angles_of(curve) if x_in_others or y_in_others else ():
        unit = units[not power[0]]
        if (x_in_others if power[0] else y_in_others) and _turns_nothing(angle):
            what = f"takes {function} of an angle in {unit}, but {function} takes radians"
            raise refused(what, unit, "radians(...)")


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


def _scales(tree: ast.expr, axes: AxisNames) -> dict[str, str]:
    """Name -> unit of the scale on which it is a value, as T0 of T - T0, and of T/T0 where T is in
    K: that of x or y; °C and K on the two sides of 273.15.  Others are differences, "" where these
    are in K.
    """
    scales = {"x": axes.x_unit}
    joined = [(ast.Add, ast.Sub), *[(ast.Mult, ast.Div)] * (powers_in(axes.x_unit) == {"K": 1})]
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.BinOp | ast.Name)]
    for node, operations in product(nodes, joined):
        parts = list(parts_of(node, operations=operations))
        named = {name: sign for part, sign in parts if (name := named_power(part)[0])}
        zero = [sign for part, sign in parts if number_in_formula(part) == ZERO_CELSIUS]
        if zero:
            scales |= {name: "°C" if sign == zero[0] else "K" for name, sign in named.items()}
            scales[""] = "K"
        known = [axes.y_unit] * (node is tree) + [scales[one] for one in named if one in scales]
        scales = {name: unit for name in named for unit in known[:1]} | scales
    return scales


def _seen_by(name: str, scales: Mapping[str, str], axes: AxisNames) -> tuple[str, str]:
    """The units of x and y from which that of a parameter follows."""
    own = scales.get(name, scales.get("", ""))
    x_unit, y_unit = (
        own if all(powers_in(one) in _TEMPERATURES for one in (own, unit)) else unit
        for unit in (scales["x"] if same_unit(axes.x_unit, "K") else axes.x_unit, axes.y_unit)
    )
    return x_unit, y_unit


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
