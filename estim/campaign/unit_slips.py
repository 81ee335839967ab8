"""Angles in radians under keys that take degrees: the campaign as it would read with the other key,
as a candidate for what its curve lacks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import msgspec

from estim.campaign.campaign_file import CampaignFile, LevelTable, RunTable
from estim.common import phrase

_KEYS = {"θ₀": ("theta0_deg", "theta0_rad"), "φ": ("phi_deg", "phi_rad")}
_T = TypeVar("_T", LevelTable, RunTable)


@dataclass(frozen=True, eq=False)
class Slip:
    """words : what may be wrong.  remark : what to write.  quantities : of the angles.  source :
    the campaign with that.
    """

    words: str
    remark: str
    quantities: tuple[str, ...]
    source: CampaignFile


def unit_slips(source: CampaignFile) -> Iterator[Slip]:
    """θ₀, φ or both in radians, where they are said in degrees."""
    for symbols in (("θ₀",), ("φ",), ("θ₀", "φ")):
        keys = dict(_KEYS[symbol] for symbol in symbols)
        changed = replace(
            source,
            shared=_with_keys(source.shared, keys),
            bodies={name: _with_keys(table, keys) for name, table in source.bodies.items()},
            runs=tuple(_with_keys(run, keys) for run in source.runs),
        )
        yield Slip(
            phrase(
                "{symbols} given in radians, not degrees", symbols=phrase(" and ").join(symbols)
            ),
            phrase(
                "write {right} in place of {wrong}",
                right=", ".join(keys.values()),
                wrong=", ".join(keys),
            ),
            tuple(key.removesuffix("_deg") for key in keys),
            changed,
        )


def _with_keys(table: _T, keys: dict[str, str]) -> _T:
    """A table with what it says under one key under another."""
    renamed = {wrong: right for wrong, right in keys.items() if getattr(table, wrong) is not None}
    values = {right: getattr(table, wrong) for wrong, right in renamed.items()}
    return msgspec.structs.replace(table, **dict.fromkeys(renamed), **values)
