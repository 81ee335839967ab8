"""The theta_min series of a campaign: smallest angles of release from which the body ascends,
against the tilt.

sin(theta_min) = sin(phi)/gamma + c_rr cos(phi)/gamma: a line of slope 1/gamma whose intercept is
c_rr/gamma (cos phi = 1 to 1 % for phi below 8 degrees).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from estim.arrays import FloatArray
from estim.campaign import CampaignFile
from estim.reading import Table, read_known_columns

COLUMNS = ("phi_deg", "theta_min_deg", "u_phi_deg", "u_theta_min_deg")
_LEAST = 1e-4  # degrees: no protractor is better, and the error of a sine would be lost in rounding


@dataclass(frozen=True, eq=False)
class ThetaMinSeries:
    """Angles (rad) and their sines with standard uncertainties, all (n_obs,), and where they came
    from.

    u(sin a) is the exact standard deviation of sin(a + e) for normal e of sd u(a); the linear law
    |cos a| u(a) has no meaning near 90 degrees:  var = (1 - q)(1 + q cos 2a)/2,  q = exp(-u^2).
    u_zero_phi, u_zero_theta_min : rad, standard uncertainty of a zero error that all readings of a
        scale share.
    """

    body: str
    file: str
    sha256: str
    phi: FloatArray
    theta_min: FloatArray
    u_phi: FloatArray
    u_theta_min: FloatArray
    u_zero_phi: float
    u_zero_theta_min: float

    @property
    def x(self) -> FloatArray:
        return np.sin(self.phi)

    @property
    def y(self) -> FloatArray:
        return np.sin(self.theta_min)

    @property
    def u_x(self) -> FloatArray:
        return _sd_of_sine(self.phi, self.u_phi)

    @property
    def u_y(self) -> FloatArray:
        return _sd_of_sine(self.theta_min, self.u_theta_min)

    @property
    def u_zero_x(self) -> FloatArray:
        """(n_obs,) what the common zero error of the tilt does to its sine."""
        return np.cos(self.phi) * self.u_zero_phi

    @property
    def u_zero_y(self) -> FloatArray:
        return np.cos(self.theta_min) * self.u_zero_theta_min


def _sd_of_sine(angle: FloatArray, u: FloatArray) -> FloatArray:
    q = np.exp(-np.square(u))
    return np.sqrt(0.5 * (1.0 - q) * (1.0 + q * np.cos(2.0 * angle)))


def read_theta_min(source: CampaignFile) -> ThetaMinSeries:
    """The series that the [line] table of a campaign names.  Raises InputError.

    source : the file of the campaign, `Campaign.source`.

    >>> from estim import load_campaign, read_theta_min
    >>> series = read_theta_min(load_campaign("data/replica/campaign.toml").source)
    >>> series.phi.shape
    (8,)
    """
    if source.line is None:
        raise source.error(
            "has no [line] table: it names the theta_min series", (), field="campaign"
        )
    line, folder = source.line, source.path.parent
    path = Path(folder / line.file)
    with source.reading(path, COLUMNS):
        table = read_known_columns(path, known=COLUMNS, min_rows=3, needed=COLUMNS[:2])
    for name in COLUMNS[:2]:
        within = np.abs(table.columns[name]) <= 90.0
        table.require(name, within, "must lie between -90 and 90")
    if np.ptp(table.columns["phi_deg"]) == 0.0:
        raise table.error(
            "must not be the same in every row: a line needs several tilts", "phi_deg", 0
        )
    return ThetaMinSeries(
        body=line.body,
        file=table.file,
        sha256=table.sha256,
        phi=np.radians(table.columns["phi_deg"]),
        theta_min=np.radians(table.columns["theta_min_deg"]),
        u_phi=np.radians(_uncertainty(source, table, "u_phi_deg", line.u_phi_deg)),
        u_theta_min=np.radians(
            _uncertainty(source, table, "u_theta_min_deg", line.u_theta_min_deg)
        ),
        u_zero_phi=float(np.radians(line.u_zero_phi_deg)),
        u_zero_theta_min=float(np.radians(line.u_zero_theta_min_deg)),
    )


def _uncertainty(source: CampaignFile, table: Table, name: str, common: float | None) -> FloatArray:
    """A column of standard uncertainties, or the campaign's common one; one of the two must be
    there.
    """
    column = table.columns.get(name)
    if column is not None and common is not None:
        raise source.error(
            f"is stated twice: here and as a column of {table.file}", ("line", name), value=common
        )
    if column is not None:
        table.require(name, column > 0.0, "must be > 0")
        table.require(name, column >= _LEAST, f"must be at least {_LEAST:g}")
        return column
    if common is None:
        raise source.error(
            f"is missing: say it here or as a column of {table.file}", ("line", name)
        )
    return np.full(table.lines.size, common)
