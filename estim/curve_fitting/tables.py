"""`read_table`: a table for Python, read as the commands read it, or out of a data frame of pandas,
with what `fit_curve` takes of it: `fit_curve("a + b*x", **read_table("a.xlsx").points("t", "U"))`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, listed
from estim.curves import AxisNames
from estim.given_numbers import real_numbers
from estim.reading import (
    PLAIN,
    Decimal,
    Dialect,
    bare_name,
    name_and_unit,
    numeric_columns,
    read_layout,
    table_of,
)


@dataclass(frozen=True, eq=False)
class Columns:
    """columns : name without its unit -> (n_row,) read-only array.  units : the same -> unit, ""
    for none.

    notes : how the table was read, and which rows were left out, in words.
    """

    columns: Mapping[str, FloatArray]
    units: Mapping[str, str]
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> FloatArray:
        bare = name if name in self.columns else bare_name(name)
        if bare not in self.columns:
            raise InputError("is no column", field=name, quoted=listed(list(self.columns)))
        return self.columns[bare]

    @property
    def uncertainties(self) -> Mapping[str, FloatArray]:
        """Column -> its standard uncertainties, of those that have a column u_NAME or u(NAME)."""
        return {
            name: self.columns[u]
            for name in self.columns
            for u in (f"u_{name}", f"u({name})")
            if u in self.columns
        }

    def points(self, x: str, y: str) -> dict[str, Any]:
        """Arguments of `fit_curve`: x, y, their uncertainties and the names and units of the axes.

        As in the commands, uncertainties of x are taken where y has some too.
        """
        names = [name if name in self.columns else bare_name(name) for name in (x, y)]
        known = self.uncertainties
        units = [self.units.get(name) or "1" for name in names]
        return {
            "x": self[x],
            "y": self[y],
            "u_y": known.get(names[1]),
            "u_x": known.get(names[0]) if names[1] in known else None,
            "axes": AxisNames(names[0], units[0], names[1], units[1]),
        }


def read_table(
    source: Any,
    *,
    columns: Sequence[str] | None = None,
    sheet: str | None = None,
    range: str | None = None,  # noqa: A002
    decimal: Decimal | None = None,
    dialect: Dialect = PLAIN,
) -> Columns:
    """The columns of numbers in a file (text, .xlsx, .ods, a zip of one table), or in a data frame.

    source : a path, or a data frame.
    columns : those that are read, None for all; a row without a value in one of them is left out.
    sheet, range, decimal : as --sheet, --range and --decimal of the commands.
    dialect : what else is stated of how a file is written.

    A data frame has units in its names, "U [V]", or in `attrs["units"]`.  Raises InputError.

    >>> from estim import fit_curve, read_table
    >>> table = read_table("data/tutorial/tea.csv")
    >>> sorted(table.columns), table.units
    (['temperature', 'time'], {'time': 'min', 'temperature': '°C'})
    >>> fit_curve("room + excess*exp(-x/tau)", **table.points("time", "temperature")).status
    'ok'
    """
    if hasattr(source, "columns") and hasattr(source, "attrs"):
        return _of_frame(source, columns)
    if not isinstance(source, str | PathLike):
        raise InputError("must be a file or a data frame", field="source", value=source)
    stated = {"sheet": sheet, "range": range, "decimal": decimal}
    changes: dict[str, Any] = {key: value for key, value in stated.items() if value is not None}
    layout = read_layout(Path(source), replace(dialect, **changes), needed=columns or ())
    names = list(columns or numeric_columns(layout))
    table = table_of(layout, names, 1)
    bare = {name: bare_name(name) for name in names}
    return Columns(
        {bare[name]: column for name, column in table.columns.items()},
        {bare[name]: unit for name, unit in table.units.items()},
        (*table.facts, *table.warnings),
    )


def _of_frame(frame: Any, columns: Sequence[str] | None) -> Columns:
    """The columns of a data frame, those of numbers where none are named; rows without a value in
    one of them are left out.
    """
    stated = frame.attrs.get("units", {})
    names = [
        name
        for name in frame.columns
        if (columns is None and np.issubdtype(np.asarray(frame[name]).dtype, np.number))
        or (columns is not None and {str(name), bare_name(str(name))} & {*columns})
    ]
    if not names:
        raise InputError("has no column of numbers", field="table", quoted=str(list(columns or ())))
    table = frame[names].dropna()
    named = {name: name_and_unit(str(name)) for name in names}
    left_out = len(frame) - len(table)
    return Columns(
        {
            bare: real_numbers(table[name].to_numpy(), str(name))
            for name, (bare, _) in named.items()
        },
        {bare: stated.get(name, unit) for name, (bare, unit) in named.items()},
        (f"{left_out} rows without a value were left out",) if left_out else (),
    )
