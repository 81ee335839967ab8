"""Files that appear whole or not at all.  The only file that writes; what is written, and when, is
said elsewhere.

A file is written under a temporary name beside its place, forced to the disk and renamed: whoever
reads the place, also after a crash or a loss of power, finds the old bytes or the new ones, never a
part.

A person names a folder, and that may be a symbolic link.  Below it (`within`) no link is followed,
for reading, writing or removing: each folder on the way is opened by itself, relative to the one
above it, so that what lies elsewhere cannot be reached through a link, not even one that appears
meanwhile (Windows has no such calls: there each step is looked at before).  Only plain files are
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
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from estim.common.errors import EstimError
from estim.versions import USED

if sys.platform != "win32":
    import fcntl

_RELATIVE = os.open in os.supports_dir_fd
_NO_LINK = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_BINARY", 0)
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_CLOEXEC", 0)
_NOT_WAITING = getattr(os, "O_NONBLOCK", 0)  # a named pipe would keep its reader waiting

Files: TypeAlias = dict[str, bytes]
"""Path -> bytes of a file, where several are made or read together."""

TEMPORARY = r"\.{}\.[0-9a-z_]{{8}}"
"""Pattern of the name under which a file is written: what a kill can leave behind.  To be
formatted with a pattern of the name.
"""


class _InTheWayError(OSError):
    """Something that is not of the kind it should be; `strerror` says what."""

    def __init__(self, path: Path, words: str) -> None:
        super().__init__(0, words)
        self.path = path


@dataclass(frozen=True)
class _Place:
    """An open folder.  `at(name)` is what the calls of `os` take for a file in it: the path, and
    the folder it is relative to.
    """

    path: Path
    handle: int | None

    def at(self, name: str) -> tuple[str, int | None]:
        return (str(self.path / name), None) if self.handle is None else (name, self.handle)

    def look(self, name: str) -> os.stat_result | None:
        """What stands under `name` itself, not what a link there leads to; None: nothing."""
        path, folder = self.at(name)
        try:
            return os.stat(path, dir_fd=folder, follow_symlinks=False)
        except FileNotFoundError:
            return None


_NOTED: ContextVar[dict[str, str] | None] = ContextVar("_NOTED", default=None)


@contextlib.contextmanager
def inputs_read() -> Iterator[dict[str, str]]:
    """Every input file that is read within the block: its path as it was asked for -> SHA-256 of
    its bytes.  Packages that are used within it count in it alone.
    """
    noted: dict[str, str] = {}
    token, packages = _NOTED.set(noted), USED.set({})
    try:
        yield noted
    finally:
        USED.reset(packages)
        _NOTED.reset(token)


def note_input(path: Path, data: bytes) -> None:
    """Tells the blocks of `inputs_read` under way that an input file was read."""
    noted = _NOTED.get()
    if noted is not None:
        noted[str(path)] = hashlib.sha256(data).hexdigest()


def write_whole(path: Path, data: bytes, *, within: Path | None = None) -> None:
    """Put `data` at `path`, whole; folders are made.  Raises EstimError where that cannot be done;
    then `path` is as it was.

    within : the folder that a person named, from which on no link is followed (None: the one of the
        file).  A link at `path` itself is replaced.
    """
    with _said(path, "cannot be written"), _opened(path.parent, within, make=True) as place:
        assert place is not None
        temporary, folder = place.at(f".{path.name}.{os.urandom(4).hex()}")
        # less what the umask takes away
        handle = os.open(
            temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _NO_LINK, 0o666, dir_fd=folder
        )
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(temporary, place.at(path.name)[0], src_dir_fd=folder, dst_dir_fd=folder)
        except BaseException:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary, dir_fd=folder)
            raise
        if place.handle is not None:
            os.fsync(place.handle)  # the new name itself


def read_file(path: Path, *, at_most: int, within: Path | None = None) -> bytes | None:
    """The bytes of the plain file at `path`, None where nothing is there.

    Raises EstimError for a link, a pipe, a device or a folder, for more than `at_most` bytes, and
    where it cannot be read.
    """
    with _said(path, "cannot be read"), _opened(path.parent, within) as place:
        if place is None or _plain(place, path.name) is None:
            return None
        name, folder = place.at(path.name)
        try:
            handle = os.open(name, os.O_RDONLY | _NO_LINK | _NOT_WAITING, dir_fd=folder)
        except FileNotFoundError:  # just removed
            return None
        with os.fdopen(handle, "rb") as stream:
            if not stat.S_ISREG(os.fstat(handle).st_mode):  # just exchanged
                raise _InTheWayError(path, "is not a plain file")
            size = os.fstat(handle).st_size
            if size > at_most:
                raise _InTheWayError(
                    path, f"is larger than anything that estim writes there ({at_most} bytes)"
                )
            # memory is taken for as many bytes as are asked for, and at_most may be more than there
            # is
            return stream.read(size)


def names_in(folder: Path, *, within: Path | None = None) -> list[str]:
    """Names of all that stands in `folder`, in order; none where there is no such folder.  Raises
    EstimError where it is none or a link.
    """
    with _said(folder, "cannot be read"), _opened(folder, within) as place:
        return (
            []
            if place is None
            else sorted(os.listdir(place.path if place.handle is None else place.handle))
        )


def remove_files(folder: Path, names: Iterable[str], *, within: Path | None = None) -> None:
    """Remove the plain files `names` of `folder`; what is not there needs no removing.  Raises
    EstimError where that cannot be done.
    """
    with _said(folder, "cannot be emptied"), _opened(folder, within) as place:
        if place is None:
            return
        for name in names:
            if _plain(place, name) is not None:
                path, relative = place.at(name)
                with contextlib.suppress(FileNotFoundError):
                    os.unlink(path, dir_fd=relative)


def remove_empty(folder: Path, *, within: Path | None = None) -> None:
    """Remove `folder` if it is empty; if it is not, or cannot be removed, it stays, for nobody
    depends on its absence.
    """
    with contextlib.suppress(OSError), _opened(folder.parent, within) as place:
        if place is not None:
            name, relative = place.at(folder.name)
            os.rmdir(name, dir_fd=relative)


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
        made = [folder for folder in path.parents[1:] if not os.path.lexists(folder)]
        with contextlib.ExitStack() as stack:
            with _said(path, "cannot be written"):
                place = stack.enter_context(_opened(path.parent, within, make=True))
                assert place is not None
                try:
                    handle = _lock(place, path)
                except BlockingIOError:
                    raise EstimError(
                        f"{path.parent}: is in use by another process: wait for its end, or "
                        "choose another place"
                    ) from None
            try:
                yield
            finally:
                with contextlib.suppress(OSError):
                    os.unlink(path.name, dir_fd=place.handle)
                os.close(handle)
                remove_empty(path.parent, within=within)
                for folder in made:
                    remove_empty(folder)


def _lock(place: _Place, path: Path) -> int:
    """Handle of the locked file.  Who locks a file that its holder has just removed holds nothing,
    and tries again.
    """
    while True:
        _plain(place, path.name)
        handle = os.open(
            path.name, os.O_RDWR | os.O_CREAT | _NO_LINK | _NOT_WAITING, 0o666, dir_fd=place.handle
        )
        try:
            opened = os.fstat(handle)
            if not stat.S_ISREG(opened.st_mode) or opened.st_size:
                raise _InTheWayError(
                    path,
                    "is in the way: estim needs this name for an empty file, its lock; "
                    "move it away",
                )
            if sys.platform != "win32":
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            current = place.look(path.name)
            if current is not None and (opened.st_ino, opened.st_dev) == (
                current.st_ino,
                current.st_dev,
            ):
                return handle
        except (BlockingIOError, _InTheWayError):
            os.close(handle)
            raise
        except OSError:  # a file system without locks
            return handle
        os.close(handle)


def _plain(place: _Place, name: str) -> os.stat_result | None:
    """What stands under `name` if it is a plain file, None if nothing does.  Raises _InTheWayError
    for anything else.
    """
    status = place.look(name)
    if status is not None and not stat.S_ISREG(status.st_mode):
        raise _InTheWayError(place.path / name, _kind(status))
    return status


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


@contextlib.contextmanager
def _opened(folder: Path, within: Path | None, *, make: bool = False) -> Iterator[_Place | None]:
    """`folder`, open, reached from `within` (None: itself) without a link on the way; None where it
    is not there and not to be made.

    Raises OSError.
    """
    with contextlib.ExitStack() as stack:
        place = None
        try:
            place = _descend(stack, folder, folder if within is None else within, make=make)
        except FileNotFoundError:
            if make:
                raise
        yield place


def _descend(stack: contextlib.ExitStack, folder: Path, root: Path, *, make: bool) -> _Place:
    steps = folder.relative_to(root).parts
    if ".." in steps:
        raise _InTheWayError(folder, "leaves its folder")
    if make:
        root.mkdir(parents=True, exist_ok=True)
    place = _Place(root, _open(stack, str(root), None))
    for step in steps:
        path, relative = place.at(step)
        if make:
            with contextlib.suppress(FileExistsError):
                os.mkdir(path, dir_fd=relative)
        status = place.look(step)
        if status is not None and stat.S_ISLNK(status.st_mode):
            raise _InTheWayError(place.path / step, _kind(status))
        place = _Place(place.path / step, _open(stack, path, relative, follow=False))
    return place


def _open(
    stack: contextlib.ExitStack, path: str, relative: int | None, *, follow: bool = True
) -> int | None:
    """Handle of a folder, closed with `stack`; None where the system cannot open one."""
    if not _RELATIVE:
        os.stat(path)
        return None
    handle = os.open(path, _FOLDER if follow else _FOLDER | _NO_LINK, dir_fd=relative)
    stack.callback(os.close, handle)
    return handle


@contextlib.contextmanager
def _said(path: Path, what: str) -> Iterator[None]:
    """Turns an OSError into one line: the path, what cannot be done with it, and why."""
    try:
        yield
    except _InTheWayError as error:
        raise EstimError(f"{error.path}: {error.strerror}") from None
    except OSError as error:
        raise EstimError(f"{path}: {what} ({(error.strerror or str(error)).lower()})") from None
