"""Rows that are not fit, in words: how many, and why."""

from __future__ import annotations

from estim.common import Kind
from estim.words.table import Table

WORDS: Table = {
    Kind.NO_DERIVATIVE: (
        "{n:.0f} at the ends or next to a missing frame, where the {test} "
        "derivative cannot be computed"
    ),
    Kind.ROWS_BETWEEN: "{n:.0f} in between: one in every {every:.0f} is fitted",
    Kind.OUTSIDE_TIMES: "{n:.0f} outside the time window",
    Kind.OUTSIDE_POSITIONS: "{n:.0f} outside the position window",
    Kind.OUTSIDE_WINDOW: "{n:.0f} outside the stated window",
    Kind.LEFT_OUT: "{n:.0f} excluded by leave_out_s",
    Kind.WAY_BACK: "{n:.0f} after the farthest point (the way back is another motion)",
    Kind.BESIDE_RELEASE: (
        "{n:.0f} less than five standard deviations of a reading away from the release"
    ),
    Kind.BESIDE_TURNING: (
        "{n:.0f} less than five standard deviations of a reading away from the turning point"
    ),
}
