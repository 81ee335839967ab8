"""Trials of release: a body set at an angle, let go, and whether it climbed.  What
`estim.line.release_likelihood` makes a likelihood of.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from estim.arrays import BoolArray, FloatArray
from estim.campaign import CampaignFile
from estim.reading import read_known_columns

COLUMNS = ("phi_deg", "theta_deg", "climbed")
LOW, HIGH = "min", "max"  # ends of the angles from which a body climbs


@dataclass(frozen=True, eq=False)
class Tilt:
    """Trials at one setting of the ramp.

    phi : rad, as read.
    theta : (n,) rad, angles as set.  climbed : (n,) whether the body started to move up the ramp.
    """

    phi: float
    theta: FloatArray
    climbed: BoolArray

    def end(self, end: str) -> Tilt:
        """The trials at one end: angles below 90 degrees ("min") or the others ("max")."""
        mask = (self.theta < 0.5 * np.pi) == (end == LOW)
        return Tilt(self.phi, self.theta[mask], self.climbed[mask])


@dataclass(frozen=True, eq=False)
class Trials:
    """All trials of one body, by tilt.

    u_phi : rad, standard uncertainty of the reading of a tilt, which all trials at it share.
    u_theta : rad, of one angle as set.
    release : rad, scale of the half-normal prior of what the release by hand costs; 0: it costs
        nothing.
    u_zero_phi, u_zero_theta : rad, standard uncertainties of zero errors that all readings of a
        scale share.
    """

    body: str
    file: str
    sha256: str
    tilts: tuple[Tilt, ...]
    u_phi: float
    u_theta: float
    release: float
    u_zero_phi: float = 0.0
    u_zero_theta: float = 0.0

    @cached_property
    def ends(self) -> tuple[str, ...]:
        """The ends at which there are trials."""
        return tuple(
            end for end in (LOW, HIGH) if any(tilt.end(end).theta.size for tilt in self.tilts)
        )

    @property
    def n_trial(self) -> int:
        return sum(tilt.theta.size for tilt in self.tilts)

    @property
    def n_climbed(self) -> int:
        return int(sum(np.count_nonzero(tilt.climbed) for tilt in self.tilts))

    def end(self, end: str) -> Trials:
        """The trials at one end alone."""
        tilts = tuple(part for tilt in self.tilts if (part := tilt.end(end)).theta.size)
        return replace(self, tilts=tilts)


def by_tilt(phi: FloatArray, theta: FloatArray, climbed: BoolArray) -> tuple[Tilt, ...]:
    """Trials (n,) grouped by the reading of the tilt, in its order; equal readings are one setting
    of the ramp.
    """
    return tuple(
        Tilt(float(reading), theta[phi == reading], climbed[phi == reading])
        for reading in np.unique(phi)
    )


def read_trials(source: CampaignFile) -> Trials:
    """The trials that the [trials] table of a campaign names.  Raises InputError."""
    stated = source.trials
    if stated is None:
        raise source.error(
            "has no [trials] table: it names the trials of release", (), field="campaign"
        )
    path = Path(source.path.parent / stated.file)
    with source.reading(path, COLUMNS):
        table = read_known_columns(path, known=COLUMNS, min_rows=4, needed=COLUMNS)
    for name, low, high in (("phi_deg", -90.0, 90.0), ("theta_deg", 0.0, 180.0)):
        within = (low <= table.columns[name]) & (table.columns[name] <= high)
        table.require(name, within, f"must lie between {low:.0f} and {high:.0f}")
    either = np.isin(table.columns["climbed"], (0.0, 1.0))
    table.require("climbed", either, "must be 1 (it climbed) or 0 (it did not)")
    keys = ("u_phi_deg", "u_theta_deg", "release_deg", "u_zero_phi_deg", "u_zero_theta_deg")
    tilts = by_tilt(
        np.radians(table.columns["phi_deg"]),
        np.radians(table.columns["theta_deg"]),
        table.columns["climbed"] == 1.0,
    )
    return Trials(
        stated.body,
        table.file,
        table.sha256,
        tilts,
        *(float(np.radians(getattr(stated, key))) for key in keys),
    )
