"""An unmodelled force in words: whether there is one, how large it is, over what distance it changes."""

from __future__ import annotations

from types import MappingProxyType

from estim.common import Finding, Kind
from estim.words.table import Table


def _share(number: float) -> str:
    return f"{100.0 * number:.2g} %"


def _who(f: Finding) -> str:
    """'run a', or the runs that share the force."""
    n = f.numbers.get("runs", 1)
    return f"run {f.run}" if n == 1 else f"the {n:.0f} runs of {f.run}"


def _found(f: Finding) -> str:
    n, unit = f.numbers, f.names[0]
    shared = " and that they share" if n.get("runs", 1) > 1 else ""
    return (
        f"{_who(f)}: the residuals are not white about the curve; read as a force along the track that the curve lacks{shared} they make "
        f"{_share(n['share'])} of the weight (root mean square along the track; at most {_share(n['most'])}), which changes over about "
        f"{n['length']:.2g} {unit} ({n['short']:.2g} to {n['long']:.2g}), P(amplitude > 0) = {f.p:.3f}"
    )


WORDS: Table = MappingProxyType(
    {
        Kind.FORCE_FOUND: _found,
        Kind.FORCE_UNDECIDED: lambda f: (
            f"{_who(f)}: whether the curve lacks a force cannot be told, P(amplitude > 0) = {f.p:.2f}; if it does, the force is about "
            f"{_share(f.numbers['share'])} of the weight (root mean square along the track), and every interval has room for it"
        ),
        Kind.FORCE_UNLIKELY: lambda f: (
            f"{_who(f)}: nothing shows a force that the curve lacks, P(amplitude > 0) = {f.p:.2f}; every interval has room for what may have "
            "stayed unseen"
        ),
        Kind.FORCE_TOO_LARGE: lambda f: (
            f"{_who(f)}: the force that would make up for what the curve lacks is {_share(f.numbers['share'])} of the weight (root mean square "
            f"along the track), {f.size:.2g} times what was expected of it: that is another motion"
        ),
        Kind.FORCE_NOT_LINEAR: lambda f: (
            f"{_who(f)}: the force that the residuals ask for is so large that the motion no longer answers in proportion to it: the fit ends "
            f"{f.size:.2g} standard deviations from what a proportional answer says, and no interval can be believed"
        ),
        Kind.NOISE_CONSERVATIVE: lambda f: (
            f"{_who(f)}: the stated error is conservative: the readings scatter by about {f.size:.2g} of it; it is kept as stated, and no "
            "interval is narrower for it"
        ),
        Kind.NOISE_LARGER: lambda f: (
            f"{_who(f)}: the readings scatter by about {f.size:.2g} times what was stated ({f.numbers['low']:.2g} to {f.numbers['high']:.2g}), "
            "the force beside them; every interval has room for it"
        ),
        Kind.NOISE_TOO_LARGE: lambda f: (
            f"{_who(f)}: the readings scatter by {f.size:.2g} times what was stated or more, a force that the curve lacks taken out "
            f"(probability {f.p:.2f})"
        ),
        Kind.CURVE_COMPLETE: lambda f: f"the curve is taken as complete: {f.names[0]}",
    }
)
