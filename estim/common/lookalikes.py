"""Names that a file system or a reader takes for the same: another case, another form of the same
letters, letters that look alike.

Folders are named after runs.  Windows and macOS do not distinguish `Run` from `run`, nor macOS one
Unicode form from another, Windows drops a full stop at the end, and nobody distinguishes a Cyrillic
а from a Latin a.  Source of the pairs: Unicode Technical Standard 39, confusables.txt, the letters
of Greek and Cyrillic that look like Latin ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from unicodedata import name as name_of
from unicodedata import normalize

_CYRILLIC = ("АВЕЅІЈКМНОРСТУХԌаеѕіјорсухһԁԛԝӏ", "ABESIJKMHOPCTYXGaesijopcyxhdqwl")
_GREEK = ("ΑΒΕΖΗΙΚΜΝΟΡΤΥΧοϲϳ", "ABEZHIKMNOPTYXocj")
_LATIN = str.maketrans(_CYRILLIC[0] + _GREEK[0], _CYRILLIC[1] + _GREEK[1])


def forms(name: str) -> tuple[str, str]:
    """What is left of a name without case and Unicode form, and without the script of letters that
    look alike either.
    """
    return _folded(_normalised(name)), _folded(_looks(name))


def _folded(text: str) -> str:
    return normalize("NFKC", text.casefold()).rstrip(".")


def first_alike(names: Sequence[str]) -> tuple[int, int] | None:
    """Indices of two names that are taken for the same, the later one first; None where all
    differ.
    """
    first_index: dict[tuple[int, str], int] = {}
    for i, name in enumerate(names):
        for key in enumerate(forms(name)):
            if key in first_index:
                return i, first_index[key]
        first_index |= dict.fromkeys(enumerate(forms(name)), i)
    return None


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
