"""Whether bodies rolled without slipping, as a record and as the rows of a table."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from estim.common import phrase, signed, significant
from estim.pipeline import Analysis
from estim.sampling import number
from estim.words import tell


class RollingSummary(msgspec.Struct, frozen=True):
    """The friction that rolling without slipping takes along the measured way, and how sure it is."""

    friction_needed: float | None  # median of the largest |F|/N; null: none is enough
    friction_enough_95: float | None  # enough with probability 95 %; null: none is
    where: float  # of the largest need, as x is read
    unit: str
    least_normal: float | None  # N/(M g), median of the smallest
    hops: float  # probability that the ramp would have to pull
    probability: float | None  # of rolling all the way with the stated friction; null where none is stated
    words: str


def rolling_summaries(analysis: Analysis) -> dict[str, RollingSummary] | None:
    """By run, where there are bodies and the status is ok."""
    if not analysis.rolling or not analysis.diagnosis.ok:
        return None
    return {
        one.run: RollingSummary(
            number(one.typical), number(one.enough), one.where, one.unit, number(float(np.median(one.least_normal))), one.hops, number(one.holds),
            tell(one.finding),
        )
        for one in analysis.rolling
    }


def rolling_rows(rolling: Mapping[str, RollingSummary]) -> list[tuple[str, str, str, str, str, str]]:
    """Run, friction that it needs, what is enough, where, least normal force, probability."""
    return [
        (
            run, _size(one.friction_needed), _size(one.friction_enough_95), f"{signed(f'{one.where:.3g}')} {one.unit}",
            "n/a" if one.least_normal is None else signed(f"{one.least_normal:.2f}"),
            phrase("no friction stated") if one.probability is None else f"{one.probability:.2f}",
        )
        for run, one in rolling.items()
    ]


def _size(friction: float | None) -> str:
    return phrase("no friction is enough") if friction is None else significant(friction, 2)
