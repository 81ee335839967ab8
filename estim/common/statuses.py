"""The statuses of a result, the kinds of findings, and the record of something wrong or worth
knowing: the one place that decides the first from the second.

A finding holds facts only; `estim.words` makes sentences of it, and nothing is read back out of
those.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from estim.common.labels import Label

PROBABILITIES = (0.68, 0.95)
QUANTILES = (0.025, 0.16, 0.5, 0.84, 0.975)  # the median, and the ends of their intervals


@dataclass(frozen=True)
class Amount:
    """A number that a finding gives of a parameter: `value` in the parameter's own unit, `whole`
    what it is a part of (nan: of nothing).

    label : how the parameter is shown, None where its bare name is.
    """

    name: str
    value: float = math.nan
    label: Label | None = None
    whole: float = math.nan


@dataclass(frozen=True)
class Finding:
    """Something wrong, worth knowing, or a reason for either, as facts.

    kind : what; it determines the status that follows, and what to do.
    run : the run that it is about, "" for all.
    test : name of the test or quantity that shows it, "" where the kind implies it.
    p : its probability, nan where there is none.
    size : how large or how many.
    numbers : name -> further number.  parameters : those it is about, with what it gives of them.
    names : of runs, arguments or sources that it is about.
    parts : findings that it is made of.
    """

    kind: Kind
    run: str = ""
    test: str = ""
    p: float = math.nan
    size: float = math.nan
    numbers: Mapping[str, float] = field(default_factory=dict)
    parameters: tuple[Amount, ...] = ()
    names: tuple[str, ...] = ()
    parts: tuple[Finding, ...] = ()

    @property
    def status(self) -> Status:
        """What a result is that has this finding and no graver one."""
        return LEADS_TO.get(self.kind, Status.OK)


def decide(findings: Iterable[Finding]) -> Status:
    """The status of a result: that of its gravest finding."""
    return gravest(finding.status for finding in findings)


def gravest(statuses: Iterable[Status]) -> Status:
    """The gravest of several statuses; ok where there is none."""
    return min(statuses, key=list(Status).index, default=Status.OK)


def wrong(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """The findings with which a result is not ok, gravest first."""
    order = list(Status)
    return tuple(
        sorted(
            (f for f in findings if f.status is not Status.OK),
            key=lambda finding: order.index(finding.status),
        )
    )


class Status(StrEnum):
    """Whether a number may be trusted, gravest first; a result has the gravest status of its
    findings.
    """

    CONTRADICTION = "contradiction"  # found before any draw: the cause comes first
    NOT_CONVERGED = "not-converged"
    METHODS_DISAGREE = "methods-disagree"
    MULTIMODAL = "multimodal"
    NOT_IDENTIFIED = "not-identified"
    POOR_FIT = "poor-fit"  # a limit from a wrong curve is none
    AT_BOUND = "at-bound"
    NOT_CALIBRATED = "not-calibrated"
    OK = "ok"

    def __repr__(self) -> str:
        """As a reader sees it in a table or at a prompt."""
        return repr(self.value)

    @property
    def ok(self) -> bool:
        return self is Status.OK

    @property
    def draws_count(self) -> bool:
        """Whether the draws mean anything: limits, at least, may be read from them."""
        return self not in (Status.CONTRADICTION, Status.NOT_CONVERGED, Status.METHODS_DISAGREE)

    @property
    def limits_count(self) -> bool:
        """Whether limits may be printed: tight ones from a wrong curve mislead more than none."""
        return self.draws_count and self is not Status.POOR_FIT


Kind = StrEnum(
    "Kind",
    # the search for the best fit
    "FIT_UNSETTLED STEP_UNSETTLED VALUE_OUTSIDE BETTER_ELSEWHERE COVARIANCE_HELD "
    "EXCHANGED EXCHANGE IMAGES IMAGE OTHER_NUMBERS FASTER_CURVES VALUES "
    # draws
    "CHAIN_SHORT WALKERS_STUCK RHAT_HIGH BULK_LOW TAIL_LOW CHAIN_BRIEF CHAIN_HOPELESS "
    "TAU_UNSETTLED CRITERIA_MET INDEPENDENT_DRAWS DRAWS_SHORT "
    # the second computation
    "METHODS_DIFFER CHAIN_DIFFERS DIFFERENCE CHAIN_AGREES TOO_MANY_PARAMETERS NOT_SAMPLED "
    "WEIGHTS_UNRELIABLE ERRORS_TOO_LARGE MARGINAL_SAMPLED RUNS_COUNT_ALIKE UNIFORM_PRIOR_MOVES "
    "MARGINAL_MISSED MARGINAL_DRAWS_FEW WEIGHTS_EXACT WEIGHTS_UNEVEN WEIGHTS_MOVE "
    "WEIGHTS_AGREE "
    # what data and priors determine
    "SEVERAL_SOLUTIONS SOLUTION DIRECTION_FLAT DIRECTION_LEARNT DIRECTION_SILENT SINGULAR "
    "UNDETERMINED HARDLY_HELD STEPS_OPEN OPEN_SIDE PRESSED_EDGE PRESSED_LIMIT LIMIT TAKEN_AS_EXACT "
    # whether the curve explains the data
    "RESIDUALS_ZERO RESIDUALS_TOO_LARGE RESIDUALS_NOT_RANDOM RESIDUALS_SMALL "
    "RESIDUALS_HARDLY PATTERN_COVERED NEIGHBOURS_ALIKE NOISE_WITH_SPEED CHI2_TOO_LARGE "
    "CHI2_SMALL COUNTS_SCATTER COUNTS_EVEN COUNTS_AS_READINGS READINGS_COPIED "
    "SCATTER_TOO_LARGE "
    "SCATTER_LARGE OUTLIERS_CROWD "
    # what the curve lacks
    "FORCE_FOUND FORCE_UNDECIDED FORCE_UNLIKELY FORCE_TOO_LARGE FORCE_NOT_LINEAR "
    "SPEEDS_NOT_LINEAR NOISE_CONSERVATIVE NOISE_LARGER NOISE_TOO_LARGE CURVE_COMPLETE "
    "DEVIATION_FOUND DEVIATION_UNDECIDED DEVIATION_UNLIKELY DEVIATION_UNASKED "
    "DEVIATION_TOO_LARGE DEVIATION_TOO_SLOW CURVE_LACKS "
    # rolling without slipping
    "FRICTION_NEEDED ROLLING_SURE ROLLING_DOUBTFUL ROLLING_HOPS "
    # the map of motions
    "RUN_OFF_MAP "
    # candidates for it, each refit
    "CAUSE_NAMED CAUSES_ALIKE CAUSE_IN_PART CAUSE_UNKNOWN "
    # bad frames
    "FRAME_OFF STEP_STAYS FRAMES_LOST FRAMES_CROWD "
    # whether the sources agree
    "RUNS_DISAGREE RUN_DISAGREES RUNS_TIED RUNS_AGAINST_STATED RUNS_AGREE RUNS_UNCOMPARED "
    "STATED_DISAGREE STATED_AND_CURVE STATED_HARDLY STATED_AGREE STATED_UNCOMPARED PULL "
    "COMMON_ERRORS COMMON_ERROR "
    # a curve fitted by `fit_curve`
    "ROUNDING CANCELLATION FEW_DEGREES NO_SCATTER AT_LIMIT NEAR_LIMIT CUT_BY_LIMIT "
    "CUT_BY_NONE LOPSIDED NOT_TESTABLE EFFECTS_FITTED "
    # a line
    "LINE_NOT_RISING SLOPES_DIFFER GAMMA_TOO_LARGE POINTS_SCATTER GAMMA_DISAGREES "
    # trials of release
    "TRIALS_SILENT TRIALS_SCATTER TRIALS_DISAGREE ENDS_DISAGREE "
    # a calibration
    "RANKS_UNEVEN COVERAGE_OFF TRIALS_FAILED "
    # rows that are not fit
    "NO_DERIVATIVE OUTSIDE_TIMES OUTSIDE_POSITIONS OUTSIDE_WINDOW ROWS_BETWEEN LEFT_OUT "
    "WAY_BACK BESIDE_RELEASE BESIDE_TURNING",
)
"""What a finding says.  Kinds without a status of their own are notes, outcomes and reasons."""

_LEADING = {
    Status.NOT_CONVERGED: (
        "FIT_UNSETTLED STEP_UNSETTLED ROUNDING VALUE_OUTSIDE BETTER_ELSEWHERE "
        "CHAIN_SHORT WALKERS_STUCK"
    ),
    Status.METHODS_DISAGREE: "METHODS_DIFFER SLOPES_DIFFER EFFECTS_FITTED",
    Status.CONTRADICTION: "STATED_DISAGREE RUNS_AGAINST_STATED RUN_OFF_MAP",
    Status.MULTIMODAL: "SEVERAL_SOLUTIONS",
    Status.NOT_IDENTIFIED: (
        "DIRECTION_FLAT SINGULAR UNDETERMINED HARDLY_HELD STEPS_OPEN OPEN_SIDE "
        "LINE_NOT_RISING TRIALS_SILENT"
    ),
    Status.POOR_FIT: (
        "RESIDUALS_ZERO RESIDUALS_TOO_LARGE RESIDUALS_NOT_RANDOM CURVE_LACKS "
        "CHI2_TOO_LARGE SCATTER_TOO_LARGE COUNTS_SCATTER DEVIATION_TOO_LARGE "
        "DEVIATION_TOO_SLOW FORCE_TOO_LARGE FORCE_NOT_LINEAR SPEEDS_NOT_LINEAR "
        "NOISE_TOO_LARGE OUTLIERS_CROWD FRAMES_CROWD RUNS_DISAGREE RUN_DISAGREES "
        "RUNS_TIED STATED_AND_CURVE GAMMA_TOO_LARGE POINTS_SCATTER TRIALS_SCATTER"
    ),
    Status.AT_BOUND: "PRESSED_EDGE PRESSED_LIMIT",
    Status.NOT_CALIBRATED: "RANKS_UNEVEN COVERAGE_OFF TRIALS_FAILED",
}  # a status -> names of the kinds that lead to it
LEADS_TO = {Kind[name]: status for status, names in _LEADING.items() for name in names.split()}
