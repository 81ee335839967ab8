"""A run: one table of measurements, read from a CSV file without changing a number.

Columns: `t_s` time, `x_m` position along the ramp since release, `v_m_s` speed, `theta_rad` angle turned since release,
`omega_rad_s` angular rate, `sigma_x_m`, `sigma_v_m_s` standard deviations row by row.  `#` starts a comment line; a
column whose name starts with `_` is left unread.  Commas, semicolons or tabs separate the cells.  A first line like
``%Time (s)<TAB>Theta (rad)<TAB>Omega (rad/s)``, as LabVIEW writes it, is understood too.
"""

from __future__ import annotations

import csv
import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from estim.errors import InputError

FloatArray = NDArray[np.float64]

COLUMNS = ("t_s", "x_m", "v_m_s", "theta_rad", "omega_rad_s", "sigma_x_m", "sigma_v_m_s")
_OTHER_NAMES = {
    "time (s)": "t_s",
    "t (s)": "t_s",
    "x (m)": "x_m",
    "v (m/s)": "v_m_s",
    "theta (rad)": "theta_rad",
    "omega (rad/s)": "omega_rad_s",
}
_COMMENTS = ("#", "%")
_MAX_BYTES = 64 * 1024**2
_MIN_ROWS = 5


@dataclass(frozen=True, eq=False)
class Run:
    """The table of one run.

    columns : standard column name -> (n_row,) read-only array, SI units.
    lines : (n_row,) line of the file that each row stands on.
    sha256 : of the file's bytes.
    """

    name: str
    file: str
    sha256: str
    columns: Mapping[str, FloatArray]
    lines: NDArray[np.int64]

    @property
    def n_row(self) -> int:
        return int(self.lines.size)

    @property
    def coordinate(self) -> str:
        """The column that says where the body is: `x_m` or `theta_rad`."""
        return "x_m" if "x_m" in self.columns else "theta_rad"

    @property
    def rate(self) -> str:
        """The column that says how fast it is there: `v_m_s` or `omega_rad_s`."""
        return "v_m_s" if self.coordinate == "x_m" else "omega_rad_s"


def read_run(path: Path, *, name: str, shown_as: str | None = None) -> Run:
    """The run in the CSV file at `path`; `shown_as` is how messages and reports name the file.

    Raises InputError with file, line, field, rule and value for anything that is not a table of finite numbers with
    known columns, one of `x_m` and `theta_rad` among them, and times that increase.
    """
    shown = shown_as or str(path)
    text, digest = read_text(path, shown_as=shown)
    rows = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    header = next(((n, line) for n, line in rows if not line.lstrip().startswith("#") or _names(line)), None)
    if header is None:
        raise InputError("has no line of column names", file=shown)
    header_line, header_text = header
    names = _names(header_text)
    if not names:
        raise InputError(f"must hold column names ({', '.join(COLUMNS)})", field="header", value=header_text, file=shown, line=header_line)
    delimiter = _delimiter(header_text)
    _check_names(names, shown, header_line)
    numbers, cells = [], []
    for number, line in rows:
        if number > header_line and not line.lstrip().startswith(_COMMENTS):
            numbers.append(number)
            cells.append(_cells(line, names, delimiter, shown, number))
    if len(cells) < _MIN_ROWS:
        raise InputError(f"must hold at least {_MIN_ROWS} rows of numbers", field="rows", value=len(cells), file=shown)
    table = np.array(cells)
    columns = {column: table[:, i] for i, column in enumerate(names) if not column.startswith("_")}
    lines = np.array(numbers)
    _check_columns(columns, lines, shown)
    for array in (*columns.values(), lines):
        array.setflags(write=False)
    return Run(name=name, file=shown, sha256=digest, columns=MappingProxyType(columns), lines=lines)


def read_text(path: Path, *, shown_as: str) -> tuple[str, str]:
    """Text of a UTF-8 file and the SHA-256 of its bytes; raises InputError where it cannot be read as such."""
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"must be at most {_MAX_BYTES // 1024**2} MiB", field="size", value=path.stat().st_size, file=shown_as)
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read ({(error.strerror or str(error)).lower()})", file=shown_as) from None
    except ValueError as error:  # a null character in the name
        raise InputError(f"cannot be read ({error})", file=shown_as) from None
    try:
        return data.decode("utf-8-sig"), hashlib.sha256(data).hexdigest()
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise InputError("must be UTF-8 text", field="byte", value=data[error.start : error.start + 1], file=shown_as, line=line) from None


def _delimiter(header: str) -> str:
    return next((mark for mark in ("\t", ";", ",") if mark in header), ",")


def _names(line: str) -> list[str]:
    """Column names on a line, in our spelling; empty where the line is no header."""
    cells = [cell.strip() for cell in line.lstrip("%# ").split(_delimiter(line))]
    names = [_OTHER_NAMES.get(cell.lower(), cell) for cell in cells]
    commented = line.lstrip().startswith(_COMMENTS)
    known = [name for name in names if name in COLUMNS]
    if commented:
        return names if len(known) == len(names) else []
    return names if all(name and not _is_number(name) for name in names) else []


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _check_names(names: list[str], file: str, line: int) -> None:
    known = ", ".join(COLUMNS)
    for name in names:
        if name not in COLUMNS and not name.startswith("_"):
            raise InputError(f"is not a column name (known: {known}; start a name with _ to skip it)", field=name, file=file, line=line)
        if names.count(name) > 1:
            raise InputError("stands twice in the header", field=name, file=file, line=line)
    if ("x_m" in names) == ("theta_rad" in names):
        raise InputError("must hold exactly one of x_m and theta_rad", field="header", value=", ".join(names), file=file, line=line)
    if not {"t_s", "v_m_s", "omega_rad_s"} & set(names):
        raise InputError("must hold a time (t_s) or a speed (v_m_s, omega_rad_s)", field="header", value=", ".join(names), file=file, line=line)


def _cells(line: str, names: list[str], delimiter: str, file: str, number: int) -> list[float]:
    try:
        texts = [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    except csv.Error as error:
        raise InputError(f"cannot be split into cells ({error})", field="row", value=line, file=file, line=number) from None
    if len(texts) != len(names):
        raise InputError(f"must have {len(names)} cells", field="row", value=len(texts), file=file, line=number)
    values = []
    for name, text in zip(names, texts, strict=True):
        if name.startswith("_"):
            values.append(0.0)
            continue
        try:
            value = float(text)
        except ValueError:
            raise InputError("must be a number", field=name, value=text, file=file, line=number) from None
        if not math.isfinite(value):
            raise InputError("must be finite", field=name, value=text, file=file, line=number)
        values.append(value)
    return values


def _check_columns(columns: Mapping[str, FloatArray], lines: NDArray[np.int64], file: str) -> None:
    if "t_s" in columns:
        backward = np.flatnonzero(np.diff(columns["t_s"]) <= 0.0)
        if backward.size:
            row = int(backward[0]) + 1
            raise InputError("must increase from row to row", field="t_s", value=columns["t_s"][row].item(), file=file, line=int(lines[row]))
    for name in ("sigma_x_m", "sigma_v_m_s"):
        if name in columns and np.any(columns[name] <= 0.0):
            row = int(np.flatnonzero(columns[name] <= 0.0)[0])
            raise InputError("must be > 0", field=name, value=columns[name][row].item(), file=file, line=int(lines[row]))
