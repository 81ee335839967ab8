"""Files that appear whole or not at all.  The only module that writes files; what is written, and
when, is decided elsewhere.

A file is written under a temporary name beside its place, forced to the disk and renamed: whoever
reads the place, also after a crash or a loss of power, finds the old bytes or the new ones, never a
part.

A person names a folder, and that may be a symbolic link.  Below it (`within`) no link is followed,
for reading, writing or removing: each folder on the way is looked at before.  Only plain files are
read or removed, by names that the caller knows for its own.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import stat
import sys
from collections.abc import Iterable, Iterator
from contextvars import ContextVar
from pathlib import Path
from typing import TypeAlias

from estim.common.errors import EstimError
from estim.versions import USED

if sys.platform != "win32":
    import fcntl

Files: TypeAlias = dict[str, bytes]
"""Path -> bytes of a file, where several are made or read together."""

TEMPORARY = r"\.{}\.[0-9a-z_]{{8}}"
"""Pattern of the name under which a file is written: what a kill can leave behind.  To be
formatted with a pattern of the name.
"""

_NOTED: ContextVar[dict[str, str] | None] = ContextVar("_NOTED", default=None)


@contextlib.contextmanager
def inputs_read() -> Iterator[dict[str, str]]:
    """Every input file that is read within the block: its path as it was given -> SHA-256 of its
    bytes.  Packages that are used within it count in it alone.
    """
    noted: dict[str, str] = {}
    token, packages = _NOTED.set(noted), USED.set({})
    try:
        yield noted
    finally:
        USED.reset(packages)
        _NOTED.reset(token)


def note_input(path: Path, data: bytes) -> None:
    """Records in the blocks of `inputs_read` under way that an input file was read."""
    noted = _NOTED.get()
    if noted is not None:
        noted[str(path)] = hashlib.sha256(data).hexdigest()


def write_whole(path: Path, data: bytes, *, within: Path | None = None) -> None:
    """Put `data` at `path`, whole; folders are made.  Raises EstimError where that cannot be done;
    then `path` is as it was.

    within : the folder that a person named, from which on no link is followed (None: the one of the
        file).  A link at `path` itself is replaced.
    """
    with _as_one_line(path, "cannot be written"):
        _reach(path.parent, within, make=True)
        temporary = path.with_name(f".{path.name}.{os.urandom(4).hex()}")
        stream = open(temporary, "xb")  # noqa: SIM115
        try:
            with stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(temporary, path)
        except BaseException:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary)
            raise
        if sys.platform != "win32":
            folder = os.open(path.parent, os.O_RDONLY)
            os.fsync(folder)  # the new name itself
            os.close(folder)


def read_file(path: Path, *, at_most: int = 2**28, within: Path | None = None) -> bytes | None:
    """The bytes of the plain file at `path`, None where nothing is there.

    Raises EstimError for a link, a pipe, a device or a folder, for more than `at_most` bytes, and
    where it cannot be read.
    """
    with _as_one_line(path, "cannot be read"):
        _reach(path.parent, within)
        if _plain_size(path) is None:
            return None
        with open(path, "rb") as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > at_most:
                raise EstimError(
                    f"{path}: is larger than anything that estim writes there ({at_most} bytes)"
                )
            # memory is allocated for as many bytes as are requested, and at_most may be more than
            # there is
            return stream.read(size)


def names_in(folder: Path, *, within: Path | None = None) -> list[str]:
    """Names of all that stands in `folder`, in order; none where there is no such folder.  Raises
    EstimError where it is none or a link.
    """
    with _as_one_line(folder, "cannot be read"):
        _reach(folder, within)
        try:
            return sorted(os.listdir(folder))
        except FileNotFoundError:
            return []


def remove_files(folder: Path, names: Iterable[str], *, within: Path | None = None) -> None:
    """Remove the plain files `names` of `folder`; what is not there needs no removing.  Raises
    EstimError where that cannot be done.
    """
    with _as_one_line(folder, "cannot be emptied"):
        _reach(folder, within)
        for path in (folder / name for name in names):
            if _plain_size(path) is not None:
                with contextlib.suppress(FileNotFoundError):
                    os.unlink(path)


def remove_empty(folder: Path, *, within: Path | None = None) -> None:
    """Remove `folder` if it is empty; if it is not, or cannot be removed, it stays, for nobody
    depends on its absence.
    """
    with contextlib.suppress(OSError, EstimError):
        _reach(folder.parent, within)
        os.rmdir(folder)


@contextlib.contextmanager
def held(path: Path, *, within: Path | None = None) -> Iterator[None]:
    """Hold the lock file `path` while the block runs, where the system has locks that end with
    their process; then remove it, and the folders made for it where nothing else is in them.

    A file that a crash left behind is no lock.  Raises EstimError where another process holds it,
    it cannot be written, or a file is there that is not such a lock (which is empty).
    """
    if sys.platform == "win32":
        yield
    else:
        made_folders = [folder for folder in path.parents[1:] if not os.path.lexists(folder)]
        with _as_one_line(path, "cannot be written"):
            _reach(path.parent, within, make=True)
            handle = _lock(path)
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                os.unlink(path)
            os.close(handle)
            remove_empty(path.parent, within=within)
            for folder in made_folders:
                remove_empty(folder)


def _lock(path: Path) -> int:
    """Handle of the locked file.  Who locks a file that its holder has just removed holds nothing,
    and tries again.
    """
    while True:
        if _plain_size(path):
            raise EstimError(
                f"{path}: is in the way: estim needs this name for an empty file, its lock; "
                "move it away"
            )
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            if sys.platform != "win32":
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            raise EstimError(
                f"{path.parent}: is in use by another process: wait for its end, or choose "
                "another place"
            ) from None
        except OSError:  # a file system without locks
            return handle
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), os.stat(path)):
                return handle
        os.close(handle)


def _plain_size(path: Path) -> int | None:
    """Bytes of the plain file at `path`, None where nothing is there.  Raises EstimError for
    anything else.
    """
    try:
        status = os.lstat(path)
    except FileNotFoundError:
        return None
    if not stat.S_ISREG(status.st_mode):
        raise EstimError(f"{path}: {_kind(status)}")
    return status.st_size


def _kind(status: os.stat_result) -> str:
    if stat.S_ISLNK(status.st_mode):
        return (
            "is a symbolic link, and estim follows none here: remove it, or choose another folder"
        )
    what = (
        "folder"
        if stat.S_ISDIR(status.st_mode)
        else "named pipe"
        if stat.S_ISFIFO(status.st_mode)
        else "device or the like"
    )
    return f"is a {what} where estim keeps a file: move it away, or choose another folder"


def _reach(folder: Path, within: Path | None, *, make: bool = False) -> None:
    """Raises EstimError where a link stands on the way from `within` (None: itself) to `folder`.
    make : whether the folders are made that are not there.
    """
    place = within or folder
    steps = folder.relative_to(place).parts
    if ".." in steps:
        raise EstimError(f"{folder}: leaves its folder")
    if make:
        place.mkdir(parents=True, exist_ok=True)
    for step in steps:
        place /= step
        if place.is_symlink():
            raise EstimError(f"{place}: {_kind(os.lstat(place))}")
        if make:
            with contextlib.suppress(FileExistsError):
                os.mkdir(place)


@contextlib.contextmanager
def _as_one_line(path: Path, what: str) -> Iterator[None]:
    """Turns an OSError into one line: the path, what cannot be done with it, and why."""
    try:
        yield
    except OSError as error:
        raise EstimError(f"{path}: {what} ({(error.strerror or str(error)).lower()})") from None
