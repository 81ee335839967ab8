"""One sheet of a workbook (.xlsx, .ods) as lines of text, a line a row of the sheet, tabs between
the cells.

Values are read by the package python-calamine, those of formulas as the file keeps them; where a
formula has an error, the cell is empty.  The package makes a place for every cell up to the last
one, so the XML is looked through first for how far the sheets reach; also for what is hidden, shown
in per cent, or a formula without a value, none of which it tells.
"""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date, datetime, time, timedelta
from decimal import Decimal
from urllib.parse import urljoin

from estim.common import Files, InputError, listed, phrase
from estim.reading.archive import opened, unpacked
from estim.reading.cell_formats import holds_a_value
from estim.reading.cells import NOT_COMPUTED, is_formula
from estim.reading.dialect import Dialect, cell_name, column_number
from estim.reading.markup import Attributes, parse_xml
from estim.reading.table import line_numbers

_MAX_CELLS = 4_000_000
_MAX_BYTES = 128 * 1024**2  # of all parts, unpacked
_MAX_COLUMNS = 16_384  # of a sheet
_TABLE = 2  # cells with values in a row
_RELATIONS = "xl/_rels/workbook.xml.rels"
_LITERAL = re.compile(r'"[^"]*"|\[[^\]]*\]|[\\_*].')  # in the number format of a cell
_PLACE = re.compile(r"([A-Z]{1,3})(\d{1,7})", re.ASCII)  # of a cell


@dataclass(frozen=True)
class _Sheet:
    """What python-calamine does not say of a sheet; rows and columns are counted from 0.

    hidden_rows : those that hold something.
    texts : row -> column -> what the cell holds instead: a share in per cent, the error that it
        shows, a formula that was never computed.
    """

    hidden_rows: set[int] = field(default_factory=set)
    hidden_columns: set[int] = field(default_factory=set)
    texts: dict[int, dict[int, str]] = field(default_factory=dict)


def sheet_text(data: bytes, dialect: Dialect) -> tuple[str, tuple[str, ...]]:
    """The lines of the stated sheet, or of the first one with rows of numbers among those that are
    not hidden; and what was chosen, in words.  Raises InputError, also where python-calamine is
    missing.
    """
    try:
        from python_calamine import CalamineError, CalamineWorkbook, SheetVisibleEnum
    except ImportError:
        rule = 'is a workbook, which needs python-calamine: pip install "estim[excel]"'
        raise InputError(f"{rule}, or save the table as CSV", field="file") from None
    parts = _parts(data)
    sheets = _sheets(parts)
    tables, widths = dict[str, tuple[list[list[str]], tuple[str, ...]]](), dict[str, int]()
    try:
        with CalamineWorkbook.from_filelike(io.BytesIO(_stored(parts))) as book:
            names = list(book.sheet_names)
            if dialect.sheet is not None and dialect.sheet not in names:
                rule = "names no sheet of the workbook"
                raise InputError(rule, field="sheet", value=dialect.sheet, quoted=listed(names))
            shown = [
                sheet.name
                for sheet in book.sheets_metadata
                if sheet.visible == SheetVisibleEnum.Visible
            ]
            for name in shown if dialect.sheet is None else [dialect.sheet]:
                rows = book.get_sheet_by_name(name).to_python(skip_empty_area=False)
                tables[name] = _shown(rows, sheets.get(name, _Sheet()), dialect)
                widths[name] = _width(tables[name][0])
                if widths[name] == _TABLE:
                    break
    except CalamineError as error:
        raise InputError("cannot be read as a workbook", quoted=str(error)) from None
    name = max(widths, key=widths.__getitem__, default="")
    if not widths.get(name):
        raise _no_numbers(tables, names)
    cells, facts = tables[name]
    others = [other for other in names if other != name]
    if others and dialect.sheet is None:
        fact = phrase(
            "read from sheet '{sheet}', the first with a table (others: {others})",
            sheet=name,
            others=listed(others),
        )
        facts = (fact, *facts)
    return _lines(cells), facts


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


def _looked_through(xml: bytes, *, ods: bool, percent: set[str]) -> dict[str, _Sheet]:
    """The sheets of an .ods by their names, or the one of a part of an .xlsx by "".

    percent : numbers of the styles of cells (.xlsx) that show shares in per cent.  Raises
    InputError where a sheet reaches over too many cells.
    """
    sheet = _Sheet()
    sheets = {"": sheet}
    row = column = rows = columns = last_row = last_column = depth = depth_of_cell = 0
    hidden = filled = False
    cell, parts = Attributes(), dict[str, str]()

    def on_start(tag: str, attributes: Attributes, _: int) -> None:
        nonlocal sheet, row, column, rows, columns, last_row, last_column, depth, depth_of_cell
        nonlocal hidden, filled, cell
        depth += 1
        match tag:
            case "table" if ods:
                row = column = rows = columns = last_row = last_column = 0
                sheet = sheets[attributes.get("table:name", "")] = _Sheet()
            case "col" | "table-column":
                first = column if ods else max(column, int(attributes.get("min", 1)) - 1)
                n = int(attributes.get("table:number-columns-repeated", 1))
                column = min(first + n if ods else int(attributes.get("max", 0)), _MAX_COLUMNS)
                if _is_hidden(attributes):
                    sheet.hidden_columns.update(range(first, column))
            case "row" | "table-row":
                row = row + rows if ods else int(attributes.get("r", row + rows + 1)) - 1
                rows = int(attributes.get("table:number-rows-repeated", 1))
                column = columns = 0
                hidden, filled = _is_hidden(attributes), False
            case "c" | "table-cell" | "covered-table-cell":
                column += columns
                columns = int(attributes.get("table:number-columns-repeated", 1))
                place = _PLACE.fullmatch(attributes.get("r", ""))
                if place is not None:
                    row, column = int(place[2]) - 1, column_number(place[1])
                cell, depth_of_cell = attributes, depth
                parts.clear()
                if not ods or {"office:value-type", "table:formula"} & {*attributes}:
                    filled = True
                    last_row = max(last_row, row + rows)
                    last_column = max(last_column, column + columns)
        if last_row * last_column > _MAX_CELLS:
            raise InputError(f"must have at most {_MAX_CELLS} cells", field="sheet")

    def on_end(tag: str, _: Attributes, text: str) -> None:
        nonlocal depth
        depth -= 1
        match tag:
            case "f" | "v" | "p" if depth == depth_of_cell:
                parts.setdefault(tag, text)
            case "row" | "table-row" if hidden and filled:
                sheet.hidden_rows.update(range(row, row + rows))
            case "c" | "table-cell" | "covered-table-cell":
                written = _ods_text(cell, parts) if ods else _xlsx_text(cell, parts, percent)
                for place in range(row, row + rows) if written else ():
                    shown = dict.fromkeys(range(column, column + columns), written)
                    sheet.texts.setdefault(place, {}).update(shown)

    parse_xml(xml, on_end, on_start)
    return sheets


def _is_hidden(attributes: Attributes) -> bool:
    """Whether a row or a column is hidden, or filtered out."""
    return (
        attributes.get("hidden") in ("1", "true")
        or attributes.get("table:visibility", "visible") != "visible"
    )


def _xlsx_text(cell: Attributes, parts: Mapping[str, str], percent: set[str]) -> str:
    """What a cell of an .xlsx holds, where python-calamine says otherwise; else ""."""
    value = parts.get("v", "").strip()
    if cell.get("t", "n") != "n":
        return ""
    if not value:
        return f"={parts['f']}" if "f" in parts else ""
    return _in_percent(value) if cell.get("s") in percent else ""


def _ods_text(cell: Attributes, parts: Mapping[str, str]) -> str:
    """What a cell of an .ods holds, where python-calamine says otherwise; else "".  OpenOffice says
    of an error that it is the number 0.
    """
    kind, text = cell.get("office:value-type"), parts.get("p", "")
    if kind is None:
        return f"={cell['table:formula'].partition('=')[2]}" if "table:formula" in cell else ""
    if kind != "string" and text.startswith(("#", "Err:")):
        return text
    return _in_percent(cell.get("office:value", "")) if kind == "percentage" else ""


def _in_percent(share: str) -> str:
    return f"{Decimal(repr(float(share))).scaleb(2).normalize():f}%"


def _percent_styles(xml: bytes) -> set[str]:
    """Numbers of the styles of cells in styles.xml that show shares in per cent."""
    formats, styles = {"9", "10"}, list[str]()  # these two have no code in the file
    within = ""

    def on_start(tag: str, attributes: Attributes, _: int) -> None:
        nonlocal within
        if tag == "numFmt" and "%" in _LITERAL.sub("", attributes.get("formatCode", "")):
            formats.add(attributes.get("numFmtId", ""))
        if tag in ("cellXfs", "cellStyleXfs", "dxfs"):
            within = tag
        elif tag == "xf" and within == "cellXfs":
            styles.append(attributes.get("numFmtId", ""))

    parse_xml(xml, lambda *_: None, on_start)
    return {str(i) for i, style in enumerate(styles) if style in formats}


def _sheets(parts: Files) -> dict[str, _Sheet]:
    """The sheets of a workbook by their names.  Raises InputError."""
    ods = "xl/workbook.xml" not in parts
    percent = _percent_styles(parts["xl/styles.xml"]) if "xl/styles.xml" in parts else set()
    found = {
        name: _looked_through(part, ods=ods, percent=percent)
        for name, part in parts.items()
        if name.endswith(".xml")
    }
    if ods:
        return found["content.xml"]
    targets, sheets = dict[str, str](), dict[str, _Sheet]()

    def on_relation(tag: str, attributes: Attributes, _: int) -> None:
        if tag == "Relationship":
            target = urljoin("/xl/", attributes.get("Target", ""))
            targets[attributes.get("Id", "")] = target.lstrip("/")

    def on_sheet(tag: str, attributes: Attributes, _: int) -> None:
        if tag == "sheet":
            key = next((value for name, value in attributes.items() if name.endswith(":id")), "")
            part = found.get(targets.get(key, ""), {"": _Sheet()})
            sheets[attributes.get("name", "")] = part[""]

    if _RELATIONS in parts:
        parse_xml(parts[_RELATIONS], lambda *_: None, on_relation)
    parse_xml(parts["xl/workbook.xml"], lambda *_: None, on_sheet)
    return sheets


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


def _shown(
    values: list[list[object]], sheet: _Sheet, dialect: Dialect
) -> tuple[list[list[str]], tuple[str, ...]]:
    """The cells of a sheet as a table in text would have them, a comment in the place of each row
    that is hidden; and what is hidden, in words.
    """
    cells = [[_written(value, dialect) for value in row] for row in values]
    for r, texts in sheet.texts.items():
        cells += [[] for _ in range(r + 1 - len(cells))]
        cells[r] += [""] * (max(texts) + 1 - len(cells[r]))
        for c, text in texts.items():
            cells[r][c] = text.replace(".", "," if dialect.decimal == "comma" else ".")
    lines, columns = dialect.within
    rows = [
        line
        for line, row in enumerate(cells, 1)
        if line - 1 in sheet.hidden_rows and line in lines and any(row[columns])
    ]
    for line in rows:
        cells[line - 1] = ["#"]
    width = max(map(len, cells), default=0)
    letters = [
        cell_name(1, c)[:-1]
        for c in range(width)[columns]
        if c in sheet.hidden_columns and any(row[c] for row in cells if len(row) > c)
    ]
    facts = []
    if rows:
        facts.append(
            phrase(
                "rows that are hidden or filtered out were not read ({lines})",
                lines=line_numbers(rows),
            )
        )
    if letters:
        facts.append(
            phrase("columns that are hidden in the sheet: {columns}", columns=listed(letters))
        )
    return cells, tuple(facts)


def _width(cells: Sequence[Sequence[str]]) -> int:
    """How many cells with numbers, dates or times two rows or more have, `_TABLE` at most."""
    counts = sorted(sum(map(holds_a_value, row)) for row in cells)
    return min(counts[-2], _TABLE) if len(counts) > 1 else 0


def _no_numbers(
    tables: Mapping[str, tuple[list[list[str]], tuple[str, ...]]], names: Sequence[str]
) -> InputError:
    """The error for a workbook with these sheets, where none of the tables holds numbers."""
    rule = "has no sheet with rows of numbers"
    if any(is_formula(cell) for cells, _ in tables.values() for row in cells for cell in row):
        rule += f", but formulas that were {NOT_COMPUTED}"
    elif len(tables) < len(names) or any(facts for _, facts in tables.values()):
        rule += " (what is hidden is not read; --sheet NAME reads a hidden sheet)"
    return InputError(rule, field="workbook", quoted=listed(names))


def _lines(cells: Sequence[Sequence[str]]) -> str:
    stream = io.StringIO()
    csv.writer(stream, delimiter="\t", lineterminator="\n").writerows(cells)
    return stream.getvalue()
