"""Tables of numbers from CSV files, read without changing a number.

`#` starts a comment line; a column whose name starts with `_` is left unread.  Commas, semicolons or tabs separate the
cells; decimals have a point, and where a comma may be either, the file is refused.

A first line like ``%Time (s)<TAB>Theta (rad)<TAB>Omega (rad/s)``, as LabVIEW writes it, is understood too.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.common import EXTREME, InputError, extreme, listed, read_number, same_unit
from estim.reading.cells import is_comment
from estim.reading.input_file import line_after_comment, lines_of, read_text

_OTHER_NAMES = {
    "time (s)": "t_s",
    "t (s)": "t_s",
    "x (m)": "x_m",
    "v (m/s)": "v_m_s",
    "theta (rad)": "theta_rad",
    "omega (rad/s)": "omega_rad_s",
}
UNITS = {
    "t_s": "s", "x_m": "m", "v_m_s": "m/s", "theta_rad": "rad", "omega_rad_s": "rad/s", "sigma_x_m": "m", "sigma_v_m_s": "m/s",
}  # of columns that are known by name
_COMMENTS = ("#", "%")
_WHOLE = re.compile(r"[+-]?\d*(,([+-]?\d+([eE][+-]?\d+)?)?)*", re.ASCII)  # no decimal point, no word, no quote, no blank beside a comma
DECIMAL_COMMAS = (
    "may hold decimal commas: every cell is a whole number, and columns that are not read leave room for the digits behind commas;"
    " separate the cells by semicolons, or write one number with a decimal point, as 0.0"
)
_MAX_LINE = 100_000  # characters
_MAX_ROWS = 1_000_000
NOTE = "# warning: "  # what `estim import` found suspicious, kept with the numbers
IMPORTED = "# made by estim import"  # first line of what it writes


@dataclass(frozen=True, eq=False)
class Table:
    """columns : name -> (n_row,) read-only array.  lines : (n_row,) line of the file of each row.

    file : how messages name it.  header_line : line of the column names.  sha256 : of the file's bytes.
    warnings : texts of the comment lines "# warning: ...".  facts : the other comments above the header of a file that
    `estim import` made; empty for other files.  units : column -> unit that the header states, "" for none; empty where no header may.
    blank : lines of the rows that are left out, since a column has no value there.  imported : whether `estim import` made the file.
    unread : further columns of numbers that the file has.
    """

    file: str
    sha256: str
    header_line: int
    columns: Mapping[str, FloatArray]
    lines: NDArray[np.int64]
    warnings: tuple[str, ...] = ()
    facts: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    blank: tuple[int, ...] = ()
    imported: bool = False
    unread: tuple[str, ...] = ()

    def require_unit(self, u: str, of: str) -> None:
        """Raises InputError where the header states one unit for the column `u` of uncertainties, and another for the column that they are of."""
        stated, wanted = (self.units.get(name, "").strip() for name in (u, of))
        if stated and wanted and not same_unit(stated, wanted):
            rule = f"must be in the unit of '{of}', {self.units[of]}; write it in that unit, or name the columns without units by --columns"
            raise InputError(f"{rule} (columns = [...] in a campaign)", field=u, value=self.units[u], file=self.file, line=self.header_line or None)

    def error(self, rule: str, name: str, row: int) -> InputError:
        """An InputError for the cell of column `name` in `row`."""
        return InputError(rule, field=name, value=self.columns[name][row].item(), file=self.file, line=int(self.lines[row]))


def read_table(path: Path, *, known: Sequence[str], min_rows: int, shown_as: str, needed: Sequence[str] = ()) -> Table:
    """The table of finite numbers in the CSV file at `path`, with columns out of `known`, those that are `needed` among them.

    Raises InputError with file, line, field, rule and value.
    """
    text, digest = read_text(path, shown_as=shown_as)
    rows = numbered_lines(text, file=shown_as)
    header = next(((n, line) for n, line in rows if not is_comment(line) or _names(line, known)), None)
    if header is None:
        raise InputError("has no line of column names", file=shown_as)
    header_line, header_text = header
    names = _names(header_text, known)
    if not names:
        raise InputError(f"must hold column names ({', '.join(known)})", field="header", value=header_text, file=shown_as, line=header_line)
    delimiter = _delimiter(header_text)
    for name in needed:
        if name not in names:
            raise InputError("is missing", field=name, file=shown_as, line=header_line, quoted=f"the header has {listed(names)}")
    _check_names(names, known, shown_as, header_line)
    percent = header_text.lstrip().startswith("%")  # LabVIEW's
    below = [(number, line) for number, line in rows if number > header_line and not is_comment(line)]
    data = [(number, line) for number, line in below if not (percent and line.lstrip().startswith("%"))]
    numbers = [number for number, _ in data]
    cells = [_cells(line, names, delimiter, shown_as, number) for number, line in data]
    if len(cells) < min_rows:
        raise InputError(f"must hold at least {min_rows} rows of numbers", field="rows", value=len(cells), file=shown_as)
    if delimiter == "," and any(name.startswith("_") for name in names) and may_be_decimal_commas(line for _, line in data):
        raise InputError(DECIMAL_COMMAS, field="row", value=data[0][1], file=shown_as, line=numbers[0])
    table = np.array(cells)
    columns = {column: table[:, i] for i, column in enumerate(names) if not column.startswith("_")}
    lines = np.array(numbers)
    for array in (*columns.values(), lines):
        array.setflags(write=False)
    warnings = tuple(line[len(NOTE) :].strip() for _, line in rows if line.startswith(NOTE))
    facts = facts_of(rows, header_line)
    return Table(shown_as, digest, header_line, MappingProxyType(columns), lines, warnings, facts, imported=bool(facts))


def facts_of(rows: Sequence[tuple[int, str]], header_line: int) -> tuple[str, ...]:
    """What the head of a file that `estim import` made says of where it comes from."""
    head = [line for number, line in rows if number < header_line]
    if not head or head[0].strip() != IMPORTED:
        return ()
    return tuple(line.lstrip("# ").strip() for line in head[1:] if not line.startswith(NOTE))


def numbered_lines(text: str, *, file: str) -> list[tuple[int, str]]:
    """The lines that are not blank, each with its number.  Raises InputError where there are too many, or one is too long."""
    rows = [(number, line) for number, line in enumerate(lines_of(text), start=1) if line.strip()]
    if len(rows) > _MAX_ROWS:
        raise InputError(f"must be at most {_MAX_ROWS}", field="number of lines", value=len(rows), file=file)
    if hidden := line_after_comment(text):
        rule = "must not follow a comment after a carriage return alone, where other lines end otherwise"
        raise InputError(rule, field="row", file=file, line=hidden)
    for number, line in rows:
        if len(line) > _MAX_LINE:
            raise InputError(f"must have at most {_MAX_LINE} characters", field="row", value=len(line), file=file, line=number)
    return rows


def may_be_decimal_commas(lines: Iterable[str]) -> bool:
    """Whether the commas of every line may be those of numbers like 0,5: with columns left unread, the count of the cells does not tell."""
    return all(_WHOLE.fullmatch(line.strip()) for line in lines)


def _delimiter(header: str) -> str:
    return next((mark for mark in ("\t", ";", ",") if mark in header), ",")


def _names(line: str, known: Sequence[str]) -> list[str]:
    """Column names on a line, in our spelling; empty where the line is no header."""
    cells = [cell.strip() for cell in line.lstrip("%# ").split(_delimiter(line))]
    names = [own_name(cell) for cell in cells]
    commented = line.lstrip().startswith(_COMMENTS)
    if commented:
        return names if all(name in known for name in names) else []
    return names if all(name and not _is_number(name) for name in names) else []


def _is_number(text: str) -> bool:
    try:
        read_number(text)
    except ValueError:
        return False
    return True


def own_name(cell: str) -> str:
    """A column name in our spelling: "Time (s)" is t_s."""
    return _OTHER_NAMES.get(cell.strip().lower(), cell.strip())


def split_cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line, blanks around them taken off.  Raises csv.Error where quotes do not enclose whole cells."""
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, strict=True))]


def _check_names(names: list[str], known: Sequence[str], file: str, line: int) -> None:
    seen: set[str] = set()
    for name in names:
        if name not in known and not name.startswith("_"):
            rule = f"is not a column name (known: {', '.join(known)}; start a name with _ to skip it)"
            raise InputError(rule, field=name, file=file, line=line)
        if name in seen:
            raise InputError("stands twice in the header", field=name, file=file, line=line)
        seen.add(name)


def _cells(line: str, names: list[str], delimiter: str, file: str, number: int) -> list[float]:
    try:
        texts = split_cells(line, delimiter)
    except csv.Error as error:
        raise InputError(f"cannot be split into cells ({error})", field="row", value=line, file=file, line=number) from None
    if len(texts) != len(names):
        commas = delimiter == "," and len(texts) == 2 * len(names)
        hint = " (decimal commas? write decimal points, or separate the cells by semicolons)" if commas else ""
        raise InputError(f"must have {len(names)} cells{hint}", field="row", value=len(texts), file=file, line=number)
    values = []
    for name, text in zip(names, texts, strict=True):
        if name.startswith("_"):
            values.append(0.0)
            continue
        try:
            value = read_number(text)
        except ValueError:
            hint = " with a decimal point, not a comma" if _is_number(text.replace(",", ".", 1)) else ""
            raise InputError(f"must be a number{hint}", field=name, value=text, file=file, line=number) from None
        if not math.isfinite(value):
            raise InputError("must be finite", field=name, value=text, file=file, line=number)
        if extreme(value):
            raise InputError(EXTREME, field=name, value=text, file=file, line=number)
        values.append(value)
    return values
