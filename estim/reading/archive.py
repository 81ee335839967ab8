"""Files inside a zip archive, within bounds: a member is read into memory, its name is never used
as a path.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager

from estim.common import InputError

_MAX_BYTES = 64 * 1024**2


@contextmanager
def opened(data: bytes) -> Iterator[zipfile.ZipFile]:
    """The archive `data`.  Raises InputError where it is damaged, also while it is used."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            yield archive
    except InputError:
        raise
    except (
        zipfile.BadZipFile,
        zlib.error,
        struct.error,
        EOFError,
        OSError,
        RuntimeError,
        ValueError,
        LookupError,
        OverflowError,
    ) as error:
        raise InputError(
            "cannot be read as an archive", quoted=str(error) or type(error).__name__
        ) from None


def unpacked(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> bytes:
    """The bytes of a member, at most 64 MiB.  Raises InputError."""
    if info.flag_bits & 1 or info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise InputError(
            "must have no password, and be compressed in the ordinary way",
            field="archive",
            value=info.filename,
        )
    with archive.open(name=info, mode="r") as stream:
        content = stream.read(_MAX_BYTES + 1)
    if len(content) > _MAX_BYTES:
        raise InputError(
            f"grows beyond {_MAX_BYTES // 1024**2} MiB when it is unpacked",
            field="archive",
            value=info.filename,
        )
    return content
