"""What one cell of a table holds: a number, nothing, or the error of a spreadsheet; and which lines
are comments.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*|,\d+)?|[.,]\d+)([eE][+-]?\d{1,4})?", re.ASCII)
_MISSING = {"", "nan", "na", "n/a", "-", "--", "−", "null"}
_MARKS = re.compile(r"[\t;,|]")
_TOO_NARROW = re.compile(r"#{3,}")  # what a spreadsheet shows of a number wider than its column
_OF_SPREADSHEETS = (
    "#N/A #N/D #N/B #NV #I/T #YOK #Н/Д #GETTING_DATA #DIV/0! #DZIEL/0! #DEEL/0! "
    "#DIVISION/0! #SAYI/0! #ДЕЛ/0! #¡DIV/0! #VALUE! #WERT! #VALEUR! "
    "#VALORE! #VALOR! #¡VALOR! #WAARDE! #ARG! #DEĞER! #ЗНАЧ! #REF! #¡REF! #BEZUG! #RIF! "
    "#VERW! #ADR! #BAŞV! #ССЫЛКА! #NAME? #NOM? #NOME? #NOMBRE? "
    "#¿NOMBRE? #NAAM? #NAZWA? #AD? #ИМЯ? #NUM! #¡NUM! #NÚM! #ZAHL! #NOMBRE! #GETAL! "
    "#LICZBA! #SAYI! #ЧИСЛО! #NULL! #NUL! #NULO! #¡NULO! #NULLO! "
    "#LEEG! #ZERO! #BOŞ! #ПУСТО! #ÜBERLAUF! #SPILL! #CALC! #FIELD! #ERROR! #UNKNOWN! "
    "#CONNECT! #BLOCKED! #BUSY!"
)
_ERRORS = frozenset(_OF_SPREADSHEETS.split())
NOT_COMPUTED = "never computed: open the file in the spreadsheet program and save it"


class Row(NamedTuple):
    """A line.  number : in the file.  cells : the line alone where it cannot be split."""

    number: int
    line: str
    cells: list[str]


def looks_like_a_number(cell: str) -> bool:
    """Whether a cell is a number with a decimal point or a decimal comma."""
    return _NUMBER.fullmatch(cell) is not None


def is_missing(cell: str) -> bool:
    """Whether a cell states that there is no value."""
    return cell.lower() in _MISSING


def is_formula(cell: str) -> bool:
    """Whether a cell is a formula in the place of its value: `=B2/2`, but not the remark `=> B`."""
    return cell.startswith("=") and not cell.startswith(("==", "=>"))


def is_spreadsheet_error(cell: str) -> bool:
    """Whether a cell is what a spreadsheet puts in the place of a value that it does not have:
    `#N/A`, `#DIV/0!`, in several languages.
    """
    return cell.upper() in _ERRORS


def is_comment(line: str) -> bool:
    """Whether a line is a comment: it begins with `#`, and is no row whose first cell a spreadsheet
    could not compute, or show.
    """
    text = line.strip()
    return (
        text.startswith("#")
        and not _is_row(_MARKS.split(text), words=False)
        and not _is_row(text.split(), words=True)
    )


def _is_row(cells: Sequence[str], *, words: bool) -> bool:
    """Whether cells that begin with `#` are a row.  words : blanks part them, as they part the
    words of a comment.
    """
    first, *others = [cell.strip() for cell in cells]
    valued = [
        looks_like_a_number(cell) or is_missing(cell) or is_spreadsheet_error(cell)
        for cell in others
    ]
    if is_spreadsheet_error(first):
        return all(valued) if words else any(valued)
    return (
        bool(_TOO_NARROW.fullmatch(first))
        and not words
        and bool(others)
        and all(map(looks_like_a_number, others))
    )
