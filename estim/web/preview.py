"""What a page shows of a file before an answer: its columns, what the import told, a plot, and the
curve at which a search begins; and a report on paper.

It runs in a worker process, in the folder of the file, and is shown by `pages`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import EstimError, InputError, as_json, read_file, spoken, write_whole
from estim.web.question import options_of

if TYPE_CHECKING:
    from estim.drawing import Figure

_LARGEST = 2**28  # bytes of a part of a report


@dataclass(frozen=True, eq=False)
class _Column:
    name: str
    unit: str
    values: FloatArray


def preview(lang: str, file: str, *asked: str) -> None:
    """Writes what was read of `file`, or the message why it cannot be read, told in the language
    `lang`; with two numbers of columns the picture of their points instead, and of the columns of
    the same names in the files named behind the numbers.
    """
    with spoken(lang):
        try:
            seen = _campaign(Path(file)) if file.endswith(".toml") else _table(Path(file), *asked)
        except EstimError as error:
            seen = {"error": str(error), "field": getattr(error, "field", "")}
        if isinstance(seen, dict) and not file.endswith(".toml"):
            from estim.reading import is_track

            seen["track"] = is_track(Path(file))
    name = picture_name(*asked[:2]) if isinstance(seen, bytes) else preview_name(lang)
    write_whole(Path(name), seen if isinstance(seen, bytes) else as_json(seen))


def start(lang: str, file: str, asked: str) -> None:
    """Writes where the search for the curve of a question begins: its parameters and a picture, or
    the message why it cannot, told in the language `lang`.

    asked : fields of the page, as JSON.
    """
    name = start_name(lang, asked)
    with spoken(lang):
        try:
            values, picture = _start(Path(file), json.loads(asked))
            write_whole(Path(f"{name}.png"), picture)
            seen: dict[str, Any] = {"values": values}
        except InputError as error:
            seen = {"error": str(error), "field": error.field or ""}
    write_whole(Path(f"{name}.json"), as_json(seen))


def paper(lang: str) -> None:
    """Writes report.pdf of the report in the folder report/, in the language `lang`."""
    from estim.reports.html_page import pdf_page

    root = Path("report")
    paths = [path for path in root.rglob("*") if path.suffix in (".md", ".png")]
    files = {
        path.relative_to(root).as_posix(): read_file(path, at_most=_LARGEST) or b""
        for path in paths
    }
    with spoken(lang):
        write_whole(Path("report.pdf"), pdf_page(files))


def start_name(lang: str, asked: str) -> str:
    """The name of the files of `start`: start-N, the same for the same question."""
    return f"start-{int(sha256((lang + asked).encode()).hexdigest()[:12], 16)}"


def preview_name(lang: str) -> str:
    return f"preview-{lang}.json"


def picture_name(x: str, y: str) -> str:
    return f"points-{x}-{y}.png"


def _table(file: Path, *asked: str) -> dict[str, Any] | bytes:
    """The columns of a file and which two a fit would take, or the picture of two of them."""
    from estim.reading import is_tracker_file

    columns, told, tracks = _read(file)
    if asked:
        from estim.drawing import png

        tables = {file.name: columns}
        for other in map(Path, asked[2:]):
            with suppress(EstimError):  # its own answer says what is wrong
                tables[other.name] = _read(other)[0]
        pair = [columns[int(number)] for number in asked[:2]]
        return png(lambda: _points(pair[0], pair[1], tables))
    values = [  # a column of one value, a date say, is not asked about
        i
        for i, column in enumerate(columns)
        if not column.name.startswith(("u_", "u(")) and np.ptp(column.values) > 0.0
    ] or [0]
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
    y = values[:2][-1]
    if is_tracker_file(file):  # of the two axes the one along which more happens
        y = max((1, 2), key=lambda i: float(np.ptp(columns[i].values)))
    return {"columns": shown, "told": told, "tracks": tracks, "x": values[0], "y": y}


def _read(file: Path) -> tuple[list[_Column], Sequence[str], Sequence[str]]:
    """The columns of a table or a track, what the import told, and the tracks where there are
    several: the columns are those of the first.
    """
    from estim.curve_fitting import read_table
    from estim.reading import Choices, import_track, is_tracker_file, track_columns

    if is_tracker_file(file):
        tracks = list[str]()
        try:
            imported = import_track(file, Choices())
        except InputError as error:
            if error.field != "track":
                raise
            tracks = error.quoted.split(", ")
            imported = import_track(file, Choices(tracks[0]))
        units = {"t": "s", "x": "m", "y": "m", "x_m": "m"}
        track = track_columns(imported, list(units)).columns
        columns = [_Column(name, unit, track[name]) for name, unit in units.items()]
        return columns, (*imported.facts, *imported.warnings), tracks
    table = read_table(file)
    found = [_Column(name, table.units[name], values) for name, values in table.columns.items()]
    return found, table.notes, ()


def _start(file: Path, fields: Mapping[str, str]) -> tuple[dict[str, float], bytes]:
    """Parameters of a curve at its start, and the picture.  What nobody stated and the curve is
    linear in, it has no start of its own: it is solved for.  Raises InputError.
    """
    from estim.campaign import campaign_of_table, choices_of_table
    from estim.drawing import png
    from estim.problem import Flat

    choices = choices_of_table(options_of(fields))
    campaign = campaign_of_table(file, choices)
    problem = campaign.problem(campaign.run_names)
    (run,) = problem.runs
    values = dict(zip(problem.names, problem.start().tolist(), strict=True))
    linear = [
        p.name
        for p in problem.parameters
        if isinstance(p.prior, Flat) and p.prior.start_stated and p.name not in choices.start
    ]
    linear = [name for name in linear if name in run.curve_parameters]
    if linear:
        local = run.curve.local(run.x, run.bind(values))
        gradient = [np.broadcast_to(local.gradient[name], local.value.shape)[0] for name in linear]
        step = np.linalg.lstsq(np.transpose(gradient), run.y - local.value[0], rcond=None)[0]
        values |= {name: values[name] + float(by) for name, by in zip(linear, step, strict=True)}
    grid = run.along(run.x[0], run.x[-1], 400)
    curve = run.curve.value(grid, run.bind(values))[0]
    axes = (run.x_name, run.x_unit, run.x), (run.y_name, run.y_unit, run.y)
    x, y = (_Column(name, "" if unit == "1" else unit, points) for name, unit, points in axes)
    shown = {name: values[name] for name in problem.names if name in run.curve_parameters}
    return shown, png(lambda: _points(x, y, {file.stem: [x, y]}, (grid, curve)))


def _points(
    x: _Column,
    y: _Column,
    tables: Mapping[str, Sequence[_Column]],
    curve: tuple[FloatArray, FloatArray] | None = None,
) -> Figure:
    from estim.drawing import COLOURS, ORANGE, new_figure

    figure = new_figure(3.2)
    ax = figure.subplots()
    for i, (table, columns) in enumerate(tables.items()):
        values = {column.name: column.values for column in columns}
        if {x.name, y.name} <= values.keys():
            colour = COLOURS[i % len(COLOURS)]
            ax.plot(values[x.name], values[y.name], "o", ms=3.5, color=colour, label=table)
    if 1 < len(tables) <= len(COLOURS):
        ax.legend()
    if curve is not None:
        ax.plot(*curve, color=ORANGE)
    for column, name in ((x, ax.set_xlabel), (y, ax.set_ylabel)):
        name(f"{column.name} ({column.unit})" if column.unit else column.name)
    return figure


def _campaign(file: Path) -> dict[str, Any]:
    from estim.campaign import load_campaign

    campaign = load_campaign(file)
    return {"runs": campaign.run_names, "told": [campaign.source.title]}
