"""Files that appear whole or not at all.  The only file that writes; what is written, and when, is said elsewhere.

A file is written under a temporary name beside its place, forced to the disk and renamed: whoever reads the place, also
after a crash or a loss of power, finds the old bytes or the new ones, never a part.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from pathlib import Path

from estim.errors import EstimError


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
