"""Columns by name out of tables of other people's making: any delimiter, header, decimal mark and
number of further columns.

What the lines show beyond doubt is taken from them; the rest is requested by one line that names
the cure (`dialect`).  Rows without a value in one of the columns are left out, and the table
reports them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, in_file, in_its_file, listed, phrase, same_numbers
from estim.reading.cells import Row, is_missing
from estim.reading.decimal_mark import decimal_mark, number_in, row_refused
from estim.reading.dialect import PLAIN, Dialect, bare_name, name_and_unit, names_and_units
from estim.reading.layout import Layout, cells_differ, numeric_columns, read_layout
from estim.reading.source import refuse
from estim.reading.table import (
    DECIMAL_COMMAS,
    UNITS,
    Table,
    line_numbers,
    may_be_decimal_commas,
    own_name,
    row_of,
)


def read_columns(
    path: Path, *, needed: Sequence[str], min_rows: int, dialect: Dialect = PLAIN
) -> Table:
    """The columns `needed` of the table at `path`; all others are left unread.

    Raises InputError with file, line, field, rule and value; where the file may be read in two
    ways, the rule names the key that resolves it.
    """
    return table_of(read_layout(path, dialect), needed, min_rows)


def table_of(
    layout: Layout,
    needed: Sequence[str],
    min_rows: int,
    *,
    complete: bool = False,
    optional: Sequence[str] = (),
) -> Table:
    """The columns `needed` of a table that is laid out so, and those that are `optional`, NaN where
    a cell is empty.  complete : whether an empty cell of the others is refused; else its row is
    left out.  Raises InputError as `read_columns` does.
    """
    with in_file(layout.file):
        return _columns(
            layout, list(dict.fromkeys((*needed, *optional))), min_rows, complete, optional
        )


def _columns(
    layout: Layout, needed: Sequence[str], min_rows: int, complete: bool, optional: Sequence[str]
) -> Table:
    indices = [place_of(name, layout.names, layout.header_line) for name in needed]
    dialect = layout.dialect
    for index in indices:
        if layout.names[index] in layout.refused:
            raise layout.refused[layout.names[index]]
    if not {layout.names[index] for index in indices} & {*layout.moments}:
        # the order of days and months may be needed for a column that is left unread
        keys = ("since", "time_unit") if layout.moments else ("dates", "since", "time_unit")
        refuse(dialect, "goes with columns of dates or times, and none is read here", *keys)
    if (
        layout.delimiter == ","
        and dialect.delimiter is None
        and dialect.decimal is None
        and len(layout.names) > len(set(indices))
        and may_be_decimal_commas(row.line for row in layout.rows)
    ):
        rule = f'{DECIMAL_COMMAS}, or say --decimal point (decimal = "point" in a campaign)'
        raise row_refused(layout.rows[0], rule, "row", layout.rows[0].line)
    rows = [row._replace(cells=_cells_of(row, layout)) for row in layout.rows]
    mark = decimal_mark(layout, rows, indices)
    numbers, values, left_out = [], [], dict[str, list[int]]()
    lines, copies = set[tuple[str, ...]](), list[int]()
    for row in rows:
        cells = {name: row.cells[index] for name, index in zip(needed, indices, strict=True)}
        empty = [name for name, cell in cells.items() if is_missing(cell)]
        blank = next((name for name in empty if name not in optional), None)
        if blank is not None and complete:
            raise row_refused(row, "must be a number", blank, cells[blank])
        if blank is not None:
            left_out.setdefault(blank, []).append(row.number)
            continue
        if tuple(row.cells) in lines:
            copies.append(row.number)
        lines.add(tuple(row.cells))
        numbers.append(row.number)
        values.append(
            [
                np.nan
                if name in empty
                else number_in(row, name, cells[name], mark, _position(row, index, layout))
                for name, index in zip(needed, indices, strict=True)
            ]
        )
    if len(values) < min_rows:
        rule = f"must hold at least {min_rows} rows of numbers"
        quoted = "; ".join(_left_out(name, lines) for name, lines in left_out.items())
        raise InputError(rule, field="rows", value=len(values), quoted=quoted)
    table = np.array(values).reshape(-1, len(needed))
    columns = {name: table[:, i].copy() for i, name in enumerate(needed)}
    at = np.array(numbers)
    at.setflags(write=False)
    return Table(
        file=layout.file,
        sha256=layout.sha256,
        header_line=layout.header_line or 0,
        columns={},
        lines=at,
        warnings=(*layout.warnings, *_copied(copies, table)),
        facts=(
            *layout.head,
            *layout.assumed,
            *(_left_out(name, lines) for name, lines in left_out.items()),
        ),
        units={name: layout.units[index] for name, index in zip(needed, indices, strict=True)},
        blank=tuple(sorted(line for lines in left_out.values() for line in lines)),
        imported=bool(layout.head),
        assumed=layout.assumed,
        unread=tuple(
            name for name in numeric_columns(layout) if layout.names.index(name) not in indices
        ),
    ).with_columns(columns)


@in_its_file
def read_known_columns(
    path: Path,
    *,
    known: Sequence[str],
    min_rows: int,
    dialect: Dialect = PLAIN,
    needed: Sequence[str] = (),
) -> Table:
    """The columns of the table at `path` that are called as one of `known`, or as other programs
    call these, those `needed` among them.

    Where nothing is stated of how the table is written, any other column must begin with _ and no
    cell may be empty; else both are left out.  Raises InputError as `read_columns` does, and where
    a column has an uncertain place or another unit than its name states.
    """
    layout = read_layout(path, dialect)
    called = {name: ours for name in layout.names if (ours := own_name(name)) in known}

    def refused(rule: str, field: str, value: str | None = None, quoted: str = "") -> InputError:
        return InputError(rule, field=field, value=value, line=layout.header_line, quoted=quoted)

    for name in layout.names if dialect == PLAIN else ():
        if name not in called and not name.startswith("_"):
            raise refused(
                f"is not a column name (known: {', '.join(known)}; start a name with _ to skip it)",
                name,
            )
    if len(set(called.values())) < len(called):
        raise refused("has two columns with the same name", "header", ", ".join(called))
    if not called:
        raise refused(
            f"must hold columns that are called {', '.join(known)} (or name all columns: "
            "columns = [...])",
            "header",
            ", ".join(layout.names),
        )
    for name in needed:
        if name not in called.values():
            raise refused("is missing", name, quoted=f"the header has {listed(list(called))}")
    table = table_of(layout, list(called), min_rows, complete=dialect == PLAIN)
    for name, ours in called.items():
        if ours in UNITS and same_numbers(table.units[name] or UNITS[ours], UNITS[ours]) is False:
            rule = f"must be in {UNITS[ours]}, as its name says; nothing is converted"
            raise refused(rule, name, table.units[name])
    return table.with_columns({called[name]: column for name, column in table.columns.items()})


def place_of(name: str, names: Sequence[str], line: int | None = None) -> int:
    """Where among `names`, on this line, the column `name` is: called just so, or so before its
    unit, or with the same unit in other brackets.  Raises InputError listing what there is.
    """
    indices = (
        [i for i, column in enumerate(names) if column == name]
        or [i for i, column in enumerate(names) if bare_name(column) == name]
        or [i for i, column in enumerate(names) if name_and_unit(column) == name_and_unit(name)]
    )
    if not indices:
        raise InputError(
            "is missing",
            field=name,
            line=line,
            quoted=f"the header has {listed([column for column in names if column])}",
        )
    if len(indices) > 1:
        raise InputError(
            "occurs twice in the header: name all columns from left to right (--columns a,b,c; "
            "columns = [...] in a campaign)",
            field=name,
            line=line,
        )
    return indices[0]


def _cells_of(row: Row, layout: Layout) -> list[str]:
    """The cells of a row, one for each column.  Raises InputError."""
    width = len(layout.names)
    if row.cells == [row.line]:
        row_of(row.line, layout.delimiter, row.number)  # its error gives the reason
    cells = row.cells if any(row.cells[width:]) else row.cells[:width]
    if len(cells) != width:
        raise cells_differ(row._replace(cells=cells), width, layout.delimiter)
    return cells


def _position(row: Row, index: int, layout: Layout) -> tuple[int, int] | None:
    """Line and column of a cell of a spreadsheet."""
    first = layout.first_column
    return None if first is None else (row.number, first + index)


def _left_out(name: str, lines: Sequence[int]) -> str:
    return phrase(
        "1 row without a value of '{name}' was excluded (line {lines})"
        if len(lines) == 1
        else "{n} rows without a value of '{name}' were excluded (lines {lines})",
        n=len(lines),
        name=name,
        lines=line_numbers(lines),
    )


def _copied(copies: Sequence[int], table: FloatArray) -> list[str]:
    """The warning about lines that repeat an earlier one in every cell, where no other value of the
    first of several columns stands twice.
    """
    if not copies or table.shape[1] < 2 or np.unique(table[:, 0]).size < len(table) - len(copies):
        return []
    return [
        phrase(
            "rows identical to an earlier one: {lines} (a copy is counted twice, so remove it)",
            lines=line_numbers(copies),
        )
    ]


def columns_sentence(read: Sequence[tuple[str, str, str]], unread: Sequence[str]) -> str:
    """Which columns are what, and which columns of numbers are not read.

    read : "x", its column, its unit or "1" where none is known.
    """
    names = names_and_units([column for _, column, _ in read])
    pairs = [
        f"{key} = {name}{f' ({unit})' if unit not in ('', '1') else ''}"
        for (key, _, unit), (name, _) in zip(read, names, strict=True)
        if name
    ]
    columns = phrase("columns: {pairs}", pairs=", ".join(pairs))
    if unread:
        columns += phrase("; columns not used: {columns}", columns=listed(unread))
    return columns
