"""Files that were handed in, and answers: a folder each, with a record that is written whole.

    FOLDER/files/ID/      record.json, the tables, preview-LANG.json, pictures of the points
    FOLDER/answers/ID/    record.json, the tables that the command reads, report/
    FOLDER/batches/ID/    record.json

Nothing else is remembered, so that a restart finds all of it.  Names that a person gave are kept to
be shown; a file is stored under a name made here.  The one exception are the tables beside a
campaign, which calls them by name: one of letters, digits, `.`, `-` and `_` alone stays.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Generic, TypeVar

import msgspec

from estim.common import (
    EstimError,
    Files,
    InputError,
    as_json,
    names_in,
    phrase,
    read_file,
    shorten,
    write_whole,
)
from estim.reading import read_suffixes
from estim.web.question import Fields

MOST_BYTES = 20 * 1024**2  # of one request
MOST_FILES = 20  # in one request
MOST_KEPT = 2000  # files handed in, and answers
_FOR_READERS = (".html", ".md", ".csv", ".tex", ".json", ".png", ".nc")
_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,79}")
_RESERVED = re.compile(r"|con|prn|aux|nul|com\d|lpt\d|report")  # on Windows; the last is ours
_RECORD = "record.json"


@dataclass(frozen=True)
class Upload:
    """given : name to be shown.  file : name of the table or campaign in its folder.  names : of
    all that is there.  asked : fields with which the question begins.  parts : where these are
    tables for one question, the name of each and the id of the file that it is.
    """

    id: str
    given: str
    file: str
    names: tuple[str, ...]
    asked: Fields = field(default_factory=dict)
    parts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Batch:
    """A question that is asked of each of many files by itself, as they come.

    given : its title, or else its formula, to be shown.  fields : of the form, as they were filled
        in.
    """

    id: str
    given: str
    fields: Fields


@dataclass(frozen=True)
class Answer:
    """upload : id of the file, "" without one.  given : what it is about, to be shown.  fields : of
    the form, as they were filled in.  arguments : of `estim`.

    state : "running" (or waiting for that), "done", "cancelled", "interrupted" (the server ended)
        or "stopped" (a limit).
    code : exit code of the command.  said : its lines.  error, field : its message where the input
        was wrong, and the option that it is about.
    batch : id of the batch of which it is a row, "" where it is none.  instead : id of the row in
        whose place it stands, "" where it is a row of its own.
    """

    id: str
    upload: str
    given: str
    fields: Fields
    arguments: tuple[str, ...]
    state: str = "running"
    code: int | None = None
    said: tuple[str, ...] = ()
    error: str = ""
    field: str = ""
    batch: str = ""
    instead: str = ""

    @property
    def is_curve(self) -> bool:
        """Whether it fits a curve to a table, which may be asked of other tables too."""
        kind = self.fields.get("asked", "formula")
        return self.arguments[0] == "fit" and kind == "formula" and "formula" in self.fields

    @property
    def standing(self) -> str:
        """The state, and of one that is done how it ended."""
        ended = {0: "ok", 2: "refused", 3: "doubtful"}
        return ended.get(self.code or 0, "failed") if self.state == "done" else self.state


Kept = TypeVar("Kept", Upload, Answer, Batch)


class Shelf(Generic[Kept]):
    """Records of one kind, the oldest first, each in a folder of its own below `folder`."""

    def __init__(self, root: Path, part: str, kind: type[Kept]) -> None:
        self.root, self.folder = root, root / part
        self.records: dict[str, Kept] = {}
        for name in names_in(self.folder, within=root):
            with suppress(EstimError, msgspec.MsgspecError):  # a kill before the first record
                data = self.read(name, _RECORD) or b""
                self.records[name] = msgspec.json.decode(data, type=kind)

    def keep(self, record: Kept, files: Files) -> Kept:
        """Writes `files` and then the record, in place of the one before."""
        for name, data in {**files, _RECORD: as_json(record)}.items():
            write_whole(self.folder / record.id / name, data, within=self.root)
        self.records[record.id] = record
        return record

    def read(self, at: str, name: str) -> bytes | None:
        """The file `name` of the folder of an id, None where there is none."""
        return read_file(self.folder / at / name, within=self.root)

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
        self.batches = Shelf(root, "batches", Batch)
        for answer in list(self.answers.records.values()):
            if answer.state in ("running", "waiting"):
                self.answers.keep(replace(answer, state="interrupted"), {})

    def take_in(self, files: Files, who: str | None = None) -> list[Upload]:
        """Keeps files by the names that a person gave them: each by itself, or a campaign with its
        tables.  Raises InputError with a sentence for the page.

        who : hands in tables for a batch, None where they are for none.
        """
        endings = read_suffixes()
        for name in files:
            if not name.lower().endswith(endings):
                values = {"name": shorten(name), "endings": " ".join(endings)}
                words = phrase("{name} is not one of {endings}: save it as a table.", **values)
                raise InputError(words)
        campaign = next((name for name in files if name.lower().endswith(".toml")), None)
        if campaign is None:
            by = f"{shorten(who)}: " if who else ""
            return [
                self._keep_upload(by + name, {_stored(name): data}) for name, data in files.items()
            ]
        if who is not None:
            raise InputError(
                phrase("A campaign already contains a question: hand in its table instead.")
            )
        tables = {name: data for name, data in files.items() if _PLAIN.fullmatch(name)}
        return [self._keep_upload(campaign, {"campaign.toml": files[campaign]} | tables)]

    def together(self, parts: Sequence[Upload]) -> Upload:
        """Tables that were handed in, for one question about all of them.  Raises InputError with
        a sentence for the page.
        """
        files, ids = Files(), dict[str, str]()
        for part in parts:
            stem, _, ending = part.file.rpartition(".")
            names = (part.file, *(f"{stem}-{i}.{ending}" for i in range(2, MOST_FILES + 1)))
            name = next(name for name in names if name not in files)
            files[name], ids[name] = self.uploads.read(part.id, part.file) or b"", part.id
        if sum(map(len, files.values())) > MOST_BYTES:
            raise InputError(phrase("That is too large."))
        return self._keep_upload(", ".join(part.given for part in parts), files, ids)

    def _keep_upload(
        self, name: str, files: Files, parts: Mapping[str, str] | None = None
    ) -> Upload:
        names = tuple(files)
        shown = shorten(name, 120)
        upload = Upload(self.uploads.new_id(), shown, names[0], names, parts=parts or {})
        return self.uploads.keep(upload, files)

    def begin(
        self,
        upload: Upload | None,
        fields: Fields,
        arguments: list[str],
        *,
        batch: str,
        instead: str,
    ) -> Answer:
        """A new answer, its tables beside it, for a command that is still to run.  Raises
        InputError with a sentence for the page.
        """
        at, given = (upload.id, upload.given) if upload else ("", fields["formula"])
        names = upload.names if upload else ()
        answer = Answer(
            self.answers.new_id(), at, given, fields, tuple(arguments), batch=batch, instead=instead
        )
        return self.answers.keep(
            answer, {name: self.uploads.read(at, name) or b"" for name in names}
        )

    def set_batch(self, fields: Fields, title: str) -> Batch:
        """A new batch of the question about a curve that `fields` hold."""
        question = {name: text for name, text in fields.items() if name != "title"}
        shown = shorten(title or fields["formula"], 120)
        return self.batches.keep(Batch(self.batches.new_id(), shown, question), {})

    def report_files(self, answer: Answer) -> list[str]:
        """Paths below report/ of what the command wrote for a reader, in order."""
        place = self.answers.folder / answer.id / "report"
        paths = [path for path in place.rglob("*") if path.suffix in _FOR_READERS]
        return sorted(path.relative_to(place).as_posix() for path in paths)


def _stored(name_given: str) -> str:
    """A name of small letters, digits and hyphens that reminds of the one that a person gave."""
    stem, _, ending = name_given.lower().rpartition(".")
    name = re.sub(r"[^a-z0-9]+", "-", stem)[:40].strip("-")
    return f"{'points' if _RESERVED.fullmatch(name) else name}.{ending}"
