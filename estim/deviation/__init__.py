"""What the curve lacks, as covariance: an unmodelled force along a track, a deviation of any curve, errors that are correlated in time.

Read `components` first, then `force`, `posing` (a run) and `joint` (several); `lacking` for a user's own curve.  Imports `common` and `problem`."""

from estim.deviation.autocorrelated import AutoCorrelated
from estim.deviation.completed import Completed
from estim.deviation.course import Course, Rows
from estim.deviation.grid import FORCE_SCALE, SCALES
from estim.deviation.joint import JointlyPosed, pose_forces
from estim.deviation.jumps import BadFrames, Jump
from estim.deviation.lacking import DeviationSize, FoundDeviation, pose_deviation
from estim.deviation.noise import FreeStart
from estim.deviation.parts import DEVIATION, FORCE, FRAMES, START, parts_of_errors
from estim.deviation.posing import FoundForce, Posed, bad_frames, pose_force
from estim.deviation.usual_errors import USUAL, WithUsualErrors, read_off
