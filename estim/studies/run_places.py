"""Where the runs of a campaign lie on the map of motions: how far each should get, and how far its
recording shows it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, Named
from estim.campaign import Campaign
from estim.checks import way_of
from estim.common import QUANTILES, Finding, Kind
from estim.curves import placed
from estim.distributions import normal_below
from estim.problem import Observations


@dataclass(frozen=True, eq=False)
class RunPlace:
    """One run on the map.

    phi, theta0 : true tilt and angle of release, (value, standard uncertainty), rad.
    sets_off : probability that it sets off.
    stop : (5,) `QUANTILES` of the distance to the turning point among the draws that set off and
        turn, m, as it would be read; nan where half of them do not.
    farthest : m from the release, how far the recording shows it.
    turned : whether it turns there.
    agrees : probability of the draws to get as far as that, two-sided where it turned.
    """

    run: str
    phi: tuple[float, float]
    theta0: tuple[float, float]
    sets_off: float
    stop: FloatArray
    farthest: float
    turned: bool
    agrees: float

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What contradicts the recording."""
        if self.agrees >= 0.001:
            return ()
        numbers = {
            "farthest": self.farthest,
            "expected": float(self.stop[2]),
            "sets_off": self.sets_off,
        }
        return (Finding(Kind.RUN_OFF_MAP, run=self.run, p=self.agrees, numbers=numbers),)


def place_of(campaign: Campaign, run: Observations, arguments: Named) -> RunPlace:
    """Where a run of a campaign lies and what follows, with all that was stated of it.

    arguments : of its curve, scalars or (n_draw, 1).
    """
    phi, theta0 = placed(arguments)
    recorded, unsure = _farthest_recorded(campaign, run)
    farthest = recorded - np.ravel(arguments.get("offset", 0.0))
    metre = float(np.median(run.body.metres(arguments)))
    stop = np.ravel(run.body.stop(arguments))
    turns, turned = (stop > 0.0) & np.isfinite(stop), _turned(run)
    further = stop - farthest
    if unsure > 0.0:
        p_beyond, p_before = (
            float(np.mean(normal_below(sign * further / unsure))) for sign in (1.0, -1.0)
        )
    else:
        p_beyond, p_before = float(np.mean(further >= 0.0)), float(np.mean(further <= 0.0))
    return RunPlace(
        run.name,
        (float(np.mean(phi)), float(np.std(phi))),
        _angle(theta0),
        float(np.mean(stop > 0.0)),
        metre * np.quantile(stop[turns], QUANTILES)
        if np.mean(turns) > 0.5
        else np.full(len(QUANTILES), np.nan),
        metre * float(np.median(farthest)),
        turned,
        min(1.0, 2.0 * min(p_beyond, p_before)) if turned else p_beyond,
    )


def _angle(theta0: FloatArray) -> tuple[float, float]:
    """Mean and standard deviation of angles that may lie on either side of the cut."""
    mean = float(np.angle(np.mean(np.exp(1j * theta0))))
    return float(np.mod(mean + 0.5 * np.pi, 2.0 * np.pi) - 0.5 * np.pi), float(
        np.std(np.mod(theta0 - mean + np.pi, 2.0 * np.pi))
    )


def _farthest_recorded(campaign: Campaign, run: Observations) -> tuple[float, float]:
    """How far the recording of a run goes, in its unit, as far as it is fit where a window was
    stated; and the standard uncertainty of that: readings scatter, and between two frames it may
    go farther.

    The median second difference is 1.65 standard deviations of the errors of readings, since the
    largest of many is read, and 8 times what a body that turns can do between two frames.
    """
    table = campaign.tables[run.name]
    windowed = any(
        finding.kind in (Kind.OUTSIDE_POSITIONS, Kind.OUTSIDE_TIMES, Kind.OUTSIDE_WINDOW)
        for finding in run.excluded
    )
    bends = np.abs(np.diff(table.position, 2)) if "t_s" in table.columns else np.zeros(0)
    return (
        way_of(run) if windowed else float(np.max(table.position)),
        float(np.median(bends)) if bends.size else 0.0,
    )


def _turned(run: Observations) -> bool:
    """Whether the recording shows frames after the farthest."""
    if run.positions:
        return bool(np.argmax(run.y) < run.n_obs - 1)
    return any(finding.kind is Kind.WAY_BACK for finding in run.excluded)
