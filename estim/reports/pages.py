"""A report as files: the page and the figures that it shows, long tables in files beside it, and
the campaign that says the same as a command.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Collection, Iterable, Mapping
from urllib.parse import unquote

from estim.common import (
    FIGURE_CHOICES,
    FigureChoice,
    Files,
    Markdown,
    as_csv,
    as_json,
    phrase,
    require_one_of,
)
from estim.drawing import Figure, png
from estim.reports.rendering import CITED, FENCED, render

_CODE_OR_BREAK = re.compile(
    rf"(?P<code>{FENCED}|`[^`\n]*`|^#[^\n]*$)"
    r"|(?<=[\d)]) (?=(?:±|%|×|°|sd|mm|cm|m|s|kg|N|J|rad|Hz|deg)(?![\w]))|(?<=±) (?=\d)",
    re.DOTALL | re.MULTILINE,
)

_NUMBERED = re.compile(
    rf"{FENCED}"
    r"|^!\[(?P<alt>[^\n]*)\]\((?P<path>[^)\n]*)\)$"
    r"(?:\n\n+\*(?P<below>(?!\ue000)(?:\\.|(?!\n\n)[^*\\])+)\*(?=\n\n|\n?\Z))?"
    rf"|(?:^\*{CITED.pattern} *(?P<above>[^\n]*)\*\n\n+)?"
    r"(?P<head>^\|(?![ |]*\n)[^\n]*\n\|[-:| ]+\n)",
    re.DOTALL | re.MULTILINE,
)
"""Code; an image alone with the caption below it; a table's caption and head, but not that of a
list, whose columns have no names.
"""

Drawers = dict[str, "Callable[[], Figure]"]
"""Path of a figure -> what draws it."""
MOST_ROWS, MOST_COLUMNS, MOST_POINTS = 150, 60, 60
_CELLS = re.compile(r"(?<!\\)\|")
_CODE_TABLE_OR_LIST = re.compile(
    rf"{FENCED}"
    r"|(?:^\|[^\n]*\n)+|^- [^\n]*\n(?:(?:- |  )[^\n]*\n|\n+(?=- |  ))*",
    re.DOTALL | re.MULTILINE,
)


def unbroken(text: str) -> str:
    """Markdown whose numbers keep their "±", "%" and units on one line; code stays as it is."""
    return _CODE_OR_BREAK.sub(lambda match: match["code"] or "\u00a0", text)


def numbered(text: str) -> str:
    """Markdown whose figures and tables have numbers, in the order in which they stand, and whose
    sentences name them by these (`cited` of a template).

    The caption of a figure begins with its number; where there is none, it is the text in place of
    the image.  A table has its number above it, with the caption that a template gives it.
    """
    places: dict[str, str] = {}
    n_figure = n_table = 0

    def with_number(match: re.Match[str]) -> str:
        nonlocal n_figure, n_table
        if match["path"] is not None:
            n_figure += 1
            name = places[unquote(match["path"])] = phrase("Figure {n}", n=n_figure)
            words = match["below"] or f"{match['alt'].rstrip('.')}."
            return f"![{match['alt']}]({match['path']})\n\n*{name}. {words}*"
        if match["head"] is not None:
            n_table += 1
            name = places[match["cited"]] = phrase("Table {n}", n=n_table)
            return f"*{name}. {match['above'] or ''}".rstrip() + f"*\n\n{match['head']}"
        return match[0]

    return CITED.sub(lambda match: places[match["cited"]], _NUMBERED.sub(with_number, text))


def marked(figure: Figure) -> Figure:
    """The figure, saying of its data that they are SYNTHETIC."""
    title = figure.get_suptitle()
    figure.suptitle(
        phrase("{title}; SYNTHETIC data", title=title) if title else phrase("SYNTHETIC data")
    )
    return figure


def page(
    drawers: Drawers,
    template: str,
    records: Mapping[str, object] = {},
    *,
    figure_choice: FigureChoice,
    further: Drawers | None = None,
    kind: str = "",
    opened: Collection[str] = (),
    **values: object,
) -> Files:
    """The figures of `figure_choice`, `report.md` of a template filled with `values`, and the JSON
    of `records`, path -> bytes.

    drawers, further, kind : as in `images`.  opened : as in `render`.  Raises InputError.
    """
    drawn = images(drawers, figure_choice=figure_choice, further=further, kind=kind)
    text = finished(render(template, pictures=drawn, opened=opened, kind=kind, **values))
    files = {path: as_json(record) for path, record in records.items()}
    return drawn | {"report.md": text.encode()} | files


def images(
    drawers: Drawers, *, figure_choice: FigureChoice, further: Drawers | None = None, kind: str = ""
) -> Files:
    """The figures of `figure_choice`, path -> PNG.

    drawers, further : of the main figures, and of those that are drawn with the choice "all".
    kind : of the data; where they are "synthetic" every figure states it.

    Raises InputError.
    """
    require_one_of(figure_choice, FIGURE_CHOICES, field="figures")
    drawn = (
        {}
        if figure_choice == "none"
        else drawers | (further or {} if figure_choice == "all" else {})
    )
    finish = marked if kind == "synthetic" else None
    return {path: png(draw, finish) for path, draw in drawn.items()}


def finished(text: str) -> str:
    """Markdown with its numbers kept on one line, and its figures and tables numbered."""
    return numbered(unbroken(text))


def with_campaign(files: Files, text: str, *, file: str, command: str) -> Files:
    """The files of a report with the TOML `text` at its end, as they are where that is empty.

    text : no line of it begins with a grave accent, and all of it is printable.
    file : name of the table.
    command : by which the campaign is fit.
    """
    if not text:
        return dict(files)
    written = Markdown(text.rstrip())
    section = render("kept_campaign.md.j2", text=written, file=file, command=command)
    return {**files, "report.md": files["report.md"].rstrip() + b"\n\n" + section.encode()}


def shortened(text: str) -> Files:
    """`report.md` of a report in Markdown, and the files with what was taken out of it."""
    files: Files = {}

    def shorten(match: re.Match[str]) -> str:
        block = match[0]
        if block.startswith("|"):
            return _table(block, _name(files, text[: match.start()], "csv"), files)
        return (
            _list(block, _name(files, text[: match.start()], "md"), files)
            if block.startswith("- ")
            else block
        )

    return {"report.md": _CODE_TABLE_OR_LIST.sub(shorten, text).encode(), **files}


def _name(files: Files, before: str, kind: str) -> str:
    """A path that is still free, after the last heading."""
    heading = (
        unicodedata.normalize("NFKD", before.rpartition("\n#")[2].partition("\n")[0].lower())
        .encode("ascii", "ignore")
        .decode()
    )
    title = re.sub(r"[^a-z0-9]+", "-", heading).strip("-") or "table"
    names = [
        f"tables/{title}.{kind}",
        *(f"tables/{title}-{n}.{kind}" for n in range(2, len(files) + 3)),
    ]
    return next(name for name in names if name not in files)


def _table(block: str, path: str, files: Files) -> str:
    cells = [_CELLS.split(row)[1:-1] for row in block.splitlines()]
    n_row, n_column = len(cells) - 2, len(cells[0])
    if n_row <= MOST_ROWS and n_column <= MOST_COLUMNS:
        return block
    full = [[cell.strip().replace("\\|", "|") for cell in row] for row in (cells[0], *cells[2:])]
    files[path] = as_csv(full).encode()
    excerpt = cells[: 2 + 24] if n_row > MOST_ROWS else cells  # what is kept of a longer one
    rows = [f"|{'|'.join(row[:12] if n_column > MOST_COLUMNS else row)}|\n" for row in excerpt]
    return (
        "".join(rows)
        + "\n"
        + phrase(
            "All {rows} rows and {columns} columns: `{path}`.",
            rows=n_row,
            columns=n_column,
            path=path,
        )
        + "\n"
    )


def _list(block: str, path: str, files: Files) -> str:
    points = [match.start() for match in re.finditer(r"^- ", block, re.MULTILINE)]
    if len(points) <= MOST_POINTS:
        return block
    files[path] = block.encode()
    return (
        block[: points[12]]
        + "\n"
        + phrase("All {n} points: `{path}`.", n=len(points), path=path)
        + "\n"
    )


def with_formats(files: Files, formats: Iterable[str]) -> Files:
    """`files` of a report (path -> bytes) and, in each of `formats` ("html", "pdf"), `report.html`
    or `report.pdf` of its `report.md`.
    """
    outputs = dict(files)
    for name in formats if "report.md" in files else ():
        # what makes one is loaded when it is requested
        from estim.reports.html_page import html_page, pdf_page

        outputs[f"report.{name}"] = {"html": html_page, "pdf": pdf_page}[name](files)
    return outputs
