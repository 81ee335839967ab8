"""Rows that are not fit, in words: how many, and why."""

from __future__ import annotations

from types import MappingProxyType

from estim.common import Finding, Kind
from estim.words.table import Table

_BESIDE = "within five standard deviations of a reading from the"
_WHY = MappingProxyType(
    {
        Kind.OUTSIDE_TIMES: "outside the window of time",
        Kind.OUTSIDE_POSITIONS: "outside the window of position",
        Kind.OUTSIDE_WINDOW: "outside the stated window",
        Kind.LEFT_OUT: "as stated by leave_out_s",
        Kind.WAY_BACK: "after the farthest point (the way back is another motion)",
        Kind.BESIDE_RELEASE: f"{_BESIDE} release",
        Kind.BESIDE_TURNING: f"{_BESIDE} turning point",
    }
)


def _without_speed(f: Finding) -> str:
    return f"{f.size:.0f} at the ends or beside a missing frame, where the {f.test} derivative does not exist"


def _left_out(f: Finding) -> str:
    return f"{f.size:.0f} {_WHY[f.kind]}"


def _between(f: Finding) -> str:
    return f"{f.size:.0f} between: one of every {f.numbers['every']:.0f} is fit"


WORDS: Table = MappingProxyType({Kind.NO_DERIVATIVE: _without_speed, Kind.ROWS_BETWEEN: _between, **dict.fromkeys(_WHY, _left_out)})
