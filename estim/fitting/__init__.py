"""The posterior mode: least squares (the only file that knows lmfit), far optima, profiles, Fisher
information.  Read `least_squares` first.
"""

from estim.fitting.arrowhead import MANY_RUNS, descend_by_runs, spreads_by_runs
from estim.fitting.curve_intervals import (
    FEW,
    Ends,
    coverage_of_sd,
    profiled,
    shown_value,
    spread,
    unsigned,
)
from estim.fitting.derived import LinearDerived, linear_derived
from estim.fitting.prior_limits import (
    ALONE,
    Limit,
    around,
    limit_cell,
    limit_found,
    limit_of,
    pressed_edges,
)
from estim.fitting.prior_limits import Quadratic as Quadratic
from estim.fitting.fisher_information import information, known_from_data, prior_sds
from estim.fitting.unmodelled_force import (
    FORCE_KEY,
    complete_as,
    expected_information,
    fit_without_force,
    taken_as_complete,
)
from estim.fitting.discrepancy_fit import fit_discrepancy, sds_near_limits
from estim.fitting.posterior_mode import fit_problem, fit_white
from estim.fitting.incidental_parameters import moved_by_integration
from estim.fitting.jeffreys import jeffreys_prior
from estim.fitting.least_squares import Fit, at_mode, chi2_p, fit_least_squares, converged_message
from estim.fitting.unbounded_sides import open_sides
from estim.fitting.optimum import (
    MAX_PARAMETERS,
    Optimum,
    find_optimum,
    fit_optimum,
    origin_of,
    with_other_modes,
)
from estim.fitting.degrees_of_freedom import ErrorSizes, error_sizes, fixed_size
from estim.fitting.profile import Contour, ProfileInterval, contour, profile_intervals
from estim.levenberg_marquardt import Start, minima
from estim.fitting.profile_search import ProfileSearch, search_of
from estim.fitting.unconstrained import PERFECT, no_scatter, silent_parameters
