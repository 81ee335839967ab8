"""What a page shows of a file before anything is asked: its columns, what the import told, a plot.

It runs in a worker process, in the folder of the file, and is shown by `pages`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import EstimError, as_json, language, spoken, write_whole

if TYPE_CHECKING:
    from estim.drawing import Figure


def preview(lang: str, file: str, *numbers: str) -> int:
    """The exit code.  Writes what was read of `file`, or the message why it cannot be read, told in
    the language `lang`; with two numbers of columns the picture of their points instead.
    """
    with spoken(lang):
        return _preview(Path(), file, *numbers)


def _preview(folder: Path, file: str, *numbers: str) -> int:
    try:
        if file.endswith(".toml"):
            write_whole(folder / preview_name(), as_json(_campaign(Path(file))))
            return 0
        columns, told = _columns(Path(file))
    except EstimError as error:
        write_whole(folder / preview_name(), as_json({"error": str(error)}))
        return 2
    if numbers:
        from estim.drawing import png

        x, y = map(int, numbers)
        picture = png(lambda: _points(columns[x], columns[y]))
        write_whole(folder / picture_name(x, y), picture)
        return 0
    x, y = _first_two([name for name, *_ in columns])
    seen = {"columns": _shown(columns), "told": told, "x": x, "y": y}
    write_whole(folder / preview_name(), as_json(seen))
    return 0


def preview_name() -> str:
    return f"preview-{language()}.json"


def picture_name(x: int, y: int) -> str:
    return f"points-{x}-{y}.png"


def _columns(file: Path) -> tuple[list[tuple[str, str, FloatArray]], Sequence[str]]:
    """Name, unit and numbers of each column, and what the import told."""
    from estim.curve_fitting import read_table
    from estim.reading import Choices, import_track, is_tracker_file, track_columns

    if is_tracker_file(file):
        imported = import_track(file, Choices())
        table = track_columns(imported, [])
        units = {"t": "s", "t_s": "s", "frame": ""}
        names = [name for name in ("t", "x", "y", "x_m") if name in table.columns]
        found = [(name, units.get(name, "m"), table.columns[name]) for name in names]
        return found, (*imported.facts, *imported.warnings)
    read = read_table(file)
    return [(name, read.units[name], column) for name, column in read.columns.items()], read.notes


def _shown(columns: Sequence[tuple[str, str, FloatArray]]) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "unit": unit,
            "n": int(column.size),
            "low": float(np.min(column)),
            "high": float(np.max(column)),
        }
        for name, unit, column in columns
    ]


def _first_two(names: Sequence[str]) -> tuple[int, int]:
    """Numbers of the first two columns that are not called as uncertainties of others."""
    values = [i for i, n in enumerate(names) if not n.startswith(("u_", "u("))] or [0]
    return values[0], values[min(1, len(values) - 1)]


def _points(x: tuple[str, str, FloatArray], y: tuple[str, str, FloatArray]) -> Figure:
    from estim.drawing import BLUE, new_figure

    figure = new_figure(3.2)
    ax = figure.subplots()
    ax.plot(x[2], y[2], "o", ms=3.5, color=BLUE)
    ax.set_xlabel(_label(x))
    ax.set_ylabel(_label(y))
    return figure


def _label(column: tuple[str, str, FloatArray]) -> str:
    name, unit, _ = column
    return f"{name} ({unit})" if unit else name


def _campaign(file: Path) -> dict[str, Any]:
    from estim.campaign import load_campaign

    campaign = load_campaign(file)
    return {"runs": list(campaign.run_names), "told": [campaign.source.title]}
