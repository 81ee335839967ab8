"""The `[trials]` table of a campaign file: a body released at set angles, and whether it
climbed.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta

from estim.campaign.key_table import KeyTable

Degrees = Annotated[float, Meta(ge=0.0, lt=45.0)]  # an uncertainty of an angle
# the same of each reading: no protractor is better, and the error of a sine would be lost
OfReading = Annotated[float, Meta(ge=1e-4, lt=45.0)]


class TrialsTable(KeyTable, frozen=True, kw_only=True):
    """u_phi_deg, u_theta_deg : standard uncertainties of a tilt, and of one angle as set.
    release_deg : scale of what the hand costs.
    """

    file: str
    body: str
    u_phi_deg: Degrees
    # no angle is set more closely, and the integral over the tilt has no nodes for less
    u_theta_deg: Annotated[float, Meta(ge=0.01, lt=45.0)]
    release_deg: Degrees = 3.0
    u_zero_phi_deg: Degrees = 0.0
    u_zero_theta_deg: Degrees = 0.0
