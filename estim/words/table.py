"""What the tables of this room hold: a sentence (by `later`), or how to make one of a finding."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from estim.common import Finding, Kind, phrase

Table = Mapping[Kind, str | Callable[[Finding], str]]


def filled(table: Table, finding: Finding) -> str:
    """The sentence of a finding whose kind stands in `table`."""
    words = table[finding.kind]
    return phrase(words) if isinstance(words, str) else words(finding)
