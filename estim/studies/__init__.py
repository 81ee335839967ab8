"""What is made of analyses: energy, limits, the paper's band, published values, noise models
compared, the reanalysis.

Read `reanalysis` first.
"""

from estim.studies.budget import PRIOR, READINGS, STATED, Budget, Source, uncertainty_budget
from estim.studies.comparison import compare_noise
from estim.studies.refits import Refit
from estim.studies.determination import Determination, determine
from estim.studies.energy import (
    Drift,
    EnergyEstimate,
    EnergyRecord,
    drift_of,
    energy_along,
    energy_status,
)
from estim.studies.known_values import FittedValues
from estim.studies.limits import Narrowing
from estim.studies.models import (
    FORCE,
    START,
    ComparedModel,
    Ground,
    NoEvidence,
    ModelComparison,
    compare_models,
    contains,
    log_odds,
    rival_of,
)
from estim.studies.paper_band import PropagatedBand
from estim.studies.reanalysis import BodyAnalysis, Reanalysis, reanalyse
from estim.studies.regimes import BodyMap, map_bodies
from estim.studies.run_places import RunPlace
from estim.studies.bodies import BodyProperties, weigh
