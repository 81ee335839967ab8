"""What may be missing, in words: the verdict on the candidates that were refit."""

from __future__ import annotations

from types import MappingProxyType

from estim.common import Finding, Kind, phrase
from estim.words.table import Table


def _alike(f: Finding) -> str:
    return phrase(
        "these data cannot distinguish between: {names}. Each of these causes explains the "
        "remaining discrepancy; an independent "
        "measurement of one of them, or a different run (another tilt, another body, a "
        "longer path), would decide",
        names="; ".join(f.names),
    )


def _in_part(f: Finding) -> str:
    return phrase(
        "{which} improves the fit most (AIC falls by {fall:.0f}) but does not remove the "
        "lack of fit: at best it is part of the cause",
        which=phrase(" or ").join(f.names),
        fall=f.size,
    )


WORDS: Table = MappingProxyType(
    {
        Kind.CAUSE_NAMED: lambda f: phrase(
            "the most likely missing effect is {name}: AIC falls by {fall:.0f}, and no "
            "discrepancy remains to be "
            "explained",
            name=f.names[0],
            fall=f.size,
        ),
        Kind.CAUSES_ALIKE: _alike,
        Kind.CAUSE_IN_PART: _in_part,
        Kind.CAUSE_UNKNOWN: lambda f: phrase(
            "none of the {n:.0f} known causes explains any of the discrepancy between "
            "curve and data",
            n=f.numbers["tried"],
        ),
    }
)
