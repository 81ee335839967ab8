"""How a table of numbers is written: what a person states of it, and what its lines show.

Nothing is guessed that two people might read in two ways: such a file is refused with the key that
resolves it.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from estim.common import InputError, in_unit, is_unit
from estim.reading.cells import looks_like_a_number

Decimal = Literal["point", "comma"]
Dates = Literal["dmy", "mdy"]
Encoding = Literal[
    "utf-8",
    "utf-16",
    "latin-1",
    "windows-1252",
    "windows-1250",
    "windows-1251",
    "iso-8859-15",
    "mac-roman",
    "cp437",
    "cp850",
]

DELIMITERS = ("\t", ";", ",", "|", " ")
_WORDS = {"tab": "\t", "semicolon": ";", "comma": ",", "bar": "|", "blank": " ", "\\t": "\t"}
_RANGE = re.compile(r"([A-Z]{0,3})(\d{0,7}):([A-Z]{0,3})(\d{0,7})", re.ASCII)
_NAMED_UNIT = re.compile(
    r"(.{1,60}?)(\s*/)?(\s*)(?:\(([^()]{1,20})\)|\[([^\[\]]{1,20})\])|(.{1,60}?)\s+/\s*([^\s/]{1,20})"
)
# as Capstone writes it: Time (s) Run #1
_BEFORE_A_RUN = re.compile(r"(.{1,60}?)\s*[(\[]([^()\[\]]{1,20})[)\]]\s+((?:[^\W\d_]+\s)?#\d+)")
_SYMBOL_OVER_UNIT = re.compile(r"([^\W\d_](?:_\w{1,8})?)/([^\s/()]{1,20})")
# v in m s-1, v / m s-1, v in (m/s)
_UNIT_BEHIND_A_WORD = re.compile(r"(.{1,60}?)\s+(?:in|/)\s+(\S.{0,19})")
_BRACKETS = re.compile(r"[(\[]([^()\[\]]+)[)\]]")
_UNCERTAINTY = re.compile(r"u_.+|u\(([^()]+)\)")
_FUNCTION = re.compile(
    r"ln|lg|log(?:2|10)?|exp|sqrt|(?:a|arc)?(?:sin|cos|tan)|sinh|cosh|tanh", re.IGNORECASE
)
_RATHER_SYMBOLS = ("t", "T", "d", "h", "l")  # in t/s and h/cm, where they could be units too
# V(l) are litres, T(l) is T as it follows from l
_LETTERS_BEFORE = {"t": "", "l": "V", "L": "V", "h": "tτ", "d": "tτ", "T": "B", "F": "C"}


@dataclass(frozen=True)
class Dialect:
    """What is stated of a table; None: what its lines show.

    columns : names of all columns from left to right, in place of a header.
    delimiter : what separates the cells, or its name (`tab`).
    skip_rows : lines left unread at the top.
    sheet : of a workbook, or the name of a table in a zip archive.
    range : the cells that are read, A3:D40, A3:D or 3:40; a line of a text is a row.
    dates : the order of day and month in 03/05/2024.
    since : the moment that is 0 in columns of times, as 2024-03-05 10:00; else their first row.
    time_unit : of these columns, else s.
    """

    columns: tuple[str, ...] | None = None
    delimiter: str | None = None
    decimal: Decimal | None = None
    skip_rows: int | None = None
    encoding: Encoding | None = None
    sheet: str | None = None
    range: str | None = None
    dates: Dates | None = None
    since: str | None = None
    time_unit: str | None = None

    def __post_init__(self) -> None:
        if self.delimiter is not None and self.mark not in DELIMITERS:
            raise InputError(
                f"must be one of {', '.join(_WORDS)[:-4]}", field="delimiter", value=self.delimiter
            )
        if self.skip_rows is not None and self.skip_rows < 0:
            raise InputError(
                "must be a number of lines, 0 or more", field="skip_rows", value=self.skip_rows
            )
        if self.range is not None:
            self.within  # noqa: B018
        if self.time_unit is not None and in_unit(1.0, "s", self.time_unit) is None:
            raise InputError("must be a unit of time", field="time_unit", value=self.time_unit)
        if self.columns is not None:
            named = [name for name in self.columns if name and not name.startswith("_")]
            if not named or len(set(named)) < len(named):
                raise InputError(
                    "must name the columns from left to right, each by a name of its own",
                    field="columns",
                    value=", ".join(self.columns),
                )

    @property
    def mark(self) -> str | None:
        """The delimiter as one character."""
        return None if self.delimiter is None else _WORDS.get(self.delimiter, self.delimiter)

    @property
    def within(self) -> tuple[Sequence[int], slice]:
        """The lines and the columns that are read.  Raises InputError."""
        match = _RANGE.fullmatch((self.range or ":").upper())
        if match is None:
            raise InputError(
                "must be written as in a spreadsheet: A3:D40, A3:D or 3:40",
                field="range",
                value=self.range,
            )
        left, top, right, bottom = match.groups()
        lines = range(int(top or 0), int(bottom) + 1 if bottom else sys.maxsize)
        return lines, slice(column_number(left), column_number(right) + 1 if right else None)


PLAIN = Dialect()  # nothing is stated


def column_number(letters: str) -> int:
    """The place of a column of a spreadsheet, 0 for A and for ""."""
    number = 0
    for letter in letters:
        number = 26 * number + ord(letter) - ord("A") + 1
    return max(number - 1, 0)


def cell_name(line: int, column: int) -> str:
    """The name of a cell of a spreadsheet: B7."""
    letters = ""
    while column >= 0:
        letters, column = chr(ord("A") + column % 26) + letters, column // 26 - 1
    return f"{letters}{line}"


def name_and_unit(cell: str) -> tuple[str, str]:
    """("U", "mV") for `U (mV)`, `U [mV]`, `U / mV`, `U/mV`, `U/(mV)` and `U in mV`, and
    ("U Run #1", "mV") for `U (mV) Run #1`; the unit is ""
    where the name states none, as `ln(U/V)`, `s(t)` and `m/s`.
    """
    in_match = _UNIT_BEHIND_A_WORD.fullmatch(cell.strip())
    if in_match is not None:
        unit = in_match[2].strip()
        bracketed = _BRACKETS.fullmatch(unit)
        if is_unit(unit := bracketed[1].strip() if bracketed else unit):
            return in_match[1].strip(), unit
    of_run = _BEFORE_A_RUN.fullmatch(cell.strip())
    if of_run is not None and is_unit(of_run[2].strip()):
        return f"{of_run[1]} {of_run[3]}", of_run[2].strip()
    is_u = cell.startswith("u(") and is_uncertainty(cell)
    match = None if is_u else _NAMED_UNIT.fullmatch(cell.strip())
    if match is None:
        over = _SYMBOL_OVER_UNIT.fullmatch(cell.strip())
        if over and is_unit(over[2]) and (over[1] in _RATHER_SYMBOLS or not is_unit(over[0])):
            return over[1], over[2]
        return cell.strip(), ""
    name, slash, blank, round_, square, other, unit = match.groups()
    if other is not None:
        return other.strip(), unit.strip()
    inside = (round_ or square).strip()
    if (_FUNCTION.fullmatch(name) and inside != "1") or (slash and not is_unit(inside)):
        return cell.strip(), ""
    return name.strip(), "" if round_ and not slash and not blank and _is_argument(
        name, inside
    ) else inside


def names_and_units(columns: Sequence[str]) -> list[tuple[str, str]]:
    """`name_and_unit` of each; beside a column T, `u(T)` is the name of its uncertainties, though T
    is a unit too.
    """
    pairs = [name_and_unit(column) for column in columns]
    own = {f"u({name})" for name, _ in pairs}
    return [
        (column, "") if column in own else pair for column, pair in zip(columns, pairs, strict=True)
    ]


def bare_name(column: str) -> str:
    """The name of a column without its unit."""
    return name_and_unit(column)[0]


def _is_argument(name: str, inside: str) -> bool:
    """Whether `name(inside)` without a blank may be a quantity as it follows from another one:
    s(t), N(E).
    """
    if len(inside) > 1 or inside.isdigit():
        return False
    if inside in _LETTERS_BEFORE and (inside == "t" or len(name) < 3):
        return not any(letter in name for letter in _LETTERS_BEFORE[inside]) and not (
            len(name) > 2 and name[0] in "mM"
        )
    return not is_unit(inside)


def is_uncertainty(name: str) -> bool:
    """Whether a column is called as that of an uncertainty, without its unit: `u_U`, or `u(U)`
    where U is no unit (`u(cm)` is a length u).
    """
    match = _UNCERTAINTY.fullmatch(name.strip())
    return match is not None and not (match[1] and is_unit(match[1]))


def uncertainty_of(column: str, names: Sequence[str]) -> str | None:
    """The column u_NAME or u(NAME) of the uncertainties of `column`, if it is among `names`."""
    named = {
        written for name in (column, bare_name(column)) for written in (f"u_{name}", f"u({name})")
    }
    matches = [
        name for name in names if not name.startswith("_") and {name, bare_name(name)} & named
    ]
    # of two that have one name without their units, the one in this unit
    return next((name for name in matches if name in named), matches[0] if matches else None)


def shown_delimiter(*lines: str, head: str = "") -> str:
    """What separates the cells of rows of data, by these alone: tabs, semicolons and bars always
    do, commas unless in numbers of the last.  head : the first line; where it has commas, those in
    "run 1,5" part cells.
    """
    if delimiter := next(
        (mark for line in reversed(lines) for mark in ("\t", ";", "|") if mark in line), None
    ):
        return delimiter
    line = lines[-1]
    words = line.split()
    return (
        " "
        if "," not in line
        or (
            len(words) > 1
            and not {"±", "+/-", "+-"} & {*words}  # these stand inside a cell
            and all(looks_like_a_number(word) for word in words if "," in word or "," in head)
        )
        else ","
    )


def is_column(name: str, names: Sequence[str]) -> bool:
    """Whether a column is called `name`, just so or before its unit."""
    return any(name in (column, bare_name(column)) for column in names)


def dialect_of_options(options: Mapping[str, Any]) -> Dialect:
    """How a table is written, as the options of a command describe it (`--skip-rows` is skip_rows).
    Options that are not given may be absent or None.  Raises InputError naming the option.
    """
    columns = options.get("columns")
    names = None if columns is None else tuple(name.strip() for name in columns.split(","))
    keys = Dialect.__dataclass_fields__.keys() - {"columns"}
    try:
        return Dialect(names, **{key: options.get(key) for key in keys})
    except InputError as error:
        option = f"--{str(error.field).replace('_', '-')}"
        raise InputError(error.rule, field=option, value=error.value) from None
