"""An unmodelled force in words: whether there is one, how large it is, over what distance it
changes.
"""

from __future__ import annotations

from types import MappingProxyType

from estim.common import OF_BODY, Finding, Kind, phrase
from estim.words.table import Table


def _share(number: float) -> str:
    return f"{100.0 * number:.2g} %"


def _who(f: Finding) -> str:
    """'run a', or the runs that share the force."""
    n = f.numbers.get("runs", 1)
    return (
        phrase("run {run}", run=f.run)
        if n == 1
        else phrase("the {n:.0f} runs of body {body}", n=n, body=f.run.removeprefix(OF_BODY))
    )


def _found(f: Finding) -> str:
    n = f.numbers
    what = phrase("an unmodelled force along the track")
    if n.get("runs", 1) > 1:
        what = phrase("an unmodelled force along the track that they share")
    return phrase(
        "{who}: the residuals about the curve are not white noise; interpreted as {what}, "
        "they amount to {share} of the weight (root "
        "mean square along the track; at most {most}), with correlation length about "
        "{length:.2g} {unit} ({short:.2g} to {long:.2g}), "
        "P(amplitude > 0) = {p:.3f}",
        who=_who(f),
        what=what,
        share=_share(n["share"]),
        most=_share(n["most"]),
        length=n["length"],
        unit=f.names[0],
        short=n["short"],
        long=n["long"],
        p=f.p,
    )


def _too_large(f: Finding) -> str:
    return phrase(
        "{who}: the unmodelled force needed to explain the data is {share} of the weight "
        "(root mean square along the track), {times:.2g} "
        "times its expected size: this is a different motion",
        who=_who(f),
        share=_share(f.numbers["share"]),
        times=f.size,
    )


WORDS: Table = MappingProxyType(
    {
        Kind.FORCE_FOUND: _found,
        Kind.FORCE_UNDECIDED: lambda f: phrase(
            "{who}: it cannot be decided whether there is an unmodelled force, P(amplitude "
            "> 0) = {p:.2f}; if there is, it is about "
            "{share} of the weight (root mean square along the track), and every interval "
            "allows for it",
            who=_who(f),
            p=f.p,
            share=_share(f.numbers["share"]),
        ),
        Kind.FORCE_UNLIKELY: lambda f: phrase(
            "{who}: there is no evidence of an unmodelled force, P(amplitude > 0) = "
            "{p:.2f}; every interval allows for one that may have "
            "gone undetected",
            who=_who(f),
            p=f.p,
        ),
        Kind.FORCE_TOO_LARGE: _too_large,
        Kind.FORCE_NOT_LINEAR: lambda f: phrase(
            "{who}: the force required by the residuals is so large that the motion no "
            "longer responds linearly to it: the fit ends "
            "{size:.2g} standard deviations from the linear prediction, and no interval is "
            "reliable",
            who=_who(f),
            size=f.size,
        ),
        Kind.NOISE_CONSERVATIVE: lambda f: phrase(
            "{who}: the stated error is conservative: the scatter of the readings is about "
            "{size:.2g} times the stated error; the stated "
            "value is kept, and no interval becomes narrower",
            who=_who(f),
            size=f.size,
        ),
        Kind.NOISE_LARGER: lambda f: phrase(
            "{who}: in addition to the force, the scatter of the readings is about "
            "{size:.2g} times the stated error ({low:.2g} to "
            "{high:.2g}); every interval allows for it",
            who=_who(f),
            size=f.size,
            low=f.numbers["low"],
            high=f.numbers["high"],
        ),
        Kind.NOISE_TOO_LARGE: lambda f: phrase(
            "{who}: after an unmodelled force is removed, the scatter of the readings is "
            "at least {size:.2g} times the stated error "
            "(probability {p:.2f})",
            who=_who(f),
            size=f.size,
            p=f.p,
        ),
        Kind.CURVE_COMPLETE: lambda f: phrase(
            "the curve is assumed to be complete: {why}", why=f.names[0]
        ),
    }
)
