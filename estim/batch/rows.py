"""What is kept of a run in a batch: a line of the table, and the file that records from what its
result was made.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath

import msgspec

from estim.batch.units import Unit
from estim.common import (
    EstimError,
    Files,
    InputError,
    Json,
    Label,
    as_json,
    json_of,
    plain,
    read_file,
    remove_files,
    remove_own,
    replace_own,
    require_room,
    split_level,
)

ROW, RESULT = "row.json", "result.json"


class Value(msgspec.Struct, frozen=True):
    """mean, sd, q025, q975 : of the posterior, SI units.  informed : whether the data narrowed what
    was stated.  label : how people read it; None: under its own name, in SI units.
    """

    mean: float
    sd: float
    q025: float
    q975: float
    unit: str
    informed: bool
    label: Label | None = None


class RunRow(msgspec.Struct, frozen=True):
    """One run: its status, its values where that is ok, else the first reason; `error` where there
    is no result at all.

    names : of its quantities, whatever its status; none where there is no result.
    kind : of the data, "measured" or "synthetic"; "" where there is no result.
    key : digest of what the result depends on.
    seconds : of one processor.  outputs : in `row.json`, files of the run and their SHA-256
        digests.
    interval : s between frames, of a run that was imported from a video; None of others.
    """

    campaign: str
    run: str
    place: str
    kind: str = ""
    status: str = ""
    reason: str = ""
    error: str = ""
    values: dict[str, Value] = {}
    seconds: float = 0.0
    key: str = ""
    outputs: dict[str, str] = {}
    interval: float | None = None
    inputs: dict[str, str] = {}  # path of each file that was read -> SHA-256 of its bytes
    names: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        return f"{self.campaign}: {self.run}" if self.run else self.campaign


def row_of(
    unit: Unit,
    result: bytes,
    labels: Mapping[str, Label],
    *,
    key: str,
    seconds: float,
    interval: float | None,
) -> RunRow:
    """The row of a `result.json`.  labels : of its parameters, by their names without a level."""
    record = json.loads(result)
    quantities = _quantities(record, labels)
    return RunRow(
        plain(str(unit.campaign)),
        unit.run,
        unit.place,
        record["kind"],
        record["status"],
        next(iter(record["reasons"]), ""),
        values={
            name: Value(p["mean"], p["sd"], p["q025"], p["q975"], p["unit"], informed, label)
            for name, p, informed, label in quantities
            if record["status"] == "ok" and p["mean"] is not None and p["sd"] is not None
        },
        names=tuple(name for name, *_ in quantities),
        seconds=seconds,
        key=key,
        interval=interval,
    )


def _quantities(
    record: Json, labels: Mapping[str, Label]
) -> list[tuple[str, Json, bool, Label | None]]:
    """Name, summary, whether the data narrowed it, and label of each quantity of a result."""
    bases = {split_level(name)[0]: p for name, p in record["parameters"].items()}
    entries = [(name, p, p["measured"], labels.get(name)) for name, p in bases.items()]
    for run in record["runs"].values():
        entries += [(name, run["derived"][name], True, None) for name in run["sought"]]
    return entries


def failed(unit: Unit, error: str, seconds: float = 0.0) -> RunRow:
    """A run without a result."""
    campaign = plain(str(unit.campaign))
    return RunRow(campaign, unit.run, unit.place, error=error, seconds=seconds)


def keep(folder: Path, row: RunRow, files: Files) -> None:
    """Write what was made of a run, with its row, in place of what an earlier batch made of it.

    Raises EstimError where a file of somebody else is in the way.
    """

    def record(outputs: Mapping[str, str]) -> bytes:
        return as_json(msgspec.structs.replace(row, outputs=dict(outputs)))

    replace_own(folder / row.place, files, _written(folder, row.place), ROW, record, within=folder)


def forget(folder: Path, place: str) -> None:
    """Remove what an earlier batch made of a run, which would pass for what is made now."""
    with suppress(EstimError):  # what is none of ours stays
        remove_own(folder / place, _written(folder, place), within=folder)
        remove_files(folder / place, [ROW], within=folder)


def require_places(folder: Path, units: Iterable[Unit]) -> None:
    """Raises EstimError, before anything is computed, where files of others stand where results of
    `units` are to go.
    """
    for unit in units:
        require_room(folder / unit.place, (RESULT,), _written(folder, unit.place), within=folder)


def kept(folder: Path, unit: Unit, key: str, interval: float | None) -> RunRow | None:
    """The row of a result that is there and was made from the same things, read from that result;
    None where it has to be made.
    """
    row = _row_at(folder, unit.place)
    if row is None or row.key != key or RESULT not in row.outputs:
        return None
    for name, digest in row.outputs.items():
        data = read_file(folder / unit.place / name, within=folder)
        if data is None or hashlib.sha256(data).hexdigest() != digest:
            return None
        if name == RESULT:
            labels = {name: value.label for name, value in row.values.items() if value.label}
            current = row_of(unit, data, labels, key=key, seconds=row.seconds, interval=interval)
    return current


def _written(folder: Path, place: str) -> dict[str, str]:
    """Files of a run that an earlier batch wrote, with their digests."""
    row = _row_at(folder, place)
    return {} if row is None else row.outputs


def _row_at(folder: Path, place: str) -> RunRow | None:
    """The row that stands there, None where none does.  Raises EstimError for a file of that name
    that is none of ours.
    """
    path = folder / place / ROW
    data = read_file(path, within=folder)
    try:
        row = None if data is None else msgspec.convert(json_of(data), RunRow)
    except (ValueError, msgspec.ValidationError):
        row = None
    if row is not None and all(
        PurePosixPath(name).parts and ".." not in PurePosixPath(name).parts for name in row.outputs
    ):
        return row
    if data is None:
        return None
    raise InputError(
        "was not written by estim, or was changed since: move it away, or choose another folder",
        file=path,
    )
