"""Tables of numbers from CSV files, read without changing a number, and text files in general.

`#` starts a comment line; a column whose name starts with `_` is left unread.  Commas, semicolons or tabs separate the
cells.  A first line like ``%Time (s)<TAB>Theta (rad)<TAB>Omega (rad/s)``, as LabVIEW writes it, is understood too.
"""

from __future__ import annotations

import csv
import hashlib
import math
import stat
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from estim.errors import InputError
from estim.quantity import EXTREME, extreme, read_number

FloatArray = NDArray[np.float64]

_OTHER_NAMES = {
    "time (s)": "t_s",
    "t (s)": "t_s",
    "x (m)": "x_m",
    "v (m/s)": "v_m_s",
    "theta (rad)": "theta_rad",
    "omega (rad/s)": "omega_rad_s",
}
_COMMENTS = ("#", "%")
TOML_BYTES = 256 * 1024  # limit for files that people write
_MAX_BYTES = 64 * 1024**2
_MAX_LINE = 100_000  # characters
_MAX_ROWS = 1_000_000
_NOTE = "# warning: "  # what `estim import` found suspicious, kept with the numbers
IMPORTED = "# made by estim import"  # first line of what it writes


@dataclass(frozen=True, eq=False)
class Table:
    """columns : name -> (n_row,) read-only array.  lines : (n_row,) line of the file of each row.

    file : how messages name it.  header_line : line of the column names.  sha256 : of the file's bytes.
    warnings : texts of the comment lines "# warning: ...".  facts : the other comments above the header of a file that
    `estim import` made; empty for other files.
    """

    file: str
    sha256: str
    header_line: int
    columns: Mapping[str, FloatArray]
    lines: NDArray[np.int64]
    warnings: tuple[str, ...] = ()
    facts: tuple[str, ...] = ()

    def error(self, rule: str, field: str, row: int) -> InputError:
        """An InputError for the cell of column `field` in `row`."""
        return InputError(rule, field=field, value=self.columns[field][row].item(), file=self.file, line=int(self.lines[row]))


def read_bytes(path: Path, *, shown_as: str, limit: int = _MAX_BYTES) -> bytes:
    """Content of a regular file of at most `limit` bytes; raises InputError where it cannot be read.

    Every input file is read here: a pipe would wait for its writer, a device never ends.
    """
    try:
        status = path.stat()
        if not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)):
            raise InputError("must be a regular file, not a pipe, a socket or a device", file=shown_as)
        if status.st_size > limit:
            shown = f"{limit // 1024**2} MiB" if limit >= 1024**2 else f"{limit // 1024} KiB"
            raise InputError(f"must be at most {shown}", field="size", value=status.st_size, file=shown_as)
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({(error.strerror or str(error)).lower()})", file=shown_as) from None
    except InputError:
        raise
    except ValueError as error:  # a null character in the name
        raise InputError(f"cannot be read ({error})", file=shown_as) from None


def read_text(path: Path, *, shown_as: str, limit: int = _MAX_BYTES) -> tuple[str, str]:
    """Text of a UTF-8 file and the SHA-256 of its bytes; raises InputError where it cannot be read as such."""
    data = read_bytes(path, shown_as=shown_as, limit=limit)
    try:
        return data.decode("utf-8-sig"), hashlib.sha256(data).hexdigest()
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError("must be UTF-8 text", field="byte", value=data[error.start : error.start + 1], file=shown_as, line=line) from None


def read_table(path: Path, *, known: Sequence[str], min_rows: int, shown_as: str) -> Table:
    """The table of finite numbers in the CSV file at `path`, with columns out of `known`.

    Raises InputError with file, line, field, rule and value.
    """
    text, digest = read_text(path, shown_as=shown_as)
    rows = numbered_lines(text, file=shown_as)
    header = next(((n, line) for n, line in rows if not line.lstrip().startswith("#") or _names(line, known)), None)
    if header is None:
        raise InputError("has no line of column names", file=shown_as)
    header_line, header_text = header
    names = _names(header_text, known)
    if not names:
        raise InputError(f"must hold column names ({', '.join(known)})", field="header", value=header_text, file=shown_as, line=header_line)
    delimiter = _delimiter(header_text)
    _check_names(names, known, shown_as, header_line)
    numbers, cells = [], []
    for number, line in rows:
        if number > header_line and not line.lstrip().startswith(_COMMENTS):
            numbers.append(number)
            cells.append(_cells(line, names, delimiter, shown_as, number))
    if len(cells) < min_rows:
        raise InputError(f"must hold at least {min_rows} rows of numbers", field="rows", value=len(cells), file=shown_as)
    table = np.array(cells)
    columns = {column: table[:, i] for i, column in enumerate(names) if not column.startswith("_")}
    lines = np.array(numbers)
    for array in (*columns.values(), lines):
        array.setflags(write=False)
    warnings = tuple(line[len(_NOTE) :].strip() for _, line in rows if line.startswith(_NOTE))
    return Table(shown_as, digest, header_line, MappingProxyType(columns), lines, warnings, _facts(rows, header_line))


def _facts(rows: Sequence[tuple[int, str]], header_line: int) -> tuple[str, ...]:
    """What the head of a file that `estim import` made says of where it comes from."""
    head = [line for number, line in rows if number < header_line]
    if not head or head[0].strip() != IMPORTED:
        return ()
    return tuple(line.lstrip("# ").strip() for line in head[1:] if not line.startswith(_NOTE))


def numbered_lines(text: str, *, file: str) -> list[tuple[int, str]]:
    """The lines that are not blank, each with its number.  Raises InputError where there are too many, or one is too long."""
    rows = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if len(rows) > _MAX_ROWS:
        raise InputError(f"must be at most {_MAX_ROWS}", field="number of lines", value=len(rows), file=file)
    for number, line in rows:
        if len(line) > _MAX_LINE:
            raise InputError(f"must have at most {_MAX_LINE} characters", field="row", value=len(line), file=file, line=number)
    return rows


def _delimiter(header: str) -> str:
    return next((mark for mark in ("\t", ";", ",") if mark in header), ",")


def _names(line: str, known: Sequence[str]) -> list[str]:
    """Column names on a line, in our spelling; empty where the line is no header."""
    cells = [cell.strip() for cell in line.lstrip("%# ").split(_delimiter(line))]
    names = [_OTHER_NAMES.get(cell.lower(), cell) for cell in cells]
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


def split_cells(line: str, delimiter: str) -> list[str]:
    """The cells of a line, blanks around them taken off.  Raises csv.Error where quotes do not enclose whole cells."""
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, strict=True))]


def _check_names(names: list[str], known: Sequence[str], file: str, line: int) -> None:
    for name in names:
        if name not in known and not name.startswith("_"):
            rule = f"is not a column name (known: {', '.join(known)}; start a name with _ to skip it)"
            raise InputError(rule, field=name, file=file, line=line)
        if names.count(name) > 1:
            raise InputError("stands twice in the header", field=name, file=file, line=line)


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
