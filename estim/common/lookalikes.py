"""Names that a file system takes for the same, or a reader: nobody distinguishes a Cyrillic а from
a Latin a.

Source of the pairs: Unicode Technical Standard 39, confusables.txt, the letters of Greek and
Cyrillic that look like Latin ones.
"""

from __future__ import annotations

from collections.abc import Iterable
from unicodedata import name as name_of
from unicodedata import normalize

_CYRILLIC = ("АВЕЅІЈКМНОРСТУХԌаеѕіјорсухһԁԛԝӏ", "ABESIJKMHOPCTYXGaesijopcyxhdqwl")
_GREEK = ("ΑΒΕΖΗΙΚΜΝΟΡΤΥΧοϲϳ", "ABEZHIKMNOPTYXocj")
_LATIN = str.maketrans(_CYRILLIC[0] + _GREEK[0], _CYRILLIC[1] + _GREEK[1])


def folded(name: str) -> str:
    """What Windows and macOS see of the name of a folder: neither case nor Unicode form, nor a full
    stop at the end.
    """
    return _normalised(name.casefold()).rstrip(".")


def same_looks(names: Iterable[str]) -> str:
    """Two different names that nobody can distinguish when they are printed, with the letters that
    differ; "" where there are none.
    """
    first_names: dict[str, str] = {}
    for name in names:
        other = first_names.setdefault(_looks(name), name)
        if _normalised(name) != _normalised(other):
            return ", ".join(
                f"{text} ({spelt})" if (spelt := _foreign(text)) else text for text in (other, name)
            )
    return ""


def _normalised(name: str) -> str:
    return normalize("NFKC", name)


def _looks(name: str) -> str:
    return _normalised(name).translate(_LATIN)


def _foreign(name: str) -> str:
    """The letters of a name that look like Latin ones, as Unicode calls them."""
    return ", ".join(
        name_of(mark).lower() for mark in dict.fromkeys(_normalised(name)) if ord(mark) in _LATIN
    )
