"""The path of one point in a video, as a .trk or a text export gives it: the record that both
readers make.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from estim.arrays import FloatArray, IntArray
from estim.common import InputError

Unit = Literal["m", "cm", "mm"]

METRES: Mapping[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}

DROP = "--drop-duplicates (in a campaign: drop_duplicates = true)"

LEAST_STEP = 1e-9  # s: frames are not closer, here and in a run's own table
MOST = 1e10  # s, and m or rad in a run's own table: beyond it is no measurement

_MIN_POINTS = 5
_MAX_POINTS = 1_000_000


@dataclass(frozen=True, eq=False)
class Track:
    """The track `name` of `file` in SI units; y points up.

    t : (n,) s, increasing.
    x, y : (n,) m in the calibrated axes; None where an export leaves the column out.
    frames : (n,) number of each frame; None where an export does not state it.
    lines : (n,) line of the file of each point.
    speed : (n,) m/s, the column v of an export, NaN where blank; a magnitude.  None where there is
        no such column.
    calibration : what the file states of scale, origin, axes and frames, in words.
    sha256 : of the file's bytes.
    warnings : what is suspicious but no error, in words.
    """

    file: str
    sha256: str
    name: str
    t: FloatArray
    x: FloatArray | None
    y: FloatArray | None
    frames: IntArray | None
    lines: IntArray
    speed: FloatArray | None
    calibration: tuple[str, ...]
    warnings: tuple[str, ...]

    def __post_init__(self) -> None:
        for array in (self.t, self.x, self.y, self.frames, self.lines, self.speed):
            if array is not None:
                array.setflags(write=False)
        n = self.t.size
        if not _MIN_POINTS <= n <= _MAX_POINTS:
            bound = f"least {_MIN_POINTS}" if n < _MIN_POINTS else f"most {_MAX_POINTS}"
            raise InputError(
                f"must hold at {bound} points", field=f"track {self.name}", value=n, file=self.file
            )
        steps = np.diff(self.t, prepend=-np.inf)
        copies = int(np.sum(steps == 0.0))
        same = (
            f"row repeats its time; if it is a copy, drop it by {DROP}"
            if copies == 1
            else "rows repeat their time: rounded by a spreadsheet?"
        )
        repeated = f" ({copies} {same})" if steps[np.argmin(steps > 0.0)] == 0.0 else ""
        for valid, rule in (
            (steps > 0.0, f"must increase from row to row{repeated}"),
            (steps >= LEAST_STEP, f"must advance by at least {LEAST_STEP:g} s from row to row"),
            (np.abs(self.t) <= MOST, f"must lie within ±{MOST:g} s"),
        ):
            if not np.all(valid):
                row = int(np.argmin(valid))
                raise InputError(
                    rule,
                    field="t",
                    value=self.t[row].item(),
                    file=self.file,
                    line=int(self.lines[row]),
                )
