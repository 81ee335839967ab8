"""A calibration in words: which interval is off, and how."""

from __future__ import annotations

from types import MappingProxyType

from estim.common import Finding, Kind, format_p
from estim.words.table import Table

_DIRECTIONS = MappingProxyType(
    {
        "": "",
        "none": "no posterior at all",
        "low": "biased, estimates lie too low",
        "high": "biased, estimates lie too high",
        "narrow": "intervals are too narrow",
        "wide": "intervals are too wide",
    }
)


def direction_words(direction: str) -> str:
    """How a quantity is off; "" where nothing tells."""
    return _DIRECTIONS[direction]


def _uneven(f: Finding) -> str:
    return f"{f.parameters[0].name}: {direction_words(f.test) or 'uneven'} (ranks not uniform, {format_p(f.p)})"


def _coverage(f: Finding) -> str:
    p, held = f.numbers["probability"], f.size
    off = f"{f.numbers['errors']:.1f} Monte-Carlo standard deviations too {'few' if held < p else 'many'}"
    return f"{f.parameters[0].name}: {direction_words(f.test)} (the {100 * p:.0f} % interval covered {100 * held:.1f} %, {off})"


WORDS: Table = MappingProxyType(
    {
        Kind.RANKS_UNEVEN: _uneven,
        Kind.COVERAGE_OFF: _coverage,
        Kind.TRIALS_FAILED: lambda f: (
            f"{f.size:.0f} of {f.numbers['trials']:.0f} simulated campaigns gave no posterior, mostly: {f.names[0]}"
        ),
    }
)
