"""The files of a `[curve]`: the columns that a run needs, read as the campaign says they are written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estim.campaign.campaign_file import CampaignFile
from estim.campaign.curve_tables import CurveRunTable, CurveTable, ReadingErrorTable, axis_of, y_axis
from estim.campaign.dialect_table import DialectKeys, dialect_of
from estim.campaign.own_curve_counts import count_columns
from estim.campaign.own_curve_lacks import order_columns
from estim.campaign.own_curve_points import MIN_ROWS
from estim.campaign.track_table import choices_of
from estim.common import InputError, same_unit
from estim.curves import AxisNames
from estim.reading import Choices, Run, Table, columns_told, is_tracker_file, of_any_curve, read_columns, run_of_table, track_columns


def read_run(source: CampaignFile, curve: CurveTable, run: CurveRunTable, index: int) -> Table:
    """The columns of run number `index` that its curve and its errors need.  Raises InputError."""
    x_column, y_column = axis_of(curve.x).column, y_axis(curve).column
    path, dialect = source.file_of(index), dialect_of(((("runs", index), run), (("curve",), curve)), source.places)
    errors = [(entry, y_column) for entry in (run.u_y, curve.u_y) if entry is not None][:1]
    errors += [(entry, x_column) for entry in (run.u_x, curve.u_x) if entry is not None][:1]
    columns = [(entry.column, of) for entry, of in errors if isinstance(entry, ReadingErrorTable) and entry.column is not None]
    counted = [*([y_column] if y_column else []), *count_columns(curve)]
    needed = list(dict.fromkeys([x_column, *counted, *(u for u, _ in columns), *order_columns(curve, run)]))
    choices = choices_of(run) or (Choices() if is_tracker_file(path) else None)
    if choices is not None and any(getattr(run, key) is not None for key in DialectKeys.__struct_fields__):
        raise source.places.error("does not go with a file of Tracker, which says itself how it is written", ("runs", index), field="columns")
    with source.reading(path, needed):
        table = track_columns(path, choices, needed=needed, shown_as=str(path)) if choices is not None else read_columns(
            path, needed=needed, min_rows=MIN_ROWS, shown_as=str(path), dialect=dialect
        )
    for column, of in columns:
        table.require_unit(column, of)
        _require_unit_of_axis(table, column, of, y_axis(curve).unit if of == y_column else axis_of(curve.x).unit)
        if np.any(table.columns[column] <= 0.0):
            raise table.error("must be > 0", column, int(np.argmax(table.columns[column] <= 0.0)))
    return table


def _require_unit_of_axis(table: Table, u: str, of: str, unit: str) -> None:
    """Raises InputError where the header states another unit for uncertainties than the campaign for what they are of."""
    stated = table.units.get(u, "")
    if unit != "1" and stated and not table.units.get(of) and same_unit(stated, unit) is False:
        rule = f"must be in the unit that the campaign says of '{of}', {unit}; nothing is converted"
        raise InputError(rule, field=u, value=stated, file=table.file, line=table.header_line or None)


def columns_of_run(curve: CurveTable, run: CurveRunTable, axes: AxisNames, table: Run) -> str:
    """Which columns are x, y and their uncertainties, with units, and which columns of numbers are not read."""
    said = [("x", axis_of(curve.x).column, axes.x_unit), ("y", y_axis(curve).column, axes.y_unit)]
    for key, entry, unit in (("u_y", run.u_y or curve.u_y, axes.y_unit), ("u_x", run.u_x or curve.u_x, axes.x_unit)):
        if isinstance(entry, ReadingErrorTable) and entry.column is not None:
            said.append((key, entry.column, unit))
    return columns_told(said, table.unread)


def of_curve(table: Table, name: str) -> Run:
    """The table as the run `name`, without warnings that are about rolling bodies."""
    return replace(run_of_table(table, name), warnings=of_any_curve(table.warnings))
