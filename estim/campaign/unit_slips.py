"""Angles that were written in radians under keys that take degrees: the campaign with the other key
is a candidate for why its curve does not fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import msgspec

from estim.campaign.campaign_file import CampaignFile, LevelTable
from estim.campaign.candidate_causes import Candidate
from estim.common import phrase

_KEYS = {"θ₀": ("theta0_deg", "theta0_rad"), "φ": ("phi_deg", "phi_rad")}


def unit_slips(source: CampaignFile) -> Iterator[Candidate]:
    """θ₀, φ or both in radians, where they are stated in degrees."""
    for symbols in (("θ₀",), ("φ",), ("θ₀", "φ")):
        keys = dict(_KEYS[symbol] for symbol in symbols)
        quantities = tuple(key.removesuffix("_deg") for key in keys)
        changed = source.with_levels(partial(_with_keys, keys=keys))
        yield Candidate(
            "-".join(("radians", *quantities)),
            phrase(
                "{symbols} given in radians, not degrees", symbols=phrase(" and ").join(symbols)
            ),
            changed,
            quantities,
            remark=phrase(
                "write {right} in place of {wrong}",
                right=", ".join(keys.values()),
                wrong=", ".join(keys),
            ),
            slip=True,
        )


def _with_keys(table: LevelTable, keys: dict[str, str]) -> LevelTable:
    """A table with what it states under one key moved to another."""
    renamed = {wrong: right for wrong, right in keys.items() if getattr(table, wrong) is not None}
    values = {right: getattr(table, wrong) for wrong, right in renamed.items()}
    return msgspec.structs.replace(table, **dict.fromkeys(renamed), **values)
