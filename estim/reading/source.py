"""The text of a table, whatever file it comes in: text, one sheet of a workbook, one table in a zip
archive, or what the reader of an installed package reads.  All that follows reads lines
(`estim.reading.layout`).
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from estim.common import InputError, listed, phrase
from estim.plugins import Plugin, plugin_called, plugins, told
from estim.reading.archive import opened, unpacked
from estim.reading.dialect import Dialect
from estim.reading.input_file import decoded, read_bytes
from estim.reading.workbook import sheet_text

GROUP = "estim.readers"  # of entry points
_TABLES = (".csv", ".txt", ".tsv", ".dat")
_OLD_WORKBOOK = b"\xd0\xcf\x11\xe0"
_NO_TEXT = (b"PK\x03\x04", b"%PDF", b"\x1f\x8b", b"\x89PNG", b"\xff\xd8\xff")
_TRACKER = (".trk", ".trz")
_READ = (*_TABLES, *_TRACKER, ".xlsx", ".ods", ".zip", ".toml")
_OWN = (".xls", *_READ)  # the first one to be refused


@dataclass(frozen=True)
class Source:
    """text : its lines.  delimiter : between the cells, where the kind of the file determines it.

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
    if path.suffix.lower() in _TRACKER:
        rule = "is of the program Tracker: make a table of it (estim import FILE -o FILE.csv)"
        raise InputError(rule, field="file")
    data = read_bytes(path)
    digest = hashlib.sha256(data).hexdigest()
    facts: list[str] = []
    reader = reader_of(path)
    if reader is not None:
        refuse(dialect, "does not go with files of this kind", "delimiter", "encoding", "sheet")
        fact = phrase("read by the package {package}", package=reader.owner)
        return Source(reader.make(lambda read: read(data), str), digest, "\t", (fact,))
    if data.startswith(b"PK\x03\x04"):
        with opened(data) as archive:
            names = archive.namelist()
        if {"xl/workbook.xml", "content.xml"} & {*names}:
            refuse(dialect, "does not go with a workbook", "delimiter", "encoding")
            text, chosen = sheet_text(data, dialect)
            return Source(text, digest, "\t", chosen)
        data, name = _of_archive(data, dialect)
        facts = [phrase("read from '{name}' in the archive", name=name)]
    else:
        rule = "names a sheet of a workbook or a table in a zip archive, and this file is neither"
        refuse(dialect, rule, "sheet")
    if data.startswith(_OLD_WORKBOOK):
        rule = (
            "is an old .xls or has a password: save it as CSV, or as .xlsx without a password, in "
            "the spreadsheet program"
        )
        raise InputError(rule, field="file")
    if data.startswith(_NO_TEXT):
        rule = "must be text, .xlsx, .ods or a zip of a table: save it as CSV or .xlsx"
        raise InputError(rule, field="file")
    text, note = decoded(data, dialect.encoding)
    return Source(text, digest, None, (*facts, *([note] if note else [])))


def refuse(dialect: Dialect, rule: str, *keys: str) -> None:
    """Raises InputError where one of the `keys` is stated, which then breaks the rule."""
    for key in keys:
        if (value := getattr(dialect, key)) is not None:
            raise InputError(rule, field=key, value=value)


def is_table(path: Path) -> bool:
    """Whether a file is a table or a track by its suffix."""
    return path.suffix.lower() in _OWN[:-1] or reader_of(path) is not None


def reader_of(path: Path) -> Plugin | None:
    """The reader of an installed package for files of this suffix, None where there is none.  Those
    of estim's own kinds have none.
    """
    suffix = path.suffix.lower()
    return None if suffix in _OWN else plugin_called(GROUP, suffix[1:])


def read_suffixes() -> tuple[str, ...]:
    """Suffixes of the files that can be read, those that installed packages add at the end."""
    added = []
    for plugin in plugins(GROUP):
        path = Path(f"a.{plugin.name}")
        with suppress(InputError):  # offered by several packages
            added += [path.suffix] if reader_of(path) == plugin else []
    return (*_READ, *added)


def known_readers() -> Iterator[str | InputError]:
    """Suffixes that installed packages read, or what is wrong with a reader."""

    def described(plugin: Plugin) -> str:
        path = Path(f"a.{plugin.name}")
        if reader_of(path) != plugin:
            raise plugin.error("must be a suffix in small letters that estim does not read itself")
        plugin.make(lambda read: read.__call__, object)
        return f"*{path.suffix}"

    return told(GROUP, described)


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
