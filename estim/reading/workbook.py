"""One sheet of a workbook (.xlsx, .ods) as lines of text, a line a row of the sheet, tabs between
the cells.

Values are read by the package python-calamine, those of formulas as the file keeps them; where a
formula has an error or no value, the cell is empty.  The package makes a place for every cell up to
the last one, so the XML is looked through first for how far the sheets reach.
"""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections.abc import Sequence
from datetime import date, datetime, time, timedelta

from estim.common import Files, InputError, listed
from estim.reading.archive import opened, unpacked
from estim.reading.cells import looks_like_a_number
from estim.reading.dialect import Dialect, column_number
from estim.reading.markup import Attributes, parse_xml

_MAX_CELLS = 4_000_000
_MAX_BYTES = 128 * 1024**2  # of all parts, unpacked
_PLACE = re.compile(r"([A-Z]{1,3})(\d{1,7})", re.ASCII)  # of a cell


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
    for name, part in parts.items():
        if name.endswith(".xml"):
            _check_sheets(part, ods="xl/workbook.xml" not in parts)
    try:
        with CalamineWorkbook.from_filelike(io.BytesIO(_stored(parts))) as book:
            names = list(book.sheet_names)
            if dialect.sheet is not None and dialect.sheet not in names:
                rule = "names no sheet of the workbook"
                raise InputError(rule, field="sheet", value=dialect.sheet, quoted=listed(names))
            for name in names if dialect.sheet is None else [dialect.sheet]:
                rows = book.get_sheet_by_name(name).to_python(skip_empty_area=False)
                cells = [[_written(cell, dialect) for cell in row] for row in rows]
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


def _check_sheets(xml: bytes, *, ods: bool) -> None:
    """Raises InputError where a sheet of .xlsx or .ods (all in one `xml`) reaches over too many
    cells, or shows an error in a cell of which OpenOffice says that it is the number 0.
    """
    row = column = repeated = last_row = last_column = 0
    number = False

    def on_end(tag: str, _: Attributes, text: str) -> None:
        if tag == "p" and number and text.startswith(("#", "Err:")):
            raise InputError("must be a number", field="cell", value=text, line=row + 1)

    def on_start(tag: str, attributes: Attributes, _: int) -> None:
        nonlocal row, column, repeated, last_row, last_column, number
        n, filled = 0, False
        match tag:
            case "table" if ods:
                row = repeated = last_row = last_column = 0
            case "row":
                row, column = int(attributes.get("r", row + 1)), 0
            case "table-row":
                row, column = row + repeated, 0
                repeated = int(attributes.get("table:number-rows-repeated", 1))
            case "c":
                place = _PLACE.fullmatch(attributes.get("r", ""))
                if place is not None:
                    row, column = int(place[2]), column_number(place[1])
                n, filled = 1, True
            case "table-cell" | "covered-table-cell":
                n = int(attributes.get("table:number-columns-repeated", 1))
                filled = "office:value-type" in attributes
                number = attributes.get("office:value-type", "string") != "string"
        column += n
        if filled:
            last_row, last_column = max(last_row, row + repeated), max(last_column, column)
        if last_row * last_column > _MAX_CELLS:
            raise InputError(f"must have at most {_MAX_CELLS} cells", field="sheet")

    parse_xml(xml, on_end, on_start)


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
