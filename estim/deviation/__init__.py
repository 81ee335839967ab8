"""What the curve lacks, as covariance: an unmodelled force along a track, a deviation of any curve, errors that are correlated in time.

Read `components` first, then `force`, then `posing`: from a run to the noise that a chain samples under.  Imports `common` and `problem`."""

from estim.deviation.course import Course, Rows
from estim.deviation.jumps import BadFrames, Jump
from estim.deviation.noise import FreeStart
from estim.deviation.posing import FoundForce, bad_frames, pose_force
