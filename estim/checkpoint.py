"""A chain on disk, in chunks that survive whatever ends the process.

A folder holds `key.json`, what the chain depends on (`estim.fingerprint`), and chunks `000000-DIGEST.npz`, `000001-DIGEST.npz`, ...:
plain NumPy archives without pickled objects.  The name holds the SHA-256 digest of the file's bytes, and each chunk names
the digest of the one before it (the first one: of the key).  So a file that is torn, truncated, changed or from another
chain is recognised, and it and all after it are never read as data.  Chunks are written whole (`estim.storage`) and never
changed: a reader needs no lock and cannot disturb the writer.  Writers exclude each other (`only_writer`).
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import time
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estim.errors import EstimError, InputError
from estim.fingerprint import Key, differences, digest_of
from estim.storage import held, remove_files, remove_folder, write_whole

FloatArray = NDArray[np.float64]

_SCHEMA = "estim-checkpoint/1"
_KEY = "key.json"
_NAME = re.compile(r"(\d{6})-([0-9a-f]{64})\.npz")


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive steps of every ensemble, and the samplers after the last of them.

    draws : (n_ensemble, n_step, n_walker, n_par).  log_density : (n_ensemble, n_step, n_walker).  The last step holds
        the coordinates and log densities from which sampling goes on.
    accepted : (n_ensemble, n_walker) moves accepted since the start.
    random_key : (n_ensemble, 624) uint32, random_place : (n_ensemble, 2) int64, random_normal : (n_ensemble,): the Mersenne
        twisters' words, their positions with whether a normal number is left over, and that number.
    """

    draws: FloatArray
    log_density: FloatArray
    accepted: FloatArray
    random_key: NDArray[np.uint32]
    random_place: NDArray[np.int64]
    random_normal: FloatArray

    @property
    def n_step(self) -> int:
        return int(self.draws.shape[1])

    def random_state(self, ensemble: int) -> tuple[Any, ...]:
        """As `numpy.random.RandomState.set_state` takes it."""
        place, left = (int(n) for n in self.random_place[ensemble])
        return "MT19937", self.random_key[ensemble], place, left, float(self.random_normal[ensemble])


@dataclass(frozen=True)
class Store:
    """Where a chain is kept while it is sampled.

    folder : of this one chain.  resume : continue the chain that is there; without it that chain is discarded.
    interval : s, the longest time between two chunks.  say : called with a line that a person should read.
    """

    folder: Path
    resume: bool = False
    interval: float = 2.0
    say: Callable[[str], object] = str  # keeps silent

    def record(self, key: Key) -> Record:
        """The record of the chain `key`, with the steps that are kept already.

        Raises InputError where the chain that should be resumed depends on anything else, EstimError where nothing can
        be written.
        """
        chain: list[tuple[str, Chunk]] = []
        said: list[str] = []
        n_found = len(_chunk_files(self.folder))
        stored = read_key(self.folder)
        if not self.resume:
            if n_found:
                said.append(f"{self.folder}: an unfinished chain is discarded and sampling starts anew (--resume would continue it)")
        elif stored is None and n_found:
            raise InputError(f"cannot continue: {_KEY} is missing or damaged; fit without --resume to start anew", field="resume", file=self.folder)
        elif stored is not None and n_found:
            self._check(stored, key)
            chain = list(_chain(self.folder, digest_of(key)))
            if len(chain) < n_found:
                said.append(f"{self.folder}: {n_found - len(chain)} of {n_found} chunks are damaged or do not follow; they are sampled again")
        if self.resume:
            n_step = sum(chunk.n_step for _, chunk in chain)
            said.append(f"{self.folder}: continued after step {n_step}" if chain else f"{self.folder}: nothing to resume, sampling starts anew")
        # first what does not belong to the chain, then the new key: at no moment is a chunk found under a key that is not its own
        remove_files(self.folder, but=frozenset([_KEY, *(name for name, _ in chain)]))
        if stored is None or digest_of(stored) != digest_of(key):
            write_whole(self.folder / _KEY, json.dumps({"schema": _SCHEMA, "parts": key}, indent=1).encode() + b"\n")
        for line in said:  # not before it is true
            self.say(line)
        link = _promised(chain[-1][0]) if chain else digest_of(key)
        return Record(self, link, len(chain), join([chunk for _, chunk in chain]) if chain else None)

    def _check(self, stored: Key, key: Key) -> None:
        found = differences(stored, key)
        if found:
            rule = f"was made with {', '.join(found)}; undo that, or fit without --resume to start anew"
            raise InputError(f"cannot continue: the chain {rule}", field="resume", file=self.folder)

    def remove(self) -> None:
        """Remove the chain, when its results are written."""
        remove_folder(self.folder)


class Record:
    """An open checkpoint: `saved` is what it held when it was opened (None: nothing), `n_step` the steps it holds now."""

    def __init__(self, store: Store, link: str, n_chunk: int, saved: Chunk | None) -> None:
        self.folder, self.saved, self.n_step = store.folder, saved, 0 if saved is None else saved.n_step
        self._interval, self._link, self._n_chunk, self._last = store.interval, link, n_chunk, time.monotonic()

    def due(self) -> bool:
        """Whether the steps since the last chunk have taken so long that they should be written."""
        return time.monotonic() - self._last >= self._interval

    def append(self, chunk: Chunk) -> None:
        """Put a chunk behind the others; when this returns it is on the disk.  Raises EstimError where it cannot be written."""
        data = _encode(chunk, self._link)
        digest = hashlib.sha256(data).hexdigest()
        try:
            write_whole(self.folder / f"{self._n_chunk:06d}-{digest}.npz", data)
        except EstimError as error:
            raise EstimError(f"{error}; {self.n_step} steps are kept: make room and continue with --resume") from None
        self._link, self._n_chunk, self._last = digest, self._n_chunk + 1, time.monotonic()
        self.n_step += chunk.n_step


def only_writer(folder: Path) -> AbstractContextManager[None]:
    """While the block runs no other process writes chains in `folder`.  Raises EstimError where one does, or nothing can be written."""
    return held(folder / ".lock")


def read_checkpoint(folder: Path) -> Chunk | None:
    """All steps that are kept in `folder`, as one chunk; None if there are none.  Safe at any moment while a chain is sampled."""
    key = read_key(folder)
    chunks = [] if key is None else [chunk for _, chunk in _chain(folder, digest_of(key))]
    return join(chunks) if chunks else None


def read_key(folder: Path) -> Key | None:
    """What the chain in `folder` depends on; None if that is missing or damaged."""
    try:
        stored = json.loads((folder / _KEY).read_bytes())
    except (OSError, ValueError):
        return None
    return stored.get("parts") if isinstance(stored, dict) and stored.get("schema") == _SCHEMA else None


def join(chunks: Sequence[Chunk]) -> Chunk:
    """Chunks that follow one another as one."""
    last = chunks[-1]
    return Chunk(
        np.concatenate([chunk.draws for chunk in chunks], axis=1), np.concatenate([chunk.log_density for chunk in chunks], axis=1),
        last.accepted, last.random_key, last.random_place, last.random_normal,
    )


def _chunk_files(folder: Path) -> list[str]:
    try:
        return sorted(path.name for path in folder.iterdir() if _NAME.fullmatch(path.name))
    except OSError:  # no such folder, or none that can be: who writes there says why
        return []


def _promised(name: str) -> str:
    """The digest in the name of a chunk's file."""
    return name.partition("-")[2].removesuffix(".npz")


def _chain(folder: Path, root: str) -> Iterator[tuple[str, Chunk]]:
    """File names and chunks from the first on, each checked, up to the first that is missing or damaged."""
    names, link, number = _chunk_files(folder), root, 0
    while True:
        for name in names:
            chunk = _read(folder / name, link) if int(name[:6]) == number else None
            if chunk is not None:
                yield name, chunk
                link, number = _promised(name), number + 1
                break
        else:
            return


def _read(path: Path, link: str) -> Chunk | None:
    """The chunk in `path`, None where its bytes are not those that its name promises or it does not follow `link`."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    return _decode(data, link) if hashlib.sha256(data).hexdigest() == _promised(path.name) else None


def _encode(chunk: Chunk, link: str) -> bytes:
    arrays = {field.name: getattr(chunk, field.name) for field in fields(Chunk)}
    stream = io.BytesIO()
    np.savez(stream, allow_pickle=False, follows=np.array(link), **arrays)
    return stream.getvalue()


def _decode(data: bytes, link: str) -> Chunk | None:
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return Chunk(**{field.name: arrays[field.name] for field in fields(Chunk)}) if str(arrays["follows"]) == link else None
    except (ValueError, KeyError, OSError, zipfile.BadZipFile):
        return None
