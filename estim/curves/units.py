"""Units of a formula's parameters from those of its axes: tau of `a*exp(-x/tau)` is in the unit of x, a in that of y."""

from __future__ import annotations

import ast
import copy
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass

from estim.common import InputError, in_unit, is_in_degrees, same_unit, with_unit
from estim.curves.dimensions import angles_of, dimensions_of
from estim.curves.formula import Formula

_LARGEST_PURE = 10.0  # a larger number in a formula, or one with decimals, may have a unit of its own
_FACTOR = re.compile(r"([^\W\d_]+|[°%′″‰]\w*)([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]*)")
_RAISED = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_LOWERED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")
_LONGEST = 20


@dataclass(frozen=True)
class AxisNames:
    """What x and y are, for figures and tables; unit "1" for a pure number."""

    x_name: str = "x"
    x_unit: str = "1"
    y_name: str = "y"
    y_unit: str = "1"


def units_of(curve: object, axes: AxisNames, names: Collection[str], *, density: bool | None = False) -> dict[str, str]:
    """Name -> unit of those of `names` that a formula `curve` determines; nothing where numbers in it may have units of their own.

    density : whether the formula is y per unit of x (counts in bins); None where it has no unit at all (single events).
    """
    if not isinstance(curve, Formula) or density is None or (axes.x_unit, axes.y_unit) == ("1", "1"):
        return {}
    if not _all_pure(curve.tree):
        return {}
    found = dimensions_of(curve, density=density, strict=True)
    units = {name: _unit(*found[name], axes.x_unit, axes.y_unit) for name in names if name in found}
    return {name: unit for name, unit in units.items() if unit is not None}


def contradiction(
    curve: object, axes: AxisNames, name: str, stated: str | None, *, density: bool | None, number: object = None
) -> str | None:
    """The rule that the unit stated for a parameter breaks, since the axes and the formula say another; None where nothing shows that.

    number : what was stated in that unit.  An axis in "1" may have a unit that nobody told: nothing follows from it.
    """
    if stated is None or not isinstance(curve, Formula) or not _all_pure(curve.tree, below=_LARGEST_PURE):
        return None
    found = dimensions_of(curve, density=density, strict=True).get(name)
    if found is None or any(power and unit == "1" for power, unit in zip(found, (axes.x_unit, axes.y_unit), strict=True)):
        return None
    follows = _unit(*found, axes.x_unit, axes.y_unit)
    if follows is None or same_unit(stated, follows) is not False:
        return None
    follows = "rad" if follows == "1" and is_in_degrees(stated) else follows
    what = "a pure number" if follows == "1" else f"in {follows}"
    said = f"must be {what} here, as the formula and the units of the axes say; nothing is converted"
    converted = in_unit(number, stated, follows) if isinstance(number, int | float) and not isinstance(number, bool) else None
    return said if converted is None else f"{said}: write {with_unit(f'{converted:.6g}', follows)} for {with_unit(f'{number:g}', stated)}"


def check_units(curve: object, axes: AxisNames, units: Mapping[str, str], numbers: Mapping[str, float], *, density: bool | None) -> None:
    """Raises InputError where a stated unit is another than the one that follows.  numbers : starts and values."""
    for name, unit in units.items():
        rule = contradiction(curve, axes, name, unit, density=density, number=numbers.get(name))
        if rule is not None:
            raise InputError(f"of '{name}' {rule}", field="units", value=unit)


def refuse_degrees(curve: object, axes: AxisNames, field: str) -> None:
    """Raises InputError naming `field` for the sine, cosine or tangent of an angle in degrees, as the axes say it is."""
    if not isinstance(curve, Formula):
        return
    for function, angle, power in angles_of(curve):
        unit = axes.x_unit if power[0] else axes.y_unit
        if is_in_degrees(unit) and _all_pure(angle):
            written = _Called(curve.variable).visit(copy.deepcopy(angle))
            rule = f"takes {function} of an angle in {unit}, but {function} takes radians: write {function}(radians({ast.unparse(written)}))"
            raise InputError(rule, field=field, value=curve.text)


class _Called(ast.NodeTransformer):
    """x becomes the name that the formula has for it, and a power is written as such."""

    def __init__(self, variable: str) -> None:
        self.variable = variable

    def visit_Name(self, node: ast.Name) -> ast.Name:
        return ast.Name(self.variable, ast.Load()) if node.id == "x" else node

    def visit_Constant(self, node: ast.Constant) -> ast.Constant:
        whole = isinstance(node.value, float) and node.value.is_integer()
        return ast.Constant(int(node.value)) if whole else node  # type: ignore[arg-type]

    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        power = isinstance(node.func, ast.Name) and node.func.id == "power"
        return ast.BinOp(node.args[0], ast.Pow(), node.args[1]) if power else node


def _all_pure(tree: ast.expr, *, below: float | None = None) -> bool:
    """Whether no number in a formula need have a unit of its own.  below : nor may one be as large as that (10, from mm to cm)."""
    numbers = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    return all(_is_pure(number) and (below is None or abs(float(number)) < below) for number in numbers)  # type: ignore[arg-type]


def _is_pure(number: object) -> bool:
    return isinstance(number, float) and abs(number) <= _LARGEST_PURE and float(4.0 * number).is_integer()


def _unit(power_x: float, power_y: float, x_unit: str, y_unit: str) -> str | None:
    """x_unit**power_x * y_unit**power_y as text; None where it cannot be written shortly."""
    if not (power_x.is_integer() and power_y.is_integer()):
        return None
    for power, unit, other, other_unit in ((power_x, x_unit, power_y, y_unit), (power_y, y_unit, power_x, x_unit)):
        if power == 1.0 and (other == 0.0 or other_unit == "1"):
            return unit
    factors: dict[str, int] = {}
    for unit, power in ((y_unit, power_y), (x_unit, power_x)):
        for name, exponent in _factors(unit).items():
            factors[name] = factors.get(name, 0) + exponent * int(power)
    over = [_raised(name, power) for name, power in factors.items() if power > 0]
    under = [_raised(name, -power) for name, power in factors.items() if power < 0]
    below = "" if not under else f"/{under[0]}" if len(under) == 1 else f"/({'·'.join(under)})"
    text = ("·".join(over) or "1") + below
    return text if len(text) <= _LONGEST else None


def _factors(unit: str) -> dict[str, int]:
    """Factors of a unit with their powers: "m/s²" -> m 1, s -2; one that is written otherwise is a factor as a whole."""
    if unit == "1":
        return {}
    over, _, under = unit.partition("/")
    found: dict[str, int] = {}
    for part, sign in ((over, 1), (under, -1)):
        for factor in re.split(r"[·* ]", part.strip("()")) if part not in ("", "1") else ():
            match = _FACTOR.fullmatch(factor)
            if match is None:
                return {f"({unit})": 1}
            found[match[1]] = found.get(match[1], 0) + sign * int(match[2].translate(_LOWERED) or 1)
    return found


def _raised(name: str, power: int) -> str:
    return name if power == 1 else name + str(power).translate(_RAISED)
