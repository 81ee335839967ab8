"""Physics of an eccentric body rolling on an incline: NumPy only, SI units, radians.  Start with `model.body`."""

from model.body import Body
from model.motion import back_and_forth, trajectory, travel_time
from model.phase import STANDARD_GRAVITY, angular_rate, ascends, speed, theta_max, theta_min, turning_angle, turning_point

__all__ = [
    "STANDARD_GRAVITY",
    "Body",
    "angular_rate",
    "ascends",
    "back_and_forth",
    "speed",
    "theta_max",
    "theta_min",
    "trajectory",
    "travel_time",
    "turning_angle",
    "turning_point",
]


def __dir__() -> list[str]:
    return list(__all__)
