"""`read_table`: a table for Python, read as the commands read it, or out of a data frame of pandas,
with what `fit_curve` takes of it: `fit_curve("a + b*x", **read_table("a.xlsx").points("t", "U"))`.
"""

from __future__ import annotations

from collections.abc import KeysView, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, listed, same_numbers
from estim.curves import AxisNames
from estim.given_numbers import real_numbers
from estim.reading import (
    PLAIN,
    Decimal,
    Dialect,
    bare_name,
    name_and_unit,
    names_and_units,
    numeric_columns,
    place_of,
    read_layout,
    require_unit,
    table_of,
    uncertainty_of,
)


@dataclass(frozen=True, eq=False)
class TableColumns:
    """columns : name -> (n_row,) read-only array; the name has its unit, "U (mV)", only where two
    columns have the same name without.  units : the same -> unit, "" for none.

    notes : how the table was read, and which rows were left out, in words.
    """

    columns: Mapping[str, FloatArray]
    units: Mapping[str, str]
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[self._called(name)]

    def keys(self) -> KeysView[str]:
        """Names of the columns; with them `dict(table)` is a dictionary, for `pandas.DataFrame`."""
        return self.columns.keys()

    def _called(self, name: str) -> str:
        """The key of the column `name`, which may have its unit.  Raises InputError."""
        if name in self.columns:
            return name
        if not isinstance(name, str):
            raise InputError("must be the name of a column", field="name", value=name)
        short_name, unit = name_and_unit(name)
        keys = [
            key
            for key, (short, _) in zip(self.columns, names_and_units([*self.columns]), strict=True)
            if short == short_name and (not unit or same_numbers(self.units.get(key, ""), unit))
        ]
        if len(keys) != 1:
            rule = "is the name of two columns: give the unit too" if keys else "is no column"
            raise InputError(rule, field=name, quoted=listed(keys or list(self.columns)))
        return keys[0]

    @property
    def uncertainties(self) -> Mapping[str, FloatArray]:
        """Column -> its standard uncertainties, of those that have a column u_NAME or u(NAME)."""
        columns = ((name, self._uncertainties(name)) for name in self.columns)
        return {name: u for name, u in columns if u is not None}

    def _uncertainties(self, name: str) -> FloatArray | None:
        """Of the column with this key.  Raises InputError where they are in another unit."""
        u = uncertainty_of(name, [*self.columns])
        if u is None:
            return None
        require_unit(self.units, u, name)
        return self.columns[u]

    def points(self, x: str, y: str) -> dict[str, Any]:
        """Arguments of `fit_curve`: x, y, their uncertainties and the names and units of the axes.

        As in the commands, uncertainties of x are taken where y has some too.
        """
        names = [self._called(name) for name in (x, y)]
        u_y = self._uncertainties(names[1])
        words = [word for name in names for word in (bare_name(name), self.units.get(name) or "1")]
        return {
            "x": self.columns[names[0]],
            "y": self.columns[names[1]],
            "u_y": u_y,
            "u_x": None if u_y is None else self._uncertainties(names[0]),
            "axes": AxisNames(*words),
        }


def _keys(names: Sequence[str]) -> dict[str, str]:
    """Name of a column -> that without its unit, where no other is called so."""
    short_names = [short for short, _ in names_and_units(names)]
    return {
        name: name if short_names.count(short) > 1 else short
        for name, short in zip(names, short_names, strict=True)
    }


def read_table(
    source: Any,
    *,
    columns: Sequence[str] | None = None,
    sheet: str | None = None,
    range: str | None = None,  # noqa: A002
    decimal: Decimal | None = None,
    dialect: Dialect = PLAIN,
) -> TableColumns:
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
    layout = read_layout(Path(source), replace(dialect, **changes))
    names = list(columns or numeric_columns(layout))
    table = table_of(layout, names, 1)
    keys = _keys(names)
    return TableColumns(
        {keys[name]: column for name, column in table.columns.items()},
        {keys[name]: unit for name, unit in table.units.items()},
        (*table.facts, *table.warnings),
    )


def _of_frame(frame: Any, columns: Sequence[str] | None) -> TableColumns:
    """The columns of a data frame, those of numbers where none are named; rows without a value in
    one of them are left out.
    """
    stated = frame.attrs.get("units", {})
    called = [str(name) for name in frame.columns]
    positions = (
        [
            i
            for i in range(len(called))
            if np.issubdtype(np.asarray(frame.iloc[:, i]).dtype, np.number)
        ]
        if columns is None
        else [place_of(name, called) for name in columns]
    )
    if not positions:
        raise InputError("has no column of numbers", field="table", quoted=str(list(columns or ())))
    positions = list(dict.fromkeys(positions))
    table = frame.iloc[:, positions].dropna()
    names = {called[i]: frame.columns[i] for i in positions}
    for name in names:
        place_of(name, called)  # refuses one that occurs twice
    keys = _keys(list(names))
    units = {name: unit for name, (_, unit) in zip(names, names_and_units([*names]), strict=True)}
    n_dropped = len(frame) - len(table)
    return TableColumns(
        {keys[name]: real_numbers(table[label].to_numpy(), name) for name, label in names.items()},
        {keys[name]: stated.get(names[name], unit) for name, unit in units.items()},
        (f"{n_dropped} rows without a value were left out",) if n_dropped else (),
    )
