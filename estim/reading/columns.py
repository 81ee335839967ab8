"""Columns by name out of tables of other people's making: any delimiter, header, decimal mark and number of further columns.

What the lines show beyond doubt is taken from them; the rest is asked for by one line that says the cure (`dialect`).  Rows without a value in
one of the columns are left out, and the table says so.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from estim.common import EXTREME, InputError, extreme, listed
from estim.reading.dialect import (
    Dialect,
    cells_of,
    decimal_mark,
    is_missing,
    looks_like_a_number,
    name_and_unit,
    number_in,
    place_of,
    shown_delimiter,
    split_row,
)
from estim.reading.input_file import read_any_text
from estim.reading.table import DECIMAL_COMMAS, NOTE, Table, facts_of, may_be_decimal_commas, numbered_lines

Lines = list[tuple[int, str]]

_RULE = re.compile(r"[-=_+|\s]+")  # a line drawn below the header
_SYMBOLS = frozenset(
    "s ms us ns ps min h d m cm mm um nm km kg g mg N mN kN Pa hPa kPa MPa bar mbar J mJ kJ eV keV MeV W mW kW V mV kV uV A mA uA nA pA Ohm ohm kOhm "
    "Hz kHz MHz GHz K C F H uF nF pF mH uH T mT uT G Wb lx cd lm dB Bq kBq Sv mol l L ml mL deg rad mrad sr px frame frames counts count arb a.u. au % "
    "° °C °F Ω kΩ MΩ Å ′ ″ 1".split()
)
_SEPARATORS = re.compile(r"[/*·⋅^ ()\[\]]|[-−]?\d+|[⁻¹²³]+")


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the numbers of a table are.

    names : of the columns, () where the file has none.  header_line : where they stand.  units : column -> its unit, as the header says.
    rows : the lines from the first row of numbers on, comments taken out.  notes : how the file was read, where that is not plain.
    """

    file: str
    sha256: str
    delimiter: str
    names: tuple[str, ...]
    header_line: int | None
    units: tuple[str, ...]
    rows: Lines
    warnings: tuple[str, ...]
    facts: tuple[str, ...]

    @property
    def width(self) -> int:
        """How many columns there are."""
        return len(self.names) or len(split_row(self.rows[0][1], self.delimiter, self.file, self.rows[0][0]))


def read_layout(path: Path, dialect: Dialect, *, shown_as: str, needed: Sequence[str] = ()) -> Layout:
    """How the table at `path` is laid out.  needed : names of columns that tell the header from other lines.  Raises InputError."""
    text, digest, note = read_any_text(path, shown_as=shown_as, encoding=dialect.encoding)
    lines = numbered_lines(text, file=shown_as)
    below = [(number, line) for number, line in lines if number > (dialect.skip_rows or 0)]
    plain = [(number, line) for number, line in below if not line.lstrip().startswith("#")]
    if not plain:
        raise InputError("has no rows of numbers" + (" below the lines that are skipped" if dialect.skip_rows else ""), file=shown_as)
    delimiter = dialect.mark or shown_delimiter(plain[-1][1])
    start = 0 if dialect.header is False else 1 if dialect.header else _start(plain, delimiter, shown_as)
    rows = [(number, line) for number, line in plain[start:]]
    if not rows:
        raise InputError("has no rows of numbers below the line of names", file=shown_as)
    percent = any(line.lstrip().startswith("%") for _, line in plain[:start])
    rows = [(number, line) for number, line in rows if not (percent and line.lstrip().startswith("%"))]
    width, least = _widths(rows, delimiter)
    names, header_line, units = _header(plain[:start], below, rows[0][0], delimiter, (least, width), dialect, needed, shown_as)
    facts = (*facts_of(lines, header_line or rows[0][0]), *([note] if note else []))
    warnings = tuple(line[len(NOTE) :].strip() for _, line in lines if line.startswith(NOTE))
    return Layout(shown_as, digest, delimiter, names, header_line, units, rows, warnings, facts)


def read_columns(
    path: Path, *, needed: Sequence[str], min_rows: int, shown_as: str, dialect: Dialect | None = None, optional: Sequence[str] = ()
) -> Table:
    """The columns `needed` of the table at `path`, and those of `optional` that it has; all others are left unread.

    Raises InputError with file, line, field, rule and value; where the file may be read in two ways, the rule names the key that settles it.
    """
    dialect = dialect or Dialect()
    layout = read_layout(path, dialect, shown_as=shown_as, needed=needed)
    if not layout.names:
        raise no_names(layout)
    needed = [*needed, *(name for name in optional if name in layout.names and name not in needed)]
    places = [place_of(name, layout.names, shown_as, layout.header_line) for name in needed]
    if layout.delimiter == "," and dialect.delimiter is None and dialect.decimal is None and len(layout.names) > len(set(places)):
        if may_be_decimal_commas(line for _, line in layout.rows):
            number, line = layout.rows[0]
            raise InputError(f'{DECIMAL_COMMAS}, or say --decimal point (decimal = "point" in a campaign)', field="row", value=line, file=shown_as, line=number)
    rows = [(number, _row(line, layout, shown_as, number)) for number, line in layout.rows]
    mark = decimal_mark(rows, places, dialect.decimal, shown_as)
    numbers, values, left_out = [], [], dict[str, list[int]]()
    for number, cells in rows:
        blank = next((name for name, place in zip(needed, places, strict=True) if is_missing(cells[place])), None)
        if blank is not None:
            left_out.setdefault(blank, []).append(number)
            continue
        numbers.append(number)
        values.append([_value(cells[place], name, mark, shown_as, number) for name, place in zip(needed, places, strict=True)])
    facts = [*layout.facts, *(_left_out(name, lines) for name, lines in left_out.items())]
    if len(values) < min_rows:
        raise InputError(f"must hold at least {min_rows} rows of numbers", field="rows", value=len(values), file=shown_as)
    table = np.array(values)
    columns = {name: table[:, i].copy() for i, name in enumerate(needed)}
    at = np.array(numbers)
    for array in (*columns.values(), at):
        array.setflags(write=False)
    return Table(shown_as, layout.sha256, layout.header_line or 0, MappingProxyType(columns), at, layout.warnings, tuple(facts))


def no_names(layout: Layout) -> InputError:
    """What to say of a table whose columns have no names."""
    rule = f"has no line of column names: name its {layout.width} columns from left to right (--columns a,b,...; columns = [...] in a campaign)"
    number, line = layout.rows[0]
    return InputError(rule, field="header", value=line.strip(), file=layout.file, line=number)


def _start(lines: Lines, delimiter: str, file: str) -> int:
    """Index of the first row of numbers: like the last row it has as many cells, with numbers (or nothing) in the same columns.

    Raises InputError where rows above it look like data.
    """
    shape = _shape(lines[-1][1], delimiter)
    wanted = [place for place, cell in enumerate(_cells(lines[-1][1], delimiter)) if looks_like_a_number(cell)]
    for i, (_, line) in enumerate(lines):
        cells = _cells(line, delimiter)
        alike = shape & _shape(line, delimiter) and all(place >= len(cells) or _may_be_value(cells[place]) for place in wanted)
        if alike and any(map(looks_like_a_number, cells)):
            break
    else:
        number, line = lines[-1]
        raise InputError("must hold numbers: the last line holds none", field="row", value=line, file=file, line=number)
    for number, line in lines[:i]:
        cells = [cell for cell in _cells(line, delimiter) if cell]
        if len(cells) > 1 and all(map(looks_like_a_number, cells)):
            rule = "is a row of numbers with another number of cells than the last row: say how many lines stand above the table (--skip-rows, skip_rows)"
            raise InputError(rule, field="row", value=line, file=file, line=number)
    return i


def _may_be_value(cell: str) -> bool:
    return looks_like_a_number(cell) or is_missing(cell)


def _shape(line: str, delimiter: str) -> set[int]:
    """Number of cells of a line, with and without blank ones at its end."""
    cells = _cells(line, delimiter)
    return {len(cells), len(_trimmed(cells))}


def _cells(line: str, delimiter: str) -> list[str]:
    """Cells of a line that need not be a row; one cell where it cannot be split."""
    try:
        return cells_of(line, delimiter)
    except csv.Error:
        return [line]


def _trimmed(cells: list[str]) -> list[str]:
    while cells and not cells[-1]:
        cells = cells[:-1]
    return cells


def _widths(rows: Lines, delimiter: str) -> tuple[int, int]:
    """Most cells that a row has, with and without blank ones at its end."""
    split = [_cells(line, delimiter) for _, line in rows]
    return max(map(len, split)), max(len(_trimmed(cells)) for cells in split)


def _header(
    above: Lines, below: Lines, first: int, delimiter: str, widths: tuple[int, int], dialect: Dialect, needed: Sequence[str], file: str
) -> tuple[tuple[str, ...], int | None, tuple[str, ...]]:
    """Names of the columns, their line and their units.  above : lines over the numbers; below : all lines with comments; first : line of numbers."""
    nearest = next((line for line in reversed(above) if not _RULE.fullmatch(line[1])), None) if not dialect.header else None
    if nearest is not None and widths[0] <= len(cells := _trimmed(_cells(nearest[1], delimiter))) <= widths[1] and any(map(_begins_with_a_digit, cells)):
        if not (nearest[1].lstrip().startswith("%") or all(cell in _SYMBOLS for cell in cells)):
            rule = "must be a row of numbers, like those below it, or of names (if it is neither, --skip-rows and skip_rows say how many lines to skip)"
            raise InputError(rule, field="row", value=nearest[1], file=file, line=nearest[0])
    if dialect.columns is not None:
        if not widths[0] <= len(dialect.columns) <= widths[1]:
            rule = f"must name all {widths[0]} columns from left to right"
            raise InputError(rule, field="columns", value=", ".join(dialect.columns), file=file, line=first)
        return dialect.columns, None, ("",) * len(dialect.columns)
    if dialect.header:
        (number, line), cells = above[0], _trimmed(_cells(above[0][1].strip().lstrip("%# "), delimiter))
        if not widths[0] <= len(cells) <= widths[1]:
            raise _cells_differ(widths[0], len(cells), delimiter, file, first)
        return tuple(cells), number, tuple(name_and_unit(cell)[1] for cell in cells)
    units: list[str] = []
    for i, (number, line) in reversed(list(enumerate(above))):
        percent = line.lstrip().startswith("%")
        cells = _trimmed(_cells(line.strip().lstrip("% ") if percent else line, delimiter))
        fits = widths[0] <= len(cells) <= widths[1] and not any(map(looks_like_a_number, cells))
        if _RULE.fullmatch(line) or (percent and not fits):
            continue
        over = _trimmed(_cells(above[i - 1][1], delimiter)) if i else []
        if fits and not units and widths[0] <= len(over) <= widths[1] and (_are_units(cells) or _all_in(needed, over) and not _all_in(needed, cells)):
            units = cells
            continue
        if not fits and any(name in cells for name in needed):
            raise _cells_differ(widths[0], len(cells), delimiter, file, first)
        return _named(cells, units, number) if fits else ((), None, ())
    comments = [(number, line.lstrip("# \t").rstrip()) for number, line in below if number < first and line.lstrip().startswith("#")]
    for number, line in comments[-1:]:
        cells = _cells(line, delimiter)
        if widths[0] <= len(cells) <= widths[1] and not any(map(looks_like_a_number, cells)):
            return _named(cells, [], number)
    return (), None, ()


def _begins_with_a_digit(cell: str) -> bool:
    return re.match(r"[+-]?[.,]?\d", cell) is not None


def _named(cells: list[str], units: list[str], line: int) -> tuple[tuple[str, ...], int, tuple[str, ...]]:
    """Names, their line, and units: those in the names, or of a line of their own."""
    told = units + [""] * len(cells)
    return tuple(cells), line, tuple(name_and_unit(cell)[1] or unit.strip("()[] ") for cell, unit in zip(cells, told, strict=False))


def _all_in(needed: Sequence[str], cells: Sequence[str]) -> bool:
    return bool(needed) and all(name in cells or name in [name_and_unit(cell)[0] for cell in cells] for name in needed)


def _are_units(cells: Sequence[str]) -> bool:
    """Whether a line below the names says units alone."""
    words = [part for cell in cells for part in _SEPARATORS.split(cell.replace("µ", "u").replace("μ", "u")) if part]
    return all(word in _SYMBOLS for word in words) and any(cells)


def _row(line: str, layout: Layout, file: str, number: int) -> list[str]:
    cells = split_row(line, layout.delimiter, file, number)
    width = len(layout.names)
    if len(cells) > width and not any(cells[width:]):
        cells = cells[:width]
    if len(cells) != width:
        raise _cells_differ(len(cells), width, layout.delimiter, file, number)
    return cells


def _cells_differ(cells: int, width: int, delimiter: str, file: str, line: int) -> InputError:
    commas = delimiter == "," and cells == 2 * width
    hint = " (decimal commas? write decimal points, or separate the cells by semicolons)" if commas else ""
    return InputError(f"must have {width} cells{hint}", field="row", value=cells, file=file, line=line)


def _value(cell: str, name: str, mark: str, file: str, line: int) -> float:
    value = number_in(cell, name, mark, file, line)
    if not np.isfinite(value):
        raise InputError("must be finite", field=name, value=cell, file=file, line=line)
    if extreme(value):
        raise InputError(EXTREME, field=name, value=cell, file=file, line=line)
    return value


def _left_out(name: str, lines: Sequence[int]) -> str:
    shown = f"line {lines[0]}" if len(lines) == 1 else f"lines {lines[0]} to {lines[-1]}" if len(lines) > 3 else "lines " + ", ".join(map(str, lines))
    return f"{len(lines)} {'row' if len(lines) == 1 else 'rows'} without a value of '{name}' left out ({shown})"
