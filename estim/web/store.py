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
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import TypeVar

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
_LARGEST = 2**28  # bytes of anything that a command writes
_ID = re.compile(r"[0-9a-f]{20}")
_PLAIN = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,79}")
_RESERVED = re.compile(r"con|prn|aux|nul|com\d|lpt\d|report")  # on Windows; the last is ours
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
    when: str
    asked: dict[str, str] = field(default_factory=dict)

    @property
    def is_campaign(self) -> bool:
        return self.file.endswith(".toml")


@dataclass(frozen=True)
class Answer:
    """upload : id of the file, "" without one.  fields : of the form, as they were filled in.
    arguments : of `estim`.

    state : "waiting", "running", "done", "cancelled", "interrupted" (the server ended) or "stopped"
        (a limit).
    code : exit code of the command once it has ended.  said : its lines.  error, field : its
        message where the input was wrong, and the option that it is about.
    """

    id: str
    upload: str
    given: str
    fields: dict[str, str]
    arguments: tuple[str, ...]
    lang: str
    when: str
    state: str = "waiting"
    code: int | None = None
    said: tuple[str, ...] = ()
    error: str = ""
    field: str = ""

    @property
    def ended(self) -> bool:
        return self.state not in ("waiting", "running")


Kept = TypeVar("Kept", Upload, Answer)


class Store:
    """Everything in the folder that the user named."""

    def __init__(self, root: Path) -> None:
        """Reads all records; what was under way when a server ended is interrupted."""
        self.root = root
        self.uploads = self._records("files", Upload)
        self.answers = self._records("answers", Answer)
        for answer in list(self.answers.values()):
            if not answer.ended:
                self.keep(replace(answer, state="interrupted"))

    def folder(self, of: Upload | Answer) -> Path:
        return self.root / ("files" if isinstance(of, Upload) else "answers") / of.id

    def keep(self, record: Upload | Answer) -> None:
        """Writes a record, in place of the one before."""
        self.write(record, _RECORD, as_json(record))
        if isinstance(record, Upload):
            self.uploads[record.id] = record
        else:
            self.answers[record.id] = record

    def write(self, of: Upload | Answer, name: str, data: bytes) -> None:
        write_whole(self.folder(of) / name, data, within=self.root)

    def read(self, of: Upload | Answer, name: str) -> bytes | None:
        """The file `name` of a folder, None where there is none."""
        return read_file(self.folder(of) / name, at_most=_LARGEST, within=self.root)

    def take_in(self, files: Mapping[str, bytes]) -> list[Upload]:
        """Keeps files by the names that a person gave them: each by itself, or a campaign with its
        tables.  Raises InputError with a sentence for the page.
        """
        for name in files:
            if _ending(name) not in ENDINGS:
                values = {"name": shorten(name), "endings": " ".join(ENDINGS)}
                words = phrase("{name} is not one of {endings}: save it as a table.", **values)
                raise InputError(words)
        if len(self.uploads) + len(files) > MOST_KEPT:
            raise InputError(phrase("The folder of this page is full: no further file is kept."))
        campaigns = [name for name in files if _ending(name) == ".toml"]
        if not campaigns:
            return [self._keep_file(name, data) for name, data in files.items()]
        beside = {
            n: data for n, data in files.items() if n not in campaigns and _PLAIN.fullmatch(n)
        }
        upload = self._upload(campaigns[0], "campaign.toml", ("campaign.toml", *beside))
        stored = {"campaign.toml": files[campaigns[0]], **beside}
        return [self._kept(upload, stored)]

    def _keep_file(self, given: str, data: bytes) -> Upload:
        file = f"{_plain_stem(given)}{_ending(given)}"
        return self._kept(self._upload(given, file, (file,)), {file: data})

    def _upload(self, given: str, file: str, names: tuple[str, ...]) -> Upload:
        return Upload(secrets.token_hex(10), shorten(given, 120), file, names, _now())

    def _kept(self, upload: Upload, files: Mapping[str, bytes]) -> Upload:
        for name, data in files.items():
            self.write(upload, name, data)
        self.keep(upload)
        return upload

    def begin(
        self, upload: Upload | None, fields: Mapping[str, str], arguments: list[str], lang: str
    ) -> Answer:
        """A new answer, its tables beside it, for a command that is still to run."""
        if len(self.answers) >= MOST_KEPT:
            raise InputError(phrase("The folder of this page is full: no further answer is kept."))
        given = fields.get("formula", "") if upload is None else upload.given
        answer = Answer(
            secrets.token_hex(10),
            "" if upload is None else upload.id,
            given,
            dict(fields),
            tuple(arguments),
            lang,
            _now(),
        )
        if upload is not None:
            for name in upload.names:
                self.write(answer, name, self.read(upload, name) or b"")
        self.keep(answer)
        return answer

    def report_files(self, answer: Answer) -> list[str]:
        """Paths below report/ of what the command wrote for a reader, in order."""
        found, folders = list[str](), [""]
        while folders:
            part = folders.pop()
            place = self.folder(answer) / "report" / part
            for name in names_in(place, within=self.root):
                path = f"{part}/{name}" if part else name
                if name.startswith("."):
                    continue
                if (place / name).is_dir() and not (place / name).is_symlink():
                    folders.append(path)
                elif _ending(name) in (
                    ".html",
                    ".md",
                    ".pdf",
                    ".csv",
                    ".tex",
                    ".json",
                    ".png",
                    ".nc",
                ):
                    found.append(path)
        return sorted(found, key=lambda path: (path.count("/"), path))

    def _records(self, part: str, kind: type[Kept]) -> dict[str, Kept]:
        found = {}
        for name in names_in(self.root / part, within=self.root):
            if _ID.fullmatch(name):
                place = self.root / part / name / _RECORD
                try:
                    data = read_file(place, at_most=MOST_BYTES, within=self.root)
                    record = msgspec.json.decode(data or b"", type=kind)
                except (EstimError, msgspec.MsgspecError):  # a kill before the first record
                    continue
                if record.id == name:
                    found[name] = record
        return dict(sorted(found.items(), key=lambda item: item[1].when))


def _ending(name: str) -> str:
    return Path(name.lower().replace("\\", "/")).suffix


def _plain_stem(given: str) -> str:
    """A name of small letters, digits and hyphens that reminds of the one that a person gave."""
    stem = unicodedata.normalize("NFKD", Path(given).stem).encode("ascii", "ignore").decode()
    name = re.sub(r"[^a-z0-9]+", "-", stem.lower()).strip("-")[:40].strip("-")
    return name if name and not _RESERVED.fullmatch(name) else "points"


def _now() -> str:
    return datetime.now().astimezone().isoformat(timespec="milliseconds")
