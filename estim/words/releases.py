"""Trials of release in words: what is wrong with them, and what they tell apart."""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import Finding, Kind, format_quantity, signed
from estim.words.table import Table

_LEARNT, _SILENT = 0.5, 0.9  # posterior sd / prior sd


def _silent(f: Finding) -> str:
    n = int(f.numbers["n_trial"])
    outcome = "none" if f.size == 0 else "all" if f.size == n else f"{f.size:.0f}"
    return f"the trials do not determine gamma: {outcome} of {n} climbed, and it is known {100 * f.numbers['share']:.0f} % as badly as before"


def _scatter(f: Finding) -> str:
    stated, factor = f.numbers["stated"], f.numbers["factor"]
    return f"the trials scatter by {f.size:.2g}°, more than {factor:g} times the stated {stated:.2g}°: no line separates ascents from refusals"


def _trials(f: Finding) -> str:
    found, stated = (format_quantity(f.numbers[which], f.numbers[f"u_{which}"]) for which in ("trials", "stated"))
    return f"γ of the trials, {found}, and γ as stated, {stated}, disagree: E_n = {f.size:+.1f}; the trials do not use the stated value"


def _ends(f: Finding) -> str:
    apart = format_quantity(f.numbers["apart"], f.numbers["u_apart"])
    words = f"γ from θ_min less γ from θ_max is {apart}, {f.numbers['sds']:+.1f} standard deviations (E_n = {f.size:+.1f})"
    return f"{words}: a zero error of the angle (the plumb line), or a release that costs another angle at θ_max, would do that"


def told_apart(shares: dict[str, float], correlation: float) -> list[str]:
    """What trials say of c_rr and of the release, each by itself: sentences.

    shares : posterior over prior standard deviation, of "rolling_resistance" and "release" where they are free.
    correlation : of the two in the posterior; nan where one of them is not free.
    """
    names = {"rolling_resistance": "c_rr", "release": "the release"}
    said, shown = [], signed(f"{correlation:+.2f}")
    for name, share in shares.items():
        if name not in names:
            continue
        verdict = "learnt from the trials" if share < _LEARNT else "partly what was assumed" if share < _SILENT else "hardly more than was assumed"
        said.append(f"{names[name]}: {verdict} (posterior sd {100 * share:.0f} % of the prior's)")
    if math.isnan(correlation):
        said.append("only one of c_rr and the release is free here, so it takes up all that raises the angles, whatever the cause")
    elif correlation < -_LEARNT:
        said.append(f"one of the two can stand in for the other (correlation {shown}): only their sum is known well")
    elif max(shares.get(name, 0.0) for name in names) > _LEARNT:
        said.append(f"the two are hardly correlated ({shown}) because their priors hold them, not because the trials tell them apart")
    else:
        said.append(f"the trials tell the two apart (correlation {shown})")
    return said


WORDS: Table = MappingProxyType(
    {Kind.TRIALS_SILENT: _silent, Kind.TRIALS_SCATTER: _scatter, Kind.TRIALS_DISAGREE: _trials, Kind.ENDS_DISAGREE: _ends}
)
