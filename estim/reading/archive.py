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
_MAX_DIRECTORY = 1024**2


@contextmanager
def opened(data: bytes) -> Iterator[zipfile.ZipFile]:
    """The archive `data`, whose list of members is short.  Raises InputError where it is damaged,
    also while it is used.
    """
    _check_directory(data)
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
    # sizes after and before compression: XML shrinks about 30 times
    limit = min(_MAX_BYTES, max(200 * info.compress_size, 1024**2))
    with archive.open(name=info, mode="r") as stream:
        content = stream.read(limit + 1)
    if len(content) > limit:
        raise InputError(
            f"grows beyond {limit / 1024**2:.0f} MiB when it is unpacked",
            field="archive",
            value=info.filename,
        )
    return content


def _check_directory(data: bytes) -> None:
    """The list of members is short, before `zipfile` reads it whole."""
    end = data.rfind(b"PK\x05\x06", max(0, len(data) - 66_000))
    if end < 0 or len(data) < end + 22:
        raise InputError("cannot be read as an archive (it has no end)")
    (size,) = struct.unpack_from("<I", data, end + 12)
    if size > _MAX_DIRECTORY or data[max(0, end - 20) : end].startswith(b"PK\x06\x07"):
        raise InputError(
            "must hold a short list of members", field="archive", value=f"{size} bytes"
        )
