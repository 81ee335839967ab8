"""Workbooks as spreadsheets write them, by a few lines of XML: .xlsx and .ods without a package.

A cell: None, a number, a text, a date or a time, `Percent` of a number that is shown in per cent,
or `Formula` with the value that the program kept, None where it was never computed.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from xml.sax.saxutils import escape, quoteattr

Cells = Sequence[Sequence[object]]
_DECLARATION = '<?xml version="1.0" encoding="UTF-8" standalone="yes"?>'
_OFFICE = "http://schemas.openxmlformats.org"


@dataclass(frozen=True)
class Formula:
    """text : of the formula.  value : that is kept beside it, a number or an error, #DIV/0!."""

    text: str
    value: object


@dataclass(frozen=True)
class Percent:
    """share : 0.021 where the sheet shows 2.1 %."""

    share: float


def changed(book: bytes, *replacements: tuple[str, str]) -> bytes:
    """The workbook with other words in its XML; each must be there."""
    with zipfile.ZipFile(io.BytesIO(book)) as archive:
        parts = {name: archive.read(name).decode() for name in archive.namelist()}
    for old, new in replacements:
        assert any(old in content for content in parts.values()), old
        parts = {name: content.replace(old, new) for name, content in parts.items()}
    return zipped(parts, compress=False)


def column_letters(column: int) -> str:
    letters = ""
    while column >= 0:
        letters, column = chr(65 + column % 26) + letters, column // 26 - 1
    return letters


def zipped(files: Mapping[str, str | bytes], *, compress: bool = True) -> bytes:
    """A zip archive of files."""
    stream = io.BytesIO()
    how = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    with zipfile.ZipFile(stream, "w", how) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return stream.getvalue()


def xlsx(sheets: Mapping[str, Cells]) -> bytes:
    """An Excel workbook with these sheets."""
    types = "".join(
        f'<Override PartName="/xl/worksheets/sheet{i}.xml" ContentType='
        '"application/vnd.openxmlformats-officedocument.spreadsheetml.worksheet+xml"/>'
        for i in range(1, len(sheets) + 1)
    )
    listed = "".join(
        f'<sheet name={quoteattr(name)} sheetId="{i}" r:id="rId{i}"/>'
        for i, name in enumerate(sheets, start=1)
    )
    relations = "".join(
        f'<Relationship Id="rId{i}" Target="worksheets/sheet{i}.xml" '
        f'Type="{_OFFICE}/officeDocument/2006/relationships/worksheet"/>'
        for i in range(1, len(sheets) + 1)
    )
    files = {
        "[Content_Types].xml": (
            f'{_DECLARATION}<Types xmlns="{_OFFICE}/package/2006/content-types">'
            '<Default Extension="rels" ContentType='
            '"application/vnd.openxmlformats-package.relationships+xml"/>'
            '<Default Extension="xml" ContentType="application/xml"/>'
            '<Override PartName="/xl/workbook.xml" ContentType='
            '"application/vnd.openxmlformats-officedocument.spreadsheetml.sheet.main+xml"/>'
            '<Override PartName="/xl/styles.xml" ContentType='
            '"application/vnd.openxmlformats-officedocument.spreadsheetml.styles+xml"/>'
            f"{types}</Types>"
        ),
        "_rels/.rels": (
            f'{_DECLARATION}<Relationships xmlns="{_OFFICE}/package/2006/relationships">'
            '<Relationship Id="rId1" Target="xl/workbook.xml" '
            f'Type="{_OFFICE}/officeDocument/2006/relationships/officeDocument"/></Relationships>'
        ),
        "xl/workbook.xml": (
            f'{_DECLARATION}<workbook xmlns="{_OFFICE}/spreadsheetml/2006/main" '
            f'xmlns:r="{_OFFICE}/officeDocument/2006/relationships">'
            f"<sheets>{listed}</sheets></workbook>"
        ),
        "xl/_rels/workbook.xml.rels": (
            f'{_DECLARATION}<Relationships xmlns="{_OFFICE}/package/2006/relationships">'
            f'{relations}<Relationship Id="rId999" Target="styles.xml" '
            f'Type="{_OFFICE}/officeDocument/2006/relationships/styles"/></Relationships>'
        ),
        "xl/styles.xml": (
            f'{_DECLARATION}<styleSheet xmlns="{_OFFICE}/spreadsheetml/2006/main">'
            '<numFmts count="1"><numFmt numFmtId="164" formatCode="0.0%"/></numFmts>'
            '<fonts count="1"><font/></fonts><fills count="1"><fill/></fills>'
            '<borders count="1"><border/></borders><cellStyleXfs count="1"><xf/></cellStyleXfs>'
            '<cellXfs count="3"><xf numFmtId="0"/><xf numFmtId="22" applyNumberFormat="1"/>'
            '<xf numFmtId="164" applyNumberFormat="1"/>'
            "</cellXfs></styleSheet>"
        ),
    }
    for i, cells in enumerate(sheets.values(), start=1):
        rows = "".join(
            f'<row r="{r}">'
            + "".join(_xlsx_cell(f"{column_letters(c)}{r}", cell) for c, cell in enumerate(row))
            + "</row>"
            for r, row in enumerate(cells, start=1)
            if any(cell is not None for cell in row)
        )
        files[f"xl/worksheets/sheet{i}.xml"] = (
            f'{_DECLARATION}<worksheet xmlns="{_OFFICE}/spreadsheetml/2006/main">'
            f"<sheetData>{rows}</sheetData></worksheet>"
        )
    return zipped(files)


def _xlsx_cell(place: str, cell: object) -> str:
    formula = ""
    if isinstance(cell, Formula):
        formula, cell = f"<f>{escape(cell.text)}</f>", cell.value
    match cell:
        case None:
            return f'<c r="{place}">{formula}<v></v></c>' if formula else ""
        case Percent():
            return f'<c r="{place}" s="2">{formula}<v>{cell.share!r}</v></c>'
        case bool():
            return f'<c r="{place}" t="b">{formula}<v>{int(cell)}</v></c>'
        case int() | float():
            return f'<c r="{place}">{formula}<v>{cell!r}</v></c>'
        case datetime():
            serial = (cell - datetime(1899, 12, 30)) / timedelta(days=1)
            return f'<c r="{place}" s="1">{formula}<v>{serial!r}</v></c>'
        case str() if cell.startswith("#") and cell.endswith("!"):
            return f'<c r="{place}" t="e">{formula}<v>{cell}</v></c>'
        case _ if formula:
            return f'<c r="{place}" t="str">{formula}<v>{escape(str(cell))}</v></c>'
        case _:
            text = escape(str(cell))
            return f'<c r="{place}" t="inlineStr"><is><t>{text}</t></is></c>'


def ods(sheets: Mapping[str, Cells]) -> bytes:
    """A workbook of LibreOffice with these sheets."""
    tables = "".join(
        f"<table:table table:name={quoteattr(name)}>"
        + "".join(
            "<table:table-row>" + "".join(map(_ods_cell, row)) + "</table:table-row>"
            for row in cells
        )
        + "</table:table>"
        for name, cells in sheets.items()
    )
    space = "urn:oasis:names:tc:opendocument:xmlns"
    content = (
        f'{_DECLARATION}<office:document-content xmlns:office="{space}:office:1.0" '
        f'xmlns:table="{space}:table:1.0" xmlns:text="{space}:text:1.0" '
        'xmlns:calcext="urn:org:documentfoundation:names:experimental:calc:xmlns:calcext:1.0" '
        f'office:version="1.2"><office:body><office:spreadsheet>{tables}'
        "</office:spreadsheet></office:body></office:document-content>"
    )
    kind = "application/vnd.oasis.opendocument.spreadsheet"
    manifest = (
        f'{_DECLARATION}<manifest:manifest xmlns:manifest="{space}:manifest:1.0">'
        f'<manifest:file-entry manifest:full-path="/" manifest:media-type="{kind}"/>'
        '<manifest:file-entry manifest:full-path="content.xml" manifest:media-type="text/xml"/>'
        "</manifest:manifest>"
    )
    files = {"mimetype": kind, "content.xml": content, "META-INF/manifest.xml": manifest}
    return zipped(files, compress=False)


def _ods_cell(cell: object) -> str:
    formula = ""
    if isinstance(cell, Formula):
        formula, cell = f" table:formula={quoteattr('of:' + cell.text)}", cell.value
    match cell:
        case None:
            return f"<table:table-cell{formula}/>"
        case Percent():
            kind = f'office:value-type="percentage" office:value="{cell.share!r}"'
            text = f"<text:p>{100 * cell.share:.0f} %</text:p>"
            return f"<table:table-cell{formula} {kind}>{text}</table:table-cell>"
        case int() | float():
            shown = str(cell).replace(".", ",")  # as a German LibreOffice shows it
            kind = f'office:value-type="float" office:value="{cell!r}"'
            return f"<table:table-cell{formula} {kind}><text:p>{shown}</text:p></table:table-cell>"
        case datetime():
            kind = f'office:value-type="date" office:date-value="{cell.isoformat()}"'
            return f"<table:table-cell{formula} {kind}><text:p>{cell}</text:p></table:table-cell>"
        case _:
            error = str(cell).startswith("#")
            kind = 'office:value-type="string"'
            kind += ' office:string-value="" calcext:value-type="error"' if error else ""
            text = f"<text:p>{escape(str(cell))}</text:p>"
            return f"<table:table-cell{formula} {kind}>{text}</table:table-cell>"
