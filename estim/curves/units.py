"""Units of a formula's parameters from those of its axes: tau of `a*exp(-x/tau)` is in the unit of x, a in that of y."""

from __future__ import annotations

import ast
import re
from collections.abc import Collection
from dataclasses import dataclass

from estim.curves.dimensions import dimensions_of
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
    if not all(_is_pure(node.value) for node in ast.walk(curve.tree) if isinstance(node, ast.Constant)):
        return {}
    found = dimensions_of(curve, density=density, strict=True)
    units = {name: _unit(*found[name], axes.x_unit, axes.y_unit) for name in names if name in found}
    return {name: unit for name, unit in units.items() if unit is not None}


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
