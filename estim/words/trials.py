"""A calibration in words: which interval has the wrong coverage, and how."""

from __future__ import annotations

from estim.common import Finding, Kind, PhraseTable, phrase
from estim.words.table import Table, worded

_DIRECTIONS = PhraseTable(
    {
        "none": "no posterior at all",
        "low": "biased: the estimates are too low",
        "high": "biased: the estimates are too high",
        "narrow": "intervals are too narrow",
        "wide": "intervals are too wide",
    }
)


def direction_words(direction: str) -> str:
    """How the estimates or intervals of a quantity are wrong; "" where that is not known."""
    return _DIRECTIONS.get(direction, "")


def _coverage(f: Finding) -> str:
    p, covered = f.numbers["probability"], f.size
    return worded(
        f,
        "{name}: {how} (the {p:.0f} % interval covered {held:.1f} %, {errors:.1f} Monte-Carlo "
        "standard deviations too few)"
        if covered < p
        else "{name}: {how} (the {p:.0f} % interval covered {held:.1f} %, {errors:.1f} Monte-Carlo "
        "standard deviations too many)",
        how=direction_words(f.test),
        p=100 * p,
        held=100 * covered,
    )


WORDS: Table = {
    Kind.RANKS_UNEVEN: lambda f: worded(
        f, "{name}: {how} (ranks not uniform, {p})", how=direction_words(f.test) or phrase("uneven")
    ),
    Kind.COVERAGE_OFF: _coverage,
    Kind.TRIALS_FAILED: (
        "{n:.0f} of {trials:.0f} simulated campaigns gave no posterior, mostly: {name}"
    ),
}
