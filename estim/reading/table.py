"""What every source of a table gives, a CSV file (`estim.reading.named_columns`) or a track:
columns of numbers, their units, and the line of each row.

`#` starts a comment line; a column whose name starts with `_` is left unread.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray
from estim.common import InputError, is_unit, phrase, same_numbers, same_unit
from estim.reading.cells import Row
from estim.reading.dialect import Dialect
from estim.reading.input_file import line_after_comment, lines_of

Lines = list[tuple[int, str]]
"""Lines of a file, each with its number."""

_TRUE_MINUS = re.compile(r"\(?−[\d.,].*|[\d.,]+[eE]−\d.*")
_OTHER_NAMES = {
    "time (s)": "t_s",
    "t (s)": "t_s",
    "x (m)": "x_m",
    "v (m/s)": "v_m_s",
    "theta (rad)": "theta_rad",
    "omega (rad/s)": "omega_rad_s",
}
UNITS = {
    "t_s": "s",
    "x_m": "m",
    "v_m_s": "m/s",
    "theta_rad": "rad",
    "omega_rad_s": "rad/s",
    "sigma_x_m": "m",
    "sigma_v_m_s": "m/s",
}  # of columns that are known by name
_COMMENTS = ("#", "%")
# no decimal point, no word, no quote, no blank beside a comma
_WHOLE = re.compile(r"[+-]?\d*(,([+-]?\d+([eE][+-]?\d+)?)?)*", re.ASCII)
DECIMAL_COMMAS = (
    "may hold decimal commas: every cell is a whole number, and columns that are not read "
    "leave room for the digits behind commas;"
    " separate the cells by semicolons, or write one number with a decimal point, as 0.0"
)
_NAME_THEM = "or name the columns without units by --columns (columns = [...] in a campaign)"
_MAX_LINE = 100_000  # characters
_MAX_ROWS = 1_000_000
NOTE = "# warning: "  # what `estim import` found suspicious, kept with the numbers
IMPORTED = "# made by estim import"  # first line of what it writes


@dataclass(frozen=True, eq=False)
class Table:
    """columns : name -> (n_row,) read-only array.  lines : (n_row,) line of the file of each row.

    file : how messages name it.
    header_line : line of the column names, 0 where they are not in it.
    sha256 : of the file's bytes.
    warnings : texts of the comment lines "# warning: ...".
    facts : the other comments above the header of a file that `estim import` made; empty for other
        files.  units : column -> unit that the header states, "" for none; empty where no header
        may.
    blank : lines of the rows that are left out, since a column has no value there.
    imported : whether `estim import` made the file.
    unread : further columns of numbers that the file has.
    assumed : those of the facts that describe how the table was read.
    """

    file: str
    sha256: str
    columns: Mapping[str, FloatArray]
    lines: IntArray
    header_line: int = 0
    warnings: tuple[str, ...] = ()
    facts: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    blank: tuple[int, ...] = ()
    imported: bool = False
    unread: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()

    def with_columns(self, columns: Mapping[str, FloatArray], **changes: Any) -> Self:
        """The table with these columns, which become read-only; changes : of its other fields."""
        for column in columns.values():
            column.setflags(write=False)
        return replace(self, columns=MappingProxyType(dict(columns)), **changes)

    def require_unit(self, u: str, of: str) -> None:
        """`require_unit` of two of its columns."""
        require_unit(self.units, u, of, file=self.file, line=self.header_line or None)

    def require(self, name: str, valid: BoolArray, rule: str) -> None:
        """Raises InputError at the first row in which the column `name` is not `valid` (n_row,)."""
        if not np.all(valid):
            raise self.error(rule, name, int(np.argmin(valid)))

    def error(self, rule: str, name: str, row: int) -> InputError:
        """An InputError for the cell of column `name` in `row`."""
        return InputError(
            rule,
            field=name,
            value=self.columns[name][row].item(),
            file=self.file,
            line=int(self.lines[row]),
        )


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the numbers of a table are.

    names : of the columns.  header_line : where they stand, None where they are stated.
    units : of the columns, as the header states them; "" where it states none.
    rows : from the first row of numbers on, comments taken out.
    head : what the head of a file that `estim import` made states; empty for other files.
    first_column : place of the first one among those of a spreadsheet, None where cells have no
        names of their own.
    assumed : how the table was read, where that is not plain.
    moments : names of the columns that held dates or times.
    refused : column -> why it cannot be read.
    """

    file: str
    sha256: str
    dialect: Dialect
    delimiter: str
    names: tuple[str, ...]
    header_line: int | None
    units: tuple[str, ...]
    rows: list[Row]
    warnings: tuple[str, ...]
    head: tuple[str, ...] = ()
    first_column: int | None = None
    assumed: tuple[str, ...] = ()
    moments: tuple[str, ...] = ()
    refused: Mapping[str, InputError] = field(default_factory=dict)


def require_unit(
    units: Mapping[str, str], u: str, of: str, *, file: str | None = None, line: int | None = None
) -> None:
    """Raises InputError where `units` has one for the column `u` of uncertainties, and another or
    none for the column that they are of: 2 % of y is not 2.
    """
    stated, expected = (units.get(name, "").strip() for name in (u, of))
    if not expected and is_unit(stated) and same_unit(stated, "1") is False:
        rule = (
            f"has a unit, and '{of}' states none: write the uncertainties in the unit of '{of}', "
            "and state it for both"
        )
        if stated != "%":
            rule += f", {_NAME_THEM}"
    elif stated and expected and not same_numbers(stated, expected, differences=True):
        rule = f"must be in the unit of '{of}', {units[of]}; write it in that unit, {_NAME_THEM}"
    else:
        return
    raise InputError(rule, field=u, value=units[u], file=file, line=line)


def facts_of(rows: Lines, header_line: int) -> tuple[str, ...]:
    """What the head of a file that `estim import` made states about its origin."""
    head = [line for number, line in rows if number < header_line]
    if not head or head[0].strip() != IMPORTED:
        return ()
    return tuple(line.lstrip("# ").strip() for line in head[1:] if not line.startswith(NOTE))


def numbered_lines(text: str) -> Lines:
    """The lines that are not blank, each with its number.  Raises InputError where there are too
    many, or one is too long.
    """
    rows = [(number, line) for number, line in enumerate(lines_of(text), start=1) if line.strip()]
    if len(rows) > _MAX_ROWS:
        raise InputError(f"must be at most {_MAX_ROWS}", field="number of lines", value=len(rows))
    if hidden := line_after_comment(text):
        raise InputError(
            "must not follow a comment after a carriage return alone, where other lines end "
            "otherwise",
            field="row",
            line=hidden,
        )
    for number, line in rows:
        if len(line) > _MAX_LINE:
            raise InputError(
                f"must have at most {_MAX_LINE} characters",
                field="row",
                value=len(line),
                line=number,
            )
    return rows


def may_be_decimal_commas(lines: Iterable[str]) -> bool:
    """Whether the commas of every line may be those of numbers like 0,5: with columns left unread,
    the count of the cells does not decide.
    """
    return all(_WHOLE.fullmatch(line.strip()) for line in lines)


def own_name(cell: str) -> str:
    """A column name in our spelling: "Time (s)" is t_s."""
    return _OTHER_NAMES.get(cell.strip().lower(), cell.strip())


def split_cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line, blanks around them taken off, the minus of Unicode in numbers as that of
    the keyboard.  Raises csv.Error where quotes do not enclose whole cells.
    """
    cells = (
        line.split()
        if delimiter == " "
        else next(csv.reader([line], delimiter=delimiter, strict=True))
    )
    return [
        cell.replace("−", "-") if "−" in cell and _TRUE_MINUS.fullmatch(cell) else cell
        for cell in map(str.strip, cells)
    ]


def row_of(line: str, delimiter: str, number: int) -> list[str]:
    """`split_cells` with the place in its error."""
    try:
        return split_cells(line, delimiter)
    except csv.Error as error:
        raise InputError(
            f"cannot be split into cells ({error})", field="row", value=line, line=number
        ) from None


def line_numbers(lines: Sequence[int]) -> str:
    """Lines of a file in short form, `3, 5, 8 to 12`; of many the first, and how many more
    there are.
    """
    parts, counted = list[str](), 0
    for _, pairs in groupby(enumerate(lines), lambda pair: pair[1] - pair[0]):
        stretch = [line for _, line in pairs]
        labels = (
            [phrase("{first} to {last}", first=stretch[0], last=stretch[-1])]
            if len(stretch) > 2
            else [*map(str, stretch)]
        )
        if len(parts) + len(labels) > 6:
            return ", ".join([*parts, phrase("and {n} more", n=len(lines) - counted)])
        parts += labels
        counted += len(stretch)
    return ", ".join(parts)
