"""Trials of release in words: what is wrong with them, and what they tell apart."""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import Finding, Kind, format_quantity, later, phrase, signed
from estim.words.table import Table

_LEARNT, _SILENT = 0.5, 0.9  # posterior sd / prior sd


def _silent(f: Finding) -> str:
    n = int(f.numbers["n_trial"])
    outcome = phrase("none of {n}", n=n) if f.size == 0 else phrase("all of {n}", n=n) if f.size == n else phrase("{k:.0f} of {n}", k=f.size, n=n)
    return phrase(
        "the trials do not determine gamma: {outcome} climbed, and it is known {share:.0f} % as badly as before",
        outcome=outcome, share=100 * f.numbers["share"],
    )


def _scatter(f: Finding) -> str:
    return phrase(
        "the trials scatter by {size:.2g}°, more than {factor:g} times the stated {stated:.2g}°: no line separates ascents from refusals",
        size=f.size, factor=f.numbers["factor"], stated=f.numbers["stated"],
    )


def _trials(f: Finding) -> str:
    found, stated = (format_quantity(f.numbers[which], f.numbers[f"u_{which}"]) for which in ("trials", "stated"))
    return phrase(
        "γ of the trials, {found}, and γ as stated, {stated}, disagree: E_n = {e_n:+.1f}; the trials do not use the stated value",
        found=found, stated=stated, e_n=f.size,
    )


def _ends(f: Finding) -> str:
    return phrase(
        "γ from θ_min less γ from θ_max is {apart}, {sds:+.1f} standard deviations (E_n = {e_n:+.1f}): "
        "a zero error of the angle (the plumb line), or a release that costs another angle at θ_max, would do that",
        apart=format_quantity(f.numbers["apart"], f.numbers["u_apart"]), sds=f.numbers["sds"], e_n=f.size,
    )


_SHARES = MappingProxyType(
    {
        "rolling_resistance": (
            later("c_rr: learnt from the trials (posterior sd {share:.0f} % of the prior's)"),
            later("c_rr: partly what was assumed (posterior sd {share:.0f} % of the prior's)"),
            later("c_rr: hardly more than was assumed (posterior sd {share:.0f} % of the prior's)"),
        ),
        "release": (
            later("the release: learnt from the trials (posterior sd {share:.0f} % of the prior's)"),
            later("the release: partly what was assumed (posterior sd {share:.0f} % of the prior's)"),
            later("the release: hardly more than was assumed (posterior sd {share:.0f} % of the prior's)"),
        ),
    }
)


def told_apart(shares: dict[str, float], correlation: float) -> list[str]:
    """What trials say of c_rr and of the release, each by itself: sentences.

    shares : posterior over prior standard deviation, of "rolling_resistance" and "release" where they are free.
    correlation : of the two in the posterior; nan where one of them is not free.
    """
    said, shown = [], signed(f"{correlation:+.2f}")
    for name, share in shares.items():
        if name in _SHARES:
            said.append(phrase(_SHARES[name][(share >= _LEARNT) + (share >= _SILENT)], share=100 * share))
    if math.isnan(correlation):
        said.append(phrase("only one of c_rr and the release is free here, so it takes up all that raises the angles, whatever the cause"))
    elif correlation < -_LEARNT:
        said.append(phrase("one of the two can stand in for the other (correlation {r}): only their sum is known well", r=shown))
    elif max(shares.get(name, 0.0) for name in _SHARES) > _LEARNT:
        said.append(phrase("the two are hardly correlated ({r}) because their priors hold them, not because the trials tell them apart", r=shown))
    else:
        said.append(phrase("the trials tell the two apart (correlation {r})", r=shown))
    return said


WORDS: Table = MappingProxyType(
    {Kind.TRIALS_SILENT: _silent, Kind.TRIALS_SCATTER: _scatter, Kind.TRIALS_DISAGREE: _trials, Kind.ENDS_DISAGREE: _ends}
)
