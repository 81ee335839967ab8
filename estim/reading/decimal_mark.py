"""The decimal mark of a table, and the numbers in its cells."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from estim.common import EXTREME, InputError, extreme, read_number
from estim.reading.cells import NOT_COMPUTED, Row, is_formula, looks_like_a_number
from estim.reading.dialect import cell_name
from estim.reading.layout import Layout

_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}", re.ASCII)  # one comma: 1,234 may be 1234


def decimal_mark(layout: Layout, rows: Sequence[Row], indices: Sequence[int]) -> str:
    """The decimal mark of the numbers in the columns at `indices`.

    Raises InputError where points and commas are mixed, or commas may part thousands.
    """
    if layout.dialect.decimal is not None:
        return {"point": ".", "comma": ","}[layout.dialect.decimal]
    first: dict[str, tuple[Row, str]] = {}
    for row in rows:
        for index in indices:
            cell = row.cells[index]
            mark = next((m for m in ",." if m in cell), None)
            if mark is not None and mark not in first and looks_like_a_number(cell):
                first[mark] = row, cell
    if len(first) == 2:
        row, cell = max(first.values(), key=lambda entry: (entry[0].number, entry[1]))
        rule = (
            "has numbers with decimal points and others with commas: write them alike, or "
            "state which of the two is the decimal mark (--decimal point or comma; "
            "decimal = ... in a campaign)"
        )
        raise row_refused(row, rule, "row", cell)
    if "," in first and not any(
        looks_like_a_number(cell) and "," in cell and not _GROUPED.fullmatch(cell)
        for row in rows
        for cell in row.cells
    ):
        rule = (
            "may part thousands or be a decimal comma, in every number that has one: say "
            '--decimal comma (decimal = "comma" in a campaign), or write the numbers without '
            "thousands"
        )
        raise row_refused(first[","][0], rule, "comma", first[","][1])
    return "," if "," in first else "."


def number_in(row: Row, name: str, cell: str, mark: str, position: tuple[int, int] | None) -> float:
    """The number in a cell that is not missing.  position : of the cell in a spreadsheet.  Raises
    InputError.
    """
    named = f"cell {cell_name(*position)}" if position else ""
    if looks_like_a_number(cell) and ("," if mark == "." else ".") not in cell:
        value = read_number(cell.replace(",", "."))
        if not np.isfinite(value) or extreme(value):
            rule = EXTREME if np.isfinite(value) else "must be finite"
            raise row_refused(row, rule, name, cell, named)
        return value
    if is_formula(cell):
        raise row_refused(
            row, f"must be a number, not a formula that was {NOT_COMPUTED}", name, cell, named
        )
    hint = f" (as 1234{mark}5 or 2e3; a time as 13:05:00)" if re.search(r"\d", cell) else ""
    raise row_refused(row, f"must be a number{hint}", name, cell, named)


def row_refused(row: Row, rule: str, field: str, value: object, cell: str = "") -> InputError:
    return InputError(rule, field=field, value=value, line=row.number, quoted=cell)
