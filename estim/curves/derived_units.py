"""In which unit a derived quantity is, from the units of the names in its formula; and what cannot
be meant there, as the tangent of degrees.

Nothing is converted.  A name in "1" may have a unit that nobody stated, and a number may have one
of its own (`5*v`, the way in 5 s): nothing follows from them.  Numbers that are surely pure:
exponents, the 1 of `1/tau`, whole divisors as in `v**2/2`, and factors beside pi.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from fractions import Fraction

from estim.common import (
    InputError,
    in_unit,
    is_in_degrees,
    powers_in,
    raised,
    same_numbers,
    same_unit,
)
from estim.curves.dimensions import (
    ALIKE,
    ARCS,
    LARGEST_PURE,
    ROOTS,
    ZERO_CELSIUS,
    is_count_or_half,
    is_pure_in_angle,
    named_power,
    number_in_formula,
    parts_of,
    summed,
)
from estim.curves.formula import CONSTANTS, TRIGONOMETRIC, names_in

Factors = dict[str, Fraction]
"""A unit: its symbols with their powers; {} for a pure number."""

_OF_OWN_ZERO = {"°C", "°F", "degC", "degF"}
_CELSIUS, _KELVIN = {"°C": Fraction(1)}, {"K": Fraction(1)}
_ENERGIES = {"J", "kJ", "mJ", "W", "mW", "kW", "eV", "meV", "cal", "kcal", "erg"}
_SHARES = {"%", "‰", "ppm", "ppb"}
_OF_PURE = (*ARCS, "exp", "expm1", "log", "ln", "log10", "log2", "log1p", "sinh", "cosh", "tanh")
LONGEST = 20  # characters of a unit that nobody stated


def unit_that_follows(
    tree: ast.expr,
    symbols: Mapping[str, str],
    units: Mapping[str, str],
    stated: str | None,
    of_curve: str | None = None,
) -> str:
    """The unit of a formula: as stated, or as it follows from those of its names; "1" where it does
    not.

    symbols : name in the formula -> as it is written, `gamma[heavy]`.
    units : of the names as they are written.
    of_curve : of a tied parameter, as it follows from the curve; ½ and whole numbers are pure in
        its tie.

    Raises InputError without a field where the stated unit is another than the one that follows, a
    sine takes degrees, or metres are added to mm.
    """
    known = {
        symbol: factors
        for symbol, name in symbols.items()
        if (factors := _factors(units.get(name, "1")))
    }
    if of_curve is not None:
        read = _Reading(known, symbols, is_count_or_half).of(tree)
        if read is not None and _is_another(of_curve, read):
            raise InputError(
                f"would be {_what(_shown(read))}, but must be {_what(of_curve)}, as the curve and "
                "the units of the axes say; nothing is converted"
            )
        return stated or of_curve
    follows = _Reading(known, symbols).of(tree)
    if stated is None:
        unit = "1" if follows is None or _is_broken(follows) else _shown(follows)
        return unit if len(unit) <= LONGEST else "1"
    guessed = _Reading(known, symbols, is_pure_in_angle).of(tree) if follows is None else None
    wrong = follows is not None and (
        _is_another(stated, follows)
        or (isinstance(tree, ast.Name) and same_numbers(stated, _written(follows)) is False)
    )
    if wrong or (guessed is not None and _is_of_other_size(stated, guessed)):
        expected = follows if follows is not None else guessed or {}
        angle = is_in_degrees(stated) and same_unit(_written(expected), "rad") is True
        cure = (
            ": write degrees(...)" if angle else "" if follows is not None else _NUMBER_OF_ITS_OWN
        )
        raise InputError(
            f"must be {_what(_shown(expected))}, as its formula and the units in it say; nothing "
            f"is converted{cure}",
            value=stated,
        )
    return stated


_NUMBER_OF_ITS_OWN = (
    ' (give a number that has a unit a line of its own: {formula = "2", unit = "min"})'
)


class _Reading:
    """Reads units off a formula.  is_pure : of a number, whether it is wherever it stands; others
    only where they surely are.
    """

    def __init__(
        self,
        known: Mapping[str, Factors],
        symbols: Mapping[str, str],
        is_pure: Callable[[float], bool] | None = None,
    ) -> None:
        self.known, self.symbols, self.is_pure = known, symbols, is_pure

    def of(self, node: ast.expr) -> Factors | None:
        """Its unit; None where that is not known."""
        match node:
            case ast.Name(id=name):
                return {} if name in CONSTANTS else self.known.get(name)
            case ast.UnaryOp(operand=operand):
                return self.of(operand)
            case ast.BinOp(op=ast.Mult() | ast.Div()):
                return self._product(node)
            case ast.BinOp(left=left, right=right):
                unit = self._common_unit(left, right, "adds")
                numbers = number_in_formula(left), number_in_formula(right)
                to_kelvin = isinstance(node.op, ast.Add) and ZERO_CELSIUS in numbers
                return _KELVIN if to_kelvin and unit == _CELSIUS else unit
            case ast.Call(func=ast.Name(id="power"), args=[base, exponent]):
                number = number_in_formula(exponent)
                return None if number is None else _raised(self.of(base), number)
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return self._call(name, arguments)
        return None

    def _product(self, node: ast.expr) -> Factors | None:
        parts = list(parts_of(node))
        turns = any(names_in(part) & CONSTANTS.keys() for part, _ in parts)
        whole_below = any(sign < 0 and _is_integer(part) for part, sign in parts)
        product: Factors | None = {}
        for part, sign in parts:
            if isinstance(part, ast.Constant):
                value = float(part.value)  # type: ignore[arg-type]
                simple = abs(value) < LARGEST_PURE and (4.0 * value).is_integer()
                sure = turns or value == 1.0 or (_is_integer(part) and (sign < 0 or whole_below))
                pure = (simple and sure) or (self.is_pure is not None and self.is_pure(value))
                unit: Factors | None = {} if pure else None
            else:
                unit = self.of(part)
            product = (
                None if product is None or unit is None else summed(product, unit, Fraction(sign))
            )
        if product and {"K", "°C"} <= product.keys():
            others = summed(product, _CELSIUS, -product["°C"])
            for name in (named_power(part)[0] for part, _ in parts):
                if self.known.get(name) == _CELSIUS and _ENERGIES & others.keys():
                    raise InputError(
                        f"multiplies {self.symbols[name]} in °C by what is in {_shown(others)}; "
                        f"nothing is converted: write ({self.symbols[name]} + 273.15), or state a "
                        "difference in K"
                    )
            product = summed(others, _KELVIN, product["°C"])  # a difference of two in °C
        return product

    def _call(self, name: str, arguments: list[ast.expr]) -> Factors | None:
        if name in ALIKE:
            first, *others = arguments[name == "where" :]
            unit = self.of(first)
            for other in others:
                unit = self._common_unit(first, other, "compares")
            return {"rad": Fraction(1)} if name in ARCS else unit
        units = [
            self.of(argument) for argument in arguments if not isinstance(argument, ast.Compare)
        ]
        if name in ROOTS:
            return _raised(units[0], ROOTS[name])
        if name in TRIGONOMETRIC or name in ("radians", "degrees"):
            self._check_angle(name, arguments[0], units[0])
        if name in _OF_PURE and units[0] and _is_other_number(units[0]):
            raise InputError(
                f"takes {name} of what is in {_shown(units[0])}, but {name} needs unit 1; "
                "nothing is converted"
            )
        if name in ARCS or name == "radians":
            return {"rad": Fraction(1)}
        return {"°": Fraction(1)} if name == "degrees" else {} if name in TRIGONOMETRIC else None

    def _check_angle(self, name: str, angle: ast.expr, unit: Factors | None) -> None:
        """Raises InputError where a function of an angle takes something else."""
        if not unit:
            return
        actual, expected = _written(unit), "°" if name == "radians" else "rad"
        if same_unit(actual, expected) is not False or (
            name == "degrees" and in_unit(1.0, actual, "rad") is None
        ):
            return
        if name in TRIGONOMETRIC and is_in_degrees(actual):
            symbol = self.symbols[angle.id] if isinstance(angle, ast.Name) else "..."
            raise InputError(
                f"takes {name} of an angle in {_shown(unit)}, but {name} takes radians: "
                f"write {name}(radians({symbol}))"
            )
        if name in TRIGONOMETRIC or in_unit(1.0, actual, "rad") is not None:
            takes = "degrees" if name == "radians" else "radians"
            raise InputError(f"takes {name} of what is in {_shown(unit)}, but {name} takes {takes}")

    def _common_unit(self, left: ast.expr, right: ast.expr, what: str) -> Factors | None:
        """The unit of two that have the same.  Raises InputError where they have not."""
        first, second = (
            None if number_in_formula(side) is not None else self.of(side) for side in (left, right)
        )
        if first is None or second is None:
            pure = number_in_formula(left if first is None else right) == 1
            factors = second if first is None else first
            if pure and factors and set(factors.values()) == {1} and set(factors) <= _SHARES:
                raise InputError(f"{what} 1 and what is in {_shown(factors)}; nothing is converted")
            return second if first is None else first
        if not first or not second:
            # a pure number and metres: one of them has a number with a unit of its own
            return {} if first == second else None
        named = bool(named_power(left)[0] and named_power(right)[0])
        same = (same_numbers if named else same_unit)(_written(first), _written(second))
        if same is False and not _has_own_zero(_written(first), second):
            raise InputError(
                f"{what} what is in {power_text(first)} and what is in {power_text(second)}; "
                "nothing is converted"
            )
        return first


def _is_other_number(unit: Factors) -> bool:
    """Whether a unit is a number other than 1, as mm/m and %."""
    return in_unit(1.0, _written(unit), "1") is not None and same_unit(_written(unit), "1") is False


def _is_integer(node: ast.expr) -> bool:
    return (
        isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value.is_integer()
    )


def _factors(unit: str) -> Factors | None:
    """Symbols of a unit with their powers; None where nothing is stated, or it may be read in
    several ways.
    """
    return {
        symbol: Fraction(power) for symbol, power in (powers_in(unit) or {}).items() if power
    } or None


def _raised(unit: Factors | None, power: Fraction) -> Factors | None:
    return (
        None
        if unit is None
        else {symbol: power * exponent for symbol, exponent in unit.items() if power}
    )


def _written(unit: Factors) -> str:
    """A unit as one that is read: `kg m^2 s^-2`; with a power that is not whole, as one that is not
    known.
    """
    if _is_broken(unit):
        return "?"
    return (
        " ".join(f"{symbol}^{power}" if power != 1 else symbol for symbol, power in unit.items())
        or "1"
    )


def _what(unit: str) -> str:
    return "a pure number" if unit == "1" else f"in {unit}"


def _shown(unit: Factors) -> str:
    """A unit as people write it, m/s²."""
    return power_text(
        {symbol: power for symbol, power in unit.items() if symbol != "rad" or len(unit) == 1}
    )


def power_text(unit: Factors) -> str:
    """The same, radians not left out."""
    over, under = (
        [_power(symbol, abs(power)) for symbol, power in unit.items() if power * sign > 0]
        for sign in (1, -1)
    )
    below = "" if not under else f"/{under[0]}" if len(under) == 1 else f"/({'·'.join(under)})"
    return ("·".join(over) or "1") + below


def _is_broken(unit: Factors) -> bool:
    """Whether a power is not whole."""
    return any(power.denominator > 1 for power in unit.values())


def _power(symbol: str, power: Fraction) -> str:
    return symbol if power == 1 else symbol + raised(power)


def _has_own_zero(text: str, unit: Factors) -> bool:
    """Whether degrees Celsius or Fahrenheit are meant, which formulas turn into each other and into
    kelvins.
    """
    return bool(_OF_OWN_ZERO & {text, *unit})


def _is_another(stated: str, unit: Factors) -> bool:
    """Whether a unit is surely another one."""
    return same_unit(stated, _written(unit)) is False and not _has_own_zero(stated, unit)


def _is_of_other_size(stated: str, unit: Factors) -> bool:
    """Whether two units differ in size alone, mJ and J, where no number can have one of its own
    that makes up for it (a degree, a percent).
    """
    factors = _factors(stated)
    if (
        factors is None
        or same_unit(stated, text := _written(unit)) is not False
        or in_unit(1.0, stated, text) is None
    ):
        return False
    if list(factors.values()) == list(unit.values()) == [1]:
        return True  # deg and rad
    return not any(in_unit(1.0, symbol, "1") is not None for symbol in {**factors, **unit})
