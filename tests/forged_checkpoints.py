"""Checkpoints that estim has not written, made one by one from a sound one.  Each is a function that changes a copy of its folder.

The digests in the names of the chunks are right throughout: who forges a file can compute them.  `KEYS` and `KINDS` are to be refused with
and without `--resume` (nothing can be discarded that is not estim's), `CHUNKS` with it.

    python tests/forged_checkpoints.py WORK     tries `DANGEROUS`, what could hang or crash, on copies of WORK/sound (test_forged.py)
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import socket
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

Forge = Callable[[Path], None]
CHUNKS: dict[str, Forge] = {}
KEYS: dict[str, Forge] = {}
KINDS: dict[str, Forge] = {}
DANGEROUS: set[str] = set()  # that once hung, crashed or took all memory


def last_chunk(folder: Path) -> Path:
    return sorted(folder.glob("0*.npz"))[-1]


def named(folder: Path, number: str, data: bytes) -> Path:
    path = folder / f"{number}-{hashlib.sha256(data).hexdigest()}.npz"
    path.write_bytes(data)
    return path


def overwrite(path: Path, data: bytes) -> None:
    path.write_bytes(data)


def arrays_of(path: Path) -> dict[str, Any]:
    with np.load(path) as arrays:
        return dict(arrays)


def replaced(folder: Path, data: bytes) -> None:
    """The last chunk with other bytes, under their digest."""
    path = last_chunk(folder)
    path.unlink()
    named(folder, path.name[:6], data)


def packed(arrays: dict[str, Any], **options: Any) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **arrays, **options)
    return stream.getvalue()


def with_array(name: str, change: Callable[[Any], Any]) -> Forge:
    def forge(folder: Path) -> None:
        arrays = arrays_of(last_chunk(folder))
        replaced(folder, packed({**arrays, name: change(arrays[name])}))

    return forge


def filled(index: Any, value: Any) -> Callable[[Any], Any]:
    def change(array: Any) -> Any:
        array = array.copy()
        array[index] = value
        return array

    return change


# arrays: every one with other shapes, types and orders; values where they matter

SHAPES: dict[str, Callable[[Any], Any]] = {
    "a scalar": lambda a: a.flat[0], "empty": lambda a: a[:0], "flat": np.ravel, "an axis more": lambda a: a[None],
    "transposed": lambda a: a.T.copy(),
    "in Fortran order": np.asfortranarray, "an ensemble less": lambda a: a[:-1], "an ensemble more": lambda a: np.concatenate([a, a[:1]]),
    "the last axis shorter": lambda a: a[..., :-1],
    "the last axis longer": lambda a: np.concatenate([a, a[..., :1]], axis=-1),
}
TYPES: dict[str, Callable[[Any], Any]] = {
    "objects": lambda a: a.astype(object), "text": lambda a: a.astype("U8"), "bytes": lambda a: a.astype("S8"),
    "complex": lambda a: a.astype(complex),
    "single precision": lambda a: a.astype("f4"), "truth values": lambda a: a.astype(bool),
    "the other order of bytes": lambda a: a.astype(a.dtype.newbyteorder(">")),
    "dates": lambda a: a.astype("i8").astype("M8[s]"), "records": lambda a: np.zeros(a.shape, dtype=[("a", "f8")]),
    "short integers": lambda a: a.astype("i2"),
}
ARRAYS = ("draws", "log_density", "accepted", "random_key", "random_place", "random_normal")
for array in ARRAYS:
    for words, change in {**SHAPES, **TYPES}.items():
        if not array.startswith("random_") or words not in ("flat", "transposed", "in Fortran order"):  # one axis: the same
            CHUNKS[f"{array}: {words}"] = with_array(array, change)
for array in ("draws", "log_density", "accepted", "random_normal"):
    for value in (np.nan, np.inf, -np.inf):
        first = (0,) * {"draws": 4, "log_density": 3, "accepted": 2, "random_normal": 1}[array]
        CHUNKS[f"{array}: one is {value}"] = with_array(array, filled(first, value))
CHUNKS |= {
    "draws: one of 1e9": with_array("draws", filled((0, 3, 2, 1), 1e9)), "draws: all of 1e300": with_array("draws", filled(..., 1e300)),
    "draws: the last ones moved": with_array("draws", filled((0, -1, 0, 0), 0.123)),
    "log density: 1e300": with_array("log_density", filled(..., 1e300)),
    "log density: the last ones higher": with_array("log_density", lambda a: a + 1e-3), "no steps": with_array("draws", lambda a: a[:, :0]),
    "a step less": with_array("draws", lambda a: a[:, 1:]), "accepted: -1": with_array("accepted", filled((0, 0), -1)),
    "accepted: 0.5 more": with_array("accepted", lambda a: a + 0.5), "accepted: 1e300": with_array("accepted", filled((0, 0), 1e300)),
    "accepted: none": with_array("accepted", lambda a: a * 0), "accepted: every step and 41": with_array("accepted", lambda a: a + 41),
    "random_normal: 1e308": with_array("random_normal", filled(0, 1e308)), "random_normal: 41": with_array("random_normal", filled(0, -41.0)),
    "random_key: all 0": with_array("random_key", lambda a: a * 0), "random_key: all 1": with_array("random_key", filled(..., 2**32 - 1)),
    "random_key: half of it 0": with_array("random_key", filled(slice(None, 312), 0)),
    "random_key: 10 words": with_array("random_key", lambda a: a[:10]),
    "random_key: a million words": with_array("random_key", lambda a: np.resize(a, 10**6)),
    **{f"random_place: {n}": with_array("random_place", filled(0, n)) for n in (-1, 625, 10**9, -(10**9), 2**31, 2**63 - 1, -(2**63))},
    **{f"normal left over: {n}": with_array("random_place", filled(1, n)) for n in (2, -1, 2**62)},
    **{f"follows: {words}": with_array("follows", lambda a, b=b: np.array(b)) for words, b in {
        "another digest": "0" * 64, "no digest": "x" * 64, "empty": "", "number": 7, "many": ["0" * 64] * 2, "long": "0" * 10_000,
        "a control": "\x1b" * 64,
    }.items()},
}
DANGEROUS |= {"random_key: all 0", "random_place: 1000000000", "random_place: -1000000000", "random_place: 2147483648", "random_normal: 1e308"}


def _without(name: str) -> Forge:
    return lambda folder: replaced(folder, packed({k: v for k, v in arrays_of(last_chunk(folder)).items() if k != name}))


CHUNKS |= {f"{name} is missing": _without(name) for name in (*ARRAYS, "follows")}


# archives


def _rewritten(write: Callable[[zipfile.ZipFile, str, bytes], object], how: int = zipfile.ZIP_STORED) -> Forge:
    """The last chunk as an archive whose members `write` puts in."""

    def forge(folder: Path) -> None:
        stream = io.BytesIO()
        with zipfile.ZipFile(last_chunk(folder)) as old, zipfile.ZipFile(stream, "w", how) as new:
            for member in old.namelist():
                write(new, member, old.read(member))
        replaced(folder, stream.getvalue())

    return forge


def _header(text: str, version: bytes = b"\x01\x00") -> bytes:
    length = len(text).to_bytes(2 if version == b"\x01\x00" else 4, "little")
    return b"\x93NUMPY" + version + length + text.encode("latin1")


def _draws_as(data: bytes) -> Forge:
    return _rewritten(lambda archive, name, old: archive.writestr(name, data if name == "draws.npy" else old))


def _bomb(folder: Path) -> None:
    """256 MB of zeros in 1 MB."""
    stream = io.BytesIO()
    with zipfile.ZipFile(last_chunk(folder)) as old, zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as new:
        for member in old.namelist():
            if member != "draws.npy":
                new.writestr(member, old.read(member))
        with new.open("draws.npy", "w", force_zip64=True) as member_stream:
            member_stream.write(_header("{'descr': '<f8', 'fortran_order': False, 'shape': (2, 40, 13, 32000), }\n"))
            for _ in range(16):
                member_stream.write(bytes(2**24))
    replaced(folder, stream.getvalue())


HEADERS = {
    "more than memory": "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }\n",
    "more than any number": f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({10**40},), }}\n",
    "negative": "{'descr': '<f8', 'fortran_order': False, 'shape': (2, -40, 13, 4), }\n",
    "two negative": "{'descr': '<f8', 'fortran_order': False, 'shape': (-2, -40, 13, 4), }\n",
    "no shape": "{'descr': '<f8', 'fortran_order': False}\n", "no dictionary": "7\n", "empty": "", "code": "__import__('os').abort()\n",
    "deep": "(" * 5000 + ")" * 5000, "many signs": "-" * 9000 + "1", "long": " " * 60_000,
    "shape of text": "{'descr': '<f8', 'fortran_order': False, 'shape': 'x', }\n",
    "many axes": "{'descr': '<f8', 'fortran_order': False, 'shape': (" + "1, " * 100 + "), }\n",
    "type of nothing": "{'descr': '|V0', 'fortran_order': False, 'shape': (2, 40, 13, 4), }\n",
    "pickled": "{'descr': '|O', 'fortran_order': False, 'shape': (2, 40, 13, 4), }\n",
}
CHUNKS |= {f"header: {words}": _draws_as(_header(text) + bytes(2 * 40 * 13 * 4 * 8)) for words, text in HEADERS.items()}
CHUNKS |= {
    "header: version 9": _draws_as(_header(HEADERS["negative"], b"\x09\x00")),
    "header: version 2, no end": _draws_as(b"\x93NUMPY\x02\x00\xff\xff\xff\xff"),
    "no header": _draws_as(b""),
    "fewer bytes than said": _draws_as(_header("{'descr': '<f8', 'fortran_order': False, 'shape': (2, 40, 13, 4), }\n") + b"1"),
    "bomb": _bomb, "compressed": _rewritten(lambda z, name, data: z.writestr(name, data), zipfile.ZIP_DEFLATED),
    "compressed otherwise": _rewritten(lambda z, name, data: z.writestr(name, data), zipfile.ZIP_BZIP2),
    "every member twice, the second in a folder": _rewritten(lambda z, name, data: (z.writestr(name, data), z.writestr("a/" + name, data))),
    "names of another folder": _rewritten(lambda z, name, data: z.writestr("../" + name, data)),
    "members that are no arrays": _rewritten(lambda z, name, data: z.writestr(name, b"x")), "nothing in it": _rewritten(lambda z, name, data: None),
    "no archive": lambda folder: replaced(folder, b"x" * 1000), "nothing": lambda folder: replaced(folder, b""),
    "half": lambda folder: replaced(folder, last_chunk(folder).read_bytes()[: last_chunk(folder).stat().st_size // 2]),
    "an array for an archive": lambda folder: replaced(folder, _header(HEADERS["negative"])),
    "the first chunk again": lambda folder: replaced(folder, sorted(folder.glob("0*.npz"))[0].read_bytes()),
    "more steps than allowed": with_array("draws", lambda a: np.repeat(a, 10, axis=1)),
}
DANGEROUS |= {"bomb", "header: more than memory"}


def _huge(folder: Path) -> None:
    os.truncate(last_chunk(folder), 2**40)


CHUNKS["sparse of a terabyte"] = _huge
DANGEROUS.add("sparse of a terabyte")


# key.json


def _key(change: Callable[[dict[str, Any]], Any]) -> Forge:
    def forge(folder: Path) -> None:
        path = folder / "key.json"
        path.write_text(json.dumps(change(json.loads(path.read_text()))))

    return forge


def _bytes(data: bytes) -> Forge:
    return lambda folder: overwrite(folder / "key.json", data)


def _items(part: str, value: Any) -> Forge:
    return _key(lambda key: {**key, "parts": {**key["parts"], part: dict.fromkeys(key["parts"][part], value)}})


WRONG: dict[str, Any] = {
    "null": None, "a number": 7, "negative": -1, "huge": 10**400, "a fraction": 0.5, "true": True, "a list": [], "nested": [[[{"a": [1]}]]],
    "a table of lists": {"a": [1]},
}
KEYS |= {f"schema is {words}": _key(lambda key, value=value: {**key, "schema": value}) for words, value in WRONG.items()}
KEYS |= {f"parts is {words}": _key(lambda key, value=value: {**key, "parts": value}) for words, value in WRONG.items()}
for part in ("settings", "seed", "versions", "moves", "starting points", "density"):
    for words in ("null", "a number", "a list", "nested"):
        KEYS[f"{part} is {words}"] = _key(lambda key, part=part, value=WRONG[words]: {**key, "parts": {**key["parts"], part: value}})
    for words, value in (("a number", 7), ("nested", {"a": {}})):
        KEYS[f"an item of {part} is {words}"] = _items(part, value)
KEYS |= {
    "no schema": _key(lambda key: {"parts": key["parts"]}), "no parts": _key(lambda key: {"schema": key["schema"]}),
    "a field more": _key(lambda key: {**key, "x": 1}),
    "another schema": _key(lambda key: {**key, "schema": "estim-checkpoint/1\n"}), "a list of keys": _key(lambda key: [key]), "empty": _bytes(b""),
    "truncated": lambda folder: overwrite(folder / "key.json", (folder / "key.json").read_bytes()[:-9]),
    "no JSON": _bytes(b"{"), "not a number": _bytes(b"NaN"), "no UTF-8": _bytes(b'{"schema": "\xff"}'),
    "half a surrogate": _bytes(b'{"schema": "\\ud800"}'),
    "deep": _bytes(b"[" * 10**6), "deep in a field": _bytes(b'{"schema": "estim-checkpoint/1", "parts": ' + b'{"a":' * 10**5 + b"}" * 10**5 + b"}"),
    "zeros": _bytes(bytes(10**5)), "UTF-16": _bytes('{"schema": "estim-checkpoint/1"}'.encode("utf-16")),
}


# what is no file


def _in_place(name: str, put: Callable[[Path], object]) -> Forge:
    def forge(folder: Path) -> None:
        path = folder / "key.json" if name == "key" else last_chunk(folder)
        path.unlink()
        put(path)

    return forge


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        before = Path.cwd()
        os.chdir(path.parent)  # the name of a socket is short
        try:
            made.bind(path.name)
        finally:
            os.chdir(before)


PUT: dict[str, Callable[[Path], object]] = {
    "fifo": os.mkfifo, "dangling link": lambda path: path.symlink_to("/nonexistent/place"),
    "link to /dev/zero": lambda path: path.symlink_to("/dev/zero"),
    "link to itself": lambda path: path.symlink_to(path.name), "folder": Path.mkdir, "socket": _socket,
    "link to a file": lambda path: path.symlink_to(__file__),
    "link to a folder": lambda path: path.symlink_to("/"),
}
KINDS |= {f"{name} is a {words}": _in_place(name, put) for name in ("key", "chunk") for words, put in PUT.items()}
KINDS["key is sparse of a terabyte"] = lambda folder: os.truncate(folder / "key.json", 2**40)
DANGEROUS |= {"key is a fifo", "key is a link to /dev/zero", "key is sparse of a terabyte", "chunk is a fifo", "chunk is a link to /dev/zero"}


def _elsewhere(folder: Path) -> None:
    moved = folder.with_name("elsewhere")
    shutil.move(folder, moved)
    folder.symlink_to(moved)


KINDS["the folder is a link to a sound one"] = _elsewhere
def _instead(put: Callable[[Path], object]) -> Forge:
    def forge(folder: Path) -> None:
        shutil.rmtree(folder)
        put(folder)

    return forge


KINDS["the folder is a file"] = _instead(lambda folder: folder.write_text("x"))
KINDS["the folder is a fifo"] = _instead(os.mkfifo)
DANGEROUS.add("the folder is a fifo")

CASES = {**{f"chunk, {words}": forge for words, forge in CHUNKS.items()}, **{f"key, {words}": forge for words, forge in KEYS.items()}, **KINDS}


def dangerous(case: str) -> bool:
    return case.removeprefix("chunk, ") in DANGEROUS or case.removeprefix("key, ") in DANGEROUS


def resumes(case: str) -> tuple[bool, ...]:
    """With --resume, and where nothing can be discarded also without it."""
    return (True,) if case.startswith("chunk, ") else (True, False)


def main() -> None:
    """Every dangerous case in this process, with the memory of a small machine; a line of JSON for each: case, answers, whether all is as it was."""
    import resource

    from test_forged import copied, entries, refusal

    resource.setrlimit(resource.RLIMIT_AS, (4 * 2**30,) * 2)
    work = Path(sys.argv[1])
    for number, case in enumerate(filter(dangerous, CASES)):
        folder = copied(work / "sound", work / str(number))
        CASES[case](folder)
        before = entries(work / str(number))
        said = [refusal(folder, resume=resume) for resume in resumes(case)]
        print(json.dumps([case, str(folder), said, entries(work / str(number)) == before]), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
