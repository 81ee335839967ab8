"""Results to copy into a lab report: plain lines, LaTeX for the package siunitx in both of its
notations, and CSV.

siunitx reads "3.3(20)" and "3.3 +- 2.0" as the same; its options decide which of them is printed,
so both are offered.  Limits and lopsided values have no notation that every version of it knows:
they are written as mathematics.  The table has the value of the text: of a lopsided one the median
without u, whose 68 % interval stands beside it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from estim.checks import Estimate
from estim.common import (
    Label,
    Markdown,
    as_csv,
    behind,
    format_quantity,
    one_line,
    phrase,
    powers_in,
)
from estim.sampling import lopsided

_BASES = {
    "m": "metre",
    "s": "second",
    "g": "gram",
    "A": "ampere",
    "K": "kelvin",
    "mol": "mole",
    "cd": "candela",
    "N": "newton",
    "J": "joule",
    "W": "watt",
    "V": "volt",
    "C": "coulomb",
    "Hz": "hertz",
    "Pa": "pascal",
    "Ω": "ohm",
    "T": "tesla",
    "F": "farad",
    "H": "henry",
    "S": "siemens",
    "rad": "radian",
    "eV": "electronvolt",
    "min": "minute",
    "h": "hour",
    "d": "day",
    "L": "litre",
    "°": "degree",
    "°C": "degreeCelsius",
    "%": "percent",
}
_PREFIXES = {
    "": "",
    "p": "pico",
    "n": "nano",
    "µ": "micro",
    "μ": "micro",
    "m": "milli",
    "c": "centi",
    "d": "deci",
    "h": "hecto",
    "k": "kilo",
    "M": "mega",
    "G": "giga",
}
_NAMES = (
    "alpha",
    "beta",
    "gamma",
    "delta",
    "epsilon",
    "zeta",
    "eta",
    "theta",
    "iota",
    "kappa",
    "lambda",
    "mu",
    "nu",
    "xi",
    "pi",
    "rho",
    "sigma",
    "tau",
    "upsilon",
    "phi",
    "chi",
    "psi",
    "omega",
)
_GREEK = dict(zip("αβγδεζηθικλμνξπρστυφχψω", _NAMES, strict=True)) | {name: name for name in _NAMES}
_VARIED = {"phi": "varphi", "epsilon": "varepsilon"}
_LOWERED = str.maketrans("₀₁₂₃₄₅₆₇₈₉", "0123456789")
_RAISED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻", "0123456789-")


@dataclass(frozen=True)
class Copies:
    """The same results in several notations, each a block of lines."""

    plain: Markdown
    brackets: Markdown
    plus_minus: Markdown
    table: Markdown


def copies_of(estimates: Sequence[Estimate], *, kind: str = "") -> Copies:
    """Every estimate with a value or a limit, measured or not; the table shows which.

    kind : of the data; where they are "synthetic" each block states it.
    """
    notices = [phrase("SYNTHETIC data")] if kind == "synthetic" else []
    comments = [f"% {words}" for words in notices]
    available = [estimate for estimate in estimates if estimate.value != "n/a"]
    quoted = [estimate for estimate in available if estimate.told]
    brackets, plus_minus = (
        _block([*comments, *(_noted(estimate, written) for estimate in quoted)], "latex")
        for written in (False, True)
    )
    return Copies(
        _block(
            notices
            + [
                estimate.relation
                if estimate.measured
                else phrase("{relation} (not measured here)", relation=estimate.relation)
                for estimate in quoted
            ]
        ),
        brackets,
        plus_minus,
        _block([*(f"# {words}" for words in notices), *_rows(available)], "csv"),
    )


def _block(lines: Sequence[str], language: str = "text") -> Markdown:
    """Lines shown as they are; nothing in them can end the block."""
    return Markdown(
        "\n".join([f"```{language}", *(one_line(line).replace("`", "'") for line in lines), "```"])
    )


def _rows(estimates: Sequence[Estimate]) -> list[str]:
    head = "quantity", "value", "u", "low_68", "high_68", "low_95", "high_95", "unit", "measured"
    rows: list[Sequence[str]] = [head]
    for estimate in estimates:
        p, factor = estimate.summary, estimate.label.factor
        limit = p.limit.limit_95 if p.limit is not None else estimate.upper
        if limit is not None:
            ends = ["", _digits(limit * factor)]
            lower = p.limit is not None and p.limit.side == "lower"
            cells = ["", "", "", "", *(ends[::-1] if lower else ends)]
        else:
            # as the text has it, in which ± would mislead there
            centre = [p.median, None] if lopsided(p) else [p.mean, p.sd]
            numbers = [*centre, p.q16, p.q84, p.q025, p.q975]
            cells = [
                "" if v is None else _digits(v * factor, p.sd and p.sd * factor) for v in numbers
            ]
        unit = "" if estimate.label.unit == "1" else estimate.label.unit
        measured = "yes" if estimate.measured else "no"
        rows.append([estimate.label.symbol, *cells, unit, measured])
    return as_csv(rows).splitlines()


def _digits(value: float, sd: float | None = None) -> str:
    """Six digits, or as many as resolve a standard deviation to a hundredth."""
    known = math.ceil(math.log10(abs(value / sd))) if value and sd else 0
    return f"{value:.{max(6, known + 2)}g}"


def _noted(estimate: Estimate, plus_minus: bool) -> str:
    return _tex(estimate, plus_minus) + (
        "" if estimate.measured else phrase("  % not measured here")
    )


def _tex(estimate: Estimate, plus_minus: bool) -> str:
    label, p, text = estimate.label, estimate.summary, estimate.value
    symbol, unit = _symbol(label), _unit(label.unit)
    known = unit and not unit.startswith(r"\text")
    space = r"\times" if "×" in behind(label.unit) else r"\,"
    unit_suffix = rf"\,\unit{{{unit}}}" if known else f"{space}{unit}" if unit else ""
    if "±" in text and p.mean is not None and p.sd is not None:
        number = _number(
            format_quantity(p.mean * label.factor, p.sd * label.factor, plus_minus=plus_minus)
        ).replace(" ± ", " +- ")
        written = rf"\qty{{{number}}}{{{unit}}}" if known else rf"\num{{{number}}}{unit_suffix}"
        return f"${symbol} = {written}$"
    if match := re.match(r"([<>]) (\S+?)[ °]", text):
        return f"${symbol} {match[1]} {_number(match[2])}{unit_suffix}$ (95\\,\\%)"
    if match := re.match(r"\(?(\S+) \+(\S+) −([^\s)]+)", text):
        centre, up, down = (
            rf"\num{{{_number(part)}}}" if "×" in part else _number(part) for part in match.groups()
        )
        return f"${symbol} = {centre}^{{+{up}}}_{{-{down}}}{unit_suffix}$"
    return f"${symbol} = {_number(text.partition(' ')[0])}{unit_suffix}$"


def _number(text: str) -> str:
    """A number as siunitx reads it: "(1.2 ± 0.3)×10⁻⁵" as "1.2 ± 0.3 e-5", "4.20(8)e+03" as
    "4.20(8)e3".
    """
    if "e" in text:
        mantissa, _, exponent = text.partition("e")
        return f"{mantissa}e{int(exponent)}"
    if match := re.match(r"\((.+)\)×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", text):
        return f"{match[1].replace('−', '-')} e{match[2].translate(_RAISED)}"
    return (
        re.sub(r"×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", lambda match: "e" + match[1].translate(_RAISED), text)
        .replace("−", "-")
        .replace("°", "")
    )


def _unit(unit: str) -> str:
    r"""A unit in siunitx's words ("1/µs" as \per\micro\second), "" for 1; what has none stands as
    text.
    """
    if unit in ("", "1"):
        return ""
    powers = powers_in(unit)
    factors = (
        [None]
        if powers is None
        else [_word(symbol, power) for symbol, power in powers.items() if power]
    )
    return (
        rf"\text{{{_escaped(unit)}}}"
        if None in factors
        else "".join(factor or "" for factor in factors)
    )


def _word(symbol: str, power: int) -> str | None:
    """One factor of a unit, or None."""
    spelled = [
        (p, symbol[len(p) :])
        for p in _PREFIXES
        if symbol.startswith(p) and symbol[len(p) :] in _BASES
    ]
    if not spelled:
        return None
    prefix, base = min(spelled, key=lambda pair: len(pair[0]))
    name = "".join(f"\\{name}" for name in (_PREFIXES[prefix], _BASES[base]) if name)
    raised = rf"\tothe{{{abs(power)}}}" if abs(power) > 1 else ""
    return (r"\per" if power < 0 else "") + name + raised


def _symbol(shown: Label) -> str:
    base, bracket, level = shown.symbol.partition("[")
    lowered = base.translate(_LOWERED)
    index = lowered[len(base.rstrip("₀₁₂₃₄₅₆₇₈₉")) :]
    stem, underscore, below = base.rstrip("₀₁₂₃₄₅₆₇₈₉").partition("_")
    if numbered := re.fullmatch(r"([A-Za-z]+?)(\d+)", stem):
        stem, index = numbered[1], numbered[2] + index
    greek = _GREEK.get(stem, "")
    letter = (
        rf"\{_VARIED.get(greek, greek)}"
        if greek
        else stem
        if len(stem) == 1
        else rf"\mathrm{{{_upright(stem)}}}"
    )
    parts = (
        rf"\mathrm{{{_upright(below)}}}" if underscore else "",
        index,
        rf"\text{{{_escaped(level[:-1])}}}" if bracket else "",
    )
    low = ",".join(filter(None, parts))
    return letter + (f"_{{{low}}}" if low else "")


def _upright(text: str) -> str:
    """The text in mathematics, which forgets blanks."""
    return _escaped(text).replace(" ", r"\ ")


def _escaped(text: str) -> str:
    return re.sub(r"([#$%&_{}])", r"\\\1", re.sub(r"[\\^~]", " ", text))
