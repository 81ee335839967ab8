"""The mean of a column of a table, and which column is what."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from estim.arrays import FloatArray
from estim.common import InputError, in_file, listed, read_number
from estim.means.averages import Mean, mean
from estim.reading import (
    PLAIN,
    Dialect,
    bare_name,
    columns_sentence,
    is_column,
    is_missing,
    read_layout,
    table_of,
    uncertainty_of,
    value_columns,
)


@dataclass(frozen=True, eq=False)
class TableMean:
    """The mean of the column `name`.  labels : of the values, their groups or lines.  told : which
    columns are what.  facts : how the table was read; both in words.
    """

    path: Path
    sha256: str
    name: str
    unit: str
    mean: Mean
    labels: tuple[str, ...]
    told: str
    facts: tuple[str, ...]


def mean_of_table(
    path: Path,
    *,
    y: str | None = None,
    u_y: str | None = None,
    group: str | None = None,
    dialect: Dialect = PLAIN,
) -> TableMean:
    """The mean of the values in column `y` of the table at `path`.

    y : None for the only column of values.  u_y : column or number; None for "u_NAME" if there, not
        beside groups.  group : column that names the group of a reading, in any words.
    Raises InputError with file, line, column, rule and value.
    """
    layout = read_layout(path, dialect)
    names = [bare_name(name) for name in value_columns(layout, (u_y, group))]
    if y is None and len(names) != 1:
        rule = "must be named by --y"
        raise InputError(
            rule, field="column", quoted=f"there are {listed(names)}", file=layout.file
        )
    name = y or names[0]
    u = u_y or (None if group else uncertainty_of(name, layout.names))
    errors: FloatArray | float | None = None
    column = ""
    if u is not None:
        try:
            errors = read_number(u)
        except ValueError:
            column = u if u in layout.names else bare_name(u)
            if u.endswith("%") and u not in layout.names:
                rule = "must be a number or a column: put the share of each value in a column"
                raise InputError(rule, field="--u-y", value=u) from None
    table = table_of(layout, [name, *filter(None, (column,))], 2)
    if column:
        errors = table.columns[column]
        table.require_unit(column, name)
        table.require(column, table.columns[column] > 0.0, "must be > 0")
    groups = None
    if group is not None:
        places = [i for i, n in enumerate(layout.names) if is_column(group, [n])]
        if len(places) != 1:
            rule = f"must be one of {listed(layout.names)}"
            raise InputError(rule, field="--group", value=group, file=layout.file)
        cells = {row.number: row.cells[places[0]] for row in layout.rows}
        groups = [cells[int(line)] for line in table.lines]
        blank = next((i for i, cell in enumerate(groups) if is_missing(cell)), None)
        if blank is not None:
            rule = "must say the group of every reading, not only of the first one in a group"
            line = int(table.lines[blank])
            raise InputError(rule, field=group, value=groups[blank], file=layout.file, line=line)
    with in_file(path):
        result = mean(table.columns[name], errors, groups=groups)
    used = [(k, n, table.units[n]) for k, n in (("y", name), ("u_y", column)) if n in table.columns]
    labels = groups or [str(line) for line in table.lines]
    return TableMean(
        path,
        table.sha256,
        bare_name(name),
        table.units[name] or "1",
        result,
        tuple(labels),
        columns_sentence(
            [*used, *([("group", group, "")] if group else [])],
            [unread for unread in table.unread if not (group and is_column(group, [unread]))],
        ),
        (*table.facts, *table.warnings),
    )
