"""Which statuses there are, which kinds of findings, and to which status each kind leads."""

from __future__ import annotations

from enum import StrEnum, auto
from types import MappingProxyType


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


class Kind(StrEnum):
    """What a finding says.  Kinds without a status of their own are notes, outcomes and reasons."""

    # the search for the best fit
    FIT_UNSETTLED = auto()
    STEP_UNSETTLED = auto()
    VALUE_OUTSIDE = auto()
    COVARIANCE_HELD = auto()
    STARTS_ELSEWHERE = auto()
    EXCHANGED = auto()
    EXCHANGE = auto()
    IMAGES = auto()
    IMAGE = auto()
    OTHER_NUMBERS = auto()
    FASTER_CURVES = auto()
    VALUES = auto()
    # draws
    CHAIN_SHORT = auto()
    WALKERS_STUCK = auto()
    RHAT_HIGH = auto()
    BULK_LOW = auto()
    TAIL_LOW = auto()
    CHAIN_BRIEF = auto()
    TAU_UNSETTLED = auto()
    CRITERIA_MET = auto()
    INDEPENDENT_DRAWS = auto()
    DRAWS_SHORT = auto()
    # the second computation
    METHODS_DIFFER = auto()
    CHAIN_DIFFERS = auto()
    DIFFERENCE = auto()
    CHAIN_AGREES = auto()
    TOO_MANY_PARAMETERS = auto()
    NOT_SAMPLED = auto()
    WEIGHTS_UNRELIABLE = auto()
    ERRORS_TOO_LARGE = auto()
    MARGINAL_SAMPLED = auto()
    RUNS_COUNT_ALIKE = auto()
    MARGINAL_MISSED = auto()
    MARGINAL_DRAWS_FEW = auto()
    WEIGHTS_EXACT = auto()
    WEIGHTS_UNEVEN = auto()
    WEIGHTS_MOVE = auto()
    WEIGHTS_AGREE = auto()
    # what data and priors determine
    SEVERAL_SOLUTIONS = auto()
    SOLUTION = auto()
    DIRECTION_FLAT = auto()
    DIRECTION_LEARNT = auto()
    DIRECTION_SILENT = auto()
    SINGULAR = auto()
    UNDETERMINED = auto()
    HARDLY_HELD = auto()
    OPEN_SIDE = auto()
    PRESSED_EDGE = auto()
    PRESSED_LIMIT = auto()
    LIMIT = auto()
    TAKEN_AS_EXACT = auto()
    # whether the curve explains the data
    RESIDUALS_ZERO = auto()
    RESIDUALS_TOO_LARGE = auto()
    RESIDUALS_NOT_RANDOM = auto()
    RESIDUALS_SMALL = auto()
    RESIDUALS_HARDLY = auto()
    PATTERN_COVERED = auto()
    NEIGHBOURS_ALIKE = auto()
    NOISE_WITH_SPEED = auto()
    CHI2_TOO_LARGE = auto()
    CHI2_SMALL = auto()
    COUNTS_SCATTER = auto()
    COUNTS_EVEN = auto()
    COUNTS_AS_READINGS = auto()
    SCATTER_TOO_LARGE = auto()
    SCATTER_LARGE = auto()
    OUTLIERS_CROWD = auto()
    # what the curve lacks
    FORCE_FOUND = auto()
    FORCE_UNDECIDED = auto()
    FORCE_UNLIKELY = auto()
    FORCE_TOO_LARGE = auto()
    FORCE_NOT_LINEAR = auto()
    NOISE_CONSERVATIVE = auto()
    NOISE_LARGER = auto()
    NOISE_TOO_LARGE = auto()
    CURVE_COMPLETE = auto()
    DEVIATION_FOUND = auto()
    DEVIATION_UNDECIDED = auto()
    DEVIATION_UNLIKELY = auto()
    DEVIATION_UNASKED = auto()
    DEVIATION_TOO_LARGE = auto()
    DEVIATION_TOO_SLOW = auto()
    CURVE_LACKS = auto()
    # rolling without slipping
    FRICTION_NEEDED = auto()
    ROLLING_SURE = auto()
    ROLLING_DOUBTFUL = auto()
    ROLLING_HOPS = auto()
    # the map of motions
    RUN_OFF_MAP = auto()
    # candidates for it, each refit
    CAUSE_NAMED = auto()
    CAUSES_ALIKE = auto()
    CAUSE_IN_PART = auto()
    CAUSE_UNKNOWN = auto()
    # bad frames
    FRAME_OFF = auto()
    STEP_STAYS = auto()
    FRAMES_LOST = auto()
    FRAMES_CROWD = auto()
    # whether the sources agree
    RUNS_DISAGREE = auto()
    RUN_DISAGREES = auto()
    RUNS_TIED = auto()
    RUNS_AGAINST_STATED = auto()
    RUNS_AGREE = auto()
    RUNS_UNCOMPARED = auto()
    STATED_DISAGREE = auto()
    STATED_AND_CURVE = auto()
    STATED_HARDLY = auto()
    STATED_AGREE = auto()
    STATED_UNCOMPARED = auto()
    PULL = auto()
    COMMON_ERRORS = auto()
    COMMON_ERROR = auto()
    # a curve fitted by `fit_curve`
    ROUNDING = auto()
    CANCELLATION = auto()
    FEW_DEGREES = auto()
    NO_SCATTER = auto()
    AT_LIMIT = auto()
    NEAR_LIMIT = auto()
    CUT_BY_LIMIT = auto()
    CUT_BY_NONE = auto()
    # a line
    LINE_NOT_RISING = auto()
    SLOPES_DIFFER = auto()
    GAMMA_TOO_LARGE = auto()
    POINTS_SCATTER = auto()
    GAMMA_DISAGREES = auto()
    # trials of release
    TRIALS_SILENT = auto()
    TRIALS_SCATTER = auto()
    TRIALS_DISAGREE = auto()
    ENDS_DISAGREE = auto()
    # a calibration
    RANKS_UNEVEN = auto()
    COVERAGE_OFF = auto()
    TRIALS_FAILED = auto()
    # rows that are not fit
    NO_DERIVATIVE = auto()
    OUTSIDE_TIMES = auto()
    OUTSIDE_POSITIONS = auto()
    OUTSIDE_WINDOW = auto()
    ROWS_BETWEEN = auto()
    LEFT_OUT = auto()
    WAY_BACK = auto()
    BESIDE_RELEASE = auto()
    BESIDE_TURNING = auto()


_KINDS = {
    Status.NOT_CONVERGED: (
        Kind.FIT_UNSETTLED,
        Kind.STEP_UNSETTLED,
        Kind.ROUNDING,
        Kind.VALUE_OUTSIDE,
        Kind.CHAIN_SHORT,
        Kind.WALKERS_STUCK,
    ),
    Status.METHODS_DISAGREE: (Kind.METHODS_DIFFER, Kind.SLOPES_DIFFER),
    Status.CONTRADICTION: (Kind.STATED_DISAGREE, Kind.RUNS_AGAINST_STATED, Kind.RUN_OFF_MAP),
    Status.MULTIMODAL: (Kind.SEVERAL_SOLUTIONS,),
    Status.NOT_IDENTIFIED: (
        Kind.DIRECTION_FLAT,
        Kind.SINGULAR,
        Kind.UNDETERMINED,
        Kind.HARDLY_HELD,
        Kind.OPEN_SIDE,
        Kind.LINE_NOT_RISING,
        Kind.TRIALS_SILENT,
    ),
    Status.POOR_FIT: (
        Kind.RESIDUALS_ZERO,
        Kind.RESIDUALS_TOO_LARGE,
        Kind.RESIDUALS_NOT_RANDOM,
        Kind.CURVE_LACKS,
        Kind.CHI2_TOO_LARGE,
        Kind.SCATTER_TOO_LARGE,
        Kind.COUNTS_SCATTER,
        Kind.DEVIATION_TOO_LARGE,
        Kind.DEVIATION_TOO_SLOW,
        Kind.FORCE_TOO_LARGE,
        Kind.FORCE_NOT_LINEAR,
        Kind.NOISE_TOO_LARGE,
        Kind.OUTLIERS_CROWD,
        Kind.FRAMES_CROWD,
        Kind.RUNS_DISAGREE,
        Kind.RUN_DISAGREES,
        Kind.RUNS_TIED,
        Kind.STATED_AND_CURVE,
        Kind.GAMMA_TOO_LARGE,
        Kind.POINTS_SCATTER,
        Kind.TRIALS_SCATTER,
    ),
    Status.AT_BOUND: (Kind.PRESSED_EDGE, Kind.PRESSED_LIMIT),
    Status.NOT_CALIBRATED: (Kind.RANKS_UNEVEN, Kind.COVERAGE_OFF, Kind.TRIALS_FAILED),
}
LEADS_TO = MappingProxyType({kind: status for status, kinds in _KINDS.items() for kind in kinds})
