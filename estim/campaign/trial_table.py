"""The `[trials]` table of a campaign file: a body released at set angles, and whether it
climbed.
"""

from __future__ import annotations

import msgspec


class TrialsTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """u_phi_deg, u_theta_deg : standard uncertainties of a tilt, and of one angle as set.
    release_deg : scale of what the hand costs.
    """

    file: str
    body: str
    u_phi_deg: float
    u_theta_deg: float
    release_deg: float = 3.0
    u_zero_phi_deg: float = 0.0
    u_zero_theta_deg: float = 0.0
