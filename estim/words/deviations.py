"""What a user's own curve lacks, in words: whether there is something, how large it is, over what distance it changes."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from estim.common import Finding, Kind
from estim.words.table import Table

_READ_AS: Mapping[str, str] = MappingProxyType(
    {"smooth": "a smooth deviation from the curve", "correlated": "errors of the readings that follow each other"}
)


def _unit(unit: str) -> str:
    return "" if unit == "1" else f" {unit}"


def _of_run(f: Finding) -> str:
    return f"run {f.run}: " if f.run else ""


def _how(f: Finding) -> str:
    """As what it is read: the probable way, and how probable where both were asked for."""
    n = f.numbers
    ways = [way for way in _READ_AS if way in n]
    probable = max(ways, key=lambda way: n[way])
    along = _unit(f.names[0]) if probable == "smooth" else f" {f.names[2]}"
    size, length, short, long = (n[f"{probable}_{what}"] for what in ("size", "length", "short", "long"))
    share = f" (probability {n[probable]:.2g}; else {_READ_AS[next(w for w in ways if w != probable)]})" if len(ways) > 1 else ""
    return (
        f"{_READ_AS[probable]}{share} of standard deviation {size:.2g}{_unit(f.names[1])}, over about {length:.2g}{along} ({short:.2g} to {long:.2g})"
    )


def _found(f: Finding) -> str:
    n, unit = f.numbers, _unit(f.names[1])
    return (
        f"{_of_run(f)}the residuals are not white about the curve; read as {_how(f)}; the part that no values of the parameters can imitate is "
        f"{n['typical']:.2g}{unit} (root mean square, at most {n['most']:.2g}{unit}), P(amplitude > 0) = {f.p:.3f}"
    )


WORDS: Table = MappingProxyType(
    {
        Kind.DEVIATION_FOUND: _found,
        Kind.DEVIATION_UNDECIDED: lambda f: (
            f"{_of_run(f)}whether the curve lacks something cannot be told, P(amplitude > 0) = {f.p:.2f}; every interval has room for it"
        ),
        Kind.DEVIATION_UNLIKELY: lambda f: (
            f"{_of_run(f)}nothing shows that the curve lacks something, P(amplitude > 0) = {f.p:.2f}; every interval has room for what may have "
            "stayed unseen"
        ),
    }
)
