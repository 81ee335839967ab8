"""What a unit means: its scale and its powers of the SI's base units, so far as a text says them beyond doubt.

Units are words of their users: shown as they were written, never converted.  What is read here only tells whether two of them differ.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

_LOWERED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")
_PREFIXES = {
    "": 1.0, "f": 1e-15, "p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "h": 1e2, "k": 1e3, "M": 1e6, "G": 1e9, "T": 1e12,
}
_BASE = ("m", "kg", "s", "A", "K", "mol", "cd")
_WITH_PREFIX = {
    "m": (1.0, "m"), "g": (1e-3, "kg"), "s": (1.0, "s"), "A": (1.0, "A"), "K": (1.0, "K"), "mol": (1.0, "mol"), "cd": (1.0, "cd"),
    "Hz": (1.0, "s-1"), "Bq": (1.0, "s-1"), "N": (1.0, "kg m s-2"), "Pa": (1.0, "kg m-1 s-2"), "bar": (1e5, "kg m-1 s-2"), "J": (1.0, "kg m2 s-2"),
    "eV": (1.602176634e-19, "kg m2 s-2"), "W": (1.0, "kg m2 s-3"), "C": (1.0, "A s"), "V": (1.0, "kg m2 s-3 A-1"), "F": (1.0, "kg-1 m-2 s4 A2"),
    "Ω": (1.0, "kg m2 s-3 A-2"), "Ohm": (1.0, "kg m2 s-3 A-2"), "ohm": (1.0, "kg m2 s-3 A-2"), "S": (1.0, "kg-1 m-2 s3 A2"),
    "Wb": (1.0, "kg m2 s-2 A-1"), "T": (1.0, "kg s-2 A-1"), "H": (1.0, "kg m2 s-2 A-2"), "L": (1e-3, "m3"), "l": (1e-3, "m3"), "rad": (1.0, ""),
    "Gy": (1.0, "m2 s-2"), "Sv": (1.0, "m2 s-2"), "lm": (1.0, "cd"), "lx": (1.0, "cd m-2"),
}
_ALONE = {
    "min": (60.0, "s"), "h": (3600.0, "s"), "d": (86400.0, "s"), "sec": (1.0, "s"), "second": (1.0, "s"), "seconds": (1.0, "s"),
    "minute": (60.0, "s"), "minutes": (60.0, "s"), "hour": (3600.0, "s"), "hours": (3600.0, "s"), "day": (86400.0, "s"), "days": (86400.0, "s"),
    "volt": (1.0, "kg m2 s-3 A-1"), "volts": (1.0, "kg m2 s-3 A-1"),
    "meter": (1.0, "m"), "metre": (1.0, "m"), "meters": (1.0, "m"), "metres": (1.0, "m"),
    "°C": (1.0, "K"), "degC": (1.0, "K"), "°F": (5.0 / 9.0, "K"), "degF": (5.0 / 9.0, "K"), "kg": (1.0, "kg"),
    "°": (math.pi / 180.0, ""), "deg": (math.pi / 180.0, ""), "degree": (math.pi / 180.0, ""), "degrees": (math.pi / 180.0, ""),
    "′": (math.pi / 10800.0, ""), "″": (math.pi / 648000.0, ""), "arcmin": (math.pi / 10800.0, ""), "arcsec": (math.pi / 648000.0, ""),
    "sr": (1.0, ""), "%": (0.01, ""), "‰": (1e-3, ""), "ppm": (1e-6, ""), "ppb": (1e-9, ""), "Å": (1e-10, "m"),
    "in": (0.0254, "m"), "inch": (0.0254, "m"), "ft": (0.3048, "m"), "t": (1e3, "kg"),
}
_OFTEN_MEANT = {"C": (1.0, "K"), "F": (5.0 / 9.0, "K"), "°": (1.0, "K"), "deg": (1.0, "K"), "g": (9.80665, "m s-2")}  # not the SI's
_NUMBER = re.compile(r"(\d+(?:\.\d+)?(?:[eE][+-]?\d+)?)(?:\^([+-]?\d+))?")
_SYMBOL = re.compile(r"((?:°[CF]?|[^\W\d_]+|[%‰′″]))(?:\^?([+-]?\d+))?")


@dataclass(frozen=True)
class Unit:
    """scale : SI units in one of it.  powers : of metre, kilogram, second, ampere, kelvin, mole, candela."""

    scale: float
    powers: tuple[int, ...]

    def raised(self, power: int) -> Unit:
        return Unit(self.scale**power, tuple(power * p for p in self.powers))

    def times(self, other: Unit) -> Unit:
        return Unit(self.scale * other.scale, tuple(p + q for p, q in zip(self.powers, other.powers, strict=True)))


_PURE = Unit(1.0, (0,) * len(_BASE))


def same_unit(one: str, other: str) -> bool | None:
    """Whether two units mean the same; None where one of them is not known.  Zeros are not compared: °C is K."""
    if _plain(one) == _plain(other):
        return True
    pairs = [(a, b) for a in _meanings(one) for b in _meanings(other)]
    return any(a.powers == b.powers and math.isclose(a.scale, b.scale, rel_tol=1e-9) for a, b in pairs) if pairs else None


def in_unit(value: float, unit: str, wanted: str) -> float | None:
    """A value in another unit; None where the two are not known to be of one dimension, or have zeros of their own."""
    pairs = [(a, b) for a in _meanings(unit) for b in _meanings(wanted) if a.powers == b.powers]
    if not pairs or any(_plain(one).lstrip("°deg") in ("C", "F") for one in (unit, wanted)):
        return None
    return float(f"{value * pairs[0][0].scale / pairs[0][1].scale:.12g}")


def is_unit(text: str) -> bool:
    """Whether a text is a unit that is known."""
    return bool(_meanings(text))


def is_in_degrees(unit: str) -> bool:
    """Whether a unit is the degree of an angle."""
    return _plain(unit) in ("°", "deg", "degree", "degrees")


def _plain(text: str) -> str:
    """A unit in one spelling: blanks, powers and products alike."""
    text = re.sub("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+", lambda found: f"^{found[0]}", text.strip()).translate(_LOWERED).replace("\u00b5", "u").replace("\u03bc", "u")
    text = text.replace("\u2126", "Ω").replace("\u212b", "Å")
    text = re.sub(r"(?<=[^\W\d_°%])(?<![eE])(?=-?\d)", "^", text.replace("**", "^"))
    return re.sub(r"\s*([/()^])\s*", r"\1", re.sub(r"\s*[·⋅*×]\s*|\s+", " ", text))


@lru_cache(maxsize=512)
def _meanings(text: str) -> tuple[Unit, ...]:
    """What a unit may mean: nothing where it is not known, two where people write the same for two."""
    found = [_read(_plain(text), further) for further in ({}, _OFTEN_MEANT)]
    return tuple(dict.fromkeys(unit for unit in found if unit is not None))


def _read(text: str, further: Mapping[str, tuple[float, str]]) -> Unit | None:
    over, *under = text.split("/")
    if any(" " in part and not (part.startswith("(") and part.endswith(")")) for part in under):
        return None  # m/s V: is V above or below?
    found = _PURE
    for part, sign in ((over, 1), *((part, -1) for part in under)):
        for factor in part.removeprefix("(").removesuffix(")").split(" "):
            unit = _factor(factor, further)
            if unit is None:
                return None
            found = found.times(unit.raised(sign))
    return found


def _factor(text: str, further: Mapping[str, tuple[float, str]]) -> Unit | None:
    if number := _NUMBER.fullmatch(text):
        size = float(number[1]) ** int(number[2] or 1)
        return Unit(size, _PURE.powers) if size > 0.0 and math.isfinite(size) else None
    symbol = _SYMBOL.fullmatch(text)
    if symbol is None or abs(power := int(symbol[2] or 1)) > 20:
        return None
    meant = further.get(symbol[1]) or _SYMBOLS.get(symbol[1])
    return None if meant is None else Unit(meant[0], _powers(meant[1])).raised(power)


def _powers(text: str) -> tuple[int, ...]:
    """"kg m2 s-2" as powers of the base units."""
    found = {base: int(power or 1) for base, power in re.findall(r"([A-Za-z]+)(-?\d*)", text)}
    return tuple(found.get(base, 0) for base in _BASE)


def _all_symbols() -> Iterator[tuple[str, tuple[float, str]]]:
    for symbol, (scale, powers) in _WITH_PREFIX.items():
        for prefix, factor in _PREFIXES.items():
            if prefix + symbol != "pH":
                yield prefix + symbol, (factor * scale, powers)
    yield from _ALONE.items()


_SYMBOLS: Mapping[str, tuple[float, str]] = MappingProxyType(dict(_all_symbols()))
