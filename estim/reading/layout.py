"""Where the numbers of a table are: the line of names, a line of units, the first row, what stands
above them.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from estim.common import InputError, is_unit
from estim.reading.cells import is_comment, is_missing, is_spreadsheet_error, looks_like_a_number
from estim.reading.dialect import (
    Dialect,
    cells_of,
    is_uncertainty,
    name_and_unit,
    shown_delimiter,
    split_row,
)
from estim.reading.input_file import read_any_text
from estim.reading.table import NOTE, facts_of, numbered_lines

Lines = list[tuple[int, str]]

_ONE_COLUMN = ";"  # stands in no row then
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+", re.ASCII)
_RULE = re.compile(r"[-=_+|\s]+")  # a line drawn below the header
_UNITS = (
    "s ms us ns ps min h d m cm mm um nm km kg g mg N mN kN Pa hPa kPa MPa bar mbar J mJ "
    "kJ eV keV MeV W mW kW V mV kV uV A mA uA nA pA Ohm ohm kOhm "
    "Hz kHz MHz GHz K C F H uF nF pF mH uH T mT uT G Wb lx cd lm dB Bq kBq Sv mol l L ml "
    "mL deg rad mrad sr px frame frames counts count arb a.u. au "
    "% ° °C °F Ω kΩ MΩ Å ′ ″ 1"
)
_SYMBOLS = frozenset(_UNITS.split()) - {"1"}
_NO_UNIT = frozenset({"1", "-", "--", "–", "—", "dimensionless", "unitless", "none", "n/a"})
_NUMBER_FIRST = re.compile(r"(?!1\s*/|10\s*[\^⁻⁰¹²³⁴⁵⁶⁷⁸⁹])[+-]?[.,]?\d")  # but 1/s, 10^-3 N
_SEPARATORS = re.compile(r"[/*·⋅^ ()\[\]]|[-−]?\d+|[⁻¹²³]+")


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the numbers of a table are.

    names : of the columns, () where the file has none.
    header_line : where they stand.  units : column -> its unit, as the header says.
    rows : the lines from the first row of numbers on, comments taken out.
    facts : what the head of an imported file says, and how the file was read, where that is not
        plain.
    imported : whether `estim import` made it.
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
    imported: bool

    @property
    def width(self) -> int:
        """How many columns there are."""
        return len(self.names) or len(
            split_row(self.rows[0][1], self.delimiter, self.file, self.rows[0][0])
        )


# 10 periods (s)
_NAMED_BY_A_NUMBER = re.compile(
    r"\d[^()\[\]]{0,20}[^\W\d_]{3}[^()\[\]]{0,20}[(\[][^()\[\]]{0,9}[^\W\d_][^()\[\]]{0,9}[)\]]"
)


def read_layout(
    path: Path, dialect: Dialect, *, shown_as: str, needed: Sequence[str] = ()
) -> Layout:
    """How the table at `path` is laid out.  needed : names of columns that tell the header from
    other lines.  Raises InputError.
    """
    text, digest, note = read_any_text(path, shown_as=shown_as, encoding=dialect.encoding)
    lines = numbered_lines(text, file=shown_as)
    below = [(number, line) for number, line in lines if number > (dialect.skip_rows or 0)]
    plain = [(number, line) for number, line in below if not is_comment(line)]
    if not plain:
        raise InputError(
            "has no rows of numbers"
            + (" below the lines that are skipped" if dialect.skip_rows else ""),
            file=shown_as,
        )
    delimiter = dialect.mark or (
        _ONE_COLUMN
        if _is_one_column(plain, dialect)
        else shown_delimiter(*(line for _, line in plain[-2:]))
    )
    start = (
        0
        if dialect.header is False
        else 1
        if dialect.header
        else _start(plain, delimiter, shown_as)
    )
    rows = [(number, line) for number, line in plain[start:]]
    if not rows:
        raise InputError("has no rows of numbers below the line of names", file=shown_as)
    percent = any(line.lstrip().startswith("%") for _, line in plain[:start])
    rows = [
        (number, line) for number, line in rows if not (percent and line.lstrip().startswith("%"))
    ]
    width, least = _widths(rows, delimiter)
    names, header_line, units = _header(
        plain[:start], below, rows, delimiter, (least, width), dialect, needed, shown_as
    )
    head = facts_of(lines, header_line or rows[0][0])
    warnings = tuple(line[len(NOTE) :].strip() for _, line in lines if line.startswith(NOTE))
    return Layout(
        shown_as,
        digest,
        delimiter,
        names,
        header_line,
        units,
        rows,
        warnings,
        (*head, *([note] if note else [])),
        bool(head),
    )


def _is_one_column(lines: Lines, dialect: Dialect) -> bool:
    """Whether each row is one number with a decimal comma: as stated, or as a name with its unit
    above them shows, `t (s)` or `t in s`.
    """
    if dialect.decimal == "point" or not _DECIMAL_COMMA.fullmatch(lines[-1][1].strip()):
        return False
    above = [line for _, line in lines if not _DECIMAL_COMMA.fullmatch(line.strip())]
    named = len(above) == 1 and "," not in above[0] and is_unit(name_and_unit(above[0])[1])
    return dialect.decimal == "comma" or named


def no_names(layout: Layout) -> InputError:
    """What to say of a table whose columns have no names."""
    number, line = layout.rows[0]
    rule = (
        f"has no line of column names: name its {layout.width} columns from left to right "
        "(--columns a,b,...; columns = [...] in a campaign)"
    )
    if layout.delimiter == "," and layout.width == 2:
        rule += (
            "; the comma is taken to part the cells: if it is the decimal mark, say --decimal "
            'comma (decimal = "comma")'
        )
    return InputError(rule, field="header", value=line.strip(), file=layout.file, line=number)


def numeric_columns(layout: Layout) -> tuple[str, ...]:
    """Names of the columns that hold numbers, in the first or the last row, or in at least half of
    their cells; those that begin with _ left out.
    """
    first, last = (
        split_row(line, layout.delimiter, layout.file, number)
        for number, line in (layout.rows[0], layout.rows[-1])
    )
    rows = [cells + [""] * len(layout.names) for cells in (first, last)]
    candidates = [i for i, name in enumerate(layout.names) if name and not name.startswith("_")]
    numeric = {i for i in candidates if any(looks_like_a_number(cells[i]) for cells in rows)}
    balance = dict.fromkeys(set(candidates) - numeric, 0)  # numbers less words
    held = set[int]()
    for _, line in layout.rows if balance else ():
        for i, cell in enumerate(_cells(line, layout.delimiter)):
            if i in balance and not is_missing(cell) and not is_spreadsheet_error(cell):
                number = looks_like_a_number(cell)
                balance[i] += 1 if number else -1
                held |= {i} if number else set()
    numeric |= {i for i in held if balance[i] >= 0}
    return tuple(layout.names[i] for i in candidates if i in numeric)


def value_columns(layout: Layout, errors: Sequence[str | None] = ()) -> tuple[str, ...]:
    """The columns of numbers that are not called as uncertainties, nor named as such in
    `errors`.
    """
    return tuple(
        name
        for name in numeric_columns(layout)
        if not is_uncertainty(_bare(name)) and not {name, _bare(name)} & {*errors}
    )


def uncertainty_of(column: str, layout: Layout) -> str | None:
    """The column u_NAME or u(NAME) of the uncertainties of `column`, if it is there."""
    named = {written for name in (column, _bare(column)) for written in (f"u_{name}", f"u({name})")}
    return next(
        (name for name in layout.names if not name.startswith("_") and {name, _bare(name)} & named),
        None,
    )


def first_and_second(columns: Sequence[str]) -> tuple[str, str] | None:
    """x and y of a table of two columns: as they are called where that is x and y, else from left
    to right.

    None where there are not two, and where the first is called y and the second not x.
    """
    if len(columns) != 2:
        return None
    first, second = columns
    if is_called(first, "y"):
        return (second, first) if is_called(second, "x") else None
    return first, second


def is_called(column: str, letter: str) -> bool:
    """Whether a column is called x, X, x_m or x [m], for the letter x."""
    return _bare(column).partition("_")[0].lower() == letter


def _bare(name: str) -> str:
    return name_and_unit(name)[0]


def _start(lines: Lines, delimiter: str, file: str) -> int:
    """Index of the first row of numbers: like the last row it has as many cells, with numbers (or
    nothing) in the same columns.

    Raises InputError where rows above it look like data.
    """
    shape = _shape(lines[-1][1], delimiter)
    wanted = [
        place
        for place, cell in enumerate(_cells(lines[-1][1], delimiter))
        if looks_like_a_number(cell)
    ]
    for first, (_, line) in enumerate(lines):  # noqa: B007
        cells = _cells(line, delimiter)
        alike = shape & _shape(line, delimiter) and all(
            place >= len(cells) or _may_be_value(cells[place]) for place in wanted
        )
        if alike and any(map(looks_like_a_number, cells)):
            break
    else:
        number, line = lines[-1]
        raise InputError(
            "must hold numbers: the last line holds none",
            field="row",
            value=line,
            file=file,
            line=number,
        )
    while first and _is_blank(lines[first - 1][1], delimiter, shape):
        first -= 1
    for number, line in lines[:first]:
        cells = [cell for cell in _cells(line, delimiter) if cell]
        if len(cells) > 1 and all(map(looks_like_a_number, cells)):
            rule = (
                "is a row with another number of cells than the last one: say how many lines "
                "stand above the table (--skip-rows, skip_rows)"
            )
            raise InputError(rule, field="row", value=line, file=file, line=number)
    return first


def _is_blank(line: str, delimiter: str, shape: set[int]) -> bool:
    """Whether a line is a row in which no cell has a value."""
    return (
        bool(shape & _shape(line, delimiter))
        and not _RULE.fullmatch(line)
        and all(map(is_missing, _cells(line, delimiter)))
    )


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
    above: Lines,
    below: Lines,
    rows: Lines,
    delimiter: str,
    widths: tuple[int, int],
    dialect: Dialect,
    needed: Sequence[str],
    file: str,
) -> tuple[tuple[str, ...], int | None, tuple[str, ...]]:
    """Names of the columns, their line and their units.  above : lines over the numbers, which
    stand in `rows`; below : all lines with comments.
    """
    first = rows[0][0]
    if not dialect.header:
        _refuse_half_a_row(above, delimiter, widths, file)
    if dialect.columns is not None:
        if not widths[0] <= len(dialect.columns) <= widths[1]:
            rule = f"must name all {widths[0]} columns from left to right"
            raise InputError(
                rule, field="columns", value=", ".join(dialect.columns), file=file, line=first
            )
        return dialect.columns, None, ("",) * len(dialect.columns)
    if dialect.header:
        (number, line), cells = (
            above[0],
            _trimmed(_cells(above[0][1].strip().lstrip("%# "), delimiter)),
        )
        if not widths[0] <= len(cells) <= widths[1]:
            raise _odd_row(rows, len(cells), delimiter, file)
        return tuple(cells), number, tuple(name_and_unit(cell)[1] for cell in cells)
    units: list[str] = []
    for i, (number, line) in reversed(list(enumerate(above))):
        percent = line.lstrip().startswith("%")
        cells = _trimmed(_cells(line.strip().lstrip("% ") if percent else line, delimiter))
        fits = widths[0] <= len(cells) <= widths[1] and not any(map(looks_like_a_number, cells))
        if _RULE.fullmatch(line) or (percent and not fits):
            continue
        over = _trimmed(_cells(above[i - 1][1], delimiter)) if i else []
        untrimmed = _cells(line, delimiter)
        of_units = _are_units(untrimmed) and widths[0] <= len(untrimmed) <= max(widths)
        below_names = of_units or (fits and _all_in(needed, over) and not _all_in(needed, cells))
        if not units and widths[0] <= len(over) <= widths[1] and below_names:
            units = untrimmed if of_units else cells
            continue
        if not fits and any(name in cells for name in needed):
            raise _odd_row(rows, len(cells), delimiter, file)
        return _named(cells, units, number) if fits else ((), None, ())
    comments = [
        (number, line.lstrip("# \t").rstrip())
        for number, line in below
        if number < first and is_comment(line)
    ]
    for number, line in comments[-1:]:
        cells = _cells(line, delimiter)
        if widths[0] <= len(cells) <= widths[1] and not any(map(looks_like_a_number, cells)):
            return _named(cells, [], number)
    return (), None, ()


def _refuse_half_a_row(above: Lines, delimiter: str, widths: tuple[int, int], file: str) -> None:
    """Raises InputError where the line over the first row looks like one more, with something in it
    that is no number.
    """
    number, line = next(
        (entry for entry in reversed(above) if not _RULE.fullmatch(entry[1])), (0, "")
    )
    cells = _trimmed(_cells(line, delimiter))
    if (
        not widths[0] <= len(cells) <= widths[1]
        or line.lstrip().startswith("%")
        or _are_units(cells)
    ):
        return
    if any(
        is_spreadsheet_error(cell)
        or (re.match(r"[+-]?[.,]?\d", cell) and not _NAMED_BY_A_NUMBER.fullmatch(cell))
        for cell in cells
    ):
        rule = (
            "must be a row of numbers, like those below it, or of names, which begin with a "
            "letter (if it is neither: --skip-rows, skip_rows)"
        )
        raise InputError(rule, field="row", value=line, file=file, line=number)


def _named(
    cells: list[str], units: list[str], line: int
) -> tuple[tuple[str, ...], int, tuple[str, ...]]:
    """Names, their line, and units: those of a line of their own, or in the names."""
    padded = units + [""] * len(cells)
    return (
        tuple(cells),
        line,
        tuple(
            _unit_in(unit) or name_and_unit(cell)[1]
            for cell, unit in zip(cells, padded, strict=False)
        ),
    )


def _all_in(needed: Sequence[str], cells: Sequence[str]) -> bool:
    return bool(needed) and all(
        name in cells or name in [name_and_unit(cell)[0] for cell in cells] for name in needed
    )


def _are_units(cells: Sequence[str]) -> bool:
    """Whether a line below the names says units alone."""
    return all(_is_in_symbols(unit) for cell in cells if (unit := _unit_in(cell))) and any(
        cell not in ("", "1") for cell in cells
    )


def _unit_in(cell: str) -> str:
    """The unit that a cell below a name says, without brackets; "1" for a pure number."""
    unit = cell.strip("()[] ")
    return "1" if unit.lower() in _NO_UNIT else unit


def _is_in_symbols(unit: str) -> bool:
    """Whether a unit is made of symbols that are known."""
    words = [part for part in _SEPARATORS.split(unit.replace("µ", "u").replace("μ", "u")) if part]
    return unit == "1" or (
        _NUMBER_FIRST.match(unit) is None
        and bool(words)
        and all(word in _SYMBOLS for word in words)
    )


def _odd_row(rows: Lines, width: int, delimiter: str, file: str) -> InputError:
    """What is said of the first row that has another number of cells than there are names."""
    number, n_cell = next(
        (number, n) for number, line in rows if (n := len(_cells(line, delimiter))) != width
    )
    return cells_differ(n_cell, width, delimiter, file, number)


def cells_differ(cells: int, width: int, delimiter: str, file: str, line: int) -> InputError:
    commas = delimiter == "," and cells == 2 * width
    cure = (
        '--decimal comma, or decimal = "comma"'
        if width == 1
        else "write decimal points, or separate the cells by semicolons"
    )
    hint = f" (decimal commas? {cure})" if commas else ""
    return InputError(
        f"must have {width} cells{hint}", field="row", value=cells, file=file, line=line
    )
