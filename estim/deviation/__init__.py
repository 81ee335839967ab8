"""What the curve lacks, as covariance: a force along a track, deviations, errors correlated in
time.  Read `components` first, then `posing`.
"""

from estim.deviation.without_force import log_rescaled, log_restarted, pose_without_force
from estim.deviation.autocorrelated import AutoCorrelated
from estim.deviation.force_bands import Completed
from estim.deviation.trajectory import Trajectory
from estim.deviation.expected import ForceSize, expected_root, force_sizes
from estim.deviation.grid import FORCE_SCALE, SCALES, START_SD
from estim.deviation.joint import NormalParts, bad_frames, by_itself, pose_forces, sharing_runs
from estim.deviation.bad_frame_search import BadFrames, Jump, Pattern, Shifts
from estim.deviation.curve_discrepancy import (
    DeviationSize,
    FoundDeviation,
    pose_deviation,
    presence,
)
from estim.deviation.noise import FreeStart
from estim.deviation.parts import DEVIATION, FORCE, FRAMES, START, parts_of_errors
from estim.deviation.with_force import FoundForce
from estim.deviation.smoothing import GUARD
from estim.deviation.repetition import MixtureErrors, replicas
