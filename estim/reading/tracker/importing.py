"""From a file of the program Tracker to the columns of a run: t_s, and x_m along the ramp since the
release.

The steps are: the track is read (`trk`, `export`), laid along one direction
(`ramp`), counted from the release, and looked at for what is suspicious (`plausibility`).
`docs/tracker.md` explains it to users.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from estim.arrays import FloatArray, IntArray
from estim.common import InputError, Quantity, in_its_file, listed, one_line, phrase, read_number
from estim.reading.input_file import read_bytes
from estim.reading.table import IMPORTED, Table
from estim.reading.tracker.export import head_of_export, read_export
from estim.reading.tracker.plausibility import missing_frames, suspicions
from estim.reading.tracker.ramp import Ramp, run_along
from estim.reading.tracker.track import Track, Unit
from estim.reading.tracker.trk import read_tracker

_UNITS = {"t": "s", "t_s": "s", "frame": "1"}  # all others are lengths in m
_MIN_ROWS = 5


@dataclass(frozen=True)
class Choices:
    """What the user states about a file.

    track : name of the track; the only one if None.
    along : see `ramp`.  unit : of the lengths, if not the file's.
    release : "first" (x = 0 at the first point), "keep" (at the origin of the axes) or a time in s
        (x = 0 at the point of that time; earlier points are left out).  frame_ms : duration of a
        frame, ms, against the file's.
    drop_duplicates : leave out rows of an export that copy the row before.
    """

    track: str | None = None
    along: str | float = "fit"
    unit: Unit | None = None
    release: Literal["first", "keep"] | float = "first"
    frame_ms: float | None = None
    drop_duplicates: bool = False


@dataclass(frozen=True, eq=False)
class Imported:
    """A run made of a track.

    rows : (n,) rows of the track from the release on.
    t : (n,) s, as in the file.  x : (n,) m along the ramp since the release.
    facts, warnings : where it comes from, and what is suspicious, in words.
    source, release : those of the facts that state the file and x = 0.
    """

    track: Track
    ramp: Ramp
    rows: IntArray
    t: FloatArray
    x: FloatArray
    facts: tuple[str, ...]
    warnings: tuple[str, ...]
    source: tuple[str, ...]
    release: str


def is_tracker_file(path: Path) -> bool:
    return path.suffix.lower() in (".trk", ".trz")


def head_of_export_file(path: Path) -> tuple[int, str, bool] | None:
    """`head_of_export` of a file; None where it cannot be read (its reader reports the reason)."""
    try:
        start = read_bytes(path)[:20_000]
    except InputError:
        return None
    return head_of_export(start.decode("utf-8-sig", errors="replace"))


def is_track(path: Path) -> bool:
    """Whether a file is one of Tracker beyond doubt: a .trk, a .trz, or an export that begins like
    no table of another program.
    """
    head = None if is_tracker_file(path) else head_of_export_file(path)
    return is_tracker_file(path) or (head is not None and not head[2])


@in_its_file
def import_track(path: Path, choices: Choices) -> Imported:
    """The run in a .trk, .trz or text export.  Raises InputError with file, line, field, rule and
    value.
    """
    if choices.frame_ms is not None and not 1e-3 <= choices.frame_ms <= 1e6:
        raise InputError("must be a duration in ms", field="frame_ms", value=choices.frame_ms)
    if is_tracker_file(path):
        if choices.drop_duplicates:
            raise InputError(
                "goes with text exports: a video has each frame once", field="drop_duplicates"
            )
        track = read_tracker(
            path, track=choices.track, unit=choices.unit, frame_ms=choices.frame_ms
        )
    else:
        if choices.frame_ms is not None:
            raise InputError(
                "goes with .trk and .trz files: an export states its times", field="frame_ms"
            )
        track = read_export(
            path, track=choices.track, unit=choices.unit, drop_duplicates=choices.drop_duplicates
        )
    ramp = run_along(track, choices.along)
    first, zero, release = _release(track, ramp, choices.release)
    rows = np.arange(first, track.t.size)
    x = ramp.along[rows] - zero
    t = track.t[rows]
    for array in (rows, t, x):
        array.setflags(write=False)
    source = (
        f"track '{track.name}' of {track.file}",
        f"SHA-256 {track.sha256}",
        *track.calibration,
    )
    facts = (*source, f"direction {ramp.direction}", *_tilt(ramp), release)
    return Imported(
        track,
        ramp,
        rows,
        t,
        x,
        facts,
        (*track.warnings, *suspicions(track, ramp, from_row=first)),
        source,
        release,
    )


def track_columns(imported: Imported, needed: Sequence[str]) -> Table:
    """Columns of a file of Tracker for any curve: `t` (s), `x`, `y` (m, calibrated axes) and
    `frame`, as Tracker names them; `t_s`, `x_m` and `across_m` as in a run, along the direction and
    counted from the release.  Rows before a stated release are left out.

    Raises InputError with file, field, rule and value.
    """
    track, rows = imported.track, imported.rows
    sources = {
        "t": track.t,
        "x": track.x,
        "y": track.y,
        "frame": None if track.frames is None else track.frames.astype(np.float64),
        "across_m": imported.ramp.across,
    }
    columns = {name: column[rows] for name, column in sources.items() if column is not None} | {
        "t_s": imported.t,
        "x_m": imported.x,
    }
    for name in needed:
        if name not in columns:
            raise InputError(
                "is missing",
                field=name,
                quoted=f"a track has {listed(list(columns))}",
                file=track.file,
            )
    along = bool({"x_m", "across_m"} & set(needed))
    of_axes = (*imported.source, *([imported.release] if rows[0] else []))
    return Table(
        file=track.file,
        sha256=track.sha256,
        columns={},
        lines=track.lines[rows],
        warnings=imported.warnings if along else (*track.warnings, *missing_frames(imported.t)),
        facts=imported.facts if along else of_axes,
        units={name: _UNITS.get(name, "m") for name in needed},
        imported=True,
    ).with_columns({name: columns[name] for name in needed})


def read_release(text: str) -> Literal["first", "keep"] | float:
    """The release as it is written on a command line.  Raises InputError."""
    if text == "first":
        return "first"
    if text == "keep":
        return "keep"
    try:
        return read_number(text)
    except ValueError:
        raise InputError(
            "must be first, keep or a time in s", field="release", value=text
        ) from None


def _release(track: Track, ramp: Ramp, release: str | float) -> tuple[int, float, str]:
    """The first row, the position that is zero there, and both in words."""
    if release == "keep":
        return 0, 0.0, phrase("x_m = 0 at the origin of the axes, as in the file")
    row = 0 if release == "first" else _row_at(track, float(release))
    words = phrase(
        "x_m = 0 at the first point, t = {t:.8g} s, {x:.6g} m from the origin of the axes"
        if release == "first"
        else "x_m = 0 at the release stated, t = {t:.8g} s, {x:.6g} m from the origin of the axes",
        t=track.t[row],
        x=ramp.along[row],
    )
    earlier = phrase("; {n} earlier points were excluded", n=row) if row else ""
    return row, float(ramp.along[row]), words + earlier


def _row_at(track: Track, time: float) -> int:
    """The row of a stated release, s.  Raises InputError."""
    step = float(np.median(np.diff(track.t)))
    if not math.isfinite(time) or not track.t[0] - step <= time <= track.t[-1]:
        raise InputError(
            f"must be a time of the track, {track.t[0]:.6g} to {track.t[-1]:.6g} s",
            field="release",
            value=time,
        )
    row = int(np.argmin(np.abs(track.t - time)))
    if track.t.size - row < _MIN_ROWS:
        raise InputError(f"must leave at least {_MIN_ROWS} points", field="release", value=time)
    return row


def _tilt(ramp: Ramp) -> tuple[str, ...]:
    if ramp.tilt is None:
        return ()
    value, u = math.degrees(ramp.tilt.value), math.degrees(ramp.tilt.u)
    return (
        phrase(
            "tilt of the fitted line {tilt:.3f} deg against the x axis, positive uphill, "
            "standard uncertainty {u:.3f} deg from the scatter of the points alone",
            tilt=value,
            u=u,
        ),
    )


def stated_tilt(facts: Sequence[str]) -> Quantity | None:
    """The tilt (rad) that the facts of an imported track state, as `estim import` words it, in
    English; None where they do not.
    """
    number = r"(-?\d{1,4}\.\d{3})"
    for fact in facts:
        if match := re.match(
            rf"tilt of the fitted line {number} deg .* standard uncertainty {number} deg", fact
        ):
            return Quantity(math.radians(float(match[1])), math.radians(abs(float(match[2]))))
    return None


def run_table(imported: Imported) -> bytes:
    """The CSV file of a run, with where it comes from in its head; columns that begin with _ are
    for people.
    """
    across = imported.ramp.across
    columns: dict[str, list[str]] = {
        "t_s": [repr(v) for v in imported.t.tolist()],
        "x_m": [repr(v) for v in imported.x.tolist()],
    }
    if across is not None:
        columns["_across_m"] = [repr(v) for v in across[imported.rows].tolist()]
    if imported.track.frames is not None:
        columns["_frame"] = [str(n) for n in imported.track.frames[imported.rows].tolist()]
    head = [f"# {fact}" for fact in imported.facts] + [
        f"# warning: {warning}" for warning in imported.warnings
    ]
    lines = [IMPORTED, *(" ".join(one_line(line).split()) for line in head), ",".join(columns)]
    lines += [",".join(row) for row in zip(*columns.values(), strict=True)]
    return ("\n".join(lines) + "\n").encode()
