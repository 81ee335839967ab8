"""The one thing to do first about a result that is not ok, in short; `sentences.advice` says all
there is to do.
"""

from __future__ import annotations

from collections.abc import Sequence

from estim.common import Finding, Kind, PhraseTable, later
from estim.words.sentences import advice, one_is_far_off

_LOOK = later(
    "look at the residuals for a bad reading, a wrong window, or an effect that the curve "
    "does not model"
)
_LARGER = later("check the file for a reason why the errors are larger than stated")
_ANOTHER = later("try another curve: if the curve is wrong, none of the intervals is reliable")
_SHORT = PhraseTable(
    {
        Kind.SEVERAL_SOLUTIONS: (
            "choose between the solutions by a prior or by a further measurement, and fit again"
        ),
        Kind.RESIDUALS_TOO_LARGE: _LARGER,
        Kind.CHI2_TOO_LARGE: (
            "check the file for a reason why the errors are larger than stated; if the points "
            "scatter at random about the curve, allow for further errors of y (jitter)"
        ),
        Kind.RESIDUALS_NOT_RANDOM: _LOOK,
        Kind.CURVE_LACKS: _LOOK,
        Kind.STATED_AND_CURVE: _LOOK,
        Kind.DEVIATION_TOO_LARGE: _ANOTHER,
        Kind.DEVIATION_TOO_SLOW: _ANOTHER,
        Kind.FORCE_NOT_LINEAR: (
            "fit a shorter section of the motion, or speeds in place of positions"
        ),
        Kind.COUNTS_SCATTER: (
            "look at the pulls: possible causes are a wrong curve, a bin that is too wide "
            "for it, dead time, or "
            "events that come in bursts"
        ),
        Kind.FORCE_TOO_LARGE: (
            "look at the figure of the force: the stated values of body, tilt and start "
            "may be wrong"
        ),
        Kind.NOISE_TOO_LARGE: ("look for readings that jump, and exclude them by a window"),
        Kind.STATED_DISAGREE: (
            "check the stated values: unit and uncertainty of each, and the scale and zero "
            "of the data"
        ),
        Kind.PRESSED_EDGE: (
            "if values beyond the edge are possible, widen the prior; if not, look for "
            "what is wrong"
        ),
    }
)
"""What to do first where all that could be done takes longer to say."""


def first_step(findings: Sequence[Finding]) -> str:
    """What to do first about `findings`, gravest first; "" where there are none."""
    if not findings:
        return ""
    tests = {finding.test for finding in findings if finding.kind is Kind.CURVE_LACKS}
    unsettled = findings[0].kind is Kind.FIT_UNSETTLED
    if one_is_far_off(findings) and (unsettled or findings[0].test in ("chi2", "largest")):
        return advice(next(finding for finding in findings if finding.test == "largest"))
    if findings[0].test in tests <= {"uneven", "repeated"}:
        return advice(findings[0])
    return _SHORT.get(findings[0].kind) or advice(findings[0])
