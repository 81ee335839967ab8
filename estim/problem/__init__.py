"""What is assumed: curves, priors, noise, and the density they make.  Read `posterior`, then
`noise` (which sigma is which) and `likelihood`.
"""

from estim.arrays import Named as Named
from estim.problem.errors_in_x_quadrature import hide_the_range
from estim.problem.curve import (
    EXACT,
    CommonError,
    Curve,
    Derived,
    Footing,
    LocalCurve,
    Motion,
    PositionCurve,
    SpeedCurve,
    SquaredCurve,
    Wording,
    plain_words,
)
from estim.problem.events import Events
from estim.problem.count_distributions import BINOMIAL, POISSON, Counted, Law
from estim.problem.count_noise import Counts, counted_words
from estim.problem.coordinates import WIDE, Coordinates, compensated
from estim.problem.differences import used_columns
from estim.problem.errors_in_x import ROOTED, rooted
from estim.problem.likelihood import (
    Likelihood,
    Noise,
    NormalErrors,
    Points,
    StackedPoints,
    n_draws,
    own_values,
    reading_sd,
    shift_of,
    some_draws,
    spread_of,
)
from estim.problem.own_density import OwnDensity
from estim.problem.noise import Differentiated, Independent
from estim.problem.finite_differences import STENCILS, Derivative, differentiate
from estim.problem.noise_variance import NoiseVariance, Scale
from estim.problem.correlated_normal import GaussianErrors
from estim.problem.observations import (
    MAX_LACKING,
    Discrepancy,
    Observations,
    Parameter,
    Rows,
    parameters_of,
    shared_first,
    uses_of,
)
from estim.problem.prior_measures import InformationBlock, JeffreysPrior, Measure, ResponseSurface
from estim.problem.posterior import Posterior, Problem
from estim.problem.correlated_runs import Group
from estim.problem.priors import (
    PRIORS,
    DefaultError,
    Flat,
    HalfNormal,
    JointNormal,
    LogNormal,
    Normal,
    Prior,
    Uniform,
    Unstated,
    as_prior,
    centre_of,
    of_other_package,
)
from estim.problem.curve_noise import Correlated, Readings, check_covariance
from estim.problem.roots import (
    BandedFactor,
    Root,
    beside,
    covariance_of,
    stacked_root,
    with_columns,
)
from estim.problem.symmetry import TURNS, Symmetry, folded, no_symmetry, same_curves
from estim.problem.whitened_residuals import Linear, Whitened
from estim.problem.installed_tails import known_laws
from estim.problem.robust import MOST_REWEIGHTED, errors_widened, shape_of, typical_size
from estim.problem.tails import Tails, TwoPiece
