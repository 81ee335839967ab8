"""The distance from the release to the end of the ramp: from the command line, from the campaign,
or the longest recording.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from estim.campaign import CampaignFile, body_levels
from estim.common import InputError


@dataclass(frozen=True)
class RampEnd:
    """length : m from the release to the end.  origin : "asked", "stated" or "recorded"."""

    length: float
    origin: str

    @property
    def of(self) -> str:
        """What it is the end of, in words."""
        return "recorded way" if self.origin == "recorded" else "ramp"


def ramp_end_of(
    source: CampaignFile, body: str, recorded: float, *, ramp_length: float | None
) -> RampEnd:
    """The end of the ramp for a body.

    ramp_length : m, in place of all else.  Then `ramp_length_m` less `ramp_start_m` at the body or
        under [shared], then the longest recording (m).  Raises InputError where it is not positive.
    """
    if ramp_length is not None:
        if not (math.isfinite(ramp_length) and ramp_length > 0.0):
            raise InputError(
                "must be > 0 (m, from the release to the end of the ramp)",
                field="--ramp-length",
                value=ramp_length,
            )
        return RampEnd(ramp_length, "asked")
    levels = body_levels(source, body)
    level, of_start = levels.first("ramp_length_m"), levels.first("ramp_start_m")
    if level is None or level.table.ramp_length_m is None:
        return RampEnd(recorded, "recorded")
    start = 0.0 if of_start is None else of_start.table.ramp_start_m
    length = level.table.ramp_length_m - (start or 0.0)
    if not (math.isfinite(length) and length > 0.0):
        raise source.error(
            "must be more than 'ramp_start_m', where the release is",
            (*level.path, "ramp_length_m"),
            value=level.table.ramp_length_m,
        )
    return RampEnd(length, "stated")
