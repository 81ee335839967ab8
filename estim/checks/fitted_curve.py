"""What is wrong with a curve fitted by `fit_curve`, and what to know before using it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from estim.checks.diagnosis import failed_tests, marginal_tests, tolerated_pattern
from estim.checks.doubtful_data import data_remarks
from estim.checks.goodness_of_fit import P_FLOOR, P_POOR_FIT, Goodness
from estim.common import Amount, Finding, Kind
from estim.fitting import FEW, Ends, Fit, Optimum, coverage_of_sd, pressed_edges, silent_parameters

_ROUNDED = 1e-6  # of an interval's width
_AS_GOOD = 0.01  # of the log density
# standard deviations that rounding errors move a value by: worth a word; no result
_FEW_DIGITS, _NO_DIGITS = 0.01, 0.5


def curve_findings(
    fixed: Fit,
    best: Optimum,
    p_value: float,
    chi2: float,
    dof: int,
    goodness: Sequence[Goodness],
    *,
    estimated: bool,
    perfect: bool,
) -> list[Finding]:
    """Everything that is wrong with the fit itself.

    fixed : with errors of a fixed size, which was `estimated` from the residuals or stated.
    perfect : whether there are no residuals.
    """
    findings = unsettled_findings(
        fixed,
        silent_parameters(fixed) if best.singular else () if best.settled else (best.mover,),
        Finding(Kind.STEP_UNSETTLED, size=best.step, parameters=(Amount(best.mover),)),
        singular=best.singular,
    )
    if best.tolerance > _NO_DIGITS and not perfect and not best.singular:
        findings.append(Finding(Kind.ROUNDING, size=best.tolerance))
    if best.unheld is not None:
        findings.append(best.unheld)
    findings += pressed_edges(fixed, Kind.PRESSED_LIMIT, estimated=estimated)
    for failed in failed_tests(goodness, dof=dof):
        if failed.test == "chi2" and (len(goodness) == 1 or not failed.run):
            kind = Kind.COUNTS_SCATTER if fixed.problem.counted else Kind.CHI2_TOO_LARGE
            # which only a simulated one is exactly
            least = {"least": P_FLOOR} if p_value == P_FLOOR else {}
            findings.append(Finding(kind, p=p_value, size=chi2, numbers={"dof": dof, **least}))
        elif failed.test:
            findings.append(failed)
    return findings


def unsettled_findings(
    fit: Fit, names: Sequence[str], unsettled: Finding, *, singular: bool
) -> list[Finding]:
    """Why there are no standard deviations: of `names` some are 0 where the curve is even in them,
    and the others are not determined; or the search is `unsettled`.
    """
    even = [name for name in names if _even_at_zero(fit, name)]
    others = tuple(name for name in names if name not in even)
    findings = [
        Finding(Kind.UNDETERMINED, names=(name,), parameters=(Amount(name, 0.0),)) for name in even
    ]
    if others and singular:
        findings.append(Finding(Kind.UNDETERMINED, names=others))
    elif others and not even:
        findings.append(unsettled)
    return findings


def _even_at_zero(fit: Fit, name: str) -> bool:
    """Whether the posterior density has its mode where a parameter is 0, and falls off equally on
    both sides: the curve has no derivative there, however well the data determine the parameter.
    """
    sizes, i = np.logspace(-30.0, 30.0, 121), fit.names.index(name)  # in any unit
    points = np.tile(fit.values, (2 * sizes.size + 2, 1))
    points[:-1, i] = [*sizes, *-sizes, 0.0]
    with np.errstate(all="ignore"):  # far away a curve may overflow
        heights = fit.posterior.log_density(points)
    (above, below), (at_zero, best) = heights[:-2].reshape(2, -1), heights[-2:]
    falls = np.any((above < at_zero - 1.0) & np.isfinite(above))
    return bool(falls and at_zero > best - _AS_GOOD and np.allclose(above, below, rtol=1e-6))


def values_outside(values: Mapping[str, float], intervals: Mapping[str, Ends]) -> list[Finding]:
    """The values that an interval of their own does not hold, beyond rounding errors; intervals :
    name -> probability -> (low, high).
    """
    return [
        Finding(Kind.VALUE_OUTSIDE, p=p, parameters=(Amount(name, value),))
        for name, value in values.items()
        for p, (low, high) in intervals[name].items()
        if not math.isnan(high - low)
        and not low - _ROUNDED * (high - low) <= value <= high + _ROUNDED * (high - low)
    ]


def curve_remarks(
    fit: Fit,
    best: Optimum,
    p_below: float,
    chi2: float,
    dof: int,
    goodness: Sequence[Goodness],
    *,
    stated: bool,
    perfect: bool,
) -> list[Finding]:
    """What to know of a fit that may be ok.  p_below : probability of a chi2 at most as large.
    stated : whether the size of the errors was.  perfect : whether there are residuals at all.
    """
    remarks = data_remarks(fit.problem.runs)
    if _NO_DIGITS >= best.tolerance > _FEW_DIGITS and not perfect:
        remarks.append(Finding(Kind.ROUNDING, size=best.tolerance))
    if best.frail and not best.singular:
        remarks.append(Finding(Kind.CANCELLATION))
    if not stated and dof <= FEW and not perfect:
        remarks.append(
            Finding(Kind.FEW_DEGREES, size=dof, numbers={"coverage": coverage_of_sd(dof)})
        )
    covered = [remark for good in goodness for remark in tolerated_pattern(good)]
    remarks += covered + [remark for good in goodness for remark in marginal_tests(good)]
    if stated and p_below < P_POOR_FIT and not covered:
        kind = (
            Kind.COUNTS_EVEN if fit.problem.runs[0].noise.counted is not None else Kind.CHI2_SMALL
        )
        remarks.append(Finding(kind, p=p_below, size=chi2, numbers={"dof": dof}))
    return remarks
