"""Names that a file system or a reader takes for the same: another case, another form of the same letters, letters that look alike.

Folders are named after runs.  Windows and macOS do not tell `Run` from `run`, macOS not one Unicode form from another,
Windows drops a full stop at the end, and nobody tells a Cyrillic а from a Latin a.
Source of the pairs: Unicode Technical Standard 39, confusables.txt, the letters of Greek and Cyrillic that look like Latin ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from unicodedata import normalize

_CYRILLIC = ("АВЕЅІЈКМНОРСТУХԌаеѕіјорсухһԁԛԝӏ", "ABESIJKMHOPCTYXGaesijopcyxhdqwl")
_GREEK = ("ΑΒΕΖΗΙΚΜΝΟΡΤΥΧοϲϳ", "ABEZHIKMNOPTYXocj")
_LATIN = str.maketrans(_CYRILLIC[0] + _GREEK[0], _CYRILLIC[1] + _GREEK[1])


def forms(name: str) -> tuple[str, str]:
    """What is left of a name without case and Unicode form, and without the script of letters that look alike either."""
    plain = normalize("NFKC", name)
    return _folded(plain), _folded(plain.translate(_LATIN))


def _folded(text: str) -> str:
    return normalize("NFKC", text.casefold()).rstrip(".")


def first_alike(names: Sequence[str]) -> tuple[int, int] | None:
    """Indices of two names that are taken for the same, the later one first; None where all differ."""
    seen: dict[tuple[int, str], int] = {}
    for i, name in enumerate(names):
        for key in enumerate(forms(name)):
            if key in seen:
                return i, seen[key]
        seen |= dict.fromkeys(enumerate(forms(name)), i)
    return None
