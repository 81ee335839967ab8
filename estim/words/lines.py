"""A theta_min line in words."""

from __future__ import annotations

from types import MappingProxyType

from estim.common import Finding, Kind, format_p, format_quantity, percentage
from estim.words.table import Table


def _not_rising(f: Finding) -> str:
    shown = f"[{f.numbers['low']:.3g}, {f.numbers['high']:.3g}]"
    return f"the points do not determine a rising line: the exact {percentage(f.numbers['probability'])} interval of its slope is {shown}"


def _slopes(f: Finding) -> str:
    n = f.numbers
    return f"York's slope {n['york']:.3g} and the Bayesian one {n['bayes']:.3g} differ by more than their combined uncertainty {n['u']:.2g}"


def _scatter(f: Finding) -> str:
    test = f"S = {f.size:.1f}, {f.numbers['dof']:.0f} degrees of freedom, {format_p(f.p)}"
    return f"the points scatter more than their uncertainties allow ({test})"


def _gammas(f: Finding) -> str:
    line, stated = (format_quantity(f.numbers[which], f.numbers[f"u_{which}"]) for which in ("line", "stated"))
    return f"γ of the line, {line}, and γ as stated, {stated}, disagree: E_n = {f.size:+.1f}; the line does not use the stated value"


WORDS: Table = MappingProxyType(
    {
        Kind.LINE_NOT_RISING: _not_rising,
        Kind.SLOPES_DIFFER: _slopes,
        Kind.GAMMA_TOO_LARGE: lambda f: f"gamma = 1/slope would be {f.size:.2g}, but a centre of mass inside the body has gamma below 1",
        Kind.POINTS_SCATTER: _scatter,
        Kind.GAMMA_DISAGREES: _gammas,
    }
)
