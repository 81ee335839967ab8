"""What the curve lacks, as covariance: a force along a track, deviations, errors correlated in
time.  Read `scale_mixture` first, then `noise_with_force`.
"""

from estim.discrepancy.noise_without_force import log_rescaled, log_restarted, pose_without_force
from estim.discrepancy.autocorrelated import AutoCorrelated
from estim.discrepancy.force_bands import Completed
from estim.discrepancy.trajectory import Trajectory
from estim.discrepancy.unmeasured_runs import ForceSize, expected_root, force_sizes
from estim.discrepancy.grid import FORCE_SCALE, SCALES, START_SD
from estim.discrepancy.joint_runs import bad_frames, by_itself, pose_forces, sharing_runs
from estim.discrepancy.bad_frame_search import BadFrames, Jump, Pattern, Shifts
from estim.discrepancy.curve_discrepancy import (
    DeviationSize,
    FoundDeviation,
    pose_deviation,
    presence,
)
from estim.discrepancy.noise_with_discrepancy import FreeStart
from estim.discrepancy.error_parts import DEVIATION, FORCE, FRAMES, START, parts_of_errors
from estim.discrepancy.noise_with_force import FoundForce, NormalParts
from estim.discrepancy.smoothing import GUARD
from estim.discrepancy.repetition import MixtureErrors, replicas
