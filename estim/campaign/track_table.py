"""The keys that say how a file of the program Tracker is read, beside those of tables
(`dialect_table`).
"""

from __future__ import annotations

from typing import Literal

import msgspec

from estim.campaign.dialect_table import DialectKeys
from estim.reading import Choices, Unit


class TrackKeys(DialectKeys, forbid_unknown_fields=True, frozen=True, kw_only=True):
    track: str | None = None
    along: str | float | None = None
    unit: Unit | None = None
    release: Literal["first", "keep"] | float | None = None
    frame_ms: float | None = None
    drop_duplicates: bool | None = None


TRACK_KEYS = tuple(
    key for key in TrackKeys.__struct_fields__ if key not in DialectKeys.__struct_fields__
)


def choices_of(run: msgspec.Struct) -> Choices | None:
    """How a file of the program Tracker is to be read, by any table with these keys; None where
    nothing is said.
    """
    stated = {key: value for key in TRACK_KEYS if (value := getattr(run, key)) is not None}
    return Choices(**stated) if stated else None
