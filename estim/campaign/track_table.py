"""The keys that say how a file of the program Tracker is read, beside those of tables
(`dialect_table`).
"""

from __future__ import annotations

from typing import Literal, Protocol

from estim.campaign.dialect_table import DialectKeys
from estim.reading import Choices, Unit


class TrackKeys(DialectKeys, forbid_unknown_fields=True, frozen=True, kw_only=True):
    track: str | None = None
    along: str | float | None = None
    unit: Unit | None = None
    release: Literal["first", "keep"] | float | None = None
    frame_ms: float | None = None
    drop_duplicates: bool | None = None


class TrackSaid(Protocol):
    """What any table with these keys has."""

    @property
    def track(self) -> str | None: ...
    @property
    def along(self) -> str | float | None: ...
    @property
    def unit(self) -> Unit | None: ...
    @property
    def release(self) -> Literal["first", "keep"] | float | None: ...
    @property
    def frame_ms(self) -> float | None: ...
    @property
    def drop_duplicates(self) -> bool | None: ...


def choices_of(run: TrackSaid) -> Choices | None:
    """How a file of the program Tracker is to be read; None where nothing is said."""
    stated = (run.track, run.along, run.unit, run.release, run.frame_ms, run.drop_duplicates)
    if all(value is None for value in stated):
        return None
    along = "fit" if run.along is None else run.along
    release = "first" if run.release is None else run.release
    return Choices(run.track, along, run.unit, release, run.frame_ms, bool(run.drop_duplicates))
