"""Finished pieces of a long computation on disk: a run's draws, a simulated campaign.  A
computation that was killed resumes with the pieces that it had.

A piece is a record (a dataclass of numbers, words, arrays and further records) in a file of its
own.  The file's name is the digest of everything that determines the piece, so that a piece made
from anything else is never found; the file begins with a digest of what follows, so that one that
was torn or changed is no piece.  A piece that is not found is computed again.  Nothing in a file is
run: it is read as the record that is expected.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

from estim.common.storage import TEMPORARY, names_in, read_file, remove_files, write_whole
from estim.versions import engine_versions

T = TypeVar("T")

_NAME = r"[0-9a-f]{64}\.piece"
# and what a kill can leave behind
_OWN = re.compile(f"{_NAME}|{TEMPORARY.format(_NAME)}", re.ASCII)
_LARGEST = 2**32  # bytes
_N_DIGEST = 32  # bytes


def key_of(*inputs: object) -> str:
    """The digest of what determines a result: `inputs`, numbers and words or records of such, whose
    `repr` is complete, and versions.
    """
    return sha256(repr((engine_versions(), inputs)).encode()).hexdigest()


@dataclass(frozen=True)
class PieceStore:
    """Where pieces are kept.

    folder : of these files; others in it stay.  No symbolic link is followed below the one above.
    inputs : what all pieces depend on, as of `key_of`.
    """

    folder: Path
    inputs: tuple[object, ...] = ()

    def with_inputs(self, *inputs: object) -> PieceStore:
        """The same place for pieces that depend on `inputs`, too."""
        return replace(self, inputs=(*self.inputs, *inputs))

    def piece(self, name: str, kind: type[T], compute: Callable[[], T]) -> T:
        """What `compute` returns, or returned when it was kept.  Raises EstimError where it cannot
        be written.
        """
        key = key_of(*self.inputs, name)
        path = self.folder / f"{key}.piece"
        result = _decoded(read_file(path, at_most=_LARGEST, within=self.folder.parent), key, kind)
        if result is None:
            import msgspec  # late, as the command line needs none to list its options

            result = compute()
            content = msgspec.msgpack.encode(result, enc_hook=_encodable)
            write_whole(path, _digest(key, content) + content, within=self.folder.parent)
        return result

    def names(self) -> list[str]:
        """The files of pieces, finished or not."""
        return [
            name
            for name in names_in(self.folder, within=self.folder.parent)
            if _OWN.fullmatch(name)
        ]

    def clear(self) -> None:
        """Remove every piece.  Raises EstimError where that cannot be done."""
        remove_files(self.folder, self.names(), within=self.folder.parent)


def _digest(key: str, content: bytes) -> bytes:
    return sha256(key.encode() + content).digest()


def _decoded(data: bytes | None, key: str, kind: type[T]) -> T | None:
    """The piece in a file; None where the file is not there, or not as it was written under this
    key.
    """
    import msgspec

    if data is None or data[:_N_DIGEST] != _digest(key, data[_N_DIGEST:]):
        return None
    try:
        return msgspec.msgpack.decode(data[_N_DIGEST:], type=kind, dec_hook=_array)
    except (msgspec.DecodeError, ValueError, TypeError):  # of another version of the record
        return None


def _encodable(thing: Any) -> object:
    """A type that msgspec cannot encode as one that it can: an array as type, shape and bytes, a
    number of NumPy's as Python's, a mapping as a dict.
    """
    import numpy as np

    if isinstance(thing, np.ndarray):
        return thing.dtype.str, thing.shape, thing.tobytes()
    return thing.item() if isinstance(thing, np.generic) else dict(thing)


def _array(_: type, stored: tuple[str, list[int], bytes]) -> Any:
    import numpy as np

    kind, shape, content = stored
    return np.frombuffer(content, dtype=kind).reshape(shape).copy()
