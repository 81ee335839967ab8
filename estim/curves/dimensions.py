"""In which unit each parameter of a formula must be, as a power of that of x times a power of that
of y.

`a*exp(-x/tau)` adds up only if tau is in the unit of x and a in that of y.  Sums have terms of one
unit, functions take and give pure numbers, the whole has the unit of y: each is a linear equation
of exponents.

For the scale of a search (`dimensions_of`) numbers are pure, unless the equations before them show
otherwise: an equation that contradicts those before it is dropped.  What is told to a person
(`certain_dimensions`) may not guess: 9.81 and 0.25 may have units of their own, and so may every
number of a formula that would not add up else (`cos(2*pi*x/3)`, x in months); if it does not add up
even so, y may be a number of unknown unit.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import lru_cache
from typing import Literal

from estim.curves.formula import CONSTANTS, Formula, angles_in, names_in

Dimension = tuple[float, float]
"""Powers of the unit of x and of that of y."""

# name of an unknown exponent -> its coefficient; "" is the constant (of x, of y)
_Row = dict[str, Fraction]
ARCS = ("arcsin", "arccos", "arctan", "asin", "acos", "atan", "arctan2", "atan2")
# give what is in the unit of their arguments, an arctangent an angle
ALIKE = {
    *("abs", "hypot", "minimum", "maximum", "min", "max", "floor", "ceil"),
    *("where", "arctan2", "atan2"),
}
_OF_ANGLES = frozenset({"radians", "degrees", "sign", "heaviside"})
_LOGARITHMS = frozenset({"log", "ln", "log2", "log10"})
ROOTS = {"sqrt": Fraction(1, 2), "cbrt": Fraction(1, 3)}
ZERO_CELSIUS = Fraction("273.15")  # in kelvins
_X, _Y, _TEN = "(x)", "(y)", "(10)"
LARGEST_PURE = 10.0  # a number as large may turn mm into cm
LARGEST_MODERATE = 100.0  # scales of a search are as wide
_MOST_DECADES = 100.0  # of a factor


def dimensions_of(formula: Formula) -> tuple[dict[str, Dimension], dict[str, float]]:
    """Name -> unit of each parameter that the formula determines; and name -> how many times as
    large as its unit a parameter is because of very large and very small numbers beside it: 1e6 for
    R in `exp(-x/(R*1e-6))`.
    """
    system = _solved(formula, _System(), density=False)
    rows = {name: system.reduced({name: Fraction(1)}) for name in formula.names}
    return _parameter_dimensions(system, formula), {
        name: 10.0 ** min(max(float(row.get(_TEN, 0)), -_MOST_DECADES), _MOST_DECADES)
        for name, row in rows.items()
    }


@lru_cache(maxsize=64)
def certain_dimensions(
    formula: Formula,
    *,
    density: bool | None = False,
    x_is: Literal["an angle", "like y"] | None = None,
) -> Mapping[str, Dimension]:
    """Name -> unit of each parameter that the formula determines without a guess at the units of
    its numbers; nothing where it does not add up.

    density : whether the whole has the unit of y over that of x, None where it may have any.
    x_is : what follows from its unit, where the formula does not add up else.
    """
    known: tuple[dict[str, _Row], ...] = (
        ({}, {_X: {}})
        if x_is == "an angle"
        else ({}, {_Y: {_X: Fraction(1)}})
        if x_is == "like y"
        else ({},)
    )
    for is_density in (density, None):
        for is_pure in (is_count_or_half, _none):
            for axis in known:
                left_open = _OF_ANGLES | (_LOGARITHMS if is_density is None else frozenset())
                system = _System(dict(axis), left_open=left_open, is_pure=is_pure)
                if not _solved(formula, system, is_density).contradicted:
                    return _parameter_dimensions(system, formula)
    return {}


def pure_angles(formula: Formula) -> set[str]:
    """Names of what must be a pure number for the argument of a sine, cosine or tangent to be one,
    whatever stands around that.
    """
    pure: set[str] = set()
    for angle in angles_in(formula.tree):
        system = _System(left_open=_OF_ANGLES | _LOGARITHMS, is_pure=is_pure_in_angle)
        system.add_equation(_dimension(angle, system), {})
        if not system.contradicted:
            names = names_in(angle) & {*formula.names}
            pure |= {name for name in names if not system.reduced({name: Fraction(1)})}
    return pure


def gives_radians(tree: ast.expr) -> bool:
    """Whether a formula gives an arcsine, arccosine or arctangent, alone or as a term, perhaps with
    a number before it.
    """
    match tree:
        case ast.Call(func=ast.Name(id=name)) if name in ARCS:
            return True
        case ast.UnaryOp(operand=one):
            return gives_radians(one)
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
            return gives_radians(left) or gives_radians(right)
        case (
            ast.BinOp(left=ast.Constant(value=float(number)), op=ast.Mult(), right=one)
            | ast.BinOp(
                left=one, op=ast.Mult() | ast.Div(), right=ast.Constant(value=float(number))
            )
        ) if is_pure_in_angle(number):
            return gives_radians(one)
    return False


def is_pure_in_angle(number: float) -> bool:
    """Whether a factor of an angle turns no degrees into radians, as pi/180 and 57.3 do."""
    return abs(number) <= LARGEST_PURE and float(4.0 * number).is_integer()


def is_count_or_half(number: float) -> bool:
    # 0 has any unit
    return number == 0.5 or (0.0 < abs(number) < LARGEST_PURE and number.is_integer())


def _none(_: float) -> bool:
    return False


def _solved(formula: Formula, system: _System, density: bool | None) -> _System:
    dimension = _dimension(formula.tree, system)
    if density is not None:
        system.add_equation(dimension, {_Y: Fraction(1), **({_X: Fraction(-1)} if density else {})})
    return system


def _parameter_dimensions(system: _System, formula: Formula) -> dict[str, Dimension]:
    units = {name: _of_axes(system.reduced({name: Fraction(1)})) for name in formula.names}
    return {name: unit for name, unit in units.items() if unit is not None}


def _of_axes(row: _Row) -> Dimension | None:
    """The powers of the units of x and y, where there are no others."""
    return None if {*row} - {_X, _Y, _TEN} else (float(row.get(_X, 0)), float(row.get(_Y, 0)))


def angles_of(formula: Formula) -> list[tuple[str, ast.expr, Dimension]]:
    """Each sine, cosine and tangent of something that has the unit of x or of y: its name, its
    argument, and that unit.
    """
    system = _System(left_open=_OF_ANGLES)
    system.add_equation(_dimension(formula.tree, system), {_Y: Fraction(1)})
    return [
        (name, node, unit)
        for name, node, row in system.turned
        if (unit := _of_axes(system.reduced(row))) in ((1.0, 0.0), (0.0, 1.0))
    ]


@dataclass
class _System:
    """Solved equations: unknown -> what it is in terms of others, of the unit of x and of that of
    y.

    left_open : functions that may take any unit, as a logarithm (ln U + ...), and `degrees` give
        one.
    is_pure : whether a number has no unit of its own; None: none has.
    turned : name, argument and its unit of each sine, cosine and tangent, whose argument is then
        taken to be pure.
    """

    solved: dict[str, _Row] = field(default_factory=dict)
    n_fresh: int = 0
    contradicted: bool = False
    left_open: frozenset[str] = frozenset()
    is_pure: Callable[[float], bool] | None = None
    turned: list[tuple[str, ast.expr, _Row]] = field(default_factory=list)

    def fresh(self) -> _Row:
        self.n_fresh += 1
        return {f"({self.n_fresh})": Fraction(1)}

    def reduced(self, row: Mapping[str, Fraction]) -> _Row:
        result: _Row = {}
        for name, factor in row.items():
            for other, share in self.solved.get(name, {name: Fraction(1)}).items():
                result[other] = result.get(other, Fraction(0)) + factor * share
        return {name: factor for name, factor in result.items() if factor}

    def add_equation(self, left: Mapping[str, Fraction], right: Mapping[str, Fraction]) -> None:
        """Adds an equation, unless it contradicts the others."""
        row = self.reduced(summed(left, right, Fraction(-1)))
        unknown = next((name for name in row if name not in (_X, _Y, _TEN)), None)
        if unknown is None:
            self.contradicted |= bool(row)
            return
        factor = row.pop(unknown)
        self.solved[unknown] = {name: -share / factor for name, share in row.items()}
        self.solved = {name: self.reduced(rest) for name, rest in self.solved.items()}


def _dimension(node: ast.expr, system: _System) -> _Row:
    match node:
        case ast.Constant(value=float(value)):
            if system.is_pure is None:
                return _power_of_ten(value)
            return {} if system.is_pure(value) else system.fresh()
        case ast.Name(id="x"):
            return {_X: Fraction(1)}
        case ast.Name(id=name):
            return {} if name in CONSTANTS else {name: Fraction(1)}
        case ast.UnaryOp(operand=operand):
            return _dimension(operand, system)
        case ast.BinOp(left=left, op=op, right=right):
            first, second = _dimension(left, system), _dimension(right, system)
            if isinstance(op, ast.Mult | ast.Div):
                return summed(first, second, Fraction(1 if isinstance(op, ast.Mult) else -1))
            system.add_equation(first, second)
            return first if {*first} - {_TEN} or not second else second
        case ast.Call(func=ast.Name(id="power"), args=[base, exponent]):
            return _power(base, exponent, system)
        case ast.Call(func=ast.Name(id="degrees"), args=[angle]) if system.left_open:
            system.add_equation(_dimension(angle, system), {})
            return system.fresh()
        case ast.Call(func=ast.Name(id=name), args=[argument, *_]) if name in system.left_open:
            _dimension(argument, system)
            return {}
        case ast.Call(func=ast.Name(id="sin" | "cos" | "tan" as name), args=[angle]):
            of_angle = system.reduced(_dimension(angle, system))
            system.turned.append((name, angle, of_angle))
            return _call(name, [of_angle], system)
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return _call(
                name,
                [_dimension(part, system) for part in arguments if not _is_choice(part, system)],
                system,
            )
    return system.fresh()


def _power_of_ten(number: float) -> _Row:
    """How large a number is, if it is very large or small."""
    size = abs(number)
    if size == 0.0 or 1.0 / LARGEST_MODERATE <= size <= LARGEST_MODERATE:
        return {}
    return {_TEN: Fraction(math.log10(size)).limit_denominator(100)}


def _power(base: ast.expr, exponent: ast.expr, system: _System) -> _Row:
    of_base, of_exponent = _dimension(base, system), _dimension(exponent, system)
    number = number_in_formula(exponent)
    if number is not None:
        return {name: factor * number for name, factor in of_base.items()}
    system.add_equation(of_exponent, {})
    if not set(system.reduced(of_base)) & {_X, _Y}:
        system.add_equation(of_base, {})
        return {}
    return system.fresh()  # x**n, whose unit changes with n


def _call(name: str, arguments: list[_Row], system: _System) -> _Row:
    if name in ROOTS:
        return {symbol: factor * ROOTS[name] for symbol, factor in arguments[0].items()}
    if name in ALIKE or name == "voigt":
        for other in arguments[1:]:
            system.add_equation(arguments[0], other)
        if name == "voigt":
            return {symbol: -factor for symbol, factor in arguments[0].items()}
        return {} if name in ARCS else arguments[0]
    for argument in arguments:
        system.add_equation(argument, {})
    return {}


def _is_choice(node: ast.expr, system: _System) -> bool:
    """Whether this is the condition of a `where`; its sides have one unit."""
    if isinstance(node, ast.Compare):
        system.add_equation(_dimension(node.left, system), _dimension(node.comparators[0], system))
    return isinstance(node, ast.Compare)


def number_in_formula(node: ast.expr) -> Fraction | None:
    """The number that a part of a formula is, None where it holds a name."""
    match node:
        case ast.Constant(value=float(value)):
            return Fraction(value).limit_denominator(1000)
        case ast.UnaryOp(op=op, operand=operand):
            number = number_in_formula(operand)
            return None if number is None else -number if isinstance(op, ast.USub) else number
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            first, second = number_in_formula(left), number_in_formula(right)
            return None if first is None or not second else first / second
    return None


def named_power(node: ast.expr) -> tuple[str, Fraction | float]:
    """The name of which a part of a formula is a power, and that power, NaN where it is no number;
    "" for others.
    """
    match node:
        case ast.Name(id=name):
            return name, 1
        case ast.Call(func=ast.Name(id="power"), args=[ast.Name(id=name), exponent]):
            return name, math.nan if (number := number_in_formula(exponent)) is None else number
        case ast.Call(func=ast.Name(id=root), args=[ast.Name(id=name)]) if root in ROOTS:
            return name, ROOTS[root]
        case ast.BinOp(left=ast.Constant(), op=ast.Div(), right=below):
            name, power = named_power(below)
            return name, -power
    return "", 1


def parts_of(
    node: ast.expr,
    sign: int = 1,
    *,
    operations: tuple[type[ast.operator], type[ast.operator]] = (ast.Mult, ast.Div),
) -> Iterator[tuple[ast.expr, int]]:
    """Factors of a product, and whether they multiply (1) or divide (-1); terms where `operations`
    are those of a sum.
    """
    match node:
        case ast.UnaryOp(op=op, operand=operand):
            turns = isinstance(op, ast.USub) and ast.Sub in operations
            yield from parts_of(operand, -sign if turns else sign, operations=operations)
        case ast.BinOp(left=left, op=op, right=right) if isinstance(op, operations):
            yield from parts_of(left, sign, operations=operations)
            second = sign if isinstance(op, operations[0]) else -sign
            yield from parts_of(right, second, operations=operations)
        case _:
            yield node, sign


def summed(left: Mapping[str, Fraction], right: Mapping[str, Fraction], factor: Fraction) -> _Row:
    names = {**left, **right}
    return {
        name: value
        for name in names
        if (value := left.get(name, Fraction(0)) + factor * right.get(name, Fraction(0)))
    }
