"""Columns by name out of tables of other people's making: any delimiter, header, decimal mark and
number of further columns.

What the lines show beyond doubt is taken from them; the rest is asked for by one line that says the
cure (`dialect`).  Rows without a value in one of the columns are left out, and the table says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from estim.arrays import FloatArray
from estim.common import EXTREME, InputError, extreme, listed, phrase, same_unit
from estim.reading.cells import is_missing
from estim.reading.dialect import (
    Dialect,
    decimal_mark,
    is_column,
    name_and_unit,
    number_in,
    place_of,
    split_row,
)
from estim.reading.layout import Layout, cells_differ, no_names, numeric_columns, read_layout
from estim.reading.table import DECIMAL_COMMAS, UNITS, Table, may_be_decimal_commas, own_name

_MOST_TOLD = 6  # lines or rows of lines


def read_columns(
    path: Path,
    *,
    needed: Sequence[str],
    min_rows: int,
    shown_as: str,
    dialect: Dialect | None = None,
    optional: Sequence[str] = (),
) -> Table:
    """The columns `needed` of the table at `path`, and those of `optional` that it has; all others
    are left unread.

    Raises InputError with file, line, field, rule and value; where the file may be read in two
    ways, the rule names the key that settles it.
    """
    layout = read_layout(path, dialect or Dialect(), shown_as=shown_as, needed=needed)
    if not layout.names:
        raise no_names(layout)
    needed = [
        *needed,
        *(name for name in optional if name not in needed and is_column(name, layout.names)),
    ]
    return _columns(layout, dialect or Dialect(), needed, min_rows)


def _columns(
    layout: Layout,
    dialect: Dialect,
    needed: Sequence[str],
    min_rows: int,
    *,
    complete: bool = False,
) -> Table:
    """complete : whether an empty cell is refused; else its row is left out."""
    shown_as = layout.file
    places = [place_of(name, layout.names, shown_as, layout.header_line) for name in needed]
    unsaid = layout.delimiter == "," and dialect.delimiter is None and dialect.decimal is None
    if (
        unsaid
        and len(layout.names) > len(set(places))
        and may_be_decimal_commas(line for _, line in layout.rows)
    ):
        number, line = layout.rows[0]
        rule = f'{DECIMAL_COMMAS}, or say --decimal point (decimal = "point" in a campaign)'
        raise InputError(rule, field="row", value=line, file=shown_as, line=number)
    rows = [(number, _row(line, layout, shown_as, number)) for number, line in layout.rows]
    mark = decimal_mark(rows, places, dialect.decimal, shown_as)
    numbers, values, left_out = [], [], dict[str, list[int]]()
    lines, copies = dict[tuple[str, ...], int](), dict[int, int]()
    for number, cells in rows:
        blank = next(
            (name for name, place in zip(needed, places, strict=True) if is_missing(cells[place])),
            None,
        )
        if blank is not None and complete:
            raise InputError(
                "must be a number",
                field=blank,
                value=cells[places[needed.index(blank)]],
                file=shown_as,
                line=number,
            )
        if blank is not None:
            left_out.setdefault(blank, []).append(number)
            continue
        if (first := lines.setdefault(tuple(cells), number)) != number:
            copies[number] = first
        numbers.append(number)
        values.append(
            [
                _value(cells[place], name, mark, shown_as, number)
                for name, place in zip(needed, places, strict=True)
            ]
        )
    facts = [*layout.facts, *(_left_out(name, lines) for name, lines in left_out.items())]
    if len(values) < min_rows:
        raise InputError(
            f"must hold at least {min_rows} rows of numbers",
            field="rows",
            value=len(values),
            file=shown_as,
        )
    table = np.array(values)
    columns = {name: table[:, i].copy() for i, name in enumerate(needed)}
    units = {
        name: layout.units[place] or name_and_unit(layout.names[place])[1]
        for name, place in zip(needed, places, strict=True)
    }
    at = np.array(numbers)
    for array in (*columns.values(), at):
        array.setflags(write=False)
    empty = tuple(sorted(line for lines in left_out.values() for line in lines))
    named = MappingProxyType(columns)
    unread = tuple(
        name for name in numeric_columns(layout) if layout.names.index(name) not in places
    )
    warnings = (*layout.warnings, *_copied(copies, table))
    return Table(
        shown_as,
        layout.sha256,
        layout.header_line or 0,
        named,
        at,
        warnings,
        tuple(facts),
        units,
        empty,
        layout.imported,
        unread,
    )


def read_known_columns(
    path: Path,
    *,
    known: Sequence[str],
    min_rows: int,
    shown_as: str,
    dialect: Dialect | None = None,
    needed: Sequence[str] = (),
) -> Table:
    """The columns of the table at `path` that are called as one of `known`, or as other programs
    call these, those `needed` among them.

    Where nothing is stated of how the table is written, any other column must begin with _ and no
    cell may be empty; else both are left out.  Raises InputError as `read_columns` does, and where
    a column has an uncertain place or another unit than its name says.
    """
    stated = dialect is not None and dialect != Dialect()
    layout = read_layout(path, dialect or Dialect(), shown_as=shown_as, needed=known)
    if not layout.names:
        raise no_names(layout)
    called = {name: ours for name in layout.names if (ours := own_name(name)) in known}
    line = layout.header_line
    for name in () if stated else layout.names:
        if name not in called and not name.startswith("_"):
            rule = (
                f"is not a column name (known: {', '.join(known)}; start a name with _ to skip it)"
            )
            raise InputError(rule, field=name, file=shown_as, line=line)
    if len(set(called.values())) < len(called):
        raise InputError(
            "has two columns with the same name",
            field="header",
            value=", ".join(called),
            file=shown_as,
            line=line,
        )
    if not called:
        rule = (
            f"must hold columns that are called {', '.join(known)} (or name all columns: "
            "columns = [...])"
        )
        raise InputError(
            rule, field="header", value=", ".join(layout.names), file=shown_as, line=line
        )
    for name in needed:
        if name not in called.values():
            raise InputError(
                "is missing",
                field=name,
                file=shown_as,
                line=line,
                quoted=f"the header has {listed(list(called))}",
            )
    table = _columns(layout, dialect or Dialect(), list(called), min_rows, complete=not stated)
    for name, ours in called.items():
        if ours in UNITS and same_unit(table.units[name] or UNITS[ours], UNITS[ours]) is False:
            rule = f"must be in {UNITS[ours]}, as its name says; nothing is converted"
            raise InputError(
                rule,
                field=name,
                value=table.units[name],
                file=shown_as,
                line=table.header_line or None,
            )
    return replace(
        table,
        columns=MappingProxyType({called[name]: column for name, column in table.columns.items()}),
    )


def _row(line: str, layout: Layout, file: str, number: int) -> list[str]:
    cells = split_row(line, layout.delimiter, file, number)
    width = len(layout.names)
    if len(cells) > width and not any(cells[width:]):
        cells = cells[:width]
    if len(cells) != width:
        raise cells_differ(len(cells), width, layout.delimiter, file, number)
    return cells


def _value(cell: str, name: str, mark: str, file: str, line: int) -> float:
    value = number_in(cell, name, mark, file, line)
    if not np.isfinite(value):
        raise InputError("must be finite", field=name, value=cell, file=file, line=line)
    if extreme(value):
        raise InputError(EXTREME, field=name, value=cell, file=file, line=line)
    return value


def _left_out(name: str, lines: Sequence[int]) -> str:
    if len(lines) == 1:
        return phrase(
            "1 row without a value of '{name}' was excluded (line {line})", name=name, line=lines[0]
        )
    return phrase(
        "{n} rows without a value of '{name}' were excluded (lines {lines})",
        n=len(lines),
        name=name,
        lines=line_numbers(lines),
    )


def _copied(copies: Mapping[int, int], table: FloatArray) -> list[str]:
    """What is said of lines that repeat an earlier one in every cell, where no other value of the
    first of several columns stands twice.

    copies : line -> the earlier one.
    """
    if not copies or table.shape[1] < 2 or np.unique(table[:, 0]).size < len(table) - len(copies):
        return []
    if len(copies) == 1:
        ((line, first),) = copies.items()
        return [
            phrase(
                "line {line} is identical to line {first}: if it is a copy, it is counted "
                "twice, so remove it",
                line=line,
                first=first,
            )
        ]
    words = phrase(
        "{n} rows are identical to an earlier one (lines {lines}): if they are copies, "
        "they are counted twice, so remove them",
        n=len(copies),
        lines=line_numbers(list(copies)),
    )
    return [words]


def columns_sentence(read: Sequence[tuple[str, str, str]], unread: Sequence[str]) -> str:
    """Which columns are what, and which columns of numbers are not read.  read : "x", its column,
    its unit or "1" where none is known.
    """
    pairs = [
        f"{key} = {name_and_unit(column)[0]}{f' ({unit})' if unit not in ('', '1') else ''}"
        for key, column, unit in read
        if column
    ]
    columns = phrase("columns: {pairs}", pairs=", ".join(pairs))
    return columns + (
        phrase("; columns not used: {columns}", columns=listed(unread)) if unread else ""
    )


def line_numbers(lines: Sequence[int]) -> str:
    """Lines of a file as people say them, `3, 5, 8 to 12`; of many the first, and how many more
    there are.
    """
    starts = [i for i, line in enumerate(lines) if i == 0 or line != lines[i - 1] + 1]
    parts: list[str] = []
    for first, end in zip(starts, [*starts[1:], len(lines)], strict=True):
        alone = end - first < 3
        stretch = (
            [str(line) for line in lines[first:end]]
            if alone
            else [phrase("{first} to {last}", first=lines[first], last=lines[end - 1])]
        )
        if len(parts) + len(stretch) > _MOST_TOLD:
            return ", ".join([*parts, phrase("and {n} more", n=len(lines) - first)])
        parts += stretch
    return ", ".join(parts)
