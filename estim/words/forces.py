"""An unmodelled force in words: whether there is one, how large it is, over what distance it changes."""

from __future__ import annotations

from types import MappingProxyType

from estim.common import OF_BODY, Finding, Kind, phrase
from estim.words.table import Table


def _share(number: float) -> str:
    return f"{100.0 * number:.2g} %"


def _who(f: Finding) -> str:
    """'run a', or the runs that share the force."""
    n = f.numbers.get("runs", 1)
    return phrase("run {run}", run=f.run) if n == 1 else phrase("the {n:.0f} runs of body {body}", n=n, body=f.run.removeprefix(OF_BODY))


def _found(f: Finding) -> str:
    n = f.numbers
    what = phrase("a force along the track that the curve lacks")
    if n.get("runs", 1) > 1:
        what = phrase("a force along the track that the curve lacks and that they share")
    return phrase(
        "{who}: the residuals are not white about the curve; read as {what} they make {share} of the weight (root mean square along the track; "
        "at most {most}), which changes over about {length:.2g} {unit} ({short:.2g} to {long:.2g}), P(amplitude > 0) = {p:.3f}",
        who=_who(f), what=what, share=_share(n["share"]), most=_share(n["most"]), length=n["length"], unit=f.names[0],
        short=n["short"], long=n["long"], p=f.p,
    )


def _too_large(f: Finding) -> str:
    return phrase(
        "{who}: the force that would make up for what the curve lacks is {share} of the weight (root mean square along the track), "
        "{times:.2g} times what was expected of it: that is another motion",
        who=_who(f), share=_share(f.numbers["share"]), times=f.size,
    )


WORDS: Table = MappingProxyType(
    {
        Kind.FORCE_FOUND: _found,
        Kind.FORCE_UNDECIDED: lambda f: phrase(
            "{who}: whether the curve lacks a force cannot be told, P(amplitude > 0) = {p:.2f}; if it does, the force is about "
            "{share} of the weight (root mean square along the track), and every interval has room for it",
            who=_who(f), p=f.p, share=_share(f.numbers["share"]),
        ),
        Kind.FORCE_UNLIKELY: lambda f: phrase(
            "{who}: nothing shows a force that the curve lacks, P(amplitude > 0) = {p:.2f}; every interval has room for what may have "
            "stayed unseen",
            who=_who(f), p=f.p,
        ),
        Kind.FORCE_TOO_LARGE: _too_large,
        Kind.FORCE_NOT_LINEAR: lambda f: phrase(
            "{who}: the force that the residuals ask for is so large that the motion no longer answers in proportion to it: the fit ends "
            "{size:.2g} standard deviations from what a proportional answer says, and no interval can be believed",
            who=_who(f), size=f.size,
        ),
        Kind.NOISE_CONSERVATIVE: lambda f: phrase(
            "{who}: the stated error is conservative: the readings scatter by about {size:.2g} of it; it is kept as stated, and no "
            "interval is narrower for it",
            who=_who(f), size=f.size,
        ),
        Kind.NOISE_LARGER: lambda f: phrase(
            "{who}: the readings scatter by about {size:.2g} times what was stated ({low:.2g} to {high:.2g}), "
            "the force beside them; every interval has room for it",
            who=_who(f), size=f.size, low=f.numbers["low"], high=f.numbers["high"],
        ),
        Kind.NOISE_TOO_LARGE: lambda f: phrase(
            "{who}: the readings scatter by {size:.2g} times what was stated or more, a force that the curve lacks taken out (probability {p:.2f})",
            who=_who(f), size=f.size, p=f.p,
        ),
        Kind.CURVE_COMPLETE: lambda f: phrase("the curve is taken as complete: {why}", why=f.names[0]),
    }
)
