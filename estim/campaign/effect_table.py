"""Keys of a campaign for effects in addition to gravity and constant rolling resistance, and for
the ramp and the image.

Each may stand under [shared], at a body or at a run; docs/campaign.md has their symbols.
"""

from __future__ import annotations

from estim.campaign.dialect_table import DialectKeys
from estim.campaign.prior_table import Positive, Stated


class EffectTable(DialectKeys, frozen=True):
    """What is known of a run besides gravity; how its table is written may be stated at the same
    levels (`DialectKeys`).

    An effect that is stated at no level is exactly zero, but for `scale_x` and `scale_t`, which
    have a default prior.

    release_energy : kinetic energy at release / (M g R).
    release_speed_m_s : the same as a speed of the axle.
    scale_x, scale_t : relative errors of the scale of length and of the clock.
    resisting_moment_n_m : torque of bearings and cords.
    load_resistance : rolling resistance in proportion to the normal force.
    viscous_drag_per_s, quadratic_drag_per_m : drag force / (M v) and / (M v^2).
    moment_once_cos, ... : first and second harmonic of a torque per turn / (M g R).
    phi_slope_deg_m, phi_slope_rad_m : gradient of the inclination, degrees or radians per metre.
    sag_m : sag of the ramp midway between its supports.
    ramp_length_m, ramp_start_m : exact; distance between the supports, and from the lower one to
        the release.
    distortion_m : shift of the middle of the image by the lens.
    picture_length_m, picture_start_m : exact; length of the image, and from its lower end to the
        release.
    """

    release_energy: Stated = None
    release_speed_m_s: Stated = None
    scale_x: Stated = None
    scale_t: Stated = None
    resisting_moment_n_m: Stated = None
    load_resistance: Stated = None
    viscous_drag_per_s: Stated = None
    quadratic_drag_per_m: Stated = None
    moment_once_cos: Stated = None
    moment_once_sin: Stated = None
    moment_twice_cos: Stated = None
    moment_twice_sin: Stated = None
    phi_slope_deg_m: Stated = None
    phi_slope_rad_m: Stated = None
    sag_m: Stated = None
    ramp_length_m: Positive | None = None
    ramp_start_m: float | None = None
    distortion_m: Stated = None
    picture_length_m: Positive | None = None
    picture_start_m: float | None = None
