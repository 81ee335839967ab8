"""One sheet of a workbook (.xlsx, .ods) as lines of text, a line a row of the sheet, tabs between
the cells.

Values are read by the package python-calamine, those of formulas as the file keeps them.  It gives
nothing where a formula has an error or no value, and makes a place for every cell up to the last
one; so the XML of a sheet is looked through first, for such cells and for its size.
"""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Sequence
from datetime import date, datetime, time, timedelta
from itertools import product
from pathlib import PurePosixPath

from estim.common import Files, InputError, listed
from estim.reading.archive import opened, unpacked
from estim.reading.cells import looks_like_a_number
from estim.reading.dialect import Dialect, column_number
from estim.reading.markup import Attributes, parse_xml

_MAX_CELLS = 4_000_000
_MAX_BYTES = 128 * 1024**2  # of all parts, unpacked

Cells = dict[tuple[int, int], str]


def sheet_text(data: bytes, dialect: Dialect) -> tuple[str, str, tuple[str, ...]]:
    """The lines of the stated sheet, or of the first one with rows of numbers; its name; and the
    names of the others.  Raises InputError, also where python-calamine is missing.
    """
    try:
        from python_calamine import CalamineError, CalamineWorkbook
    except ImportError:
        rule = 'is a workbook, which needs python-calamine: pip install "estim[excel]"'
        raise InputError(f"{rule}, or save the table as CSV", field="file") from None
    parts = _parts(data)
    uncomputed = _uncomputed_of_ods(parts["content.xml"]) if "content.xml" in parts else None
    try:
        with CalamineWorkbook.from_filelike(io.BytesIO(_stored(parts))) as book:
            names = list(book.sheet_names)
            if dialect.sheet is not None and dialect.sheet not in names:
                rule = "names no sheet of the workbook"
                raise InputError(rule, field="sheet", value=dialect.sheet, quoted=listed(names))
            for name in names if dialect.sheet is None else [dialect.sheet]:
                missing = (
                    _uncomputed_of_xlsx(parts, names.index(name))
                    if uncomputed is None
                    else uncomputed.get(name, {})
                )
                rows = book.get_sheet_by_name(name).to_python(skip_empty_area=False)
                cells = [[_written(cell, dialect) for cell in row] for row in rows]
                for (row, column), text in missing.items():
                    cells += [[] for _ in range(row + 1 - len(cells))]
                    cells[row] += [""] * (column + 1 - len(cells[row]))
                    cells[row][column] = text
                if name == dialect.sheet or _has_numbers(cells):
                    return _lines(cells), name, tuple(other for other in names if other != name)
    except CalamineError as error:
        raise InputError("cannot be read as a workbook", quoted=str(error)) from None
    raise InputError("has no sheet with rows of numbers", field="workbook", quoted=listed(names))


def _parts(data: bytes) -> Files:
    """The members of a workbook that tables may need, by name.  Raises InputError."""
    parts, size = Files(), 0
    with opened(data) as archive:
        for info in archive.infolist():
            if info.filename.endswith((".xml", ".rels", "mimetype")):
                parts[info.filename] = unpacked(archive, info)
                size += len(parts[info.filename])
            if size > _MAX_BYTES:
                raise InputError(
                    f"grows beyond {_MAX_BYTES // 1024**2} MiB when it is unpacked",
                    field="workbook",
                    value=info.filename,
                )
    return parts


def _stored(parts: Files) -> bytes:
    """An archive of these parts, as they were unpacked here."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return stream.getvalue()


class _Sheet:
    """What is met in the XML of one sheet: the place of the cell, from 0, and cells without a value
    that have a formula or an error.
    """

    def __init__(self) -> None:
        self.row = self.column = -1
        self.most = [0, 0]
        self.uncomputed: Cells = {}

    def cell(self, rows: int, columns: int, text: str | None) -> None:
        """The cell that stands here, as many times as it is repeated from here."""
        ends = (self.row + rows, self.column + columns)
        self.most = [max(pair) for pair in zip(self.most, ends, strict=True)]
        if self.most[0] * self.most[1] > _MAX_CELLS:
            raise InputError(f"must have at most {_MAX_CELLS} cells", field="sheet")
        if text is not None:
            places = product(range(self.row, ends[0]), range(self.column, ends[1]))
            self.uncomputed |= dict.fromkeys(places, text)


def _uncomputed_of_xlsx(parts: Files, index: int) -> Cells:
    """Row and column of each cell of sheet number `index` that has an error or a formula without a
    value -> the text of the error, or = and the formula.
    """
    sheets, targets = list[str](), dict[str, str]()

    def of_book(tag: str, attributes: Attributes, _: str) -> None:
        if tag == "sheet":
            sheets.append(next(attributes[key] for key in attributes if key.endswith(":id")))
        elif tag == "Relationship":
            targets[attributes["Id"]] = attributes["Target"]

    parse_xml(parts.get("xl/workbook.xml", b"<none/>"), of_book)
    parse_xml(parts.get("xl/_rels/workbook.xml.rels", b"<none/>"), of_book)
    target = targets.get(sheets[index], "") if index < len(sheets) else ""
    part = str(PurePosixPath("/xl") / target)[1:]
    if part not in parts:
        raise InputError("is not in the workbook", field="sheet", value=target)
    sheet, texts = _Sheet(), dict[str, str]()

    def on_start(tag: str, attributes: Attributes, _: int) -> None:
        if tag == "row":
            sheet.row, sheet.column = int(attributes.get("r", sheet.row + 2)) - 1, -1
        elif tag == "c":
            texts.clear()
            place = attributes.get("r", "").rstrip("0123456789")
            sheet.column = column_number(place) if place else sheet.column + 1

    def on_end(tag: str, attributes: Attributes, text: str) -> None:
        texts[tag] = text
        if tag == "c":
            error = texts.get("v") if attributes.get("t") == "e" else None
            empty = "f" in texts and not texts.get("v")
            sheet.cell(1, 1, f"={texts['f']}" if empty else error)

    parse_xml(parts[part], on_end, on_start)
    return sheet.uncomputed


def _uncomputed_of_ods(content: bytes) -> dict[str, Cells]:
    """The same of every sheet, by its name."""
    uncomputed_cells, sheet, texts, rows = dict[str, Cells](), _Sheet(), list[str](), 1

    def on_start(tag: str, attributes: Attributes, _: int) -> None:
        nonlocal sheet, rows
        if tag == "table":
            sheet = _Sheet()
            uncomputed_cells[attributes.get("table:name", "")] = sheet.uncomputed
        elif tag == "table-row":
            sheet.row, sheet.column = sheet.row + 1, 0
            rows = int(attributes.get("table:number-rows-repeated", 1))
        elif tag in ("table-cell", "covered-table-cell"):
            texts.clear()

    def on_end(tag: str, attributes: Attributes, text: str) -> None:
        if tag == "p":
            texts.append(text)
        elif tag in ("table-cell", "covered-table-cell"):
            columns = int(attributes.get("table:number-columns-repeated", 1))
            kind, shown = attributes.get("office:value-type"), " ".join(texts)
            uncomputed = None
            if attributes.get("calcext:value-type") == "error" or shown.startswith(("#", "Err:")):
                uncomputed = shown
            elif "table:formula" in attributes and kind is None:
                uncomputed = attributes["table:formula"].removeprefix("of:")
            if kind is not None or shown or uncomputed:
                sheet.cell(rows, columns, uncomputed)
            sheet.column += columns
        elif tag == "table-row":
            sheet.row += rows - 1

    parse_xml(content, on_end, on_start)
    return uncomputed_cells


def _written(cell: object, dialect: Dialect) -> str:
    """A cell as a table in text would have it."""
    match cell:
        case bool():
            return str(cell).upper()
        case int() | float():
            return repr(cell).replace(".", "," if dialect.decimal == "comma" else ".")
        case datetime():
            return cell.isoformat(sep=" ")
        case date() | time():
            return cell.isoformat()
        case timedelta():
            minutes, seconds = divmod(cell.total_seconds(), 60)
            return f"{minutes // 60:.0f}:{minutes % 60:02.0f}:{seconds:09.6f}"
        case _:
            return " ".join(str(cell).split())


def _has_numbers(cells: Sequence[Sequence[str]]) -> bool:
    """Whether rows hold numbers, two in a row or more."""
    counts = [sum(map(looks_like_a_number, row)) for row in cells]
    return sum(count > 1 for count in counts) >= 2


def _lines(cells: Sequence[Sequence[str]]) -> str:
    stream = io.StringIO()
    csv.writer(stream, delimiter="\t", lineterminator="\n").writerows(cells)
    return stream.getvalue()
