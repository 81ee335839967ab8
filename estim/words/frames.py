"""Frames in words: those that are not fit and why; bad ones, by how much, and the line of a
campaign that leaves them out.
"""

from __future__ import annotations

import math

from estim.common import Finding, Kind, format_quantity, phrase
from estim.words.table import Table, worded


def _where(f: Finding) -> str:
    n = f.numbers
    place = f"x = {n['x']:.4g}" if math.isnan(n["t"]) else f"t = {n['t']:.6g} s"
    return place + (worded(f, " (line {line:.0f} of its file)") if n["line"] else "")


def _shift(f: Finding) -> str:
    counts = worded(f, ", {counts:+.1f} counts of the encoder") if f.numbers["counts"] else ""
    sign = "+" if f.size > 0.0 else ""
    return f"{sign}{format_quantity(f.size, f.numbers['sd'])} {f.names[0]}{counts} (P = {f.p:.3f})"


def _frame(f: Finding) -> str:
    sentence = worded(
        f,
        "run {run}: the frame at {where} is displaced by {shift}; the data are not altered: "
        "the frame stays in the fit, and its displacement is an additional unknown",
        where=_where(f),
        shift=_shift(f),
    )
    if math.isnan(f.numbers["t"]):
        return sentence
    return sentence + worded(
        f, "; to leave it out, put leave_out_s = [{t:.6g}] in the table of the run"
    )


def _windows(f: Finding) -> str:
    return worded(
        f,
        "with t_max_s = {before:.6g} in its window a fit has only what comes before, with "
        "t_min_s = {after:.6g} only what comes after",
    )


def _lost(f: Finding) -> str:
    frames = f.numbers["frames"]
    return worded(
        f,
        "run {run}: before the frame at {where} {what}, but the time stamps do not show it (P "
        "= {prob:.3f}); the data are not altered: the time offset is an additional unknown; "
        "{windows}",
        where=_where(f),
        windows=_windows(f),
        what=phrase(
            "{n} frames were lost" if frames > 0.0 else "{n} frames were counted twice",
            n=format_quantity(abs(frames), f.numbers["sd_frames"]),
        ),
    )


WORDS: Table = {
    Kind.FRAME_OFF: _frame,
    Kind.STEP_STAYS: lambda f: worded(
        f,
        "run {run}: from the frame at {where} onwards all readings are displaced by {shift}; "
        "the data are not altered: the displacement is an additional unknown; {windows} "
        '(then state offset_{unit} = "0 +/- {wide:.1g}" too)',
        where=_where(f),
        shift=_shift(f),
        windows=_windows(f),
        unit=f.names[0],
        wide=2.0 * abs(f.size),
    ),
    Kind.FRAMES_LOST: _lost,
    Kind.FRAMES_CROWD: (
        "run {run}: more than {n:.0f} frames are displaced: these are not "
        "isolated errors; the readings scatter more than stated"
    ),
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
