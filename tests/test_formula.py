"""A user's formula: what is refused, and derivatives against ones that share no code with them."""

from __future__ import annotations

import ast
import cmath
import math
import time

import numpy as np
import pytest

from estim.common.errors import InputError
from estim.curves.formula import FUNCTIONS, MAX_LENGTH, _compiled, evaluate, read_formula
from estim.curves.function import wrap_function

HOSTILE = [
    "__import__('os').system('true')",
    "().__class__.__bases__[0].__subclasses__()",
    "x.__class__",
    "np.sin(x)",
    "open('/etc/passwd')",
    "eval('1')",
    "exec('1')",
    "getattr(x, 'T')",
    "print(x)",
    "globals()",
    "lambda: x",
    "(lambda: 0)()",
    "[i for i in range(10**9)]",
    "{i for i in x}",
    "(i for i in x)",
    "{1: x}",
    "[x]*10",
    "(x, x)",
    "x[0]",
    "x[::2]",
    "'a'*10**9",
    "'a'",
    "b'a'",
    "f'{x}'",
    "...",
    "None",
    "True + x",
    "1j*x",
    "x if x > 0 else 1",
    "x and a",
    "not x",
    "~x",
    "x << 99",
    "x | 1",
    "x // 2",
    "x % 2",
    "x @ x",
    "a := 3",
    "await x",
    "yield x",
    "*x",
    "x; x",
    "x\nimport os",
    "import os",
    "a = 2",
    "a == 2",
    "9**9**9",
    "9**9**9**9",
    "x**(9**9)",
    "2**-(9**9)",
    "10.0**400",
    "1e999*x",
    "9" * 1500 + "*x",
    "1/0",
    "x + 0/0",
    "exp(1000)*x",
    "log(-1) + x",
    "sqrt(-1)",
    "exp[x]",
    "2x",
    "3(x)",
    "x x",
    "sin x",
    "sin",
    "sin()",
    "sin(x, x)",
    "sin(x=1)",
    "sin(*x)",
    "sin(**x)",
    "where(x)",
    "max(x)",
    "x < 1",
    "1 < x < 2",
    "where(1 < x < 2, 1, 0)",
    "_a*x",
    "__builtins__",
    "power(x, 2)",
    "a.b",
    "",
    "   ",
    "(",
    ")",
    "(" * 90 + "x",
    "-" * 1500 + "x",
    "+".join(["x"] * 900),
    "x" * (MAX_LENGTH + 1),
    "a\0b",
    "\ud800",
    "h*f/e",
    "where(where(x > 1, 1, 0), 1, x > 2)",
]


@pytest.mark.parametrize("text", HOSTILE, ids=range(len(HOSTILE)))
def test_what_is_no_formula_is_refused_in_one_line_and_at_once(text: str) -> None:
    begun = time.process_time()
    with pytest.raises(InputError, match="'expression' ") as caught:
        read_formula(text)
    assert time.process_time() - begun < 0.5
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


@pytest.mark.parametrize("value", [None, 3, ["x"], b"x"])
def test_a_formula_is_text(value: object) -> None:
    with pytest.raises(InputError, match="must be a formula"):
        read_formula(value)


def test_a_formula_that_grew_nested_powers_at_run_time_gives_no_number_but_ends() -> None:
    formula = read_formula("a**(b**(c**x))")
    value = formula.value(np.array([5.0]), {"a": 9.0, "b": 9.0, "c": 9.0})
    assert np.isinf(value[0, 0])


def test_a_typing_error_is_met_with_a_suggestion() -> None:
    with pytest.raises(InputError, match="did you mean 'sqrt'"):
        read_formula("a*sqr(x)")


def test_a_caret_is_a_power_and_is_shown_as_one() -> None:
    formula = read_formula("a*x^2")
    assert formula.text == "a*x**2"
    assert formula.value(np.array([3.0]), {"a": 2.0})[0, 0] == 18.0


def test_parameters_come_in_order_of_appearance() -> None:
    assert read_formula("b*sin(x) + a*pi + b*e**2").names == ("b", "a")


def test_a_formula_may_be_written_on_several_lines() -> None:
    assert read_formula("a*x\n + b").value(np.array([2.0]), {"a": 3.0, "b": 1.0}) == 7.0


@pytest.mark.parametrize(
    "text",
    [
        "a*x + b   # line\n+ 3.0*x**2",
        "a*x  # slope",
        "# c\na*x",
        "a*x + b  # line + 3.0*x**2",
        "a*x # c\u2028+ b",
        "a*x #\r+ b",
        "a*x##\n",
    ],
)
def test_a_comment_is_refused_for_it_would_hide_terms(text: str) -> None:
    """TOML joins lines that end with a backslash before the formula is read: where a comment ends
    is not known here.
    """
    with pytest.raises(
        InputError,
        match=r"must not hold a comment, for # hides what follows it.*: put comments outside the "
        r"quotes: #",
    ):
        read_formula(text)


def test_the_line_of_a_comment_is_told() -> None:
    with pytest.raises(InputError, match=r"\(here in line 2 of the formula\).*: # curvature \+ b$"):
        read_formula("a*x\n+ c*x**2   # curvature\n+ b")


JOINED = [
    "a*x +\n b",
    "a*x\n+ b",
    "a*x\n\n\n+ b\n",
    "a*x\r\n+ b",
    "a*x\r+ b",
    "a*x\u2028+ b",
    "a*x\x0c+\tb",
    "(a\n*x)\n+b",
]
APART = [
    "a*x \\\n + b",
    "a*x; + b",
    "a*x +",
    "a*x\nb",
    "a*1\n5*x",
    "a*1e\n5",
    "ab\n(x)",
    "a*x*\n*b",
    "si\nn(x)",
    "a*x\n;b",
    "'a*x' + b",
    '"""a*x"""',
    "a*x, b",
    "a*x\n\\\nb",
]


@pytest.mark.parametrize("text", JOINED)
def test_the_end_of_a_line_is_a_blank_and_nothing_more(text: str) -> None:
    assert read_formula(text).value(np.array([2.0]), {"a": 3.0, "b": 1.0}) == 7.0


@pytest.mark.parametrize("text", APART)
def test_what_is_more_than_one_expression_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="'expression' "):
        read_formula(text)


@pytest.mark.parametrize("number", ["1_0", "1_000.5", "0x10", "0b1", "0o7", "1e1_0", "1_0e3"])
def test_numbers_are_written_as_in_tables(number: str) -> None:
    with pytest.raises(
        InputError, match=f"must write numbers with the digits 0 to 9 and a decimal point: {number}"
    ):
        read_formula(f"a*x + {number}")


@pytest.mark.parametrize(
    ("number", "value"),
    [
        ("1e3", 1e3),
        (".5", 0.5),
        ("6.", 6.0),
        ("00", 0.0),
        ("2.5E-1", 0.25),
        ("0.1", 0.1),
        ("9" * 30, 1e30),
    ],
)
def test_numbers_are_read_to_the_last_digit(number: str, value: float) -> None:
    assert read_formula(number).value(np.array([1.0]), {})[0, 0] == value


def test_every_function_agrees_with_the_library_it_is_named_after() -> None:
    from scipy import special

    x = np.array([0.3, 0.7, 1.4])
    other = {
        "ln": np.log,
        "abs": np.abs,
        "asin": np.arcsin,
        "acos": np.arccos,
        "atan": np.arctan,
        "atan2": np.arctan2,
    }
    other |= {"max": np.maximum, "min": np.minimum, "erf": special.erf, "erfc": special.erfc}
    for name, (_, count) in FUNCTIONS.items():
        if count == 3:
            continue
        call = f"{name}(x)" if count == 1 else f"{name}(x, 0.8)"
        function = other.get(name) or getattr(np, name)
        with np.errstate(invalid="ignore"):
            expected = function(x) if count == 1 else function(x, 0.8)
        np.testing.assert_array_equal(read_formula(call).value(x, {})[0], expected, err_msg=name)


def test_a_formula_is_compiled_once_and_sees_no_built_in_name() -> None:
    formula = read_formula("a*exp(-b*x) + 1/x")
    values = {"a": 2.0, "b": 0.5}
    formula.value(np.array([1.0, 2.0]), values)
    compiled = _compiled.cache_info()
    for _ in range(50):
        assert np.isinf(formula.value(np.array([0.0]), values)[0, 0])
    assert _compiled.cache_info().misses == compiled.misses
    assert _compiled(formula.tree)[1]["__builtins__"] == {}
    for forged in ("open", "print", "__import__", "np"):
        with pytest.raises(NameError):
            evaluate(ast.parse(forged, mode="eval").body, {})
    with pytest.raises(TypeError, match="no part of a checked formula: Attribute"):
        evaluate(ast.parse("x.real", mode="eval").body, {"x": 1.0})


SMOOTH = [
    "a*exp(-b*x) + c",
    "a*sin(b*x + c)/x",
    "a*x**b + c",
    "(a + b*x + c*x**2)/(1 + a*x)",
    "a*log(b*x + c*c)",
    "a*sqrt(b*x) + cbrt(c*x)",
    "a**(b*x)*c",
    "a*arctan(b*x) + arcsin(c*x/9)",
    "a*tanh(b*x)*cosh(c)",
    "a/(1 + exp(b - c*x))",
    "arctan2(a*x, b + c*x)",
    "hypot(a, b*x)*c",
    "a*expm1(-b*x)/log1p(c*x)",
    "where(x > 1.2, a*x**2, b*x) + c",
    "a*log10(b*x)*log2(c + x)",
    "a*arccosh(2 + b*x) + arcsinh(c*x) + arctanh(x/9)",
    "tan(a*x/4)*radians(b)*degrees(c)",
    "max(a*x, b) + min(c*x, 1)",
    "a - -b*+x + x**-c",
    "abs(a - x)*b + c",
]
VALUES = {"a": 1.3, "b": 0.7, "c": 0.45}
X = np.array([0.5, 0.9, 1.5, 2.6])


@pytest.mark.parametrize("text", SMOOTH)
def test_derivatives_agree_with_differences(text: str) -> None:
    formula = read_formula(text)
    local = formula.local(X, VALUES)
    np.testing.assert_array_equal(local.value, formula.value(X, VALUES))
    h = 1e-6
    for name in formula.names:
        up, down = (formula.value(X, VALUES | {name: VALUES[name] + s}) for s in (h, -h))
        np.testing.assert_allclose(
            local.gradient[name], (up - down) / (2 * h), rtol=1e-7, atol=1e-8, err_msg=name
        )
    slope = (formula.value(X + h, VALUES) - formula.value(X - h, VALUES)) / (2 * h)
    np.testing.assert_allclose(local.slope, slope, rtol=1e-7, atol=1e-8)


def test_derivatives_are_exact_where_a_complex_step_is() -> None:
    formula = read_formula("a*exp(-b*x)*cos(c*x)/(1 + a*x**b)")
    local = formula.local(X, VALUES)

    def by_hand(x: float, a: complex, b: complex, c: complex) -> complex:
        return a * cmath.exp(-b * x) * cmath.cos(c * x) / (1 + a * x**b)

    for name in "abc":
        step = {k: v + (1e-40j if k == name else 0) for k, v in VALUES.items()}
        expected = [by_hand(float(x), **step).imag / 1e-40 for x in X]
        np.testing.assert_allclose(local.gradient[name][0], expected, rtol=5e-15)


def test_a_power_of_zero_has_a_derivative() -> None:
    local = read_formula("a*x**b").local(np.array([0.0, 2.0]), {"a": 2.0, "b": 1.5})
    np.testing.assert_allclose(local.gradient["b"][0], [0.0, 2.0 * 2.0**1.5 * np.log(2.0)])
    np.testing.assert_allclose(local.slope[0], [0.0, 3.0 * 2.0**0.5])


def test_a_choice_hides_the_branch_that_is_not_taken() -> None:
    local = read_formula("where(x > 0, a*log(x), a*x)").local(np.array([-1.0, 1.0]), {"a": 2.0})
    np.testing.assert_allclose(local.slope[0], [2.0, 2.0])
    np.testing.assert_allclose(local.gradient["a"][0], [-1.0, 0.0])


def test_draws_together_are_the_draws_one_by_one(rng: np.random.Generator) -> None:
    formula = read_formula("a*exp(-b*x) + 3")
    draws = {"a": rng.normal(2, 1, (5, 1)), "b": rng.normal(1, 0.1, (5, 1))}
    together = formula.local(X, draws)
    assert together.value.shape == together.gradient["b"].shape == together.slope.shape == (5, 4)
    for i in range(5):
        single = formula.local(X, {name: float(column[i, 0]) for name, column in draws.items()})
        np.testing.assert_allclose(together.value[i], single.value[0], rtol=1e-15)
        np.testing.assert_allclose(together.gradient["b"][i], single.gradient["b"][0], rtol=1e-15)
    assert read_formula("a + 0*x").value(X, {"a": np.ones((5, 1))}).shape == (5, 4)
    assert read_formula("a").value(X, {"a": 2.0}).shape == (1, 4)


def numpy_style(x, a, b):
    return a * np.exp(-b * x) + np.where(x > 1.0, np.sqrt(x), 1.0)


def cast_first(x, a, b):
    return np.asarray(a * np.exp(-b * np.asarray(x)))  # no dual numbers, but complex ones


def real_only(x, a, b):
    return np.array([float(a) * 2.718281828459045 ** (-float(b) * float(v)) for v in x])


WAYS = [
    (numpy_style, "dual", 1e-14),
    (cast_first, "complex", 1e-14),
    (real_only, "differences", 1e-9),
]


@pytest.mark.parametrize(("function", "way", "digits"), WAYS)
def test_a_function_is_differentiated_in_the_best_way_it_allows(
    function, way: str, digits: float
) -> None:
    curve = wrap_function(function, ("a", "b"), X, {"a": 2.0, "b": 0.8})
    assert curve.derivatives == way
    local = curve.local(X, {"a": 2.0, "b": 0.8})
    np.testing.assert_allclose(local.gradient["a"][0], np.exp(-0.8 * X), rtol=digits)
    np.testing.assert_allclose(local.gradient["b"][0], -2.0 * X * np.exp(-0.8 * X), rtol=digits)


def test_a_function_whose_complex_values_mislead_is_not_differentiated_by_them() -> None:
    def misleading(x, a):
        # the modulus of a complex number has no useful imaginary part
        return np.abs(np.asarray(x) + a)

    curve = wrap_function(misleading, ("a",), X, {"a": 2.0})
    np.testing.assert_allclose(curve.local(X, {"a": 2.0}).gradient["a"], 1.0, rtol=1e-9)


NARROW = {
    "a line at 780 nm": (
        lambda x, a, x0, w: a * np.exp(-0.5 * ((x - x0) / w) ** 2),
        "a*exp(-0.5*((x-x0)/w)**2)",
        np.linspace(779.0, 781.5, 150),
        {"a": 4.0, "x0": 780.24, "w": 0.05},
    ),
    "a period at an epoch in days": (
        lambda x, a, x0, w: a * np.sin(2.0 * np.pi * (x - x0) / w),
        "a*sin(2*pi*(x-x0)/w)",
        np.linspace(2459000.0, 2459020.0, 150),
        {"a": 1.0, "x0": 2459003.2, "w": 3.1},
    ),
    "a period that steps of one size would miss": (
        lambda x, a, x0, w: a * np.sin(2.0 * np.pi * (x - x0) / w),
        "a*sin(2*pi*(x-x0)/w)",
        np.linspace(1e5, 1e5 + 4.0, 150),
        {"a": 1.0, "x0": 1e5, "w": 1.0},
    ),
    "a place that happens to be nearly zero": (
        lambda x, a, x0, w: a * np.exp(-0.5 * ((x - x0) / w) ** 2),
        "a*exp(-0.5*((x-x0)/w)**2)",
        np.linspace(-3.0, 3.0, 150),
        {"a": 4.0, "x0": 1e-17, "w": 1.0},
    ),
}


def plain_only(function):
    """The function, but of plain numbers alone: neither dual nor complex ones."""
    return lambda x, **parameters: function(
        np.asarray(x, dtype=float), **{name: float(value) for name, value in parameters.items()}
    )


@pytest.mark.parametrize("case", NARROW)
def test_a_narrow_feature_far_from_zero_is_differentiated_as_well_as_its_formula(case: str) -> None:
    function, text, x, values = NARROW[case]
    exact = read_formula(text, field="curve").local(x, values)
    for given, way, digits in (
        (function, "dual", 1e-13),
        (plain_only(function), "differences", 3e-9),
    ):
        curve = wrap_function(given, tuple(values), x, values)
        assert curve.derivatives == way
        local = curve.local(x, values)
        for ours, theirs in (
            (local.slope, exact.slope),
            *((local.gradient[name], exact.gradient[name]) for name in values),
        ):
            np.testing.assert_allclose(
                ours, theirs, rtol=0.0, atol=digits * float(np.max(np.abs(theirs)))
            )


def test_a_step_that_spoils_a_function_of_plain_numbers_is_no_step() -> None:
    def curve(x, a, b):  # math.log has no value where a wide step would take it
        return np.array([a + math.log(v - b) for v in x])

    x = np.linspace(100.01, 101.0, 40)
    local = wrap_function(curve, ("a", "b"), x, {"a": 1.0, "b": 100.0}).local(
        x, {"a": 1.0, "b": 100.0}
    )
    np.testing.assert_allclose(local.gradient["b"][0], -1.0 / (x - 100.0), rtol=1e-6)


PARTS = {
    "modulus": (lambda z: np.abs(z), "sqrt(u**2 + v**2)"),
    "square of the modulus": (lambda z: (z * np.conj(z)).real, "u**2 + v**2"),
    "argument": (lambda z: np.angle(z), "arctan2(v, u)"),
    "real part": (lambda z: np.real(z) * z.imag, "u*v"),
}


@pytest.mark.parametrize("part", PARTS)
def test_a_complex_resonator_has_the_derivatives_of_its_real_form(part: str) -> None:
    seen, text = PARTS[part]
    d = "(2*q*(x-f)/f)"
    text = text.replace("u", f"(1 - k/(1+{d}**2))").replace("v", f"(k*{d}/(1+{d}**2))")

    def resonator(x, f, q, k):
        return seen(1.0 - k / (1.0 + 2j * q * (x - f) / f))

    x, values = np.linspace(5.999e9, 6.001e9, 151), {"f": 6.0001e9, "q": 2e4, "k": 0.7}
    curve, exact = (
        wrap_function(resonator, tuple(values), x, values),
        read_formula(text, field="curve").local(x, values),
    )
    assert curve.derivatives == "dual"
    local = curve.local(x, values)
    for ours, theirs in (
        (local.value, exact.value),
        (local.slope, exact.slope),
        *((local.gradient[n], exact.gradient[n]) for n in values),
    ):
        np.testing.assert_allclose(
            ours, theirs, rtol=0.0, atol=1e-12 * float(np.max(np.abs(theirs)))
        )


def test_a_function_that_takes_no_columns_is_called_draw_by_draw() -> None:
    def stubborn(x, a):
        return x * 2.0 if a > 1.0 else x * a

    curve = wrap_function(stubborn, ("a",), X, {"a": 0.5})
    assert not curve.broadcasts
    np.testing.assert_allclose(curve.value(X, {"a": np.array([[0.5], [3.0]])}), [0.5 * X, 2.0 * X])


@pytest.mark.parametrize("name", ["print", "open", "match", "alpha", "self", "sum", "a_b_c_"])
def test_a_parameter_may_bear_any_name_that_python_could_read(name: str) -> None:
    formula = read_formula(f"{name} + 2*{name}*x")
    assert formula.value(np.array([1.0, 2.0]), {name: 3.0}).ravel().tolist() == [9.0, 15.0]


@pytest.mark.parametrize(
    ("formula", "told"),
    [
        ("a*x + \u0430", "a, \u0430 (cyrillic small letter a)"),
        ("a*\u0445 + b", "x, \u0445 (cyrillic small letter ha)"),
        ("k*x + \u0435", "e, \u0435 (cyrillic small letter ie)"),
        ("T*x + \u03a4", "T, \u03a4 (greek capital letter tau)"),
    ],
)
def test_names_that_only_look_alike_are_refused_with_their_letters(formula: str, told: str) -> None:
    with pytest.raises(
        InputError, match="has two names that look alike: write both in the letters of one alphabet"
    ) as refused:
        read_formula(formula)
    assert told in str(refused.value)


@pytest.mark.parametrize(
    "formula",
    [
        "A*x + a",
        "\u03c1*x + p",
        "\u0430*x + \u0431",
        "\u00b5*x + m",
        "\u03bd*x + v",
        "\u03b1*x + a",
    ],
)
def test_names_that_can_be_told_apart_pass(formula: str) -> None:
    assert len(read_formula(formula).names) == 2


@pytest.mark.parametrize("text", ["y0 + v0 t - 1/2 a t^2", "2x", "a x", "sin x", "3 sin(x)"])
def test_a_formula_as_on_paper_is_told_to_write_its_products(text: str) -> None:
    with pytest.raises(InputError, match=r"write products with \*"):
        read_formula(text, field="formula")


@pytest.mark.parametrize("text", ["(a*x", "a*x+", "a**"])
def test_another_slip_is_not_told_of_products(text: str) -> None:
    with pytest.raises(InputError) as refused:
        read_formula(text, field="formula")
    assert "products" not in str(refused.value)


def test_a_word_of_python_is_named() -> None:
    with pytest.raises(InputError, match=r"'lambda' is a word of Python: take another name, like"):
        read_formula("a*exp(-lambda*x)")
