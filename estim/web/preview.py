"""What a page shows of a file before anything is asked: its columns, what the import told, a plot.

It runs in a worker process, in the folder of the file, and is shown by `pages`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from estim.arrays import FloatArray
from estim.common import EstimError, as_json, spoken, write_whole

if TYPE_CHECKING:
    from estim.drawing import Figure


@dataclass(frozen=True, eq=False)
class _Column:
    name: str
    unit: str
    values: FloatArray


def preview(lang: str, file: str, *numbers: str) -> None:
    """Writes what was read of `file`, or the message why it cannot be read, told in the language
    `lang`; with two numbers of columns the picture of their points instead.
    """
    with spoken(lang):
        try:
            seen = _campaign(Path(file)) if file.endswith(".toml") else _table(Path(file), *numbers)
        except EstimError as error:
            seen = {"error": str(error)}
        if isinstance(seen, dict) and not file.endswith(".toml"):
            from estim.reading import is_track

            seen["track"] = is_track(Path(file))
    name = picture_name(*numbers) if isinstance(seen, bytes) else preview_name(lang)
    write_whole(Path(name), seen if isinstance(seen, bytes) else as_json(seen))


def preview_name(lang: str) -> str:
    return f"preview-{lang}.json"


def picture_name(x: str, y: str) -> str:
    return f"points-{x}-{y}.png"


def _table(file: Path, *numbers: str) -> dict[str, Any] | bytes:
    """The columns of a file and which two a fit would take, or the picture of two of them."""
    columns, told = _read(file)
    if numbers:
        from estim.drawing import png

        return png(lambda: _points(*(columns[int(number)] for number in numbers)))
    values = [i for i, c in enumerate(columns) if not c.name.startswith(("u_", "u("))] or [0]
    shown = [
        {
            "name": column.name,
            "unit": column.unit,
            "n": column.values.size,
            "low": column.values.min(),
            "high": column.values.max(),
        }
        for column in columns
    ]
    return {"columns": shown, "told": told, "x": values[0], "y": values[:2][-1]}


def _read(file: Path) -> tuple[list[_Column], Sequence[str]]:
    """The columns of a table or a track, and what the import told."""
    from estim.curve_fitting import read_table
    from estim.reading import Choices, import_track, is_tracker_file, track_columns

    if is_tracker_file(file):
        imported = import_track(file, Choices())
        units = {"t": "s", "x": "m", "y": "m", "x_m": "m"}
        track = track_columns(imported, list(units)).columns
        columns = [_Column(name, unit, track[name]) for name, unit in units.items()]
        return columns, (*imported.facts, *imported.warnings)
    table = read_table(file)
    found = [_Column(name, table.units[name], values) for name, values in table.columns.items()]
    return found, table.notes


def _points(x: _Column, y: _Column) -> Figure:
    from estim.drawing import BLUE, new_figure

    figure = new_figure(3.2)
    ax = figure.subplots()
    ax.plot(x.values, y.values, "o", ms=3.5, color=BLUE)
    for column, name in ((x, ax.set_xlabel), (y, ax.set_ylabel)):
        name(f"{column.name} ({column.unit})" if column.unit else column.name)
    return figure


def _campaign(file: Path) -> dict[str, Any]:
    from estim.campaign import load_campaign

    campaign = load_campaign(file)
    return {"runs": campaign.run_names, "told": [campaign.source.title]}
