"""The record `origin.json` that stands beside each report."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from estim.common import EstimError, InputError, read_file

ORIGIN = "origin.json"
SCHEMA = "estim-origin/1"
_LARGEST = 2**24


@dataclass(frozen=True)
class Origin:
    """command : arguments of `estim`, without those that change no number.  part : folder of this report within what the command writes.

    inputs, outputs : path (of outputs: within the folder) -> SHA-256 of its bytes.
    """

    schema: str
    command: list[str]
    part: str
    inputs: dict[str, str]
    outputs: dict[str, str]
    versions: dict[str, str]

    @property
    def line(self) -> str:
        return shlex.join(["estim", *self.command])


def read_origin(folder: Path) -> Origin:
    """The origin of the report in `folder`.  Raises InputError where there is none, or it is none of estim's."""
    path = folder / ORIGIN
    data = read_file(path, at_most=_LARGEST, within=folder)
    if data is None:
        raise InputError(f"holds no {ORIGIN}: it is no report of this version of estim", field="report", value=str(folder))
    import msgspec

    try:
        origin = msgspec.json.decode(data, type=Origin)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(f"is no origin of a report ({str(error).splitlines()[0]})", file=str(path)) from None
    if origin.schema != SCHEMA:
        raise InputError(f"must be {SCHEMA}", field="schema", value=origin.schema, file=str(path))
    return origin


def written_before(folder: Path) -> dict[str, str]:
    """Files of the report that stands in `folder`, with their digests; none where none of ours does."""
    try:
        outputs = read_origin(folder).outputs
    except EstimError:
        return {}
    return {name: digest for name, digest in outputs.items() if inside(name)}


def inside(name: str) -> bool:
    """Whether a path that somebody may have written leads no way out of its folder."""
    return not (PurePosixPath(name).is_absolute() or Path(name).is_absolute() or ".." in PurePosixPath(name).parts)
