"""Physics of an eccentric body rolling on an incline: NumPy, SI units, radians.  Start with
`estim.model.body`.
"""

from estim.model.body import Body
from estim.model.contact import ContactForces, contact_forces, needed_friction
from estim.model.forces import (
    Forces,
    moment_ratio,
    release_energy,
    release_speed,
    sagging,
    turn_amplitude,
    turn_components,
)
from estim.model.motion import back_and_forth, trajectory, travel_time
from estim.model.parts import Assembly, Part, assemble, bolt, disk, ring, rod
from estim.model.phase_curve import (
    STANDARD_GRAVITY,
    angular_rate,
    ascends,
    speed,
    theta_max,
    theta_min,
    turning_angle,
    turning_point,
)
from estim.model.readings import Readings, blurred_sigma
from estim.model.regimes import range_of_release, release_for_turn, release_that_rolls_on

__all__ = [
    "STANDARD_GRAVITY",
    "Assembly",
    "Body",
    "ContactForces",
    "Forces",
    "Part",
    "Readings",
    "angular_rate",
    "ascends",
    "assemble",
    "back_and_forth",
    "blurred_sigma",
    "bolt",
    "contact_forces",
    "disk",
    "moment_ratio",
    "needed_friction",
    "range_of_release",
    "release_energy",
    "release_for_turn",
    "release_speed",
    "release_that_rolls_on",
    "ring",
    "rod",
    "sagging",
    "speed",
    "theta_max",
    "theta_min",
    "trajectory",
    "travel_time",
    "turn_amplitude",
    "turn_components",
    "turning_angle",
    "turning_point",
]


def __dir__() -> list[str]:
    return list(__all__)
