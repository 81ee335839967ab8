"""The keys that state how the tables of runs are written: `columns`, `delimiter`, `decimal`,
`skip_rows`, `encoding`, `sheet`, `range`, `dates`, `since`, `time_unit`; and those that
state how a file of the program Tracker is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import msgspec

from estim.campaign.key_table import KeyTable
from estim.common import InputError
from estim.reading import Choices, Dates, Decimal, Dialect, Encoding, KeyPath, Places

TRACK_KEYS = tuple(Choices.__dataclass_fields__)


class DialectKeys(KeyTable, frozen=True):
    columns: list[str] | None = None
    delimiter: str | None = None
    decimal: Decimal | None = None
    skip_rows: int | None = None
    encoding: Encoding | None = None
    sheet: str | None = None
    range: str | None = None
    dates: Dates | None = None
    since: str | None = None
    time_unit: str | None = None


def dialect_of(levels: Sequence[tuple[KeyPath, DialectKeys]], places: Places) -> Dialect:
    """How a table is written by what the levels state of it, the first of them before the others.
    Raises InputError at the key's line.
    """
    entries: dict[str, tuple[Any, KeyPath]] = {
        key: (tuple(value) if key == "columns" else value, path)
        for path, level in reversed(levels)
        for key in DialectKeys.__struct_fields__
        if (value := getattr(level, key)) is not None
    }
    try:
        return Dialect(**{key: value for key, (value, _) in entries.items()})
    except InputError as error:
        field = str(error.field)
        _, path = entries[field]
        raise places.error(error.rule, (*path, field), value=error.value) from None


def choices_of(run: msgspec.Struct) -> Choices | None:
    """How a file of the program Tracker is to be read, by any table with these keys; None where
    nothing is stated.
    """
    stated = {key: value for key in TRACK_KEYS if (value := getattr(run, key)) is not None}
    return Choices(**stated) if stated else None
