"""Text exports of the program Tracker: tables of t, x, y, ... with or without a line of track
names, in every dialect.

Tabs, semicolons, commas, bars or blanks separate the cells; decimals have a point or a comma, never
both.  Columns may come in any order; v and a are magnitudes and are not used as speeds.  An export
does not say its unit of length unless the column's name does (`x (cm)`).  A file that another
program has changed is refused with the first sign of it.
"""

from __future__ import annotations

import csv
import datetime as dt
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estim.common import InputError, in_its_file, listed, phrase, read_number
from estim.reading.cells import is_comment
from estim.reading.input_file import lines_of, read_text
from estim.reading.table import (
    DECIMAL_COMMAS,
    may_be_decimal_commas,
    numbered_lines,
    row_of,
    split_cells,
)
from estim.reading.tracker.track import METRES, Track

Lines = list[tuple[int, str]]

_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d{1,4})?", re.ASCII)
_NAME = re.compile(r"(.{1,30}?)\s*[(\[]\s*(\w{1,5})\s*[)\]]")
_DATE = re.compile(
    r"\d{1,4}[./-](\d{1,2}|[^\W\d_]{3,9})\.?([./-]\d{1,4})?|[^\W\d_]{3,9}[./-]\d{2,4}|\d{1,2}\.\s?[^\W\d_]{3,9}\.?"
)
_DAYS = (36526.0, 54789.0)  # day numbers of a spreadsheet, years 2000 to 2049
_COLUMNS = ("t", "x", "y", "v", "frame")
_SECONDS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3}
_SEARCHED = 10  # lines in which the names of the columns stand
_LIMIT = 1e6  # m and s
_SPREADSHEET = (
    "a spreadsheet has changed this file: export the table from Tracker again and do "
    "not save it in a spreadsheet"
)


@dataclass(frozen=True)
class _Layout:
    """line : number of the line of names.  width : columns.  places : column of t, x, y, v, frame.
    units : of t, x, y, as named.
    """

    line: int
    delimiter: str
    width: int
    places: Mapping[str, int]
    units: Mapping[str, str]
    track: str


def head_of_export(text: str) -> tuple[int, str, bool] | None:
    """Number and text of the line of names with which an export begins, `t` and `x` or `y` among
    them; and whether it has one coordinate and no name of a track above it, as any table may begin.

    None for a text that begins otherwise.
    """
    lines = [
        (n, line)
        for n, line in enumerate(lines_of(text[:20_000]), start=1)
        if line.strip() and not line.lstrip().startswith(("#", "%"))
    ]
    at = _header_at(lines)
    if at is None:
        return None
    number, line = lines[at]
    delimiter = _delimiter(line)
    names = [_named(cell)[0] for cell in split_cells(line, delimiter)]
    nameless = _track_names(lines[:at], delimiter, len(names)) == [("unnamed", 0)]
    return number, line, nameless and not {"x", "y"} <= set(names)


@in_its_file
def read_export(
    path: Path, *, track: str | None = None, unit: str | None = None, drop_duplicates: bool = False
) -> Track:
    """The track in the text export at `path`; `track` chooses where there are several.

    unit : of x and y; metres if neither it nor the column's name says otherwise.
    drop_duplicates : leave out rows that are exact copies of the row before.  Raises InputError
        with file, line, field, rule and value.
    """
    text, digest = read_text(path)
    lines = [(n, line) for n, line in numbered_lines(text) if not is_comment(line)]
    layout = _layout(lines, track)
    factor, unit_fact = _length_unit(layout, unit)
    data = [(n, line) for n, line in lines if n > layout.line]
    numbers, rows, blank = _rows(data, layout, drop_duplicates)
    copies = len(data) - blank - len(rows)
    if (
        layout.delimiter == ","
        and layout.width > len(layout.places)
        and rows
        and may_be_decimal_commas(line for _, line in data)
    ):
        raise InputError(DECIMAL_COMMAS, field="row", value=data[0][1], line=data[0][0])
    table = np.array(rows, dtype=np.float64).reshape(-1, len(layout.places))
    scales = {"t": _SECONDS[layout.units.get("t", "s")], "frame": 1.0}
    columns = {
        name: column * scales.get(name, factor)
        for name, column in zip(layout.places, table.T, strict=True)
    }
    at = np.array(numbers, dtype=np.int64)
    for name in [name for name in ("t", "x", "y") if name in columns]:
        beyond = ~(np.abs(columns[name]) <= _LIMIT)
        if np.any(beyond):
            row = int(np.argmax(beyond))
            raise InputError(
                f"must lie within ±{_LIMIT:g} {'s' if name == 't' else 'm'}",
                field=name,
                value=float(columns[name][row]),
                line=int(at[row]),
            )
    frames = columns.get("frame")
    whole = (
        frames is not None
        and bool(np.all(np.abs(frames) < 1e9))
        and bool(np.all(frames == np.rint(frames)))
    )
    dropped = (
        phrase("1 row that copies the previous one was dropped")
        if copies == 1
        else phrase("{n} rows that copy the previous one were dropped", n=copies)
    )
    return Track(
        file=str(path),
        sha256=digest,
        name=layout.track,
        t=columns["t"],
        x=columns.get("x"),
        y=columns.get("y"),
        frames=frames.astype(np.int64) if frames is not None and whole else None,
        lines=at,
        speed=columns.get("v"),
        calibration=(
            unit_fact,
            *([phrase("{n} rows without a position were excluded", n=blank)] if blank else []),
        ),
        warnings=(dropped,) if copies else (),
    )


def _rows(
    lines: Lines, layout: _Layout, drop_duplicates: bool
) -> tuple[list[int], list[list[float]], int]:
    """Line numbers and numbers of the rows that hold a position, and how many do not."""
    numbers: list[int] = []
    rows: list[list[float]] = []
    mark, blank = "", 0
    for number, line in lines:
        cells = _cells(line, layout, number)
        mark = _decimal_mark(cells, mark, number)
        values = {name: _value(cells[place], name, number) for name, place in layout.places.items()}
        row = list(values.values())
        if any(math.isnan(values.get(name, 0.0)) for name in ("x", "y")):
            blank += 1
        elif math.isnan(values["t"]):
            raise InputError("must be a number", field="t", value="blank", line=number)
        elif not (drop_duplicates and rows and repr(row) == repr(rows[-1])):  # a blank copies one
            numbers.append(number)
            rows.append(row)
    return numbers, rows, blank


# the header


def _delimiter(line: str) -> str:
    return next((mark for mark in ("\t", ";", ",", "|") if mark in line), " ")


def _named(cell: str) -> tuple[str, str]:
    """Name and unit of a column: ("x", "cm") for `x (cm)`, ("x", "") for `x`."""
    match = _NAME.fullmatch(cell.strip())
    return (match[1].strip(), match[2]) if match else (cell.strip(), "")


def _header_at(lines: Lines) -> int | None:
    """Index of the line of names among the first lines."""
    return next((i for i, (_, line) in enumerate(lines[:_SEARCHED]) if _is_header(line)), None)


def _is_header(line: str) -> bool:
    if len(line) > 5000:
        return False
    try:
        names = {_named(cell)[0] for cell in split_cells(line, _delimiter(line))}
    except csv.Error:
        return False
    return "t" in names and bool({"x", "y"} & names)


def _layout(lines: Lines, wanted: str | None) -> _Layout:
    """Where the columns of the wanted track are.  Raises InputError."""
    at = _header_at(lines)
    if at is None:
        raise _no_header(lines)
    number, text = lines[at]
    delimiter = _delimiter(text)
    cells = split_cells(text, delimiter)
    while cells and not cells[-1]:
        cells.pop()
    columns = [_named(cell) for cell in cells]
    starts = _track_names(lines[:at], delimiter, len(cells))
    track, low, high = _chosen(starts, len(cells), wanted, number)
    places: dict[str, int] = {}
    for i, (name, _) in enumerate(columns):
        if name in _COLUMNS and (low <= i < high or (name in ("t", "frame") and i < starts[0][1])):
            if name in places and places[name] >= low:
                raise InputError("occurs twice in the header", field=name, line=number)
            places[name] = i
    if "t" not in places:
        places["t"] = next(i for i, (name, _) in enumerate(columns) if name == "t")
    if not {"x", "y"} & set(places):
        raise InputError("must have a column x or y", field=f"track {track}", line=number)
    units = {name: columns[i][1] for name, i in places.items() if columns[i][1]}
    for name, known in (("t", _SECONDS), ("x", METRES), ("y", METRES)):
        if name in units and units[name] not in known:
            raise InputError(
                f"must be in one of {', '.join(known)}", field=name, value=units[name], line=number
            )
    return _Layout(number, delimiter, len(cells), places, units, track)


def _track_names(lines: Lines, delimiter: str, width: int) -> list[tuple[str, int]]:
    """Names of the tracks and the column where each begins, from the line above the header; one
    without a name if there is none.
    """
    if not lines:
        return [("unnamed", 0)]
    cells = lines[-1][1].split(delimiter) if delimiter != " " else [lines[-1][1]]
    names = [
        (" ".join(cell.split())[:100], i) for i, cell in enumerate(cells[:width]) if cell.strip()
    ]
    if not names:
        return [("unnamed", 0)]
    return [(names[0][0], 0)] if len(names) == 1 else names


def _chosen(
    starts: list[tuple[str, int]], width: int, wanted: str | None, line: int
) -> tuple[str, int, int]:
    """Name and range of columns of the wanted track."""
    names = [name for name, _ in starts]
    if wanted is None and len(starts) > 1:
        raise InputError(
            "must be named, as there are several", field="track", quoted=listed(names), line=line
        )
    if wanted is not None and names.count(wanted) != 1 and names != ["unnamed"]:
        raise InputError(
            "must name one of the tracks",
            field="track",
            value=wanted,
            quoted=listed(names),
            line=line,
        )
    i = names.index(wanted) if wanted in names else 0
    return wanted or names[i], starts[i][1], starts[i + 1][1] if i + 1 < len(starts) else width


def _no_header(lines: Lines) -> InputError:
    """Why a file without a line of names is refused: destroyed by a spreadsheet, or something
    else.
    """
    rule = "must have a line of column names with t and x or y, as Tracker exports it"
    if not lines:
        return InputError(rule, field="header", value="nothing")
    number, line = lines[0]
    if "t_s" in re.split(r"[\s,;]+", line[:200]):
        return InputError(
            "is a table of estim already: name it in a campaign as it is",
            field="header",
            value=line,
            line=number,
        )
    short = line[:5000]
    cells = [cell.strip() for cell in short.split(_delimiter(short))]
    marks = {mark for cell in cells if _NUMBER.fullmatch(cell) for mark in ".," if mark in cell}
    if marks == {".", ","} or (_DATE.fullmatch(cells[0]) and not _NUMBER.fullmatch(cells[0])):
        day = _as_day(cells[0])
        what = "mixes decimal points and commas" if len(marks) == 2 else "begins with a date"
        return InputError(
            f"{what} and the line of column names is gone; {_SPREADSHEET}",
            field="row",
            quoted=day,
            value=line,
            line=number,
        )
    return InputError(
        f"{rule}, or be fit as any table (estim fit FILE --columns t,x,y)",
        field="header",
        value=line,
        line=number,
    )


def _as_day(cell: str) -> str:
    """A number that a spreadsheet shows as a date, in words."""
    value = float(cell.replace(",", ".")) if _NUMBER.fullmatch(cell) else 0.0
    if value != round(value) or not _DAYS[0] <= value <= _DAYS[1]:
        return ""
    return (
        f"a time became a date, {cell} is "
        f"{(dt.date(1899, 12, 30) + dt.timedelta(value)).isoformat()}"
    )


def _length_unit(layout: _Layout, stated: str | None) -> tuple[float, str]:
    """Metres in the unit of x and y, and where that is said."""
    named = {layout.units[name] for name in ("x", "y") if name in layout.units}
    if len(named) > 1 or (stated is not None and named and named != {stated}):
        given = f"; --unit says {stated}" if stated else ""
        raise InputError(
            f"must all have one unit{given}",
            field="x, y",
            value=", ".join(sorted(named)),
            line=layout.line,
        )
    if stated is not None:
        return METRES[stated], phrase("lengths in {unit} as stated by the user", unit=stated)
    if named:
        (unit,) = named
        return METRES[unit], phrase(
            "lengths in {unit}, according to the name of the column", unit=unit
        )
    return 1.0, phrase(
        "lengths are taken to be in m, because an export does not state its unit (use "
        "--unit cm if it is another one)"
    )


# the cells


def _cells(line: str, layout: _Layout, number: int) -> list[str]:
    """The cells of a row, as many as there are names; blank ones at its end may be missing or too
    many.
    """
    cells = row_of(line, layout.delimiter, number)
    if any(cells[layout.width :]):
        hint = (
            " (are decimals written with commas too? then export with semicolons or tabs)"
            if layout.delimiter == ","
            else ""
        )
        while not cells[-1]:
            cells.pop()
        raise InputError(
            f"must have {layout.width} cells{hint}", field="row", value=len(cells), line=number
        )
    return cells[: layout.width] + [""] * (layout.width - len(cells))


def _decimal_mark(cells: list[str], mark: str, number: int) -> str:
    """The decimal mark in use; raises InputError where a cell has the other one."""
    for cell in cells:
        if _NUMBER.fullmatch(cell):
            here = "," if "," in cell else "." if "." in cell else mark
            if mark and here != mark:
                names = {",": "comma", ".": "point"}
                raise InputError(
                    f"has a decimal {names[here]} where the file has decimal {names[mark]}s; "
                    f"{_SPREADSHEET}",
                    field="row",
                    quoted=_as_day(cells[0]),
                    value=cell,
                    line=number,
                )
            mark = here
    return mark


def _value(cell: str, name: str, line: int) -> float:
    """The number in a cell; NaN where it is blank."""
    if not cell:
        return math.nan
    if not _NUMBER.fullmatch(cell):
        rule = f"is a date; {_SPREADSHEET}" if _DATE.fullmatch(cell) else "must be a number"
        raise InputError(rule, field=name, value=cell, line=line)
    return read_number(cell.replace(",", "."))
