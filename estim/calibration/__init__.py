"""Does the pipeline tell the truth about its uncertainty?  Simulated campaigns: ranks and coverage.
Read `calibration` first.
"""

from estim.calibration.calibration import (
    UNIFORM_BELOW,
    Calibration,
    run_trials,
    coverage_sentence,
    direction,
    findings,
)
from estim.calibration.experiment import campaign_design, curve_at, follow, release_times
from estim.calibration.trial import posterior_draws
from estim.calibration.uniformity import EDGES, N_RANK, rank_counts, uniformity_band
