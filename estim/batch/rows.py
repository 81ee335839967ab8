"""What is kept of a run in a batch: a line of the table, and the file that says from what its result was made."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import msgspec

from estim.batch.units import Unit
from estim.campaign import Campaign
from estim.common import EstimError, as_json, pictures_of, read_file, remove_files, remove_pictures, split_level, write_whole
from estim.versions import engine_versions

ROW, RESULT, REPORT = "row.json", "result.json", "report.md"
_FORMATS = ("report.html", "report.pdf")
_LARGEST, _LARGEST_RESULT = 2**24, 2**28


class Value(msgspec.Struct, frozen=True):
    """mean, sd, q025, q975 : of the posterior, SI units.  informed : whether the data narrowed what was stated."""

    mean: float
    sd: float
    q025: float
    q975: float
    unit: str
    informed: bool


class Row(msgspec.Struct, frozen=True):
    """One run: its status, its values where that is ok, else the first reason; `error` where there is no result at all.

    kind : of the data, "measured" or "synthetic"; "" where there is no result.
    key : digest of what the result depends on.  digest : SHA-256 of `result.json`.  seconds : of one processor.
    interval : s between frames, of a run that was imported from a video; None of others.
    """

    campaign: str
    run: str
    place: str
    kind: str
    status: str
    reason: str
    error: str
    values: dict[str, Value]
    seconds: float
    key: str
    digest: str = ""
    interval: float | None = None
    inputs: dict[str, str] = {}  # path of each file that was read -> SHA-256 of its bytes

    @property
    def name(self) -> str:
        return f"{self.campaign}: {self.run}" if self.run else self.campaign


def key_of(campaign: Campaign, run: str, settings: Mapping[str, object]) -> str:
    """Digest of everything that decides the result: the campaign's file, the data, true values, seed and settings, versions."""
    parts = {
        "campaign": campaign.sha256, "data": campaign.tables[run].sha256, "run": run, "truth": dict(campaign.truth),
        "settings": {name: str(value) for name, value in settings.items()},
        "versions": engine_versions(),
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def row_of(unit: Unit, result: bytes, *, key: str, seconds: float, interval: float | None) -> Row:
    """The row of a `result.json`."""
    record = json.loads(result)
    return Row(
        str(unit.campaign), unit.run, unit.place, record["kind"], record["status"], next(iter(record["reasons"]), ""), "",
        _values(record) if record["status"] == "ok" else {}, seconds, key, hashlib.sha256(result).hexdigest(), interval,
    )


def _values(record: Mapping[str, Any]) -> dict[str, Value]:
    found: dict[str, Value] = {}
    for name, p in record["parameters"].items():
        if p["mean"] is not None and p["sd"] is not None:
            found[split_level(name)[0]] = Value(p["mean"], p["sd"], p["q025"], p["q975"], p["unit"], p["measured"])
    for run in record["runs"].values():
        for name in run["sought"]:
            p = run["derived"][name]
            if p["mean"] is not None and p["sd"] is not None:
                found[name] = Value(p["mean"], p["sd"], p["q025"], p["q975"], p["unit"], True)
    return found


def failed(unit: Unit, error: str, seconds: float = 0.0) -> Row:
    """A run without a result."""
    return Row(str(unit.campaign), unit.run, unit.place, "", "", "", error, {}, seconds, "")


def keep(folder: Path, row: Row, files: Mapping[str, bytes]) -> None:
    """Write what was made of a run in place of what was there, and its row last: where that stands, all is whole and of its key."""
    forget(folder, row.place)
    for name, data in files.items():
        write_whole(folder / row.place / name, data, within=folder)
    write_whole(folder / row.place / ROW, as_json(row), within=folder)


def forget(folder: Path, place: str) -> None:
    """Remove what an earlier batch made of a run, which would pass for what is made now; its row first, so that no row stands without the rest."""
    pictures = pictures_of(folder / place / REPORT, within=folder)
    for name in (ROW, RESULT, REPORT, *_FORMATS):
        with suppress(EstimError):  # what is no plain file is none of ours
            remove_files(folder / place, [name], within=folder)
    remove_pictures(folder / place, pictures, within=folder)


def kept(folder: Path, unit: Unit, key: str) -> Row | None:
    """The row of a result that is there and was made from the same things; None where it has to be made."""
    try:
        data = read_file(folder / unit.place / ROW, at_most=_LARGEST, within=folder)
        row = None if data is None else msgspec.json.decode(data, type=Row)
        result = read_file(folder / unit.place / RESULT, at_most=_LARGEST_RESULT, within=folder)
    except (EstimError, msgspec.DecodeError, UnicodeDecodeError):
        return None
    if row is None or row.key != key or result is None or hashlib.sha256(result).hexdigest() != row.digest:
        return None
    return row
