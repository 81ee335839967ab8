"""What was handed in and what was answered: a folder each, with a record that is written whole.

    FOLDER/files/ID/      record.json, the tables, preview-LANG.json, pictures of the points
    FOLDER/answers/ID/    record.json, the tables that the command reads, report/

Nothing else is remembered, so that a restart finds all of it.  Names that a person gave are kept to
be shown; a file is stored under a name made here.  The one exception are the tables beside a
campaign, which calls them by name: one of letters, digits, `.`, `-` and `_` alone stays.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Generic, TypeVar

import msgspec

from estim.common import (
    EstimError,
    InputError,
    as_json,
    names_in,
    phrase,
    read_file,
    shorten,
    write_whole,
)

ENDINGS = (".csv", ".txt", ".tsv", ".dat", ".xlsx", ".xls", ".ods", ".trk", ".trz", ".toml", ".zip")
MOST_BYTES = 20 * 1024**2  # of one request
MOST_FILES = 20  # in one request
MOST_KEPT = 2000  # files handed in, and answers
_FOR_READERS = (".html", ".md", ".csv", ".tex", ".json", ".png", ".nc")
_LARGEST = 2**28  # bytes of anything that a command writes
_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,79}")
_RESERVED = re.compile(r"|con|prn|aux|nul|com\d|lpt\d|report")  # on Windows; the last is ours
_RECORD = "record.json"


@dataclass(frozen=True)
class Upload:
    """given : name to be shown.  file : name of the table or campaign in its folder.  names : of
    all that is there.  asked : fields with which the question begins.
    """

    id: str
    given: str
    file: str
    names: tuple[str, ...]
    asked: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Answer:
    """upload : id of the file, "" without one.  given : what it is about, to be shown.  fields : of
    the form, as they were filled in.  arguments : of `estim`.

    state : "running" (or waiting for that), "done", "cancelled", "interrupted" (the server ended)
        or "stopped" (a limit).
    code : exit code of the command.  said : its lines.  error, field : its message where the input
        was wrong, and the option that it is about.
    """

    id: str
    upload: str
    given: str
    fields: Mapping[str, str]
    arguments: tuple[str, ...]
    state: str = "running"
    code: int | None = None
    said: tuple[str, ...] = ()
    error: str = ""
    field: str = ""

    @property
    def standing(self) -> str:
        """The state, and of one that is done how it ended."""
        ended = {0: "ok", 2: "refused", 3: "doubtful"}
        return ended.get(self.code or 0, "failed") if self.state == "done" else self.state


Kept = TypeVar("Kept", Upload, Answer)


class Shelf(Generic[Kept]):
    """Records of one kind, the oldest first, each in a folder of its own below `folder`."""

    def __init__(self, root: Path, part: str, kind: type[Kept]) -> None:
        self.root, self.folder = root, root / part
        self.records: dict[str, Kept] = {}
        for name in names_in(self.folder, within=root):
            with suppress(EstimError, msgspec.MsgspecError):  # a kill before the first record
                data = self.read(name, _RECORD) or b""
                self.records[name] = msgspec.json.decode(data, type=kind)

    def keep(self, record: Kept, files: Mapping[str, bytes]) -> Kept:
        """Writes `files` and then the record, in place of the one before."""
        for name, data in {**files, _RECORD: as_json(record)}.items():
            write_whole(self.folder / record.id / name, data, within=self.root)
        self.records[record.id] = record
        return record

    def read(self, at: str, name: str) -> bytes | None:
        """The file `name` of the folder of an id, None where there is none."""
        return read_file(self.folder / at / name, at_most=_LARGEST, within=self.root)

    def new_id(self) -> str:
        """Raises InputError where the shelf is full."""
        if len(self.records) >= MOST_KEPT:
            raise InputError(phrase("The folder of this page is full: nothing more is kept."))
        return f"{datetime.now():%Y%m%d-%H%M%S-%f}-{secrets.token_hex(6)}"


class Store:
    """Everything in the folder that the user named."""

    def __init__(self, root: Path) -> None:
        """Reads all records; what was under way when a server ended is interrupted."""
        self.uploads, self.answers = Shelf(root, "files", Upload), Shelf(root, "answers", Answer)
        for answer in list(self.answers.records.values()):
            if answer.state == "running":
                self.answers.keep(replace(answer, state="interrupted"), {})

    def take_in(self, files: Mapping[str, bytes]) -> list[Upload]:
        """Keeps files by the names that a person gave them: each by itself, or a campaign with its
        tables.  Raises InputError with a sentence for the page.
        """
        for name in files:
            if not name.lower().endswith(ENDINGS):
                values = {"name": shorten(name), "endings": " ".join(ENDINGS)}
                words = phrase("{name} is not one of {endings}: save it as a table.", **values)
                raise InputError(words)
        campaign = next((name for name in files if name.lower().endswith(".toml")), None)
        if campaign is None:
            return [self._kept(name, {_stored(name): data}) for name, data in files.items()]
        beside = {name: data for name, data in files.items() if _PLAIN.fullmatch(name)}
        return [self._kept(campaign, {"campaign.toml": files[campaign]} | beside)]

    def _kept(self, given: str, files: Mapping[str, bytes]) -> Upload:
        names = tuple(files)
        upload = Upload(self.uploads.new_id(), shorten(given, 120), names[0], names)
        return self.uploads.keep(upload, files)

    def begin(
        self, upload: Upload | None, fields: Mapping[str, str], arguments: list[str]
    ) -> Answer:
        """A new answer, its tables beside it, for a command that is still to run.  Raises
        InputError with a sentence for the page.
        """
        at, given = (upload.id, upload.given) if upload else ("", fields["formula"])
        names = upload.names if upload else ()
        answer = Answer(self.answers.new_id(), at, given, fields, tuple(arguments))
        return self.answers.keep(
            answer, {name: self.uploads.read(at, name) or b"" for name in names}
        )

    def report_files(self, answer: Answer) -> list[str]:
        """Paths below report/ of what the command wrote for a reader, in order."""
        place = self.answers.folder / answer.id / "report"
        found = [path for path in place.rglob("*") if path.suffix in _FOR_READERS]
        return sorted(path.relative_to(place).as_posix() for path in found)


def _stored(given: str) -> str:
    """A name of small letters, digits and hyphens that reminds of the one that a person gave."""
    stem, _, ending = given.lower().rpartition(".")
    name = re.sub(r"[^a-z0-9]+", "-", stem)[:40].strip("-")
    return f"{'points' if _RESERVED.fullmatch(name) else name}.{ending}"
