"""Consecutive steps of a chain as bytes, and back.  Bytes come from a disk that others can write to: nothing in them is believed.

A chunk is a plain NumPy archive (`.npz`, members stored as they are) of the fields of `Chunk` and `follows`, the digest of what it
follows.  Reading allocates nothing but the bytes that are there: compression, pickled objects, other types, orders and shapes, and
numbers that no sampler writes are refused with the reason in words.
"""

from __future__ import annotations

import io
import math
import struct
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.common import InputError

_WORDS = 624  # of a Mersenne twister
_LARGEST_NORMAL = 40.0  # a normal number made of 53 random bits is below 13
_OVERHEAD = 16_384  # bytes of an archive beside its numbers
_DIGEST = 64  # characters


@dataclass(frozen=True)
class Layout:
    """Sizes that every chunk of a chain shares; n_step is the most that the chain may have."""

    n_ensemble: int
    n_walker: int
    n_par: int
    n_step: int

    @property
    def largest(self) -> int:
        """Bytes that no chunk exceeds."""
        return 8 * self.n_ensemble * self.n_walker * (self.n_step * (self.n_par + 1) + 1) + 8 * (_WORDS + 3) + _OVERHEAD

    @classmethod
    def of(cls, settings: Mapping[str, str]) -> Layout | None:
        """The layout that the settings of a key (`estim.sampling.keys`) decide; None where they do not."""
        texts = [settings.get(name, "") for name in ("n_ensemble", "n_walker", "n_par", "max_step")]
        sound = all(text.isascii() and text.isdecimal() and len(text) < 10 for text in texts)
        return cls(*(int(text) for text in texts)) if sound and all(int(text) for text in texts) else None


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive steps of every ensemble, and the sampler after the last of them.

    draws : (n_ensemble, n_step, n_walker, n_par).  log_density : (n_ensemble, n_step, n_walker).  The last step holds
        the coordinates and log densities from which sampling goes on.
    accepted : (n_ensemble, n_walker) moves accepted since the start.
    random_key : (624,) uint32, random_place : (2,) int64, random_normal : (1,): the Mersenne twister's words, its position with whether a
        normal number is left over, and that number.
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

    def random_state(self) -> tuple[Any, ...]:
        """As `numpy.random.RandomState.set_state` takes it."""
        place, left = (int(n) for n in self.random_place)
        return "MT19937", self.random_key, place, left, float(self.random_normal[0])


_NAMES = tuple(field.name for field in fields(Chunk))
_TYPES = dict(zip(_NAMES, ("<f8", "<f8", "<f8", "<u4", "<i8", "<f8"), strict=True))


def join(chunks: Sequence[Chunk]) -> Chunk:
    """Chunks that follow one another as one."""
    last = chunks[-1]
    return Chunk(
        np.concatenate([chunk.draws for chunk in chunks], axis=1), np.concatenate([chunk.log_density for chunk in chunks], axis=1),
        last.accepted, last.random_key, last.random_place, last.random_normal,
    )


def encode(chunk: Chunk, link: str) -> bytes:
    """The bytes of `chunk`, which follows what has the digest `link`."""
    arrays: dict[str, Any] = {name: np.ascontiguousarray(getattr(chunk, name), dtype=_TYPES[name]) for name in _NAMES}
    stream = io.BytesIO()
    np.savez(stream, follows=np.array(link), **arrays)
    return stream.getvalue()


def decode(data: bytes, layout: Layout) -> tuple[Chunk, str]:
    """The chunk in `data`, read-only, and the digest of what it follows.  Raises InputError where estim cannot have written it."""
    arrays = _arrays(data)
    draws = arrays["draws"]
    n_step = draws.shape[1] if draws.ndim == 4 else 0
    if not 0 < n_step <= layout.n_step:
        raise InputError(f"must have 1 to {layout.n_step} steps", field="draws", value=draws.shape)
    walkers = (layout.n_ensemble, layout.n_walker)
    shapes: dict[str, tuple[int, ...]] = {
        "draws": (layout.n_ensemble, n_step, layout.n_walker, layout.n_par), "log_density": (layout.n_ensemble, n_step, layout.n_walker),
        "accepted": walkers, "random_key": (_WORDS,), "random_place": (2,), "random_normal": (1,), "follows": (),
    }
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise InputError(f"must have the shape {shape}", field=name, value=arrays[name].shape)
    link = arrays["follows"].reshape(1).view("<u4").tolist()
    if not all(48 <= code < 58 or 97 <= code < 103 for code in link):
        raise InputError("must be a digest", field="follows")
    chunk = Chunk(**{name: arrays[name].astype(arrays[name].dtype.newbyteorder("="), copy=False) for name in _NAMES})
    _check_numbers(chunk, layout)
    return chunk, "".join(map(chr, link))


def _check_numbers(chunk: Chunk, layout: Layout) -> None:
    """Raises InputError for a number that sampling cannot have led to."""
    for name in ("draws", "log_density", "accepted", "random_normal"):
        if not np.all(np.isfinite(getattr(chunk, name))):
            raise InputError("must be finite", field=name)
    accepted = chunk.accepted
    if np.any((accepted < 0) | (accepted > layout.n_step) | (accepted != np.floor(accepted))):
        raise InputError(f"must be whole numbers from 0 to {layout.n_step}", field="accepted")
    place, left = (int(n) for n in chunk.random_place)
    if not 0 <= place <= _WORDS:  # beyond, the generator reads memory that is not its own
        raise InputError(f"must be from 0 to {_WORDS}", field="random_place")
    if left not in (0, 1) or abs(float(chunk.random_normal[0])) > _LARGEST_NORMAL:
        raise InputError("cannot be a normal number left over", field="random_normal")
    ones = float(np.mean(np.unpackbits(chunk.random_key.view(np.uint8))))  # of 19 968 random bits: .5 with sd .0035
    if abs(ones - 0.5) > 0.05:  # a generator whose words are all 0 draws 0 for ever, and a normal number never
        raise InputError("is not a state of the random numbers", field="random_key")


def _arrays(data: bytes) -> dict[str, NDArray[Any]]:
    """The arrays of an archive, views of `data`.  Raises InputError."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()
            if sorted(member.filename for member in members) != sorted(f"{name}.npy" for name in (*_NAMES, "follows")):
                raise InputError("must hold the arrays of a chunk and nothing else", field="archive")
            if any(m.compress_type != zipfile.ZIP_STORED or m.flag_bits & 1 or m.file_size != m.compress_size for m in members):
                raise InputError("must not be compressed or encrypted", field="archive")
            if sum(member.file_size for member in members) > len(data):
                raise InputError("must not hold more than its bytes", field="archive")
            return {(name := member.filename.removesuffix(".npy")): _array(name, archive.read(member)) for member in members}
    except (zipfile.BadZipFile, struct.error, ValueError, NotImplementedError, EOFError, OSError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError("is not a NumPy archive", field="archive") from None


def _array(name: str, data: bytes) -> NDArray[Any]:
    """The array in the bytes of an `.npy` file.  Raises InputError."""
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}[version]
        shape, fortran, dtype = read(stream, max_header_size=1000)
    except (ValueError, KeyError, TypeError, SyntaxError, RecursionError, MemoryError, OverflowError):
        raise InputError("is not a NumPy array", field=name) from None
    wanted = f"<U{_DIGEST}" if name == "follows" else _TYPES[name]
    if dtype.str != wanted or fortran:
        raise InputError(f"must be numbers of the type {wanted} in C order" if name != "follows" else "must be a digest", field=name)
    count = math.prod(shape) if len(shape) <= 4 and all(0 <= n <= len(data) for n in shape) else 0
    if not count or count * dtype.itemsize != len(data) - stream.tell():
        raise InputError("must have as many bytes as its shape says", field=name)
    return np.frombuffer(data, dtype=dtype, offset=stream.tell()).reshape(shape)
