"""Input files: read whole, within bounds, and only where they are ordinary files; their text, and
its lines.

Every input file is opened here.  A pipe would wait for its writer, a device never ends, and a file
that the system makes as it is read (/proc, /sys) may wait or never end though it calls itself
regular: its size is 0.
"""

from __future__ import annotations

import codecs
import hashlib
import os
import re
import stat
from pathlib import Path

from estim.common import InputError, in_its_file, note_input, phrase

MAX_BYTES = 64 * 1024**2
TOML_BYTES = 256 * 1024  # limit for files that people write
_LINE_END = re.compile(r"\r\n|\n|\r")
_HIDDEN_ROWS = re.compile(r"(?:\A|(?<=[\r\n]))[^\S\r\n]*[#%][^\r\n]*\r(?![\r\n])")
_UTF_32 = (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)


@in_its_file
def read_bytes(path: Path, *, limit: int = MAX_BYTES) -> bytes:
    """Content of a regular file that is not empty and has at most `limit` bytes; raises InputError
    where it cannot be read.
    """
    refuse_outside(path)
    try:
        # before it is opened: opening a device may move it, and a pipe waits for its writer
        _check_status(path.stat(), limit)
        with path.open("rb") as stream:
            data = stream.read(limit + 1)  # however long it says it is
    except OSError as error:
        raise InputError(f"cannot be read ({(error.strerror or str(error)).lower()})") from None
    except InputError:
        raise
    except ValueError as error:  # a null character in the name
        raise InputError(f"cannot be read ({error})") from None
    if len(data) > limit:
        raise _too_large(limit, f"more than {limit}")
    note_input(path, data)
    return data


def refuse_outside(path: Path) -> None:
    """Raises InputError where ESTIM_INPUTS_WITHIN names a folder and `path` lies outside it:
    whoever runs estim on files of others sets it, and no other file is even looked for.
    """
    home = os.environ.get("ESTIM_INPUTS_WITHIN")
    if home and leads_out(path, Path(home)):
        raise InputError("lies outside the folder of the files that were handed in", file=path)


def _check_status(status: os.stat_result, limit: int) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise InputError("cannot be read (is a directory)")
    if not stat.S_ISREG(status.st_mode):
        raise InputError("must be a regular file, not a pipe, a socket or a device")
    if status.st_size > limit:
        raise _too_large(limit, status.st_size)
    if status.st_size == 0:
        raise InputError("must not be empty: its size is 0")


def _too_large(limit: int, size: object) -> InputError:
    maximum = f"{limit // 1024**2} MiB" if limit >= 1024**2 else f"{limit // 1024} KiB"
    return InputError(f"must be at most {maximum}", field="size", value=size)


@in_its_file
def read_text(path: Path, *, limit: int = MAX_BYTES) -> tuple[str, str]:
    """Text of a UTF-8 file and the SHA-256 of its bytes; raises InputError where it cannot be read
    as such.
    """
    data = read_bytes(path, limit=limit)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise _not_utf8(data, error) from None
    return _without_nulls(text), hashlib.sha256(data).hexdigest()


def _without_nulls(text: str) -> str:
    if "\0" in text:
        line = len(_LINE_END.findall(text[: text.index("\0")])) + 1
        raise InputError(
            "must not hold a null character (the file is damaged, or UTF-16 without its mark: save "
            "it as UTF-8, or say so by --encoding utf-16; encoding = ... in a campaign)",
            field="text",
            line=line,
        )
    return text


def decoded(data: bytes, encoding: str | None = None) -> tuple[str, str]:
    """Text of a table from any program, and how it was read where that is not plain ("" for
    UTF-8).

    encoding : as stated; None: UTF-8, UTF-16 with its mark, else Windows-1252, in which numbers are
        the same as in every other kind of Latin text.  Raises InputError where the file is no text.
    """
    note = (
        phrase("read as {encoding}, as stated", encoding=encoding) if encoding is not None else ""
    )
    try:
        text = data.decode(
            encoding
            or ("utf-32" if data.startswith(_UTF_32) else "")  # before UTF-16, whose mark it has
            or ("utf-16" if data.startswith(_UTF_16) else "utf-8-sig")
        ).removeprefix("\ufeff")
    except UnicodeDecodeError as error:
        if encoding is not None or data.startswith(_UTF_16):
            raise InputError(
                f"cannot be read as {encoding or 'utf-16'}", field="encoding"
            ) from None
        try:
            text = data.decode("windows-1252")
        except UnicodeDecodeError:
            raise _not_utf8(data, error) from None
        note = phrase(
            "the file is not UTF-8 and was read as Windows-1252 (if letters of a name look wrong, "
            "save it as UTF-8)"
        )
    return _without_nulls(text), note


def _not_utf8(data: bytes, error: UnicodeDecodeError) -> InputError:
    """Where bytes are no UTF-8, and what they are likely to be instead."""
    line = len(re.findall(rb"\r\n|\n|\r", data[: error.start])) + 1
    if data.startswith(_UTF_16):
        what = "this is UTF-16"
    else:
        what = "this may be Latin-1 or Windows-1252"
    return InputError(
        f"must be UTF-8 text ({what}: save it again as UTF-8)",
        field="byte",
        value=error.object[error.start : error.start + 1],
        line=line,
    )


def lines_of(text: str) -> list[str]:
    r"""Lines as editors show them, ended by \n, \r\n or \r and by no other mark of Unicode
    (in a comment, its rest would be data).
    """
    return _LINE_END.split(text)


def leads_out(path: Path, folder: Path) -> bool:
    """Whether a file lies outside `folder`, links followed."""
    try:
        target, home = os.path.realpath(path), os.path.realpath(folder)
        return os.path.commonpath([target, home]) != home
    except ValueError:  # another drive, or no name of a file at all
        return True


def way_to(path: Path | str, folder: Path | str) -> str:
    """How `path` is called from `folder`, with `/`: by its whole name where it is on another
    drive.
    """
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:
        return Path(path).resolve().as_posix()


def line_after_comment(text: str) -> int | None:
    r"""Number of the first line that a \r alone parts from a comment though other lines end with
    \n: some programs show it as part of the comment.
    """
    match = _HIDDEN_ROWS.search(text) if "\n" in text else None
    return None if match is None else len(_LINE_END.findall(text[: match.end()])) + 1
