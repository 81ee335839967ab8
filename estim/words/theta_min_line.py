"""A theta_min line in words."""

from __future__ import annotations

from estim.common import Kind, percentage
from estim.words.table import Table, worded

WORDS: Table = {
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
