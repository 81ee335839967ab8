"""Files that appear whole or not at all.  The only file that writes; what is written, and when, is said elsewhere.

A file is written under a temporary name beside its place, forced to the disk and renamed: whoever reads the place, also
after a crash or a loss of power, finds the old bytes or the new ones, never a part.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from estim.errors import EstimError

if sys.platform != "win32":
    import fcntl


def write_whole(path: Path, data: bytes) -> None:
    """Put `data` at `path`, whole; folders are made.  Raises EstimError where that cannot be done; then `path` is as it was."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as stream:
                stream.write(data)
                stream.flush()
                os.fsync(stream.fileno())
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except BaseException:
            with contextlib.suppress(FileNotFoundError):
                os.unlink(temporary)
            raise
        _sync_folder(path.parent)
    except OSError as error:
        raise EstimError(f"{path}: cannot be written ({(error.strerror or str(error)).lower()})") from None


def _sync_folder(folder: Path) -> None:
    """Force the new name itself to the disk, where the system can (Windows cannot)."""
    if hasattr(os, "O_DIRECTORY"):
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextlib.contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold the lock file `path` while the block runs, where the system has locks that end with their process; then remove it.

    A file that a crash left behind is no lock.  Raises EstimError where another process holds it, or it cannot be written.
    """
    if sys.platform == "win32":
        yield
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle = _lock(path)
    except BlockingIOError:
        raise EstimError(f"{path.parent}: is in use by another process: wait for its end, or choose another place") from None
    except OSError as error:
        raise EstimError(f"{path}: cannot be written ({(error.strerror or str(error)).lower()})") from None
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            os.unlink(path)
        os.close(handle)
        with contextlib.suppress(OSError):
            path.parent.rmdir()  # only if it is empty


def _lock(path: Path) -> int:
    """Handle of the locked file.  Who locks a file that its holder has just removed holds nothing, and tries again."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(handle).st_ino == path.stat().st_ino:
                return handle
        except BlockingIOError:
            os.close(handle)
            raise
        except FileNotFoundError:
            pass
        except OSError:  # a file system without locks
            return handle
        os.close(handle)


def remove_files(folder: Path, *, but: frozenset[str] = frozenset()) -> None:
    """Remove every file of `folder` whose name is not in `but`.  Raises EstimError where that cannot be done."""
    try:
        for path in sorted(folder.iterdir()) if folder.is_dir() else []:
            if path.name not in but:
                path.unlink(missing_ok=True)
    except OSError as error:
        raise EstimError(f"{folder}: cannot be emptied ({(error.strerror or str(error)).lower()})") from None


def remove_folder(folder: Path) -> None:
    """Remove `folder`, and its parent if that is then empty; what cannot be removed stays, for nobody depends on its absence."""
    shutil.rmtree(folder, ignore_errors=True)
    with contextlib.suppress(OSError):
        folder.parent.rmdir()
