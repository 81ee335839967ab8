"""A theta_min line and trials of release in words: what is wrong with them, and what they
distinguish.
"""

from __future__ import annotations

import math

from estim.common import Finding, Kind, later, percentage, phrase, signed
from estim.words.table import Table, worded

_LEARNT, _SILENT = 0.5, 0.9  # posterior sd / prior sd


def _silent(f: Finding) -> str:
    n = f.numbers["n_trial"]
    outcome = worded(
        f,
        "none of {n_trial:.0f}"
        if f.size == 0
        else "all of {n_trial:.0f}"
        if f.size == n
        else "{size:.0f} of {n_trial:.0f}",
    )
    return worded(
        f,
        "the trials do not determine gamma: {outcome} climbed, and the standard deviation of "
        "gamma is still {share:.0f} % of its prior value",
        outcome=outcome,
        share=100 * f.numbers["share"],
    )


_SHARES = {
    "rolling_resistance": (
        later("c_rr is constrained by the trials (posterior sd {share:.0f} % of the prior's)"),
        later("c_rr depends partly on its prior (posterior sd {share:.0f} % of the prior's)"),
        later(
            "c_rr is hardly constrained beyond its prior (posterior sd {share:.0f} % "
            "of the prior's)"
        ),
    ),
    "release": (
        later(
            "the effect of the release is constrained by the trials (posterior sd "
            "{share:.0f} % of the prior's)"
        ),
        later(
            "the effect of the release depends partly on its prior (posterior sd "
            "{share:.0f} % of the prior's)"
        ),
        later(
            "the effect of the release is hardly constrained beyond its prior "
            "(posterior sd {share:.0f} % of the prior's)"
        ),
    ),
}


def told_apart(shares: dict[str, float], correlation: float) -> list[str]:
    """What trials show of c_rr and of the release, each by itself: sentences.

    shares : posterior over prior standard deviation, of "rolling_resistance" and "release" where
        they are free.
    correlation : of the two in the posterior; nan where one of them is not free.
    """
    sentences, coefficient = [], signed(f"{correlation:+.2f}")
    for name, share in shares.items():
        if name in _SHARES:
            sentences.append(
                phrase(_SHARES[name][(share >= _LEARNT) + (share >= _SILENT)], share=100 * share)
            )
    if math.isnan(correlation):
        sentences.append(
            phrase(
                "only one of c_rr and the release is free here, so it absorbs everything "
                "that raises the angles, whatever the cause"
            )
        )
    elif correlation < -_LEARNT:
        sentences.append(
            phrase(
                "the two are strongly correlated ({r}), so only their sum is well determined",
                r=coefficient,
            )
        )
    elif max(shares.get(name, 0.0) for name in _SHARES) > _LEARNT:
        sentences.append(
            phrase(
                "the two are only weakly correlated ({r}), but because their priors "
                "constrain them, not because the trials "
                "distinguish them",
                r=coefficient,
            )
        )
    else:
        sentences.append(phrase("the trials distinguish the two (correlation {r})", r=coefficient))
    return sentences


WORDS: Table = {
    Kind.TRIALS_SILENT: _silent,
    Kind.TRIALS_SCATTER: (
        "the trials scatter by {size:.2g}°, more than {factor:g} times the "
        "stated {stated:.2g}°: no line separates the trials that climbed from "
        "those that did not"
    ),
    Kind.TRIALS_DISAGREE: (
        "γ of the trials, {trials}, and γ as stated, {stated}, disagree: E_n = {size:+.1f}; "
        "the trials do not use the stated value"
    ),
    Kind.ENDS_DISAGREE: (
        "γ from θ_min minus γ from θ_max is {apart}, {sds:+.1f} standard deviations (E_n = "
        "{size:+.1f}): a zero error of the angle (the plumb line), or an effect of the release "
        "on the angle that differs at θ_max, would explain it"
    ),
    Kind.LINE_NOT_RISING: lambda f: worded(
        f,
        "the points do not determine a rising line: the exact {probability} interval of its "
        "slope is [{low:.3g}, {high:.3g}]",
        probability=percentage(f.numbers["probability"]),
    ),
    Kind.SLOPES_DIFFER: (
        "York's slope {york:.3g} and the Bayesian one {bayes:.3g} differ by more "
        "than their combined uncertainty {u:.2g}"
    ),
    Kind.GAMMA_TOO_LARGE: (
        "gamma = 1/slope would be {size:.2g}, but a centre of mass inside the "
        "body has gamma below 1"
    ),
    Kind.POINTS_SCATTER: (
        "the points scatter more than their uncertainties allow (S = {size:.1f}, "
        "{dof:.0f} degrees of freedom, {p})"
    ),
    Kind.GAMMA_DISAGREES: (
        "γ of the line, {line}, and γ as stated, {stated}, disagree: E_n = {size:+.1f}; the "
        "line does not use the stated value"
    ),
}
