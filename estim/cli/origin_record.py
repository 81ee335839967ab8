"""The record `origin.json` that stands beside each report."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from estim.common import InputError, json_of, read_file

ORIGIN = "origin.json"
# of a synthetic campaign, in whose folder a report may stand: it must not pass for the report
# before
SIMULATION = "simulation.json"
SCHEMA = "estim-origin/1"
_LARGEST = 2**24


@dataclass(frozen=True)
class Origin:
    """command : arguments of `estim`, without those that change no number.  part : folder of this
    report within what the command writes.

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


def read_origin(folder: Path, *, within: Path | None = None, name: str = ORIGIN) -> Origin:
    """The origin of the report in `folder`.  Raises InputError where there is none, or it is none
    of estim's: it may be another program's.
    """
    path = folder / name
    data = read_file(path, at_most=_LARGEST, within=within or folder)
    if data is None:
        raise InputError(
            f"holds no {ORIGIN}: it is not a report of this version of estim",
            field="report",
            value=str(folder),
        )
    import msgspec

    try:
        origin = msgspec.convert(json_of(data), Origin)
    except (ValueError, msgspec.ValidationError) as error:
        raise InputError(
            f"is no origin of a report ({str(error).splitlines()[0]})", file=str(path)
        ) from None
    if origin.schema != SCHEMA:
        raise InputError(f"must be {SCHEMA}", field="schema", value=origin.schema, file=str(path))
    for field, places in (("part", [origin.part]), ("outputs", origin.outputs)):
        for place in places:
            if not stays_inside(place) or (field == "outputs" and not PurePosixPath(place).parts):
                raise InputError(
                    "must lie within what the command writes",
                    field=field,
                    value=place,
                    file=str(path),
                )
    return origin


def written_before(folder: Path, *, within: Path, name: str = ORIGIN) -> dict[str, str]:
    """Files of the report that stands in `folder`, with their digests; none where there is none.

    Raises InputError for an origin that is none of ours.
    """
    exists = read_file(folder / name, at_most=_LARGEST, within=within) is not None
    return read_origin(folder, within=within, name=name).outputs if exists else {}


def stays_inside(name: str) -> bool:
    """Whether a path that somebody may have written can be one of a file and leads no way out of
    its folder.
    """
    return name.isprintable() and not (
        PurePosixPath(name).is_absolute()
        or Path(name).is_absolute()
        or ".." in PurePosixPath(name).parts
    )
