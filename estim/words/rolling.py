"""Rolling without slipping in words: how sure it is, or what friction it takes."""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import Finding, Kind, phrase
from estim.words.table import Table


def _needs(f: Finding) -> str:
    n = f.numbers
    values = {"where": n["where"], "unit": f.names[0]}
    if math.isinf(n["typical"]):
        return phrase(
            "near {where:.2g} {unit} no friction is sufficient: the ramp would have to "
            "pull on the body",
            **values,
        )
    if math.isinf(n["enough"]):
        return phrase(
            "rolling requires a friction coefficient of about {typical:.2g}, near "
            "{where:.2g} {unit} along the path; no friction "
            "coefficient is sufficient with probability 95 %",
            typical=n["typical"],
            **values,
        )
    return phrase(
        "rolling requires a friction coefficient of about {typical:.2g}, near {where:.2g} "
        "{unit} along the path; {enough:.2g} is "
        "sufficient with probability 95 %",
        typical=n["typical"],
        enough=n["enough"],
        **values,
    )


def _sure(p: float) -> str:
    return (
        phrase("above 0.995") if p > 0.995 else f"{p:.2f}" if p >= 0.005 else phrase("below 0.005")
    )


WORDS: Table = MappingProxyType(
    {
        Kind.FRICTION_NEEDED: lambda f: phrase("run {run}: {needs}", run=f.run, needs=_needs(f)),
        Kind.ROLLING_SURE: lambda f: phrase(
            "run {run}: with the stated friction, the probability of rolling without "
            "slipping is {p}; {needs}",
            run=f.run,
            p=_sure(f.p),
            needs=_needs(f),
        ),
        Kind.ROLLING_DOUBTFUL: lambda f: phrase(
            "run {run}: with the stated friction, the probability of rolling without "
            "slipping is only {p}, while the curve assumes "
            "rolling without slipping; {needs}",
            run=f.run,
            p=_sure(f.p),
            needs=_needs(f),
        ),
        Kind.ROLLING_HOPS: lambda f: phrase(
            "run {run}: on the fitted curve the body would leave the ramp with probability "
            "{p:.2f}, while the curve assumes that it does not",
            run=f.run,
            p=f.numbers["hops"],
        ),
    }
)
