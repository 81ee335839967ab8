"""What may be missing, in words: the verdict on the candidates that were refit."""

from __future__ import annotations

from types import MappingProxyType

from estim.common import Finding, Kind
from estim.words.table import Table


def _alike(f: Finding) -> str:
    return (
        f"these data cannot tell apart: {'; '.join(f.names)}. Each of them explains what is left; a measurement of one of them by itself, "
        "or a run that differs (another tilt, another body, a longer way), would decide"
    )


def _in_part(f: Finding) -> str:
    which = " or ".join(f.names)
    return f"{which} gains most (AIC falls by {f.size:.0f}), but the residuals are not in random order with it either: it is not all, or not it"


WORDS: Table = MappingProxyType(
    {
        Kind.CAUSE_NAMED: lambda f: f"what is missing is most likely {f.names[0]}: AIC falls by {f.size:.0f}, and what is left is in random order",
        Kind.CAUSES_ALIKE: _alike,
        Kind.CAUSE_IN_PART: _in_part,
        Kind.CAUSE_UNKNOWN: lambda f: f"none of {f.numbers['tried']:.0f} known causes explains anything that the curve lacks",
    }
)
