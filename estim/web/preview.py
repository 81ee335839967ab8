"""What a page shows of a file before an answer: its columns, the notes of the import, a plot, and
the curve at which a search begins; and a report on paper.

It runs in a worker process, in the folder of the file, and is shown by `pages`.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import EstimError, InputError, as_json, read_file, spoken, write_whole
from estim.web.question import Fields, options_of

if TYPE_CHECKING:
    from estim.curve_fitting import TableColumns
    from estim.drawing import Figure


def preview(lang: str, file: str, *arguments: str) -> None:
    """Writes what was read of `file`, or the message why it cannot be read, in the language
    `lang`; with two numbers of columns the picture of their points instead, and of the columns of
    the same names in the files named behind the numbers.
    """
    with spoken(lang):
        try:
            content = (
                _campaign(Path(file)) if file.endswith(".toml") else _table(Path(file), *arguments)
            )
        except EstimError as error:
            content = {"error": str(error), "field": getattr(error, "field", "")}
        if isinstance(content, dict) and not file.endswith(".toml"):
            from estim.reading import is_track

            content["track"] = is_track(Path(file))
    name = picture_name(*arguments[:2]) if isinstance(content, bytes) else preview_name(lang)
    write_whole(Path(name), content if isinstance(content, bytes) else as_json(content))


def start(lang: str, file: str, question: str) -> None:
    """Writes where the search for the curve of a question begins: its parameters and a picture, or
    the message why it cannot, in the language `lang`.

    question : fields of the page, as JSON.
    """
    name = start_name(lang, question)
    with spoken(lang):
        try:
            values, picture = _start(Path(file), json.loads(question))
            write_whole(Path(f"{name}.png"), picture)
            content: dict[str, Any] = {"values": values}
        except InputError as error:
            content = {"error": str(error), "field": error.field or ""}
    write_whole(Path(f"{name}.json"), as_json(content))


def paper(lang: str) -> None:
    """Writes report.pdf of the report in the folder report/, in the language `lang`."""
    from estim.reports.html_page import pdf_page

    root = Path("report")
    paths = [path for path in root.rglob("*") if path.suffix in (".md", ".png")]
    files = {path.relative_to(root).as_posix(): read_file(path) or b"" for path in paths}
    with spoken(lang):
        write_whole(Path("report.pdf"), pdf_page(files))


def start_name(lang: str, question: str) -> str:
    """The name of the files of `start`: start-N, the same for the same question."""
    return f"start-{int(sha256((lang + question).encode()).hexdigest()[:12], 16)}"


def preview_name(lang: str) -> str:
    return f"preview-{lang}.json"


def picture_name(x: str, y: str) -> str:
    return f"points-{x}-{y}.png"


def _table(file: Path, *arguments: str) -> dict[str, Any] | bytes:
    """The columns of a file and which two a fit would take, or the picture of two of them."""
    from estim.reading import is_tracker_file

    table, tracks = _read(file)
    names = list(table.columns)
    if arguments:
        from estim.drawing import png

        tables = {file.name: table}
        for other in map(Path, arguments[2:]):
            with suppress(EstimError):  # its own answer reports the error
                tables[other.name] = _read(other)[0]
        x_name, y_name = (names[int(number)] for number in arguments[:2])
        return png(lambda: _points(x_name, y_name, tables))
    heights = [float(np.ptp(values)) for values in table.columns.values()]
    values = [  # a column of one value, a date say, is not asked about
        i for i, name in enumerate(names) if not name.startswith(("u_", "u(")) and heights[i] > 0.0
    ] or [0]
    shown = [
        {
            "name": name,
            "unit": table.units[name],
            "n": column.size,
            "low": column.min(),
            "high": column.max(),
        }
        for name, column in table.columns.items()
    ]
    y = values[:2][-1]
    if is_tracker_file(file):  # of the two axes the one along which more happens
        y = max((1, 2), key=heights.__getitem__)
    return {"columns": shown, "told": table.notes, "tracks": tracks, "x": values[0], "y": y}


def _read(file: Path) -> tuple[TableColumns, Sequence[str]]:
    """The columns of a table or a track, and the tracks where there are several: the columns are
    those of the first.
    """
    from estim.curve_fitting import TableColumns, read_table
    from estim.reading import Choices, import_track, is_tracker_file, track_columns

    if not is_tracker_file(file):
        return read_table(file), ()
    tracks = list[str]()
    try:
        imported = import_track(file, Choices())
    except InputError as error:
        if error.field != "track":
            raise
        tracks = error.quoted.split(", ")
        imported = import_track(file, Choices(tracks[0]))
    track = track_columns(imported, ("t", "x", "y", "x_m"))
    return TableColumns(track.columns, track.units, (*imported.facts, *imported.warnings)), tracks


def _start(file: Path, fields: Fields) -> tuple[dict[str, float], bytes]:
    """Parameters of a curve at its start, and the picture.  Raises InputError."""
    from estim.campaign import campaign_of_table, choices_of_table
    from estim.curve_fitting import TableColumns
    from estim.drawing import png

    choices = choices_of_table(options_of(fields))
    campaign = campaign_of_table(file, choices)
    problem = campaign.problem(campaign.run_names)
    (run,) = problem.runs
    values = dict(zip(problem.names, problem.start().tolist(), strict=True))
    grid = run.along(run.x[0], run.x[-1], 400)
    curve = run.curve.value(grid, run.bind(values))[0]
    x, y = run.x_label, run.y_label  # two quantities may have one name
    points = TableColumns({x: run.x, y: run.y}, {x: "", y: ""})
    shown = {name: values[name] for name in problem.names if name in run.curve_parameters}
    return shown, png(lambda: _points(x, y, {file.stem: points}, (grid, curve)))


def _points(
    x: str,
    y: str,
    tables: Mapping[str, TableColumns],
    curve: tuple[FloatArray, FloatArray] | None = None,
) -> Figure:
    """The columns x and y of those `tables` that have both; of the first one are their units."""
    from estim.drawing import COLOURS, ORANGE, new_figure

    figure = new_figure(3.2)
    ax = figure.subplots()
    for i, (name, table) in enumerate(tables.items()):
        if {x, y} <= table.columns.keys():
            colour = COLOURS[i % len(COLOURS)]
            ax.plot(table.columns[x], table.columns[y], "o", color=colour, label=name)
    if 1 < len(tables) <= len(COLOURS):
        ax.legend()
    if curve is not None:
        ax.plot(*curve, color=ORANGE)
    units = next(iter(tables.values())).units
    for name, label in ((x, ax.set_xlabel), (y, ax.set_ylabel)):
        unit = f" ({units[name]})" if units[name] else ""
        label(name if name.endswith(unit) else name + unit)
    return figure


def _campaign(file: Path) -> dict[str, Any]:
    from estim.campaign import load_campaign

    campaign = load_campaign(file)
    return {"runs": campaign.run_names, "told": [campaign.source.title]}
