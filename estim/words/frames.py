"""Bad frames in words: which, by how much, and the line of a campaign that leaves them out."""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import Finding, Kind, format_quantity
from estim.words.table import Table

_KEPT = "nothing is repaired: the frame stays in the fit with its shift as one more unknown"


def _where(f: Finding) -> str:
    n = f.numbers
    place = f"x = {n['x']:.4g}" if math.isnan(n["t"]) else f"t = {n['t']:.6g} s"
    return place + (f" (line {n['line']:.0f} of its file)" if n["line"] else "")


def _shift(f: Finding) -> str:
    counts = f", {f.numbers['counts']:+.1f} counts of the encoder" if f.numbers["counts"] else ""
    sign = "+" if f.size > 0.0 else ""
    return f"{sign}{format_quantity(f.size, f.numbers['sd'])} {f.names[0]}{counts} (P = {f.p:.3f})"


def _frame(f: Finding) -> str:
    without = "" if math.isnan(f.numbers["t"]) else f"; leave_out_s = [{f.numbers['t']:.6g}] in the table of the run leaves it out"
    return f"run {f.run}: the frame at {_where(f)} is off by {_shift(f)}; {_KEPT}{without}"


def _windows(f: Finding) -> str:
    return f"window = {{t_max_s = {f.numbers['before']:.6g}}} fits what comes before, {{t_min_s = {f.numbers['t']:.6g}}} what comes after"


def _step(f: Finding) -> str:
    return (
        f"run {f.run}: from the frame at {_where(f)} on all readings are shifted by {_shift(f)}; nothing is repaired: the shift is one more "
        f"unknown; {_windows(f)}"
    )


def _lost(f: Finding) -> str:
    frames, sd = f.numbers["frames"], f.numbers["sd_frames"]
    what = "frames were lost" if frames > 0.0 else "frames were counted twice"
    return (
        f"run {f.run}: before the frame at {_where(f)} {format_quantity(abs(frames), sd)} {what} and the times go on as if nothing were "
        f"(P = {f.p:.3f}); nothing is repaired: the shift of the times is one more unknown; {_windows(f)}"
    )


WORDS: Table = MappingProxyType(
    {
        Kind.FRAME_OFF: _frame, Kind.STEP_STAYS: _step, Kind.FRAMES_LOST: _lost,
        Kind.FRAMES_CROWD: lambda f: (
            f"run {f.run}: more than {f.size:.0f} frames are off: these are no single slips, the readings scatter more than stated"
        ),
    }
)
