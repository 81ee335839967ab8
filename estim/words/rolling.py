"""Rolling without slipping in words: how sure it is, or what friction it takes."""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import Finding, Kind
from estim.words.table import Table


def _needs(f: Finding) -> str:
    n = f.numbers
    if math.isinf(n["typical"]):
        return f"near {n['where']:.2g} {f.names[0]} no friction is enough: the ramp would have to pull"
    enough = "no friction is enough with probability 95 %" if math.isinf(n["enough"]) else f"{n['enough']:.2g} is enough with probability 95 %"
    return f"rolling needs a coefficient of friction of about {n['typical']:.2g}, near {n['where']:.2g} {f.names[0]} on the way; {enough}"


def _sure(p: float) -> str:
    return "above 0.995" if p > 0.995 else f"{p:.2f}" if p >= 0.005 else "below 0.005"


WORDS: Table = MappingProxyType(
    {
        Kind.FRICTION_NEEDED: lambda f: f"run {f.run}: {_needs(f)}",
        Kind.ROLLING_SURE: lambda f: (
            f"run {f.run}: with the stated friction the probability that it rolled without slipping is {_sure(f.p)}; {_needs(f)}"
        ),
        Kind.ROLLING_DOUBTFUL: lambda f: (
            f"run {f.run}: with the stated friction the probability that it rolled without slipping is only {_sure(f.p)}, and the curve assumes "
            f"that it did; {_needs(f)}"
        ),
        Kind.ROLLING_HOPS: lambda f: (
            f"run {f.run}: on the fitted curve the body would leave the ramp with probability {f.numbers['hops']:.2f}, and the curve assumes that "
            "it does not"
        ),
    }
)
