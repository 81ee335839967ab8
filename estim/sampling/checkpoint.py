"""A chain on disk, in chunks that survive whatever ends the process.

A folder holds `key.json`, what the chain depends on (`estim.sampling.keys`), and chunks `000000-DIGEST.npz`, `000001-DIGEST.npz`, ...
(`estim.sampling.chunk`).  The name holds the SHA-256 digest of the file's bytes, and each chunk names the digest of the one before it (the
first one: of the key).  So a file that is torn, truncated or changed by the disk is recognised, and it and all after it are never
read as data.  A digest is no proof of who wrote a file: what is whole is checked number by number before it is used, and what
estim cannot have written is refused.  Chunks are written whole (`estim.common.storage`) and never changed: a reader needs no lock and
cannot disturb the writer.  Writers exclude each other (`only_writer`).

Of the folder's files only those with the names above, plain files, are ever read or removed; others stay.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np

from estim.common import TEMPORARY, EstimError, InputError, held, names_in, read_file, remove_empty, remove_files, require_plain, write_whole
from estim.sampling.chunk import Chunk, Layout, decode, encode, join
from estim.sampling.keys import Key, differences, digest_of
from estim.sampling.keys import fingerprint as fingerprint
from estim.sampling.keys import problem_key as problem_key
from estim.sampling.pieces import Pieces as Pieces
from estim.sampling.pieces import PieceStore as PieceStore

_SCHEMA = "estim-checkpoint/1"
_KEY = "key.json"
_LARGEST_KEY = 2**24  # bytes
_NAME = re.compile(r"(\d{6})-([0-9a-f]{64})\.npz", re.ASCII)
_OWN = re.compile("|".join((re.escape(_KEY), _NAME.pattern, TEMPORARY.format(re.escape(_KEY)), TEMPORARY.format(_NAME.pattern))), re.ASCII)
MARGINAL = "marginal"
_ANEW = "fit without --resume to start anew"


class _KeyFile(msgspec.Struct, forbid_unknown_fields=True):
    """What `key.json` holds."""

    schema: str
    parts: dict[str, dict[str, str]]


class _Schema(msgspec.Struct):
    """What is read of the `key.json` of another version."""

    schema: str


@dataclass(frozen=True)
class Store:
    """Where a chain is kept while it is sampled.

    folder : of this one chain.  resume : continue the chain that is there; without it that chain is discarded.
    interval : s, the longest time between two chunks.  say : called with a line that a person should read.
    within : the folder above that a person named; below it no symbolic link is followed (None: the one above `folder`).
    """

    folder: Path
    resume: bool = False
    interval: float = 2.0
    say: Callable[[str], object] = str  # keeps silent
    within: Path | None = None

    @property
    def root(self) -> Path:
        return self.folder.parent if self.within is None else self.within

    def beside(self, what: str) -> PieceStore:
        """Where another computation of the same runs keeps its pieces."""
        return PieceStore(self.folder.with_name(f"{self.folder.name}-{what}"), self.resume, self.say, self.root)

    def check(self) -> Key | None:
        """What the chain that is there depends on; None where there is no key, or one that another version of estim wrote.

        Raises EstimError where something stands in the folder that estim cannot have written under that name, and cannot resume then.
        """
        own = self._own_files()
        require_plain(self.folder, own, within=self.root)
        stored = _stored_key(self.folder, self.root)
        if self.resume and any(_NAME.fullmatch(name) for name in own):
            if stored is None:
                raise InputError(f"cannot continue: {_KEY} is missing; {_ANEW}", field="resume", file=self.folder)
            if stored.schema != _SCHEMA:
                rule = f"cannot continue: the chain was made by another version of estim ({stored.schema}); {_ANEW}"
                raise InputError(rule, field="resume", file=self.folder)
        return stored.parts if stored is not None and stored.schema == _SCHEMA else None

    def record(self, key: Key, *, accept: Callable[[Path, Chunk], object] | None = None) -> Record:
        """The record of the chain `key`, with the steps that are kept already.

        accept : called with the folder and these steps before anything is said or changed; may raise InputError.
        Raises InputError where the chain that should be resumed depends on anything else or cannot be estim's, EstimError where
        nothing can be written.
        """
        chain: list[tuple[str, Chunk]] = []
        said: list[str] = []
        stored, own = self.check(), self._own_files()
        n_found = sum(_NAME.fullmatch(name) is not None for name in own)
        if not self.resume:
            if n_found:
                said.append(f"{self.folder}: an unfinished chain is discarded and sampling starts anew (--resume would continue it)")
        elif stored is not None and n_found:
            self._require_same(stored, key)
            layout = Layout.of(key.get("settings", {}))
            assert layout is not None, "the key of a chain says how large it is"
            chain = list(_chain(self.folder, self.root, digest_of(key), layout))
            if len(chain) < n_found:
                said.append(f"{self.folder}: {n_found - len(chain)} of {n_found} chunks are damaged or do not follow; they are sampled again")
        saved = join([chunk for _, chunk in chain]) if chain else None
        if saved is not None and accept is not None:
            accept(self.folder, saved)
        if self.resume:
            n_step = 0 if saved is None else saved.n_step
            said.append(f"{self.folder}: continued after step {n_step}" if chain else f"{self.folder}: nothing to resume, sampling starts anew")
        # first what does not belong to the chain, then the new key: at no moment is a chunk found under a key that is not its own
        remove_files(self.folder, set(own) - {_KEY, *(name for name, _ in chain)}, within=self.root)
        if stored is None or digest_of(stored) != digest_of(key):
            write_whole(self.folder / _KEY, json.dumps({"schema": _SCHEMA, "parts": key}, indent=1).encode() + b"\n", within=self.root)
        for line in said:  # not before it is true
            self.say(line)
        link = _promised(chain[-1][0]) if chain else digest_of(key)
        return Record(self, link, len(chain), saved)

    def _require_same(self, stored: Key, key: Key) -> None:
        found = differences(stored, key)
        if found:
            rule = f"was made with {', '.join(found)}; undo that, or {_ANEW}"
            raise InputError(f"cannot continue: the chain {rule}", field="resume", file=self.folder)

    def _own_files(self) -> list[str]:
        return [name for name in names_in(self.folder, within=self.root) if _OWN.fullmatch(name)]

    def remove(self) -> None:
        """Remove the chain, when its results are written; what estim did not write stays, and so does what cannot be removed."""
        with contextlib.suppress(EstimError):
            remove_files(self.folder, self._own_files(), within=self.root)
        self.beside(MARGINAL).remove()
        remove_empty(self.folder, within=self.root)
        remove_empty(self.folder.parent)


class Record:
    """An open checkpoint: `saved` is what it held when it was opened (None: nothing), `n_step` the steps it holds now."""

    def __init__(self, store: Store, link: str, n_chunk: int, saved: Chunk | None) -> None:
        self.folder, self.saved, self.n_step = store.folder, saved, 0 if saved is None else saved.n_step
        self._root = store.root
        self._interval, self._link, self._n_chunk, self._last = store.interval, link, n_chunk, time.monotonic()

    def due(self) -> bool:
        """Whether the steps since the last chunk have taken so long that they should be written."""
        return time.monotonic() - self._last >= self._interval

    def append(self, chunk: Chunk) -> None:
        """Put a chunk behind the others; when this returns it is on the disk.  Raises EstimError where it cannot be written."""
        data = encode(chunk, self._link)
        digest = hashlib.sha256(data).hexdigest()
        try:
            write_whole(self.folder / f"{self._n_chunk:06d}-{digest}.npz", data, within=self._root)
        except EstimError as error:
            raise EstimError(f"{error}; {self.n_step} steps are kept: make room and continue with --resume") from None
        self._link, self._n_chunk, self._last = digest, self._n_chunk + 1, time.monotonic()
        self.n_step += chunk.n_step


def only_writer(folder: Path) -> AbstractContextManager[None]:
    """While the block runs no other process writes chains in `folder`, which is no link.

    Raises EstimError where another process does, or nothing can be written.
    """
    return held(folder / ".lock", within=folder.parent)


def read_checkpoint(folder: Path) -> Chunk | None:
    """All steps that are kept in `folder`, as one chunk; None if there are none.  Safe at any moment while a chain is sampled."""
    key = read_key(folder)
    layout = None if key is None else Layout.of(key.get("settings", {}))
    chunks: list[Chunk] = []
    if key is not None and layout is not None:
        with contextlib.suppress(EstimError):  # what cannot be a chunk ends the chain
            for _, chunk in _chain(folder, folder, digest_of(key), layout):
                chunks.append(chunk)
    return join(chunks) if chunks else None


def read_key(folder: Path) -> Key | None:
    """What the chain in `folder` depends on; None if that is missing or not what estim writes."""
    try:
        stored = _stored_key(folder, folder)
    except EstimError:
        return None
    return stored.parts if stored is not None and stored.schema == _SCHEMA else None


def _stored_key(folder: Path, root: Path) -> _KeyFile | None:
    """What `key.json` holds (of another version its schema only), None where it is missing.  Raises EstimError where estim has not written it."""
    data = read_file(folder / _KEY, at_most=_LARGEST_KEY, within=root)
    if data is None:
        return None
    try:
        schema = msgspec.json.decode(data, type=_Schema).schema
        if schema == _SCHEMA:
            return msgspec.json.decode(data, type=_KeyFile)
        if re.fullmatch(r"estim-checkpoint/\d{1,4}", schema, re.ASCII):
            return _KeyFile(schema, {})
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        pass
    raise InputError("is damaged, or estim has not written it: move it away, or choose another folder", file=folder / _KEY)


def _promised(name: str) -> str:
    """The digest in the name of a chunk's file."""
    return name.partition("-")[2].removesuffix(".npz")


def _chain(folder: Path, root: Path, link: str, layout: Layout) -> Iterator[tuple[str, Chunk]]:
    """File names and chunks from the first on, each checked, up to the first that is missing or damaged.

    Raises InputError for a file that is whole and comes next, but is no chunk of this chain: no accident makes one.
    """
    names = [name for name in names_in(folder, within=root) if _NAME.fullmatch(name)]
    n_step, number, accepted = 0, 0, np.zeros((layout.n_ensemble, layout.n_walker))
    while True:
        found = None
        for name in names:
            if int(name[:6]) != number or (data := _whole(folder / name, root, layout)) is None:
                continue
            found = name, _next(data, folder / name, link, layout)
            break
        if found is None:
            return
        name, chunk = found
        n_step += chunk.n_step
        if n_step > layout.n_step or np.any((chunk.accepted < accepted) | (chunk.accepted > accepted + chunk.n_step)):
            raise _refused(folder / name, InputError("does not fit the chunks before it", field="accepted"))
        yield found
        link, number, accepted = _promised(name), number + 1, chunk.accepted


def _next(data: bytes, path: Path, link: str, layout: Layout) -> Chunk:
    try:
        chunk, follows = decode(data, layout)
        if follows != link:
            raise InputError("does not name the chunk before it", field="follows")
    except InputError as error:
        raise _refused(path, error) from None
    return chunk


def _refused(path: Path, error: InputError) -> InputError:
    """The refusal of a chunk, with what to do."""
    return InputError(f"{error.rule}, so estim has not written this file; {_ANEW}", field=error.field, file=path)


def _whole(path: Path, root: Path, layout: Layout) -> bytes | None:
    """The bytes of `path`, None where they are not those that its name promises.  Raises EstimError where it is no plain file, or too large."""
    data = read_file(path, at_most=layout.largest, within=root)
    return data if data is not None and hashlib.sha256(data).hexdigest() == _promised(path.name) else None
