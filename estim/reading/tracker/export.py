"""Text exports of the program Tracker: tables of t, x, y, ... with or without a line of track
names, in every dialect.

Tabs, semicolons, commas, bars or blanks separate the cells; decimals have a point or a comma, never
both.  Columns may come in any order; v and a are magnitudes and are not used as speeds.  An export
does not state its unit of length unless the column's name does (`x (cm)`).  Where the columns are
is found here; their cells are read as those of any table (`estim.reading.named_columns`).
"""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from estim.arrays import BoolArray, FloatArray
from estim.common import InputError, in_its_file, listed, phrase
from estim.reading.cells import Row, is_comment, looks_like_a_number
from estim.reading.dialect import Decimal, Dialect, name_and_unit, shown_delimiter
from estim.reading.input_file import decoded, lines_of, read_bytes
from estim.reading.named_columns import table_of
from estim.reading.table import (
    DECIMAL_COMMAS,
    Layout,
    Lines,
    may_be_decimal_commas,
    numbered_lines,
    row_of,
    split_cells,
)
from estim.reading.tracker.track import METRES, Track

_COLUMNS = ("t", "x", "y", "v", "frame")
_SECONDS: Mapping[str, float] = {"s": 1.0, "ms": 1e-3}
_LIMIT = 1e6  # s and m


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
    delimiter = shown_delimiter(line)
    names = [name_and_unit(cell)[0] for cell in split_cells(line, delimiter)]
    starts = _track_names(lines[:at], delimiter, names)
    if not starts:
        return None
    nameless = starts == [("unnamed", 0)]
    return number, line, nameless and not {"x", "y"} <= set(names)


@in_its_file
def read_export(
    path: Path, *, track: str | None = None, unit: str | None = None, drop_duplicates: bool = False
) -> Track:
    """The track in the text export at `path`; `track` chooses where there are several.

    unit : of x and y; metres if neither it nor the column's name states otherwise.
    drop_duplicates : leave out rows of which every number read is that of the row before.  Raises
        InputError with file, line, field, rule and value.
    """
    data = read_bytes(path)
    (text, note), digest = decoded(data), hashlib.sha256(data).hexdigest()
    lines = [(n, line) for n, line in numbered_lines(text) if not is_comment(line)]
    name, layout = _laid_out(str(path), digest, lines, track)
    units = dict(zip(layout.names, layout.units, strict=True))
    factor, unit_fact = _length_unit(units, unit, layout.header_line)
    read_names = [key for key in ("t", "x", "y") if key in units]
    table = table_of(
        layout, read_names, 0, optional=[key for key in ("frame", "v") if key in layout.names]
    )
    scales = {"t": _SECONDS[units["t"] or "s"], "frame": 1.0}
    table = table.with_columns(
        {key: scales.get(key, factor) * c for key, c in table.columns.items()}
    )
    for key in read_names:
        rule = f"must lie within ±{_LIMIT:g} {'s' if key == 't' else 'm'}"
        table.require(key, np.abs(table.columns[key]) <= _LIMIT, rule)
    mask = np.full(table.lines.size, True)
    if drop_duplicates:
        mask[1:] = ~_copies(table.columns.values())
    columns = {key: column[mask] for key, column in table.columns.items()}
    frames = columns.get("frame")
    whole_numbers = frames is not None and bool(
        np.all((np.abs(frames) < 1e9) & (frames == np.rint(frames)))
    )
    copies = int(np.sum(~mask))
    dropped = (
        phrase("1 row that copies the previous one was dropped")
        if copies == 1
        else phrase("{n} rows that copy the previous one were dropped", n=copies)
    )
    return Track(
        file=str(path),
        sha256=digest,
        name=name,
        t=columns["t"],
        x=columns.get("x"),
        y=columns.get("y"),
        frames=frames.astype(np.int64) if frames is not None and whole_numbers else None,
        lines=table.lines[mask],
        speed=columns.get("v"),
        calibration=(*([note] if note else []), unit_fact, *table.facts),
        warnings=(dropped,) if copies else (),
    )


def _copies(columns: Iterable[FloatArray]) -> BoolArray:
    """Whether each row but the first has the numbers of the row before; a blank copies a blank."""
    return np.logical_and.reduce(
        [
            (column[1:] == column[:-1]) | (np.isnan(column[1:]) & np.isnan(column[:-1]))
            for column in columns
        ]
    )


# the header


def _header_at(lines: Lines) -> int | None:
    """Index of the line of names among the first lines."""
    return next((i for i, (_, line) in enumerate(lines[:10]) if _is_header(line)), None)


def _is_header(line: str) -> bool:
    if len(line) > 5000:
        return False
    try:
        names = {name_and_unit(cell)[0] for cell in split_cells(line, shown_delimiter(line))}
    except csv.Error:
        return False
    return "t" in names and bool({"x", "y"} & names)


def _laid_out(file: str, digest: str, lines: Lines, track_name: str | None) -> tuple[str, Layout]:
    """The name of the chosen track, and where its columns are: all others have no name.  Raises
    InputError.
    """
    at = _header_at(lines)
    if at is None:
        raise _no_header(lines)
    number, text = lines[at]
    delimiter = shown_delimiter(text)
    cells = split_cells(text, delimiter)
    while cells and not cells[-1]:
        cells.pop()
    columns = [name_and_unit(cell) for cell in cells]
    starts = _track_names(lines[:at], delimiter, [name for name, _ in columns])
    if not starts:
        raise _no_header(lines)
    track, low, high = _chosen(starts, len(cells), track_name, number)
    indices: dict[str, int] = {}
    for i, (name, _) in enumerate(columns):
        if name in _COLUMNS and (low <= i < high or (name in ("t", "frame") and i < starts[0][1])):
            if name in indices and indices[name] >= low:
                raise InputError("occurs twice in the header", field=name, line=number)
            indices[name] = i
    if "t" not in indices:
        indices["t"] = next(i for i, (name, _) in enumerate(columns) if name == "t")
    if not {"x", "y"} & set(indices):
        raise InputError("must have a column x or y", field=f"track {track}", line=number)
    for name, known in (("t", _SECONDS), ("x", METRES), ("y", METRES)):
        unit = columns[indices[name]][1] if name in indices else ""
        if unit and unit not in known:
            raise InputError(
                f"must be in one of {', '.join(known)}", field=name, value=unit, line=number
            )
    rows = [Row(n, line, row_of(line, delimiter, n)) for n, line in lines[at + 1 :]]
    rows = [row._replace(cells=row.cells + [""] * (len(cells) - len(row.cells))) for row in rows]
    if (
        delimiter == ","
        and len(cells) > len(indices)
        and rows
        and may_be_decimal_commas(row.line for row in rows)
    ):
        raise InputError(DECIMAL_COMMAS, field="row", value=rows[0].line, line=rows[0].number)
    used = set(indices.values())
    return track, Layout(
        file,
        digest,
        Dialect(decimal=_decimal_mark(rows, list(indices.values()))),
        delimiter,
        tuple(name if i in used else "" for i, (name, _) in enumerate(columns)),
        number,
        tuple(unit for _, unit in columns),
        rows,
        (),
    )


def _decimal_mark(rows: Sequence[Row], indices: Sequence[int]) -> Decimal:
    """The decimal mark of the first number that has one in the columns at `indices`; a comma parts
    no thousands.
    """
    cells = (row.cells[index] for row in rows for index in indices)
    first = next((c for c in cells if ("." in c or "," in c) and looks_like_a_number(c)), "")
    return "comma" if "," in first else "point"


def _track_names(lines: Lines, delimiter: str, columns: Sequence[str]) -> list[tuple[str, int]]:
    """Names of the tracks and the column where each begins, from the line above the header, which
    names `columns`; one without a name if there is none.  Empty where t has a name of its own.
    """
    if not lines:
        return [("unnamed", 0)]
    cells = lines[-1][1].split(delimiter) if delimiter != " " else [lines[-1][1]]
    names = [
        (" ".join(cell.split())[:100], i)
        for i, cell in enumerate(cells[: len(columns)])
        if cell.strip()
    ]
    if not names:
        return [("unnamed", 0)]
    starts = [*(i for _, i in names), len(columns)]
    if len(names) > 1 and any(columns[i:j] == ["t"] for i, j in pairwise(starts)):
        return []
    return [(names[0][0], 0)] if len(names) == 1 else names


def _chosen(
    starts: list[tuple[str, int]], width: int, track_name: str | None, line: int
) -> tuple[str, int, int]:
    """Name and range of columns of the chosen track."""
    names = [name for name, _ in starts]
    if track_name is None and len(starts) > 1:
        raise InputError(
            "must be named, as there are several", field="track", quoted=listed(names), line=line
        )
    if track_name is not None and names.count(track_name) != 1 and names != ["unnamed"]:
        raise InputError(
            "must name one of the tracks",
            field="track",
            value=track_name,
            quoted=listed(names),
            line=line,
        )
    i = names.index(track_name) if track_name in names else 0
    return track_name or names[i], starts[i][1], starts[i + 1][1] if i + 1 < len(starts) else width


def _no_header(lines: Lines) -> InputError:
    """The error for a file without a line of names."""
    rule = (
        "must have a line of column names with t and x or y, as Tracker exports it (where a "
        "spreadsheet has changed it: export it again); any table may be fit (estim fit FILE "
        "--columns t,x,y), or named in a campaign as it is"
    )
    number, line = lines[0] if lines else (None, "nothing")
    return InputError(rule, field="header", value=line, line=number)


def _length_unit(
    units: Mapping[str, str], stated: str | None, line: int | None
) -> tuple[float, str]:
    """Metres in the unit of x and y, and where that is stated."""
    named = {units[name] for name in ("x", "y") if units.get(name)}
    if len(named) > 1 or (stated is not None and named and named != {stated}):
        other = f"; --unit says {stated}" if stated else ""
        raise InputError(
            f"must all have one unit{other}",
            field="x, y",
            value=", ".join(sorted(named)),
            line=line,
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
