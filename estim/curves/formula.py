"""A user's own formula, like `a*exp(-b*x) + c`, as a curve.

A formula is data, not code: numbers, `x`, parameters, `pi`, `e`, + - * / **, comparisons inside
`where` and the functions of `FUNCTIONS`.  Everything else is refused when the text is read, with
one line that says what, before anything is computed.  What is left is compiled once and evaluated
with no other names, Python's built-in ones included; on dual numbers the same evaluation gives the
exact derivatives.
"""

from __future__ import annotations

import ast
import copy
import difflib
import keyword
import re
import warnings
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import CodeType
from typing import Any

import numpy as np

from estim.arrays import FloatArray, Named
from estim.common import InputError, read_number, same_looks
from estim.curves.dual_numbers import Dual, plain
from estim.problem import LocalCurve

CONSTANTS: Mapping[str, float] = {"pi": float(np.pi), "e": float(np.e)}
# name -> NumPy's or SciPy's name, number of arguments
FUNCTIONS: Mapping[str, tuple[str, int]] = {
    **{
        name: (name, 1)
        for name in (
            "sin",
            "cos",
            "tan",
            "arcsin",
            "arccos",
            "arctan",
            "sinh",
            "cosh",
            "tanh",
            "arcsinh",
            "arccosh",
            "arctanh",
            "exp",
            "expm1",
            "log",
            "log1p",
            "log2",
            "log10",
            "sqrt",
            "cbrt",
            "abs",
            "sign",
            "floor",
            "ceil",
            "radians",
            "degrees",
            "erf",
            "erfc",
        )
    },
    "asin": ("arcsin", 1),
    "acos": ("arccos", 1),
    "atan": ("arctan", 1),
    "ln": ("log", 1),
    "where": ("where", 3),
    "voigt": ("voigt_profile", 3),
    **{name: (name, 2) for name in ("arctan2", "hypot", "heaviside")},
    "atan2": ("arctan2", 2),
    "min": ("minimum", 2),
    "max": ("maximum", 2),
}
RESERVED = frozenset({"x", *CONSTANTS, *FUNCTIONS})
TRIGONOMETRIC = ("sin", "cos", "tan")

MAX_LENGTH = 2000
_MAX_POWER = 1000.0
_POWER = "power"  # no name of a formula: ** is turned into it
_OPERATORS = (ast.Add, ast.Sub, ast.Mult, ast.Div)
_SIGNS = (ast.UAdd, ast.USub)
_COMPARISONS = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
_NODES = (ast.Constant, ast.Name, ast.Load, ast.UnaryOp, ast.BinOp, ast.Compare, ast.Call)
_PARTS = (*_NODES, *_SIGNS, *_OPERATORS, *_COMPARISONS)


@dataclass(frozen=True, eq=False)
class Formula:
    """A formula that was read and found harmless; it keeps to `estim.problem.curve.Curve`, and x
    may differ from draw to draw.

    text : as written.
    names : its parameters in order of appearance.  tree : what `evaluate` takes.  variable : how x
        is called in the text.
    """

    text: str
    names: tuple[str, ...]
    tree: ast.expr
    variable: str = "x"

    def in_terms_of(self, variable: str) -> Formula:
        """The same formula with its parameter `variable` as the abscissa, for one that does not use
        x.
        """
        tree = Renamed(variable, "x").visit(copy.deepcopy(self.tree))
        return Formula(
            self.text, tuple(name for name in self.names if name != variable), tree, variable
        )

    @property
    def uses_x(self) -> bool:
        """Whether it depends on its variable; one that does not is a constant."""
        return "x" in names_in(self.tree)

    def value(self, x: FloatArray, arguments: Named) -> FloatArray:
        return _full(
            evaluate(self.tree, {"x": x, **numbers_of(arguments, self.names)}), x, arguments
        )

    def local(self, x: FloatArray, arguments: Named) -> LocalCurve:
        symbols = {
            name: Dual(value, {name: 1.0})
            for name, value in {"x": x, **numbers_of(arguments, self.names)}.items()
        }
        return local_of(evaluate(self.tree, symbols), x, arguments, self.names)


def names_in(tree: ast.expr) -> set[str]:
    """All names in a tree, those of constants and functions too."""
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


def angles_in(tree: ast.expr) -> list[ast.expr]:
    """What a tree takes sines, cosines and tangents of."""
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
    return [call.args[0] for call in calls if getattr(call.func, "id", "") in TRIGONOMETRIC]


class Renamed(ast.NodeTransformer):
    """One name in place of another."""

    def __init__(self, name: str, new: str) -> None:
        self.name, self.new = name, new

    def visit_Name(self, node: ast.Name) -> ast.Name:
        if node.id != self.name:
            return node
        return ast.copy_location(ast.Name(self.new, ast.Load()), node)


def read_formula(text: object, *, field: str = "expression") -> Formula:
    """The formula written in `text`, on one line or several: the end of a line is a blank; one that
    was read already as it is.

    Raises InputError naming `field` where the text is not a formula of the allowed kind, holds a
    comment, or a part of it that holds neither x nor a parameter is not a finite number.
    """
    if isinstance(text, Formula):
        return text
    if not isinstance(text, str) or not text.strip():
        raise InputError(
            'must be a formula like "a*exp(-b*x) + c"',
            field=field,
            value=text if text != "" else "''",
        )
    return _read(text, field)


@lru_cache(maxsize=256)
def _read(text: str, field: str) -> Formula:
    if len(text) > MAX_LENGTH:
        raise InputError(
            f"must be at most {MAX_LENGTH} characters long", field=field, value=len(text)
        )
    _check_comment(text, field)
    text = " ".join(text.split()).replace("^", "**")  # as it is written elsewhere
    tree = _parse(text, field)
    _check_size(tree, field)
    names: dict[str, None] = {}
    checked = _checked(tree, names, field, text)
    _check_constants(checked, field)
    _check_looks(names, field)
    return Formula(text, tuple(names), ast.fix_missing_locations(checked))


def check_names(names: Collection[str], *, field: str) -> None:
    """Names of parameters can stand in a formula.  Raises InputError."""
    for name in names:
        if not isinstance(name, str) or not name.isidentifier() or name.startswith("_"):
            raise InputError(
                "must be named by letters, digits and _, a letter first", field=field, value=name
            )
        if name in RESERVED or name == _POWER:
            raise InputError(
                "has a parameter named like the variable, a constant or a function",
                field=field,
                value=name,
            )
    _check_looks(names, field)


def _check_looks(names: Iterable[str], field: str) -> None:
    """No name passes for another one, nor for the variable, a constant or a function, by letters of
    another alphabet.
    """
    latin = all(map(str.isascii, names))
    if not latin and (lookalikes := same_looks((*sorted(RESERVED), *names))):
        raise InputError(
            "has two names that look alike: write both in the letters of one alphabet",
            field=field,
            value=lookalikes,
        )


def evaluate(tree: ast.expr, symbols: Mapping[str, Any]) -> Any:
    """Value of a checked tree; NaN or infinity where it has none (a logarithm of a negative
    number).
    """
    code, known = _compiled(tree)
    with np.errstate(all="ignore"):
        return eval(code, known, symbols)


@lru_cache(maxsize=256)
def _compiled(tree: ast.expr) -> tuple[CodeType, dict[str, Any]]:
    """The code of a checked tree and all names that it finds beside its symbols.

    Numbers become names, `_0` and so on, which no parameter can have: Python's own would raise an
    error where NumPy's give an infinity.
    """
    known: dict[str, Any] = {**_functions(), **CONSTANTS, "__builtins__": {}}

    class Numbered(ast.NodeTransformer):
        def visit(self, node: Any) -> Any:
            if not isinstance(node, _PARTS):
                raise TypeError(f"no part of a checked formula: {type(node).__name__}")
            return super().visit(node)

        def visit_Constant(self, node: ast.Constant) -> ast.Name:
            name = f"_{len(known)}"
            known[name] = np.float64(node.value)  # type: ignore[arg-type]
            return ast.Name(name, ast.Load())

    named = ast.fix_missing_locations(Numbered().visit(copy.deepcopy(tree)))
    return compile(ast.Expression(named), "<formula>", "eval"), known


def local_of(result: Any, x: FloatArray, arguments: Named, names: Iterable[str]) -> LocalCurve:
    """The curve and its derivatives from a result on dual numbers, every array (n_draw, n_obs)."""
    partials = result.partials if isinstance(result, Dual) else {}
    value = _full(plain(result), x, arguments)
    slopes = {name: _spread(partials.get(name, 0.0), value.shape) for name in ("x", *names)}
    return LocalCurve(value, slopes["x"], {name: slopes[name] for name in names})


def _full(result: Any, x: FloatArray, arguments: Named) -> FloatArray:
    """A result as (n_draw, n_obs)."""
    shapes = [np.shape(value) for value in (x, *arguments.values())]
    n_draw = next((shape[0] for shape in shapes if len(shape) == 2 and shape[0] != 1), 1)
    return _spread(result, (n_draw, np.shape(x)[-1]))


def _spread(result: Any, shape: tuple[int, ...]) -> FloatArray:
    """A result in all rows and columns of `shape`."""
    array = np.asarray(result, dtype=float)
    return array if array.shape == shape else np.full(shape, array)


def numbers_of(arguments: Named, names: Iterable[str]) -> dict[str, Any]:
    """The arguments `names` as numbers of NumPy, of which 0.0 ** -1 is inf, or arrays of them."""
    return {name: np.asarray(arguments[name], dtype=float)[()] for name in names}


@lru_cache(maxsize=1)
def _functions() -> dict[str, Any]:
    from scipy import special

    of_scipy = ("erf", "erfc", "voigt_profile")
    named = {
        name: getattr(special if numpy_name in of_scipy else np, numpy_name)
        for name, (numpy_name, _) in FUNCTIONS.items()
    }
    return named | {_POWER: np.power}


def _check_comment(text: str, field: str) -> None:
    """No part of a formula is a comment: what `#` hides depends on where lines end, and TOML joins
    lines before they are read here.
    """
    before, mark, hidden = text.partition("#")
    if mark:
        line = before.count("\n") + 1
        position = f" (here in line {line} of the formula)" if "\n" in text.strip() else ""
        raise InputError(
            f"must not hold a comment, for # hides what follows it{position}: put comments outside "
            "the quotes",
            field=field,
            value=" ".join((mark + hidden).split()),
        )


def _parse(text: str, field: str) -> ast.expr:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of Python's parser, on things that are refused below
            return ast.parse(text, mode="eval").body
    except SyntaxError as error:
        hint = " (one expression, without '=')" if "=" in text else ""
        for word in re.findall(r"[^\W\d]\w*", text):
            if keyword.iskeyword(word):
                hint += f" ('{word}' is a word of Python: take another name, like {word}_)"
        if re.search(r"[\w)]\s+[\w(]|\d[^\W\d]", text):  # 2x, a x, sin x
            hint += (
                " (write products with *, as in 2*a*x, and functions with brackets, as in sin(x))"
            )
        raise InputError(f"is not a formula{hint}: {error.msg}", field=field, value=text) from None
    except (ValueError, RecursionError, MemoryError) as error:
        raise InputError(
            f"is not a formula ({type(error).__name__})", field=field, value=text
        ) from None


def _check_size(tree: ast.expr, field: str) -> None:
    pending: list[tuple[ast.AST, int]] = [(tree, 1)]
    count = 0
    while pending:
        node, depth = pending.pop()
        count += 1
        if count > 600 or depth > 120:
            raise InputError("is too long or nested too deeply", field=field)
        pending.extend(
            (child, depth + 1)
            for child in ast.iter_child_nodes(node)
            if isinstance(child, ast.expr | ast.keyword | ast.comprehension)
        )


def _checked(
    node: ast.AST, names: dict[str, None], field: str, text: str, *, condition: bool = False
) -> ast.expr:
    """The tree made of allowed nodes only, numbers as floats, ** as a function; `names` collects
    the parameters.
    """

    def below(child: ast.AST, *, condition: bool = False) -> ast.expr:
        return _checked(child, names, field, text, condition=condition)

    match node:
        case ast.Constant(value=number) if isinstance(number, int | float) and not isinstance(
            number, bool
        ):
            return ast.Constant(_number(ast.get_source_segment(text, node) or "", field))
        case ast.Name(id=name):
            if name in FUNCTIONS:
                raise InputError(
                    f"must give the function '{name}' its arguments in ( )", field=field, value=text
                )
            if name == "e":
                raise InputError(
                    "has an e that is no base of a power: e is Euler's number here; "
                    "write exp(1) for it, and another name, as q_e, for a charge",
                    field=field,
                    value=text,
                )
            if name not in RESERVED:
                check_names([name], field=field)
                names.setdefault(name)
            return ast.Name(name, ast.Load())
        case ast.UnaryOp(op=op, operand=operand) if isinstance(op, _SIGNS):
            return ast.UnaryOp(op, below(operand))
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            exponent = below(right)
            _check_power(exponent, field, text)
            of_e = isinstance(left, ast.Name) and left.id == "e"
            base = ast.Name("e", ast.Load()) if of_e else below(left)
            return ast.Call(ast.Name(_POWER, ast.Load()), [base, exponent], [])
        case ast.BinOp(left=left, op=op, right=right) if isinstance(op, _OPERATORS):
            return ast.BinOp(below(left), op, below(right))
        case ast.Compare(left=left, ops=[op], comparators=[right]) if condition and isinstance(
            op, _COMPARISONS
        ):
            return ast.Compare(below(left), [op], [below(right)])
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in FUNCTIONS:
            n_arguments = FUNCTIONS[name][1]
            if len(arguments) != n_arguments:
                raise InputError(
                    f"must give '{name}' {n_arguments} argument{'s' if n_arguments > 1 else ''}",
                    field=field,
                    value=text,
                )
            children = [
                below(argument, condition=name == "where" and i == 0)
                for i, argument in enumerate(arguments)
            ]
            return ast.Call(ast.Name(name, ast.Load()), children, [])
    raise InputError(_refusal(node), field=field, value=text)


def _number(written: str, field: str) -> float:
    """A number as tables write it: 1_000 and 0x10 are slips here as there."""
    try:
        value = read_number(written)
    except ValueError:
        raise InputError(
            "must write numbers with the digits 0 to 9 and a decimal point",
            field=field,
            value=written,
        ) from None
    if not np.isfinite(value):
        raise InputError("holds a number that is too large", field=field)
    return value


def _check_power(exponent: ast.expr, field: str, text: str) -> None:
    if names_in(exponent) <= _constant_names():
        value = evaluate(exponent, {})
        if not abs(value) <= _MAX_POWER:
            raise InputError(f"holds an exponent beyond {_MAX_POWER:.0f}", field=field, value=text)


def _check_constants(tree: ast.expr, field: str) -> None:
    """Parts without x and parameters are finite numbers."""
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.BinOp | ast.Call)
            and names_in(node) <= _constant_names()
            and not np.isfinite(evaluate(node, {}))
        ):
            raise InputError(
                "holds a part that is not a finite number", field=field, value=ast.unparse(node)
            )


def _constant_names() -> frozenset[str]:
    return frozenset({*CONSTANTS, *FUNCTIONS, _POWER})


def _refusal(node: ast.AST) -> str:
    match node:
        case ast.Attribute() | ast.Import():
            return "must not reach into anything with '.': write sin(x), not np.sin(x)"
        case ast.Call(func=ast.Name(id=name), args=_):
            if name not in FUNCTIONS:
                close = difflib.get_close_matches(name, FUNCTIONS, n=1)
                hint = (
                    f"did you mean '{close[0]}'?"
                    if close
                    else "for example sin, exp, log, sqrt, where"
                )
                return f"calls '{name}', which is not a known function ({hint})"
            return f"must give '{name}' plain arguments, without names or *"
        case ast.Call():
            return "must call functions by their names, and multiply with *"
        case ast.Subscript():
            return "must use ( ), not [ ]"
        case ast.Compare() | ast.BoolOp() | ast.IfExp():
            return (
                "must write a choice as where(condition, value, other), with one < or > in its "
                "condition"
            )
        case ast.Constant():
            return "must hold numbers, not text or other values"
    return f"must be made of numbers, names, + - * / ** and functions, not {type(node).__name__}"
