"""Keys of a campaign for what is known beside weight and plain rolling resistance, and for how tables are written; each may stand at every level."""

from __future__ import annotations

from estim.campaign.dialect_table import DialectKeys
from estim.campaign.prior_table import Value


class EffectTable(DialectKeys, forbid_unknown_fields=True, frozen=True):
    """What none of them says is taken as exactly zero."""

    release_energy: Value | None = None
    release_speed_m_s: Value | None = None
    scale_x: Value | None = None
    scale_t: Value | None = None
    resisting_moment_n_m: Value | None = None
    load_resistance: Value | None = None
    viscous_drag_per_s: Value | None = None
    quadratic_drag_per_m: Value | None = None
    moment_once_cos: Value | None = None
    moment_once_sin: Value | None = None
    moment_twice_cos: Value | None = None
    moment_twice_sin: Value | None = None
    phi_slope_deg_m: Value | None = None
    phi_slope_rad_m: Value | None = None
    sag_m: Value | None = None
    ramp_length_m: float | None = None
    ramp_start_m: float | None = None
    distortion_m: Value | None = None
    picture_length_m: float | None = None
    picture_start_m: float | None = None
