"""What can be fit, with derivatives and errors common to all points.  Read `rolling` for the disk,
`formula` for text.
"""

from estim.curves.count_data import Binomial, Counting, EventTimes, Poisson
from estim.curves.differences import HALVED, extrapolated
from estim.curves.dual_numbers import Dual
from estim.curves.formula import RESERVED, Formula, evaluate, read_formula
from estim.curves.joining import JointProblem, join, of_data_set
from estim.curves.models import Limits, ModelSum, known_models, read_model
from estim.curves.named import arguments_of, called_by_name, in_time, with_defaults, within
from estim.curves.variable_projection import linear_in
from estim.curves.curve_problem import (
    MAX_DENSE,
    SIGMA,
    SIGMA_NOTATION,
    SIGMA_SPREAD,
    CurveProblem,
    require_points,
    roughness,
)
from estim.curves.units import AxisNames, refuse_degrees, units_of
from estim.curves.data_set import DataSet
from estim.curves.posing import pose_points, pose_sets
from estim.curves.quantities import refuse_quantities
from estim.curves.regimes import (
    Borders,
    borders_of,
    farthest_stop,
    placed,
    steepest_tilt,
    turning_contours,
)
from estim.curves.rolling import (
    MotionCurve,
    PhaseCurve,
    Place,
    RollingMotion,
    Setting,
    energy_of_speed,
    size_with_blur,
)
from estim.curves.parameter_settings import ParameterSettings, with_joint_priors
from estim.curves.several_abscissas import are_abscissas, at_abscissas, numbered
from estim.curves.systematic_errors import Component, scale_errors_of
from estim.curves.derived import SoughtQuantity, check_derived_names, in_units, seek
from estim.curves.derived_units import unit_that_follows
