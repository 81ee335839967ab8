"""What a unit means: its size and its powers of the SI's base units, so far as a text states them
beyond doubt.

Units are words of their users: shown as they were written, never converted.  What is read here only
decides whether two of them differ.  A text that people write for two units (ms⁻¹: 1/ms, or m/s as
British books print it) has both meanings, and differs from neither.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import product
from typing import NamedTuple

_LOWERED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−º˚", "-0123456789-°°")
_LETTERS = str.maketrans("µμ\u2126\u212b", "uuΩÅ")
_PREFIXES = {
    "": 1.0,
    "f": 1e-15,
    "p": 1e-12,
    "n": 1e-9,
    "u": 1e-6,
    "m": 1e-3,
    "c": 1e-2,
    "d": 1e-1,
    "h": 1e2,
    "k": 1e3,
    "M": 1e6,
    "G": 1e9,
    "T": 1e12,
}
_BASE = ("m", "kg", "s", "A", "K", "mol", "cd")
# symbol, SI units in one of it, and which; a prefix may stand before it
_PREFIXED = """
m 1.0 m
g 0.001 kg
s 1.0 s
A 1.0 A
K 1.0 K
mol 1.0 mol
cd 1.0 cd
Hz 1.0 s-1
Bq 1.0 s-1
N 1.0 kg m s-2
Pa 1.0 kg m-1 s-2
bar 100000.0 kg m-1 s-2
J 1.0 kg m2 s-2
eV 1.602176634e-19 kg m2 s-2
W 1.0 kg m2 s-3
C 1.0 A s
V 1.0 kg m2 s-3 A-1
F 1.0 kg-1 m-2 s4 A2
Ω 1.0 kg m2 s-3 A-2
Ohm 1.0 kg m2 s-3 A-2
ohm 1.0 kg m2 s-3 A-2
S 1.0 kg-1 m-2 s3 A2
Wb 1.0 kg m2 s-2 A-1
T 1.0 kg s-2 A-1
H 1.0 kg m2 s-2 A-2
L 0.001 m3
l 0.001 m3
Gy 1.0 m2 s-2
Sv 1.0 m2 s-2
lm 1.0 cd
lx 1.0 cd m-2
"""
_DEGREE, _GON = math.pi / 180.0, math.pi / 200.0
_ANGLES = {
    "rad": 1.0,
    "mrad": 1e-3,
    "urad": 1e-6,
    "nrad": 1e-9,
    "°": _DEGREE,
    "deg": _DEGREE,
    "gon": _GON,
    "′": _DEGREE / 60.0,
    "arcmin": _DEGREE / 60.0,
    "″": _DEGREE / 3600.0,
    "arcsec": _DEGREE / 3600.0,
    "grad": _DEGREE,
}
# the same without a prefix
_BARE = """
min 60.0 s
h 3600.0 s
d 86400.0 s
sec 1.0 s
secs 1.0 s
kg 1.0 kg
°C 1.0 K
sr 1.0 1
% 0.01 1
‰ 0.001 1
ppm 1e-06 1
ppb 1e-09 1
Å 1e-10 m
in 0.0254 m
inch 0.0254 m
ft 0.3048 m
t 1000.0 kg
"""
_WORDS = {  # in any case
    "s": "sec secs second seconds sekunde sekunden segundo segundos",
    "min": "min minute minutes minuten minuto minutos",
    "h": "hour hours stunde stunden hora horas",
    "d": "day days",
    "m": "meter meters metre metres metro metros",
    "kg": "kg",
    "g": "gram grams gramm",
    "V": "volt volts",
    "A": "ampere amperes",
    "K": "kelvin",
    "°C": "celsius",
    "°F": "fahrenheit",
    "N": "newton newtons",
    "J": "joule joules",
    "W": "watt watts",
    "Hz": "hz hertz",
    "Pa": "pascal",
    "°": "deg degree degrees grado grados",
    "grad": "grad",
    "rad": "rad radian radians",
}
_OFTEN_MEANT = {  # not the SI's
    "C": (1.0, "K"),
    "F": (5.0 / 9.0, "K"),
    "°": (1.0, "K"),
    "deg": (1.0, "K"),
    "g": (9.80665, "m s-2"),
    "mg": (9.80665e-3, "m s-2"),
    "S": (1.0, "s"),
    "mS": (1e-3, "s"),
    "rpm": (1.0 / 60.0, "s-1"),
    "grad": (_GON, ""),
    "Gs": (1e-4, "kg s-2 A-1"),
}
_OF_TEMPERATURE = re.compile(r"(?i:°|deg|grad|celsius|fahrenheit)|[CF]$")
_JOINED = re.compile(
    r"(?i:°|degrees?|deg\.?|grados?|grad)\s*(?:(C)(?:elsius)?|(F)(?:ahrenheit)?)(?![^\W\d_])"
)
_TOKEN = re.compile(
    r"\d+(?:\.\d+)?(?:[eE][+-]?\d+)?|°[CF]?|a\.u\.|[^\W\d_]+|[%‰′″]|[()/ ]"
    r"|\^[+-]?\d{1,3}(?![\d.])"
)


def _listed(table: str) -> dict[str, tuple[float, str]]:
    rows = (line.split(maxsplit=2) for line in table.strip().splitlines())
    return {symbol: (float(size), powers) for symbol, size, powers in rows}


_WITH_PREFIX = _listed(_PREFIXED)
_ALONE = {
    **{name: (size, "1") for name, size in _ANGLES.items()},
    **_listed(_BARE),
    "°F": (5.0 / 9.0, "K"),
    "rpm": (2.0 * math.pi / 60.0, "s-1"),
}


# natural logarithm of the SI units in one of it, then its powers of metre, kilogram, second,
# ampere, kelvin, mole and candela; those of a product are the sums of those of its factors
Unit = tuple[float, ...]


class Factor(NamedTuple):
    """A symbol or a number with the power that is written at it, and that of what it stands in: s⁻²
    below a line is -2 and -1.
    """

    symbol: str
    power: int = 1
    outer: int = 1

    def within(self, outer: int) -> Factor:
        return self._replace(outer=self.outer * outer)


_KELVIN = tuple(float(base == "K") for base in _BASE)


def _pure(number: float) -> Unit:
    return (math.log(number), *(0.0 for _ in _BASE))


def _raised(unit: Unit, power: int) -> Unit:
    return tuple(power * part for part in unit)


def _product(*units: Unit) -> Unit:
    return tuple(map(sum, zip(*units, strict=True)))


def _same(unit: Unit, other: Unit) -> bool:
    return unit[1:] == other[1:] and math.isclose(unit[0], other[0], rel_tol=1e-12, abs_tol=1e-9)


def same_unit(unit: str, other: str) -> bool | None:
    """Whether two units mean the same, or may; None where one of them is not known.  Zeros are not
    compared: °C is K.
    """
    if _normalised(unit) == _normalised(other):
        return True
    pairs = [(a, b) for a in _meanings(unit) for b in _meanings(other)]
    return any(_same(a, b) for a, b in pairs) if pairs else None


def same_numbers(unit: str, other: str, *, differences: bool = False) -> bool | None:
    """`same_unit` for numbers in these units: Hz counts cycles and is not rad/s; °C is not K,
    except for `differences`.
    """
    zeros = {_has_own_zero(text) for text in (unit, other)}
    kelvins = all(any(a[1:] == _KELVIN for a in _meanings(text)) for text in (unit, other))
    shifted = kelvins and len(zeros) > 1 and not differences
    return False if shifted or _turns(unit, other) else same_unit(unit, other)


def _has_own_zero(unit: str) -> bool:
    return _OF_TEMPERATURE.search(_normalised(unit)) is not None


def _turns(unit: str, other: str) -> bool:
    """Whether one of two units counts cycles, and the other angles."""
    first, second = (
        {_symbol_of(factor.symbol) for factor in _factors_of(text) or ()} for text in (unit, other)
    )
    return any(
        any(symbol.endswith("Hz") for symbol in cycles - angles) and (angles - cycles) & {*_ANGLES}
        for cycles, angles in ((first, second), (second, first))
    )


def in_unit(value: float, unit: str, target: str) -> float | None:
    """A value in another unit; None where the two are not known to be of one dimension, may mean
    several, have zeros of their own, or are cycles and angles.
    """
    pairs = [(a, b) for a in _meanings(unit) for b in _meanings(target) if a[1:] == b[1:]]
    sizes = [a[0] - b[0] for a, b in pairs]
    temperatures = any(a[1:] == _KELVIN for a, _ in pairs) and any(
        map(_has_own_zero, (unit, target))
    )
    if (
        not pairs
        or max(sizes) - min(sizes) > 1e-9
        or temperatures
        or _turns(unit, target)
        or abs(sizes[0]) > math.log(1e300)
    ):
        return None
    return float(f"{value * math.exp(sizes[0]):.12g}")


def is_unit(text: str) -> bool:
    """Whether a text is a unit that is known."""
    return bool(_meanings(text))


def is_angle(unit: str) -> bool:
    """Whether a unit is one of angles: the radian, the degree, the minute of arc and so on."""
    factors = _factors_of(unit)
    return (
        factors is not None
        and [factor.power * factor.outer for factor in factors] == [1]
        and _symbol_of(factors[0].symbol) in _ANGLES
    )


def is_in_degrees(unit: str) -> bool:
    """Whether a unit is the degree of an angle."""
    return is_angle(unit) and any(_same(meaning, _pure(_DEGREE)) for meaning in _meanings(unit))


def powers_in(unit: str) -> dict[str, int] | None:
    """Symbols of a unit with their powers: "m/s²" -> m 1, s -2; None where it holds a number, or
    may be read in several ways.
    """
    factors = [factor for factor in _factors_of(unit) or (Factor("0"),) if factor.symbol != "1"]
    if any(factor.symbol[0].isdigit() or _as_two(factor) for factor in factors):
        return None
    powers: dict[str, int] = {}
    for factor in factors:
        powers[factor.symbol] = powers.get(factor.symbol, 0) + factor.power * factor.outer
    return powers


@lru_cache(maxsize=512)
def _factors_of(text: str) -> tuple[Factor, ...] | None:
    """The factors of a unit, known or not; None where their order leaves a doubt (m/s V: is V above
    or below?).
    """
    spelled = _spelled(text)
    tokens = deque(_TOKEN.findall(spelled))
    if len(spelled) > 200 or "".join(tokens) != spelled:  # characters of a unit that is read
        return None
    try:
        factors = _quotient(tokens)
    except (IndexError, ValueError):
        return None
    return None if tokens else tuple(factors)


def _normalised(text: str) -> str:
    """A unit in one spelling, with one letter for what looks the same."""
    return _spelled(text).translate(_LETTERS)


def _spelled(text: str) -> str:
    """A unit with one spelling of blanks, powers, products and degrees."""
    text = (
        re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda match: f"^{match[0]}", text.strip().rstrip("."))
        .translate(_LOWERED)
        .replace("℃", "°C")
        .replace("℉", "°F")
    )
    text = _JOINED.sub(lambda match: f"°{match[1] or match[2]}".upper(), text)
    text = re.sub(r"\^[({]([+-]?\d+)[)}]", r"^\1", text.replace("**", "^"))
    text = re.sub(r"(?<=[^\W\d_°%])(?<!\d[eE])(?=-?\d)", "^", text)
    text = re.sub(r"\s*([/()^])\s*", r"\1", text)
    text = re.sub(
        r"\s*[·⋅*×]\s*|\s+|(?<=[^\W_])(?!(?<=\ba)\.u(?![^\W\d_]))\.(?=[^\W\d_])", " ", text
    )
    return re.sub(r"\ba\.u(?![\w.])", "a.u.", text)


def _quotient(tokens: deque[str]) -> list[Factor]:
    """a b/c/d, each of which may stand in brackets.  Raises ValueError and IndexError."""
    factors = _single(tokens)
    while tokens and tokens[0] == " ":
        tokens.popleft()
        factors += _single(tokens)
    while tokens and tokens[0] == "/":
        tokens.popleft()
        factors += [factor.within(-1) for factor in _single(tokens)]
    return factors


def _single(tokens: deque[str]) -> list[Factor]:
    head = tokens.popleft()
    if head == "(":
        factors = _quotient(tokens)
        if tokens.popleft() != ")":
            raise ValueError(head)
        outer = _power(tokens)
        return [factor.within(outer) for factor in factors]
    if head in ")/ " or head.startswith("^"):
        raise ValueError(head)
    return [Factor(head, _power(tokens))]


def _power(tokens: deque[str]) -> int:
    return int(tokens.popleft()[1:]) if tokens and tokens[0].startswith("^") else 1


@lru_cache(maxsize=512)
def _meanings(text: str) -> tuple[Unit, ...]:
    """What a unit may mean: nothing where it is not known, two where people write the same for
    two.
    """
    readings = [_readings(factor) for factor in _factors_of(text) or ()]
    if not readings or math.prod(map(len, readings)) > 64:  # meanings of one
        return ()
    units: list[Unit] = []
    for chosen in product(*readings):
        combined = _product(*chosen)
        units += [] if any(_same(combined, other) for other in units) else [combined]
    return tuple(units)


def _readings(factor: Factor) -> list[Unit]:
    """What a factor may mean: one of its symbol's meanings, or m s⁻¹ where ms⁻¹ is written."""
    if factor.symbol[0].isdigit():
        number = float(factor.symbol)
        pure = [_pure(number)] if 0.0 < number < math.inf else []
        return [_raised(unit, factor.power * factor.outer) for unit in pure]
    known = _SYMBOLS.get(_symbol_of(factor.symbol), ())
    meanings = [*(_raised(unit, factor.power) for unit in known), *_as_two(factor)]
    return [_raised(unit, factor.outer) for unit in meanings]


def _as_two(factor: Factor) -> list[Unit]:
    """m s⁻¹ for ms⁻¹: each way to part a symbol with a negative power into two, the second without
    a prefix.
    """
    products, symbol = list[Unit](), factor.symbol.translate(_LETTERS)
    for second in (*_WITH_PREFIX, "kg") if factor.power < 0 else ():
        first = symbol.removesuffix(second)
        if first in _SYMBOLS and first not in (symbol, second):
            products.append(
                _product(_SYMBOLS[first][0], _raised(_SYMBOLS[second][0], factor.power))
            )
    return products


def _symbol_of(text: str) -> str:
    """A symbol, where it may be written as a word."""
    text = text.translate(_LETTERS)
    return text if text in _SYMBOLS else _SYMBOL_OF_WORD.get(text.casefold(), text)


def _unit(size: float, text: str) -> Unit:
    """ "kg m2 s-2" as powers of the base units."""
    powers = dict(re.findall(r"([A-Za-z]+)(-?\d*)", text))
    return (
        math.log(size),
        *(float(powers[base] or 1) if base in powers else 0.0 for base in _BASE),
    )


def _all_symbols() -> Iterator[tuple[str, tuple[float, str]]]:
    for symbol, (scale, powers) in _WITH_PREFIX.items():
        for prefix, factor in _PREFIXES.items():
            if prefix + symbol != "pH":
                yield prefix + symbol, (factor * scale, powers)
    yield from _ALONE.items()


def _all_meanings() -> dict[str, tuple[Unit, ...]]:
    strict = {symbol: (_unit(*definition),) for symbol, definition in _all_symbols()}
    return strict | {
        symbol: (*strict.get(symbol, ()), _unit(*definition))
        for symbol, definition in _OFTEN_MEANT.items()
    }


_SYMBOLS: Mapping[str, tuple[Unit, ...]] = _all_meanings()
_SYMBOL_OF_WORD: Mapping[str, str] = {
    word: symbol for symbol, names in _WORDS.items() for word in names.split()
}
