"""The text of a table, whatever file it comes in: text, one sheet of a workbook, or one table in a
zip archive.  All that follows reads lines (`estim.reading.layout`).
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

from estim.common import InputError, listed, phrase
from estim.reading.archive import opened, unpacked
from estim.reading.dialect import Dialect
from estim.reading.input_file import decoded, read_bytes
from estim.reading.workbook import sheet_text

_TABLES = (".csv", ".txt", ".tsv", ".dat")


@dataclass(frozen=True)
class Source:
    """text : its lines.  delimiter : between the cells, where the kind of the file says it.

    facts : what was chosen, in words.
    """

    text: str
    sha256: str
    delimiter: str | None
    facts: tuple[str, ...]


def read_source(path: Path, dialect: Dialect) -> Source:
    """The text of the table at `path`.  Raises InputError where it holds several and none is
    stated.
    """
    data = read_bytes(path)
    digest = hashlib.sha256(data).hexdigest()
    facts: list[str] = []
    if data.startswith(b"PK\x03\x04"):
        with opened(data) as archive:
            names = archive.namelist()
        if {"xl/workbook.xml", "content.xml"} & {*names}:
            for key in ("delimiter", "encoding"):
                if (said := getattr(dialect, key)) is not None:
                    raise InputError("does not go with a workbook", field=key, value=said)
            text, sheet, others = sheet_text(data, dialect)
            if others and dialect.sheet is None:
                facts = [
                    phrase(
                        "read from sheet '{sheet}', the first with a table (others: {others})",
                        sheet=sheet,
                        others=listed(others),
                    )
                ]
            return Source(text, digest, "\t", tuple(facts))
        data, name = _of_archive(data, dialect)
        facts = [phrase("read from '{name}' in the archive", name=name)]
    elif dialect.sheet is not None:
        rule = "names a sheet of a workbook or a table in a zip archive, and this file is neither"
        raise InputError(rule, field="sheet", value=dialect.sheet)
    text, note = decoded(data, dialect.encoding)
    return Source(text, digest, None, (*facts, *([note] if note else [])))


def _of_archive(data: bytes, dialect: Dialect) -> tuple[bytes, str]:
    """The one table in a zip archive, as phyphox exports it, or the one that is stated; and its
    name.
    """
    with opened(data) as archive:
        tables = {
            info.filename: info
            for info in archive.infolist()
            if info.filename.lower().endswith(_TABLES)
            and not info.filename.startswith(("meta/", "__MACOSX/"))
        }
        name = dialect.sheet or (next(iter(tables)) if len(tables) == 1 else "")
        if name not in tables:
            rule = (
                "holds several tables: name one (--sheet NAME; sheet = ... in a campaign)"
                if tables and not name
                else "has no table of that name"
                if tables
                else "holds no table (.csv, .txt, .tsv, .dat)"
            )
            raise InputError(rule, field="archive", value=name or None, quoted=listed(list(tables)))
        return unpacked(archive, tables[name]), name
