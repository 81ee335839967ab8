"""Reading and rounding quantities.  Rounding rule: Particle Data Group, Review of Particle Physics,
introduction, 5.3.
"""

from __future__ import annotations

import math

import pytest
from uncertainties import ufloat_fromstr

from estim import InputError
from estim.common import behind
from estim.common.quantity_text import (
    Quantity,
    format_quantity,
    format_rounded,
    in_ascii,
    read_quantity,
    read_with_unit,
    with_unit,
)


@pytest.mark.parametrize(
    ("text", "value", "u"),
    [
        ("4.0 +/- 0.4", 4.0, 0.4),
        ("4.0+/-0.4", 4.0, 0.4),
        ("4.0±0.4", 4.0, 0.4),
        ("4.0+-0.4", 4.0, 0.4),
        ("−4.0 +- 0.4", -4.0, 0.4),
        ("−4.0e−1", -0.4, 0.0),
        ("0.1500(5)", 0.15, 0.0005),
        ("0.072(5)", 0.072, 0.005),
        ("38.8(1.5)", 38.8, 1.5),
        ("60.0(15)", 60.0, 1.5),
        ("-5.50(25)", -5.5, 0.25),
        ("1.5(2)e-3", 1.5e-3, 2e-4),
        ("(4.0 +/- 0.4)e2", 400.0, 40.0),
        ("  4.0(4)\n", 4.0, 0.4),
        ("5000 (30)", 5000.0, 30.0),
        ("1.5 (0.1)", 1.5, 0.1),
        ("5.0e3(1)", 5000.0, 100.0),
        ("1.0e-3(2)", 1e-3, 2e-4),
        ("(5.0(1))e3", 5000.0, 100.0),
        ("1.73×10⁻⁵", 1.73e-5, 0.0),
        ("−1.73 x 10^-5", -1.73e-5, 0.0),
        ("2*10^3", 2000.0, 0.0),
        ("1.73(2)×10⁻⁵", 1.73e-5, 2e-7),
        ("(1.73 ± 0.02)×10^(-5)", 1.73e-5, 2e-7),
        ("2.40×10⁻⁷ ± 0.12×10⁻⁷", 2.4e-7, 1.2e-8),
        ("4", 4.0, 0.0),
        ("4e-3", 0.004, 0.0),
        (4, 4.0, 0.0),
        (-0.5, -0.5, 0.0),
    ],
)
def test_reads_value_and_uncertainty(text, value, u):
    quantity = read_quantity(text, field="phi_deg")
    assert quantity.value == pytest.approx(value, rel=1e-14)
    assert quantity.u == pytest.approx(u, rel=1e-12)
    assert quantity.exact == (u == 0.0)
    if isinstance(text, str):
        assert read_with_unit(text, field="phi_deg") == (quantity, "1")
        assert read_with_unit(f"{text.strip()} V", field="phi_deg") == (quantity, "V")


def test_what_is_written_for_a_keyboard_is_read_back():
    text = "(−1.73 ± 0.02)×10⁻⁵ m/s²"
    assert in_ascii(text) == "(-1.73 +/- 0.02)x10^-5 m/s^2"
    quantity, unit = read_with_unit(in_ascii(text), field="a")
    assert (quantity, unit) == (read_with_unit(text, field="a")[0], "m/s^2")
    assert in_ascii("γ, 3.7 µm at 20 °C") == "γ, 3.7 um at 20 degC"


@pytest.mark.parametrize(
    "source", ["5 (30 m)", "5(30 m)", "5 ((30))", "5(3)(2)", "5 ± 1 (2)", "(5)"]
)
def test_no_unit_begins_with_digits_in_brackets(source: str) -> None:
    with pytest.raises(InputError, match=r"^'a' must be a number .*, with or without a unit: "):
        read_with_unit(source, field="a")
    assert read_with_unit("5 (1/s)", field="a") == (Quantity(5.0), "(1/s)")


def test_a_word_behind_a_number_that_is_no_unit_is_told() -> None:
    with pytest.raises(InputError, match=r"'a' must have a known unit .*: 5\.0\(1\) foo"):
        read_with_unit("5.0(1) foo", field="a")


def test_digits_in_parentheses_belong_to_the_last_digits():
    assert read_quantity("0.187(10)", field="f").u == pytest.approx(0.010)
    assert read_quantity("0.187(1)", field="f").u == pytest.approx(0.001)


NONSENSE = [
    "nonsense",
    "",
    " ",
    "4.0 +/-",
    "4,0(4)",
    "4.0 4",
    "0x10",
    "4.0(4",
    "×10⁻⁵",
    "2×10",
    "2×11³",
    "4.0 degrees",
    "__import__('os')",
    "1_000",
    "1_0(2)",
    "\u0664(1)",
]


@pytest.mark.parametrize("source", NONSENSE)
def test_what_is_no_quantity_is_refused(source):
    with pytest.raises(
        InputError,
        match=r"^'phi_deg' must be a number [^\"]+, or read like \"4\.0 \+/- 0\.4\" or "
        r"\"4\.0\(4\)\", without a unit: ",
    ) as caught:
        read_quantity(source, field="phi_deg")
    assert caught.value.value == source.strip()


@pytest.mark.parametrize(
    "source",
    [
        *("9.81 m/s2", "9.81 m/s^2", "3.69°", "3.69(40)°", "2.0(1) m/s", "2 %", "4.0 +/- 0.4 mm"),
        *("(4.0 ± 0.4) °C", "9,81 m/s²", "5e3 V", "1.5 1/s", "30mV", "2,0(1)", "2,0 ± 0,1"),
        *("0,03", "1,5e-3", "4.0 4.1", "1,2,3", "1/2", "2;3", "1.2.3"),
    ],
)
def test_the_usual_slips_are_told_how_a_number_is_written(source: str) -> None:
    with pytest.raises(InputError, match=r"or \"4.0\(4\)\", without a unit: "):
        read_quantity(source, field="g")


@pytest.mark.parametrize("source", ["nan", "inf", "-inf", "1e400", "4 +/- inf", math.nan, math.inf])
def test_what_is_not_finite_is_refused(source):
    with pytest.raises(InputError, match=r"^'phi_deg' must be finite: "):
        read_quantity(source, field="phi_deg")


@pytest.mark.parametrize(
    "source",
    [
        "nan(1)",
        "4 +/- nan",
        pytest.param("10" * 200, id="long-text"),
        pytest.param(10**400, id="long-number"),
    ],
)
def test_what_is_neither_finite_nor_usual_is_refused_too(source):
    with pytest.raises(InputError, match=r"^'phi_deg' must "):
        read_quantity(source, field="phi_deg")


@pytest.mark.parametrize("source", ["4.0 +/- 0", "4.0(0)", "4.0 +/- 0.0"])
def test_zero_uncertainty_is_refused_because_a_plain_number_says_it(source):
    with pytest.raises(InputError, match=r"^'phi_deg' must have an uncertainty > 0 "):
        read_quantity(source, field="phi_deg")


def test_negative_uncertainty_is_refused():
    with pytest.raises(InputError, match=r"^'phi_deg' must .*: 4.0 "):
        read_quantity("4.0 +/- -0.4", field="phi_deg")


@pytest.mark.parametrize("source", [True, None, [4.0], {"value": 4}])
def test_only_numbers_and_text_are_quantities(source):
    with pytest.raises(InputError, match="must be a number or"):
        read_quantity(source, field="phi_deg")


def test_another_unit_scales_both_parts_and_keeps_the_uncertainty_positive():
    assert Quantity(4.0, 0.4).scaled(math.pi / 180) == Quantity(
        4.0 * (math.pi / 180), 0.4 * (math.pi / 180)
    )
    assert Quantity(4.0, 0.4).scaled(-2.0) == Quantity(-8.0, 0.8)
    assert Quantity(4.0).scaled(3.0).exact


# rounding


@pytest.mark.parametrize(
    ("value", "u", "text", "short"),
    [
        # three leading digits of u up to 354: two digits; up to 949: one; above: rounded up to 1000
        # and two digits
        (0.827, 0.119, "0.83 ± 0.12", "0.83(12)"),
        (0.827, 0.367, "0.8 ± 0.4", "0.8(4)"),
        (0.187, 0.0100, "0.187 ± 0.010", "0.187(10)"),
        (0.1234, 0.0354, "0.123 ± 0.035", "0.123(35)"),
        (0.1234, 0.0356, "0.12 ± 0.04", "0.12(4)"),
        (0.1234, 0.0949, "0.12 ± 0.09", "0.12(9)"),
        (0.1234, 0.0950, "0.12 ± 0.10", "0.12(10)"),
        (-5.5, 0.25, "−5.50 ± 0.25", "-5.50(25)"),
    ],
)
def test_rounding_follows_the_particle_data_group(value, u, text, short):
    assert format_quantity(value, u) == text
    assert format_quantity(value, u, plus_minus=False) == short


@pytest.mark.parametrize(
    ("value", "u"), [(0.187, 0.0101), (61.7, 1.5), (1.2e-7, 3e-9), (123456.0, 2000.0), (0.0, 0.3)]
)
def test_what_is_written_reads_back_within_the_rounding(value, u):
    read = ufloat_fromstr(format_quantity(value, u, plus_minus=False))
    assert read.nominal_value == pytest.approx(value, abs=0.15 * u)
    assert read.std_dev == pytest.approx(u, rel=0.15)


@pytest.mark.parametrize("u", [None, 0.0, -1.0, math.nan, math.inf])
def test_without_a_usable_uncertainty_six_digits_are_shown(u):
    assert format_quantity(1.23456789, u) == "1.23457"


def test_no_number_is_not_available():
    assert (
        format_quantity(math.nan, 0.1)
        == format_quantity(math.inf)
        == format_rounded(math.nan, 0.1)
        == "n/a"
    )


@pytest.mark.parametrize(
    ("value", "u", "text"),
    [
        (0.187321, 0.0101, "0.187"),
        (61.7321, 1.52, "61.7"),
        (1234.56, 200.0, "1235"),
        (0.5, 0.0, "0.5"),
        (1.23456789012e11, 2e6, "1.234568×10¹¹"),
        (1.2341e-6, 1e-8, "1.234×10⁻⁶"),
        (2.00231930436, 1e-11, "2.002319304360"),
    ],
)
def test_a_value_alone_keeps_one_digit_beyond_its_uncertainty(value, u, text):
    assert format_rounded(value, u) == text


def test_an_uncertainty_has_the_notation_of_its_value():
    assert format_rounded(5e-5, 5e-5) == "5.0×10⁻⁵"
    assert format_rounded(5e-5, 5e-5, beside=0.0123) == "0.000050"
    assert format_rounded(3e4, 3e4, beside=-2e10) == "0.0000030×10¹⁰"
    assert format_rounded(0.012345, 5e-5, 3) == "0.0123450"


def test_messages_hold_nothing_that_moves_a_cursor():
    with pytest.raises(InputError) as caught:
        read_quantity("4\r\x1b[2K\u202e\u2028x", field="phi_deg")
    assert str(caught.value).isprintable()


def test_no_unit_leaves_no_blank_behind_a_number() -> None:
    assert (behind(""), behind("1"), behind("m")) == ("", "", " m")


def test_a_unit_that_begins_with_a_number_is_a_factor() -> None:
    assert with_unit("5.3", "10³ V") == "5.3 × 10³ V"
    assert with_unit("5.3 ± 0.2", "100 g") == "(5.3 ± 0.2) × 100 g"
    assert with_unit("5.3", "1/s") == "5.3 1/s"
    assert with_unit("5.3", "(100 g)/s") == "5.3 (100 g)/s"
