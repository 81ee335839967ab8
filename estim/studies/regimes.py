"""The map of what a body does from rest: does it climb, how far, does it turn on the ramp or roll
over the top.

Over the plane of true tilt and angle of release; the uncertainty of a border is that of what is
known of the body, that of a run also of where it lies.  All of it comes from draws of what was
stated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, Named
from estim.campaign import EFFECTS, Campaign
from estim.common import QUANTILES, Finding, InputError, Stream, stream
from estim.curves import Borders, borders_of, farthest_stop, steepest_tilt, turning_contours
from estim.problem import Parameter
from estim.studies.ramp_end import RampEnd, ramp_end_of
from estim.studies.run_places import RunPlace, place_of

_N_PHI, _N_DRAW = 361, 2000
# m between contours, and how many at most
_STEPS, _CONTOURS = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0), 10
_FAR_DRAWS, _FAR_EVERY = 300, 2  # of how far it gets, and every so many tilts
# how far a map reaches: of the steepest tilt that is climbed, and beyond the runs
_BEYOND, _SDS = 1.2, 3.5
_LEAST = math.radians(1.0)
_STEEPEST = math.radians(80.0)


@dataclass(frozen=True, eq=False)
class BodyMap(Borders):
    """The map of one body.

    phi : (n_phi,) rad.
    theta0_range : rad.
    lowest, highest, rolls_on, passes : (5, n_phi) quantiles (`QUANTILES`) of the borders
        (`estim.curves.Borders`).
    stops : (n_stop,) m.
    contours : (n_stop, n_phi) rad, the release from which the body turns after so far, at the
        medians of what is known of it; nan where from none.
    steepest : (5,) quantiles of the steepest tilt that the body climbs, rad.
    farthest : (5, n) quantiles of how far it gets from the best release, m, at the tilts far_phi
        (n,) rad.
    uphill, downhill : whether the map shows these tilts.
    left_out : symbols of what the campaign states beside, which the map leaves out.
    """

    body: str
    phi: FloatArray
    theta0_range: tuple[float, float]
    stops: FloatArray
    contours: FloatArray
    steepest: FloatArray
    far_phi: FloatArray
    farthest: FloatArray
    runs: tuple[RunPlace, ...]
    end: RampEnd
    left_out: tuple[str, ...]

    @property
    def uphill(self) -> bool:
        return bool(self.phi[-1] > 0.0)

    @property
    def downhill(self) -> bool:
        return bool(self.phi[0] < 0.0)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What contradicts a recording."""
        return tuple(finding for place in self.runs for finding in place.findings)


def map_bodies(
    campaign: Campaign, bodies: Sequence[str] = (), *, ramp_length: float | None = None, seed: int
) -> tuple[BodyMap, ...]:
    """The maps of `bodies`, or of every body of a campaign that has runs.

    ramp_length (m from the release) : in place of that of the campaign.

    Raises InputError.
    """
    of_run = {name: campaign.body_of(name) for name in campaign.run_names}
    chosen = tuple(dict.fromkeys(bodies)) or tuple(
        dict.fromkeys(body for body in of_run.values() if body is not None)
    )
    for body in chosen:
        if body not in campaign.source.bodies:
            raise InputError(
                f"must name one of the bodies ({', '.join(campaign.source.bodies)})",
                field="--body",
                value=body,
                file=campaign.path,
            )
        if body not in of_run.values():
            raise InputError(
                "has no [[runs]], and a map needs the tilt and the angle of one",
                field="--body",
                value=body,
                file=campaign.path,
            )
    names = [name for name, body in of_run.items() if body in chosen]
    draws = _stated(campaign, names, seed=seed)
    return tuple(
        _map_body(
            campaign,
            body,
            [name for name in names if of_run[name] == body],
            draws,
            ramp_length=ramp_length,
        )
        for body in chosen
    )


def _map_body(
    campaign: Campaign,
    body: str,
    names: Sequence[str],
    draws: Mapping[str, FloatArray],
    *,
    ramp_length: float | None,
) -> BodyMap:
    runs = [campaign.problem([name]).runs[0] for name in names]
    arguments = {run.name: run.bind(draws) for run in runs}
    first = arguments[names[0]]
    places = tuple(place_of(campaign, run, arguments[run.name]) for run in runs)
    recorded = max(place.farthest for place in places)
    end = ramp_end_of(campaign.source, body, recorded, ramp_length=ramp_length)
    steepest = steepest_tilt(first)
    phi, theta0_range = _extent(places, float(np.median(steepest)))
    borders = borders_of(first, phi, ramp_end=end.length)
    far_phi = phi[::_FAR_EVERY]
    farthest = farthest_stop(_first(first, _FAR_DRAWS), far_phi)
    stops = _steps(float(np.max(farthest[np.isfinite(farthest)], initial=0.0)))
    quantiles = {name: np.quantile(b, QUANTILES, axis=0) for name, b in vars(borders).items()}
    return BodyMap(
        **quantiles,
        body=body,
        phi=phi,
        theta0_range=theta0_range,
        stops=stops,
        contours=turning_contours(_central(first), phi, stops)[0],
        steepest=np.quantile(steepest, QUANTILES),
        far_phi=far_phi,
        farthest=np.quantile(farthest, QUANTILES, axis=0, method="higher"),
        runs=places,
        end=end,
        left_out=tuple(
            kind.notation.symbol
            for name, kind in EFFECTS.items()
            if any(name in run.arguments for run in runs)
        ),
    )


def _stated(campaign: Campaign, names: Sequence[str], *, seed: int) -> dict[str, FloatArray]:
    """Draws (n_draw, 1) from the priors of every parameter of the runs; one name is one unknown,
    whichever runs depend on it.
    """
    parameters: dict[str, Parameter] = {}
    for name in names:
        problem = campaign.problem([name])
        used = problem.runs[0].curve_parameters
        parameters.update({p.name: p for p in problem.parameters if p.name in used})
    rng = stream(seed, Stream.REGIMES)
    return {name: p.prior.draw(rng, _N_DRAW)[:, None] for name, p in parameters.items()}


def _first(arguments: Named, n_draw: int) -> dict[str, float | FloatArray]:
    return {
        name: value if isinstance(value, float) else value[:n_draw]
        for name, value in arguments.items()
    }


def _steps(farthest: float) -> FloatArray:
    """(n_stop,) round distances up to the farthest, m."""
    step = next((step for step in _STEPS if farthest / step <= _CONTOURS), _STEPS[-1])
    return np.asarray(np.arange(1, max(int(np.ceil(farthest / step)), 2)) * step)


def _central(arguments: Named) -> dict[str, float | FloatArray]:
    """The median of each argument, (1, 1)."""
    return {
        name: value if isinstance(value, float) else np.full((1, 1), np.median(value))
        for name, value in arguments.items()
    }


def _extent(places: Sequence[RunPlace], steepest: float) -> tuple[FloatArray, tuple[float, float]]:
    """Tilts (n_phi,) and the range of angles of release that a map shows, rad."""
    tilts = [place.phi for place in places]
    highest = max((value + _SDS * u for value, u in tilts if value >= 0.0), default=0.0)
    lowest = min((value - _SDS * u for value, u in tilts if value < 0.0), default=0.0)
    reach = _BEYOND * steepest
    high = max(highest, reach, _LEAST) if highest > 0.0 else 0.0
    low = min(lowest, -reach, -_LEAST) if lowest < 0.0 else 0.0
    if low == high:  # level
        low, high = -max(reach, _LEAST), max(reach, _LEAST)
    inside = all(0.0 <= place.theta0[0] <= np.pi for place in places)
    return np.linspace(max(low, -_STEEPEST), min(high, _STEEPEST), _N_PHI), (
        0.0,
        np.pi,
    ) if low == 0.0 and inside else (-0.5 * np.pi, 1.5 * np.pi)
