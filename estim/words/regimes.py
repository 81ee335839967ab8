"""The place of a run on the map of motions in words: what it should do, and what its recording
shows.
"""

from __future__ import annotations

import math

from estim.common import Finding, Kind
from estim.words.table import Table, worded


def sure(p: float) -> str:
    """A probability in words: 'P > 0.999', 'P = 0.87'."""
    return (
        "P > 0.999"
        if p > 0.999
        else "P < 0.001"
        if p < 0.001
        else f"P = {p:.3f}"
        if p > 0.99 or p < 0.01
        else f"P = {p:.2f}"
    )


def _off(f: Finding) -> str:
    n = f.numbers
    return worded(
        f,
        "run {run}: with these values it should not start in this direction, but its "
        "recording extends to {farthest:.3g} m ({sure})"
        if n["sets_off"] < 0.5
        else "run {run}: with these values it should keep rolling, but its recording extends only "
        "to {farthest:.3g} m ({sure})"
        if math.isnan(n["expected"])
        else "run {run}: with these values it should turn back at {expected:.3g} m, but its "
        "recording extends to {farthest:.3g} m ({sure})",
        sure=sure(f.p),
    )


WORDS: Table = {Kind.RUN_OFF_MAP: _off}
