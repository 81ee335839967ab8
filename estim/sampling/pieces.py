"""What a computation in independent pieces has done, on disk: trials of a calibration, stages of a marginal.

A folder holds `key.json`, what the pieces depend on (`estim.sampling.keys`), and one archive a piece, `NAME-DIGEST.npz`, whose digest is
that of its bytes and which holds the digest of the key.  A torn or changed file is no piece and is computed again.  Files are written whole, and
of the folder's files only those with such names, plain ones, are read or removed.  Pieces may be done in any order, unlike the chunks of a chain.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estim.common import TEMPORARY, EstimError, InputError, names_in, read_file, remove_empty, remove_files, write_whole
from estim.sampling.keys import Key, differences, digest_of

_SCHEMA = "estim-pieces/1"
_KEY = "key.json"
_NAME = re.compile(r"([a-z0-9]+)-([0-9a-f]{64})\.npz", re.ASCII)
_OWN = re.compile("|".join((re.escape(_KEY), _NAME.pattern, TEMPORARY.format(re.escape(_KEY)), TEMPORARY.format(_NAME.pattern))), re.ASCII)
_LARGEST = 2**30  # bytes
_OF = "of"  # the array that holds the digest of the key

Arrays = Mapping[str, NDArray[Any]]


@dataclass(frozen=True)
class PieceStore:
    """Where the pieces of one computation are kept; fields as of `Store`."""

    folder: Path
    resume: bool = False
    say: Callable[[str], object] = str
    within: Path | None = None

    def under(self, key: Key) -> Pieces:
        """The pieces under `key`.

        Raises InputError where those that should be resumed depend on anything else, EstimError where none can be written.
        """
        own, root = [name for name in names_in(self.folder, within=self._root) if _OWN.fullmatch(name)], self._root
        found = [name for name in own if _NAME.fullmatch(name)]
        if self.resume and found:
            changed = differences(self._stored(), key)
            if changed:
                rule = f"cannot continue: what is kept was made with {', '.join(changed)}; undo that, or start anew without --resume"
                raise InputError(rule, field="resume", file=self.folder)
            self.say(f"{self.folder}: continued, {len(found)} pieces were done")
            return Pieces(self.folder, root, digest_of(key), {match[1]: name for name in found if (match := _NAME.fullmatch(name))})
        if found:
            self.say(f"{self.folder}: what was kept is discarded (--resume would continue it)")
        remove_files(self.folder, own, within=root)
        text = json.dumps({"schema": _SCHEMA, "parts": {part: dict(items) for part, items in key.items()}}, indent=1)
        write_whole(self.folder / _KEY, text.encode() + b"\n", within=root)
        return Pieces(self.folder, root, digest_of(key), {})

    def remove(self) -> None:
        """Remove what is kept, when its results are written; what estim did not write stays."""
        with suppress(EstimError):
            remove_files(self.folder, [name for name in names_in(self.folder, within=self._root) if _OWN.fullmatch(name)], within=self._root)
        remove_empty(self.folder, within=self._root)
        remove_empty(self.folder.parent)

    @property
    def _root(self) -> Path:
        return self.folder.parent if self.within is None else self.within

    def _stored(self) -> Key:
        data = read_file(self.folder / _KEY, at_most=2**24, within=self._root)
        try:
            stored = json.loads(data or b"")
            if stored["schema"] == _SCHEMA:
                return {str(part): {str(k): str(v) for k, v in items.items()} for part, items in stored["parts"].items()}
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            pass
        raise InputError("is damaged, or estim has not written it: move it away, or choose another folder", file=self.folder / _KEY)


@dataclass(frozen=True)
class Pieces:
    """Open pieces of the key with digest `key`; files : name -> file of those that were there when it was opened."""

    folder: Path
    root: Path
    key: str
    files: Mapping[str, str]

    def kept(self, name: str) -> Arrays | None:
        """The arrays of a piece, None where it is not kept or its file is damaged."""
        file = self.files.get(name)
        data = None if file is None else read_file(self.folder / file, at_most=_LARGEST, within=self.root)
        if file is None or data is None or file != _file_of(name, data):
            return None
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as archive:
                arrays = {entry: archive[entry] for entry in archive.files}
        except (ValueError, OSError, EOFError, zipfile.BadZipFile):
            return None
        of = arrays.pop(_OF, None)
        return arrays if of is not None and of.dtype == np.uint8 and of.tobytes() == self.key.encode() else None

    def keep(self, name: str, arrays: Arrays) -> None:
        """Keep a piece; when this returns it is on the disk.  Raises EstimError where it cannot be written."""
        buffer = io.BytesIO()
        whole: dict[str, Any] = {**arrays, _OF: np.frombuffer(self.key.encode(), dtype=np.uint8)}
        np.savez(buffer, **whole)
        write_whole(self.folder / _file_of(name, buffer.getvalue()), buffer.getvalue(), within=self.root)


def _file_of(name: str, data: bytes) -> str:
    return f"{name}-{hashlib.sha256(data).hexdigest()}.npz"
