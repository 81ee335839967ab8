"""Reading and rounding "value +/- uncertainty".

A quantity is written as the `uncertainties` package writes it: ``"4.0 +/- 0.4"``, ``"0.1500(5)"``,
``"4.0±0.4"``.  A plain number, also inside a string, is exact.  The uncertainty is a standard
uncertainty (GUM 2.3.1).
"""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

from estim.common.errors import InputError
from estim.common.unit_symbols import is_unit

if TYPE_CHECKING:
    from estim.arrays import FloatArray

_NUMBER = re.compile(
    r"[+-]?((\d+(\.\d*)?|\.\d+)(e[+-]?\d+)?|nan|inf|infinity)", re.ASCII | re.IGNORECASE
)

_DIGITS = r"(?:\s*\((?:\d+(?:[.,]\d*)?|[.,]\d+)\))"  # an uncertainty behind its number
_POWER = r"(?:[eE][+-]?\d+)?"
_PLAIN = r"[+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)"
_SIZE = rf"{_PLAIN}(?:{_DIGITS}{_POWER}|{_POWER}{_DIGITS}?)"
_WITH_UNIT = re.compile(
    rf"(\(?{_SIZE}(?:\s*(?:\+/-|\+-|±)\s*{_SIZE})?(?:\){_POWER})?)"
    r"(\s+1/\S.{0,20}|\s*[^\s\d.,].{0,20})?",
    re.ASCII,
)
_NO_UNIT = re.compile(r"[(\s]+(?!1\s*/)[\d.,]")  # (30) and (30 m), but (1/s) is one
_NUMBER_FIRST = re.compile(r"(?!1\s*/)\d")
_UNCLEAR = re.compile(
    rf"\(?\s*({_PLAIN}{_POWER})\s*(?:\+/-|\+-|±)\s*({_PLAIN}{_POWER})\s*(%|‰|pp[mb]\b).{{0,20}}",
    re.ASCII,
)
_SHARES = {"%": 1e-2, "‰": 1e-3, "ppm": 1e-6, "ppb": 1e-9}
_WORD = re.compile(r"[^\W\d_][^\d,;]{0,20}")
_LEAST_POWER = -4  # of ten, of a number that is written without
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LOWERED = str.maketrans("⁺⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "+-0123456789")
_IN_ASCII = str.maketrans(
    {"−": "-", "±": "+/-", "×": "x", "·": "*", "°": "deg", "µ": "u", "μ": "u", "Ω": "Ohm"}
)
_TIMES_TEN = re.compile(
    r"(?<=[\d.)])\s*[×x*·⋅]\s*10\s*(?:\^\s*([+-]?\d+)|\^\(([+-]?\d+)\)|([⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+))",
    re.ASCII,
)
# characters of a quantity; the library's pattern takes time as the square of a row of blanks
_LONGEST = 200
_MAY_FOLLOW = "with or without a unit"
EXTREME = "must be 0 or between 1e-100 and 1e100 in size"


@dataclass(frozen=True)
class Quantity:
    """A measured value and its standard uncertainty in the same unit; u = 0 means exact."""

    value: float
    u: float = 0.0

    @classmethod
    def of(cls, draws: FloatArray) -> Quantity:
        """Mean and standard deviation of draws (n_draw,)."""
        return cls(float(draws.mean()), float(draws.std(ddof=1)))

    def scaled(self, factor: float) -> Quantity:
        """The same quantity in another unit, `factor` new units per old one."""
        return Quantity(self.value * factor, self.u * abs(factor))

    def of_unit(self, unit: str = "1") -> QuantityOfUnit:
        """The same with its unit, for files."""
        return QuantityOfUnit(self.value, self.u, unit)

    @property
    def exact(self) -> bool:
        return self.u == 0.0


@dataclass(frozen=True)
class QuantityOfUnit(Quantity):
    """A quantity that says its unit."""

    unit: str = "1"


def read_number(text: str) -> float:
    """The number in `text`, with the digits 0 to 9, a decimal point and either minus, - or
    −; `nan` and `inf` as words, for their reader to refuse.

    Raises ValueError for everything else, also where Python reads a number: "1_000" is a slip, not
    1000.
    """
    normalised = text.replace("−", "-")
    if not _NUMBER.fullmatch(normalised):
        raise ValueError(text)
    return float(normalised)


def extreme(value: float) -> bool:
    """Whether the square of a number, or the product of a few, may be no number at all, which no
    measurement needs.
    """
    return math.isfinite(value) and value != 0.0 and not 1e-100 <= abs(value) <= 1e100


def read_quantity(source: str | float, *, field: str, unit: str = "without a unit") -> Quantity:
    """The quantity written in `source`.  unit : how one is to be written, for the error.

    Raises InputError naming `field` where the text is no number, is not finite or beyond all
    measure, or has an uncertainty of zero or less.
    """
    if isinstance(source, bool) or not isinstance(source, (str, int, float)):
        raise InputError('must be a number or "value +/- uncertainty"', field=field, value=source)
    try:
        quantity = (
            Quantity(float(source))
            if isinstance(source, (int, float))
            else _read_text(source.strip(), field, unit)
        )
    except OverflowError:
        raise InputError("must be finite", field=field, value=source) from None
    if not (math.isfinite(quantity.value) and math.isfinite(quantity.u)):
        raise InputError("must be finite", field=field, value=source)
    if extreme(quantity.value) or extreme(quantity.u):
        raise InputError(EXTREME, field=field, value=source)
    return quantity


def read_with_unit(source: str | float, *, field: str) -> tuple[Quantity, str]:
    """The quantity in `source` and the unit behind it, "0.85(1) m"; "1" where there is none.

    Raises InputError as `read_quantity` does, and where what stands behind is no unit.
    """
    match = None
    if isinstance(source, str):
        require_clear_share(source, field=field)
        match = _WITH_UNIT.fullmatch(_as_typed(source.strip()))
    unit = (match[2] or "").strip() if match else ""
    if match is not None and _WORD.fullmatch(unit) and not is_unit(unit):
        rule = "must have a known unit after its number, such as m/s or kg"
        raise InputError(rule, field=field, value=source)
    if match is None or _NO_UNIT.match(unit) or not is_unit(unit):
        return read_quantity(source, field=field, unit=_MAY_FOLLOW), "1"
    return read_quantity(match[1], field=field, unit=_MAY_FOLLOW), unit


def require_clear_share(text: str, *, field: str, line: int | None = None) -> None:
    """Raises InputError for "9.81 ± 2 %", which people write for (9.81 ± 2) % and for a share of
    9.81.
    """
    if (match := _UNCLEAR.fullmatch(text.strip())) is None:
        return
    value, u = (part.replace(",", ".") for part in match.groups()[:2])
    size = abs(float(value) * float(u)) * _SHARES[match[3]]
    alternatives = f'"({value} ± {u}) {match[3]}" or "{value} ± {size:.2g}"'
    raise InputError(
        f"must be {alternatives}, whichever is meant", field=field, value=text, line=line
    )


def _read_text(text: str, field: str, unit: str) -> Quantity:
    if len(text) > _LONGEST:
        raise InputError(
            f"must be at most {_LONGEST} characters long", field=field, value=len(text)
        )
    try:
        return Quantity(read_number(_as_typed(text)))
    except ValueError:
        require_clear_share(text, field=field)
    rule = f'must be a number as 4.0, or read like "4.0 +/- 0.4" or "4.0(4)", {unit}'
    if "_" in text or any(mark.isdecimal() and not mark.isascii() for mark in text):
        raise InputError(rule, field=field, value=text)
    from uncertainties import ufloat_fromstr
    from uncertainties.core import NegativeStdDev

    written = _rearranged(text)
    if not re.search(r"[\d.]\(|\+/?-|±", written):  # "(5)" would get an uncertainty
        raise InputError(rule, field=field, value=text)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # an uncertainty of 0 is refused below
            number = ufloat_fromstr(written)
    except (ValueError, NegativeStdDev):
        raise InputError(rule, field=field, value=text) from None
    if not number.std_dev > 0.0:
        raise InputError(
            "must have an uncertainty > 0 (write a plain number for an exact value)",
            field=field,
            value=text,
        )
    return Quantity(float(number.nominal_value), float(number.std_dev))


def _as_typed(text: str) -> str:
    """ "−1.73×10⁻⁵" and "-1.73 x 10^-5" as "-1.73e-5"."""
    return _TIMES_TEN.sub(
        lambda match: "e" + match[match.lastindex or 0].translate(_LOWERED), text.replace("−", "-")
    )


def _rearranged(text: str) -> str:
    """ "5000 (30)", "5.0e3(1)", "(5.0(1))e3" and "5+-1" as the library reads them."""
    text = _as_typed(text).replace("+-", "+/-")
    text = re.sub(r"(?<=[\d.])\s+(?=\([\d.]+\))", "", text)
    text = re.sub(r"^\(([^()]+\([^()]+\))\)", r"\1", text)
    return re.sub(r"([eE][+-]?\d+)(\(\d+\))", r"\2\1", text)


def format_quantity(value: float, u: float | None = None, *, plus_minus: bool = True) -> str:
    """`value` rounded by its uncertainty `u` (Particle Data Group rule: 355, 949 -> one or two
    digits).

    "0.187 ± 0.010", or "0.187(10)" without `plus_minus`; without a usable u, `value` to six
    significant digits.
    """
    if value is None or not math.isfinite(value):
        return "n/a"
    if u is None or not math.isfinite(u) or u <= 0.0:
        return signed(f"{value:.6g}")
    from uncertainties import ufloat

    if plus_minus:
        return signed(f"{ufloat(value, u):P}".replace("±", " ± "))
    return f"{ufloat(value, u):S}"


def format_rounded(value: float, u: float, digits: int = 2, *, beside: float = 0.0) -> str:
    """`value` alone to the decimal place of the last of `digits` significant digits of its
    uncertainty `u`; as a power of ten where it is smaller than 1e-4 or larger than 1e9.  Without a
    usable u to six significant digits.

    beside : the larger number next to which it stands, whose notation it shares.
    """
    if not math.isfinite(value):
        return "n/a"
    if not (math.isfinite(u) and u > 0.0):
        return signed(f"{value:.6g}")
    place = math.floor(math.log10(u) + 1e-12) - (digits - 1)
    if round(u / 10.0**place) >= 10**digits:
        place += 1
    beside = abs(beside) if math.isfinite(beside) else 0.0
    exponent = math.floor(math.log10(max(abs(value), u, beside)))
    if exponent == 0 or (-4 <= exponent < 9 and place > -9):
        return signed(f"{value:.{max(0, -place)}f}")
    mantissa = signed(f"{value / 10.0**exponent:.{max(0, exponent - place)}f}")
    return f"{mantissa}×10{raised(exponent)}"


def interval(low: float, high: float, u: float, digits: int) -> str:
    """Both ends by `format_rounded`, or "n/a"."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return "n/a"
    larger = max(abs(low), abs(high))
    ends = (format_rounded(end, u, digits, beside=larger) for end in (low, high))
    return f"[{', '.join(ends)}]"


def format_p(p: float, least: float = 0.0) -> str:
    """'p = 0.030', or 'p < 1e-6': smaller probabilities have no meaning for errors that are only
    nearly normal.

    least : the smallest that is shown, for instance because simulation cannot resolve less.
    """
    least = max(least, 1e-6)
    return f"p = {p_digits(p)}" if p > least else f"p < {p_digits(least, 1)}"


def p_digits(p: float, digits: int = 2) -> str:
    """A probability: '0.20', '0.00030', '5e-5'."""
    mantissa, _, exponent = f"{p:.{digits - 1}e}".partition("e")
    if p and exponent and int(exponent) < _LEAST_POWER:
        return f"{mantissa}e{int(exponent)}"
    return significant(p, digits)


def significant(value: float, digits: int = 3) -> str:
    """`value` to as many significant digits, zeros at the end kept ("0.090"); sizes below 1e-4 or
    from 1e6 on as powers of ten ("5.5×10⁻⁵").
    """
    if not math.isfinite(value):
        return "n/a"
    if value == 0.0:
        return "0"
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    power = int(exponent)
    if _LEAST_POWER <= power < 6:
        decimals = max(0, digits - 1 - power)
        return signed(f"{float(f'{mantissa}e{exponent}'):.{decimals}f}")
    return f"{signed(mantissa)}×10{raised(power)}"


def raised(power: object) -> str:
    """A whole number as an exponent."""
    return str(power).translate(_RAISED)


def in_ascii(text: str) -> str:
    """`text` with the marks of numbers and units written as a keyboard has them: "1.7×10⁻⁵ m/s²" as
    "1.7x10^-5 m/s^2".
    """
    return re.sub(
        r"[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda match: f"^{match[0].translate(_LOWERED)}", text
    ).translate(_IN_ASCII)


def percentage(share: float) -> str:
    """A share as '8.6 %', '106 %', '0.30 %'."""
    size = max(abs(100.0 * share), 1.0)
    return f"{significant(100.0 * share, max(2, 1 + math.floor(math.log10(size))))} %"


def per_cent(probability: float) -> str:
    """A probability as it was chosen: '95 %', '99.73 %'."""
    return f"{100.0 * probability:g} %"


def with_unit(text: str, unit: str) -> str:
    """A number and its unit, brackets around more than one number: '0.447 m', '(3.86 ± 0.26)°'; the
    unit 1 is not written.
    """
    if unit in ("", "1") or text == "n/a":
        return text
    number = f"({text})" if " " in text and not text.startswith("(") else text
    return number + (unit if unit == "°" else behind(unit))


def behind(unit: str) -> str:
    """A unit as it stands behind a number; one that begins with a number, "10³ V", as a factor."""
    if unit in ("", "1"):
        return ""
    return f" × {unit}" if _NUMBER_FIRST.match(unit) else f" {unit}"


def signed(text: str) -> str:
    """A formatted number as a reader should see it: a true minus, and no sign before a rounded zero
    ("-0.42" -> "−0.42", "-0.00" -> "0.00").
    """
    return re.sub(r"(?<!e)-", "−", re.sub(r"(?<![\w.])[+-](?=0(\.0+)?(?![\d.e]))", "", text))


def difference(a: Quantity, b: Quantity, *, correlation: float = 0.0) -> Quantity:
    """a - b with u^2 = u_a^2 + u_b^2 - 2 r u_a u_b (GUM 5.2.2)."""
    square = (a.u - b.u) ** 2 + 2.0 * (1.0 - correlation) * a.u * b.u
    return Quantity(a.value - b.value, math.sqrt(square))


def e_n(a: Quantity, b: Quantity) -> float:
    """E_n = (a - b)/U with the expanded uncertainty U = 2 u(a - b) (ISO 13528); |E_n| <= 1 means
    agreement.
    """
    delta = difference(a, b)
    return delta.value / (2.0 * delta.u) if delta.u > 0.0 else math.nan
