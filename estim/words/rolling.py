"""Rolling in words: how sure it is that the body does not slip, or what friction it takes; what a
run should do on the map of motions, and what its recording shows.
"""

from __future__ import annotations

import math

from estim.common import Finding, Kind, later, phrase
from estim.words.table import Table, worded


def _needs(f: Finding) -> str:
    n = f.numbers
    return worded(
        f,
        "near {where:.2g} {names} no friction is sufficient: the ramp would have to pull on "
        "the body"
        if math.isinf(n["typical"])
        else "rolling requires a friction coefficient of about {typical:.2g}, near {where:.2g} "
        "{names} along the path; no friction coefficient is sufficient with probability 95 %"
        if math.isinf(n["enough"])
        else "rolling requires a friction coefficient of about {typical:.2g}, near {where:.2g} "
        "{names} along the path; {enough:.2g} is sufficient with probability 95 %",
    )


def _with_friction(f: Finding, words: str) -> str:
    return worded(
        f,
        words,
        p=phrase("above 0.995")
        if f.p > 0.995
        else f"{f.p:.2f}"
        if f.p >= 0.005
        else phrase("below 0.005"),
        needs=_needs(f),
    )


def sure(p: float) -> str:
    """A probability in words: 'P > 0.999', 'P = 0.87'."""
    return (
        "P > 0.999"
        if p > 0.999
        else "P < 0.001"
        if p < 0.001
        else f"P = {p:.3f}"
        if p > 0.99 or p < 0.01
        else f"P = {p:.2f}"
    )


def _off(f: Finding) -> str:
    n = f.numbers
    return worded(
        f,
        "run {run}: with these values it should not start in this direction, but its "
        "recording extends to {farthest:.3g} m ({sure})"
        if n["sets_off"] < 0.5
        else "run {run}: with these values it should keep rolling, but its recording extends only "
        "to {farthest:.3g} m ({sure})"
        if math.isnan(n["expected"])
        else "run {run}: with these values it should turn back at {expected:.3g} m, but its "
        "recording extends to {farthest:.3g} m ({sure})",
        sure=sure(f.p),
    )


WORDS: Table = {
    Kind.FRICTION_NEEDED: lambda f: phrase("run {run}: ", run=f.run) + _needs(f),
    Kind.ROLLING_SURE: lambda f: _with_friction(
        f,
        later(
            "run {run}: with the stated friction, the probability of rolling without slipping "
            "is {p}; {needs}"
        ),
    ),
    Kind.ROLLING_DOUBTFUL: lambda f: _with_friction(
        f,
        later(
            "run {run}: with the stated friction, the probability of rolling without slipping "
            "is only {p}, while the curve assumes rolling without slipping; {needs}"
        ),
    ),
    Kind.ROLLING_HOPS: (
        "run {run}: on the fitted curve the body would leave the ramp with "
        "probability {hops:.2f}, while the curve assumes that it does not"
    ),
    Kind.RUN_OFF_MAP: _off,
}
