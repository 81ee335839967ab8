"""The place of a run on the map of motions in words: what it should do, and what its recording shows."""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import Finding, Kind
from estim.words.table import Table


def sure(p: float) -> str:
    """A probability in words: 'P > 0.999', 'P = 0.87'."""
    return "P > 0.999" if p > 0.999 else "P < 0.001" if p < 0.001 else f"P = {p:.3f}" if p > 0.99 or p < 0.01 else f"P = {p:.2f}"


def _off(f: Finding) -> str:
    n = f.numbers
    should = "should roll on" if math.isnan(n["expected"]) else f"should turn at {n['expected']:.3g} m"
    if n["sets_off"] < 0.5:
        should = "should not set off in this direction"
    return f"run {f.run}: with these values it {should}, and its recording goes to {n['farthest']:.3g} m ({sure(f.p)})"


WORDS: Table = MappingProxyType({Kind.RUN_OFF_MAP: _off})
