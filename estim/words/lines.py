"""A theta_min line in words."""

from __future__ import annotations

from types import MappingProxyType

from estim.common import Finding, Kind, format_p, format_quantity, percentage, phrase
from estim.words.table import Table


def _not_rising(f: Finding) -> str:
    return phrase(
        "the points do not determine a rising line: the exact {probability} interval of "
        "its slope is [{low:.3g}, {high:.3g}]",
        probability=percentage(f.numbers["probability"]),
        low=f.numbers["low"],
        high=f.numbers["high"],
    )


def _slopes(f: Finding) -> str:
    return phrase(
        "York's slope {york:.3g} and the Bayesian one {bayes:.3g} differ by more than "
        "their combined uncertainty {u:.2g}",
        **{name: f.numbers[name] for name in ("york", "bayes", "u")},
    )


def _scatter(f: Finding) -> str:
    return phrase(
        "the points scatter more than their uncertainties allow (S = {s:.1f}, {dof:.0f} "
        "degrees of freedom, {p})",
        s=f.size,
        dof=f.numbers["dof"],
        p=format_p(f.p),
    )


def _gammas(f: Finding) -> str:
    line, stated = (
        format_quantity(f.numbers[which], f.numbers[f"u_{which}"]) for which in ("line", "stated")
    )
    return phrase(
        "γ of the line, {line}, and γ as stated, {stated}, disagree: E_n = {e_n:+.1f}; the "
        "line does not use the stated value",
        line=line,
        stated=stated,
        e_n=f.size,
    )


def _too_large(f: Finding) -> str:
    return phrase(
        "gamma = 1/slope would be {gamma:.2g}, but a centre of mass inside the body has "
        "gamma below 1",
        gamma=f.size,
    )


WORDS: Table = MappingProxyType(
    {
        Kind.LINE_NOT_RISING: _not_rising,
        Kind.SLOPES_DIFFER: _slopes,
        Kind.GAMMA_TOO_LARGE: _too_large,
        Kind.POINTS_SCATTER: _scatter,
        Kind.GAMMA_DISAGREES: _gammas,
    }
)
