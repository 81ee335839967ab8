"""A user's own curve: what one further reading would do, wherever it is taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, phrase
from estim.planning.candidates import MORE, Change, FurtherReadings, further, which_place
from estim.planning.expected_uncertainty import sds_by
from estim.planning.planned_readings import CurveBasis
from estim.planning.rolling import Outlook
from estim.problem import Parameter

_BEYOND = 0.25  # of the range of x on either side: how far readings may lie outside
_N_PLACE = 61


@dataclass(frozen=True, eq=False)
class ReadingsAtPlaces:
    """One further reading of a run at each of some places.

    x : (n,).
    ratio : (n_target, n) of the standard deviations to the present ones.  inside : (2,) the range
        of the readings at hand.
    """

    run: str
    x: FloatArray
    ratio: FloatArray
    inside: tuple[float, float]


def weigh_places(
    basis: CurveBasis, present: Outlook, targets: Sequence[Parameter]
) -> tuple[ReadingsAtPlaces, ...]:
    """For every run, one further reading at places over its range and beside it; those where none
    can be taken are left out.
    """
    columns = [present.problem.names.index(p.name) for p in targets]
    now, weighed = sds_by(present.information, columns), []
    for run in present.problem.runs:
        x, ratios = [], []
        for place in _places(run.x):
            try:
                changed = basis.outlook(
                    Change("", MORE, readings=(FurtherReadings(run.name, float(place), 1),))
                )
            except InputError:
                continue
            x.append(place)
            ratios.append(sds_by(changed.information, columns) / now)
        if x:
            weighed.append(
                ReadingsAtPlaces(
                    run.name,
                    np.array(x),
                    np.array(ratios).T,
                    (float(np.min(run.x)), float(np.max(run.x))),
                )
            )
    return tuple(weighed)


def _places(x: FloatArray) -> FloatArray:
    """(n,) abscissas at which a further reading is weighed: over the range of x (n_obs,), and a
    quarter of it on either side.
    """
    low, high = float(np.min(x)), float(np.max(x))
    margin = _BEYOND * (high - low)
    start = max(low - margin, 0.0) if low >= 0.0 else low - margin
    return np.linspace(start, high + margin, _N_PLACE)


def more_readings(present: Outlook, weighed: Sequence[ReadingsAtPlaces]) -> tuple[Change, ...]:
    """As many readings as a tenth of those at hand at the place that is best for each target,
    inside the range and beside it.
    """
    changes: dict[tuple[str, float], Change] = {}
    for along in weighed:
        n = max(
            1, round(0.1 * next(run.n_obs for run in present.problem.runs if run.name == along.run))
        )
        inside = (along.x >= along.inside[0]) & (along.x <= along.inside[1])
        for ratio in along.ratio:
            for allowed in (inside, np.ones(inside.size, dtype=bool)):
                x = float(f"{along.x[allowed][np.argmin(ratio[allowed])]:.3g}")
                where = (
                    ""
                    if along.inside[0] <= x <= along.inside[1]
                    else phrase(", outside the present range")
                )
                which = which_place(present.problem, along.run, x) + where
                readings = (FurtherReadings(along.run, x, n),)
                changes[along.run, x] = further(which, readings=readings)
    return tuple(changes.values())
