"""What can be wrong with a result, one file a question; `diagnosis` gathers the findings.  Read it
first.
"""

from estim.checks.quoted_results import (
    Estimate,
    estimates_of,
    headline,
    not_measured,
    p_sentence,
    posterior_table,
)
from estim.checks.quoted_results import best_words, print_lines, result_table, screen_lines
from estim.checks.conflict import (
    NOTE_BELOW,
    P_CONFLICT,
    Conflict,
    check_stated_values,
    stated_values,
)
from estim.checks.consistency import (
    P_INCONSISTENT,
    PRIORS,
    Consistency,
    check_consistency,
    comparable,
)
from estim.checks.cross_validation import LeaveOneOut, difference, leave_one_out
from estim.checks.diagnosis import (
    Diagnosis,
    tolerated_pattern,
    diagnose,
    failed_tests,
    same_curve,
    sampling_findings,
    several_solutions,
    too_many_outliers,
    held_by_draws,
    unidentified,
)
from estim.checks.model_discrepancy import deviation_finding, unasked, wrong_curves
from estim.checks.doubtful_data import data_remarks
from estim.checks.fitted_curve import (
    curve_findings,
    curve_remarks,
    unsettled_findings,
    values_outside,
)
from estim.checks.unmodelled_force import SURE, force_finding, noise_finding
from estim.checks.goodness_of_fit import (
    Check,
    P_FLOOR,
    P_POOR_FIT,
    P_TOLD,
    Goodness,
    check_goodness,
    check_linear,
    untested,
)
from estim.checks.identifiability import PRIOR_DOMINATED, Identifiability, identify
from estim.checks.modes import Modes, find_modes, optima_of
from estim.checks.outliers import Outliers, bad_frames_found, find_outliers
from estim.checks.rolling import Rolling, check_rolling, way_of
from estim.checks.prior_sensitivity import CONFLICT, THRESHOLD, Sensitivity, power_scaling
from estim.checks.systematic_errors import Influence, influences
