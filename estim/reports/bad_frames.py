"""The bad frames of a run in `result.json` and the report."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from estim.checks import bad_frames_found
from estim.deviation import FoundForce
from estim.sampling import number
from estim.words import tell


class BadFrame(msgspec.Struct, frozen=True):
    """A frame whose reading is shifted, or from which on all are, found beside an unmodelled force; its shift is one more unknown of the fit."""

    kind: str  # "frame": this one reading; "step": all from it on; "clock": all times from it on
    t_s: float | None
    line: int | None  # of the file
    size: float  # of the shift
    sd: float
    unit: str
    probability: float  # that something is wrong there
    words: str


def bad_frames(forces: Sequence[FoundForce], run: str) -> list[BadFrame]:
    """Those of one run, in the order of time."""
    return [
        BadFrame(
            jump.kind, number(jump.t), jump.line or None, jump.size, jump.sd, "s" if jump.kind == "clock" else found.reading_unit,
            jump.probability, tell(words),
        )
        for found in forces if found.run == run
        for jump, words in zip(found.bad.jumps, bad_frames_found(found), strict=True)
    ]
