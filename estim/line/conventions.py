"""Which standard errors of a line are in print, and which of them to quote."""

from __future__ import annotations

from collections.abc import Mapping

from estim.arrays import max_abs
from estim.checks import NOTE_BELOW, P_POOR_FIT
from estim.common import PhraseTable, format_p, phrase
from estim.fitting import FEW, PERFECT, coverage_of_sd
from estim.line.angle_profile import LineData

CONVENTIONS: Mapping[str, str] = PhraseTable(
    {
        "york": (
            "York et al. 2004, Am. J. Phys. 72, 367, eq. (13): from the adjusted points, "
            "with the stated uncertainties taken as true"
        ),
        "propagated": (
            "Kalantar 1992, Meas. Sci. Technol. 3, 1113; Krystek and Anton 2007, Meas. "
            "Sci. Technol. 18, 3438: the "
            "uncertainties of all data propagated through the minimum; for exact x ISO/TS "
            "28037:2010, 6.2"
        ),
        "scaled": (
            "York 1966, Can. J. Phys. 44, 1079 (for exact x the Birge ratio; without "
            "uncertainties GUM H.3): scaled by "
            "sqrt(S/(n - 2)), so only the ratios of the stated uncertainties count; "
            "Student's t with n - 2 degrees of freedom"
        ),
    }
)


def recommendation(data: LineData, chi2: float, dof: int, p_value: float) -> tuple[str, str]:
    """The convention to quote and why."""
    if data.method == "ols":
        reason = phrase(
            "no uncertainties are stated, so the scatter of the residuals alone sets the "
            "scale (Student's t, {dof} dof)",
            dof=dof,
        )
        if is_exact(data, chi2):
            none = phrase(
                ", and there is no scatter beyond rounding errors, so nothing indicates "
                "how large the errors are: state u_y"
            )
            return "scaled", reason + none
        few = phrase(
            "; value ± standard error contains the true value in {held:.0f} % of such "
            "experiments, not in 68 %; the intervals allow for it",
            held=100 * coverage_of_sd(dof),
        )
        return "scaled", reason + (few if dof <= FEW else "")
    if p_value < P_POOR_FIT:
        return "scaled", phrase(
            "S/dof = {ratio:.3g} ({p}): the stated uncertainties do not explain the "
            "scatter; rescaling assumes that all are too small by "
            "the same factor, while a Bayesian line with intrinsic scatter assumes that an "
            "effect was left out",
            ratio=chi2 / dof,
            p=format_p(p_value),
        )
    low = phrase(
        "{p} is low, but not below the threshold of {least:g} used here, so the stated "
        "uncertainties are kept; if you doubt them, use the scaled ones",
        p=format_p(p_value),
        least=P_POOR_FIT,
    )
    if data.method == "weighted":
        if p_value < NOTE_BELOW:
            return "propagated", low
        return "propagated", phrase(
            "x is exact and S agrees with the stated uncertainties, so they are propagated "
            "as they are"
        )
    fine = phrase(
        "the scatter does not contradict the stated uncertainties ({p}), so they need no rescaling",
        p=format_p(p_value),
    )
    return "propagated", (low if p_value < NOTE_BELOW else fine) + phrase(
        "; the york convention gives too small errors where the errors along the line are not "
        "small compared with the range"
    )


def is_exact(data: LineData, chi2: float) -> bool:
    """Whether the points of an ordinary line scatter by rounding errors alone."""
    return chi2 <= data.x.size * (PERFECT * max_abs(data.y)) ** 2
