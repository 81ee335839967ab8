"""What the keys `deviation` and `correlated` say that a user's own curve may lack, and where they may stand.

Both are asked for by name: a curve in the units of anything has no scale of what it may be off by, and the same points are a smooth deviation
to one and correlated errors to another.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estim.campaign.campaign_file import CampaignFile
from estim.campaign.curve_tables import CurveRunTable, CurveTable, Place, axis_of
from estim.common import InputError, phrase
from estim.problem import MAX_LACKING, Lacks, Noise
from estim.reading import Run

_KEYS = ("deviation", "correlated")


def order_columns(table: CurveTable, run: CurveRunTable) -> list[str]:
    """The column along which the errors of a run are correlated, if it is named."""
    written = table.correlated if run.correlated is None else run.correlated
    return [written] if isinstance(written, str) else []


def read_lacks(
    source: CampaignFile, curve: CurveTable, runs: Sequence[CurveRunTable], index: int, table: Run, *, kept: NDArray[np.int64], stated: bool
) -> Lacks | None:
    """What the curve of run number `index` may lack, None for nothing; kept: (n_obs,) rows that are fit, in order of x.

    Raises InputError at the key's line.
    """
    run = runs[index]
    scale, correlated = (getattr(curve if getattr(run, key) is None else run, key) for key in _KEYS)
    if not (scale or correlated):
        return None
    if scale is not None and not (math.isfinite(scale) and scale >= 0.0):
        raise source.places.error("is in the unit of y: it must be > 0, or 0 for none", _path(run, index, "deviation"), value=scale)
    if kept.size > MAX_LACKING:
        key = _KEYS[0] if scale else _KEYS[1]
        rule = f"goes with at most {MAX_LACKING} points: say every = {math.ceil(kept.size / MAX_LACKING)} beside it, or state a window"
        raise source.places.error(rule, _path(run, index, key), value=int(kept.size))
    if not correlated:
        return Lacks(float(scale), None, "", stated)
    along = table.columns[correlated][kept] if isinstance(correlated, str) else kept.astype(float)
    if not float(np.ptp(along)) > 0.0:
        raise source.places.error("must name a column that is not all the same", _path(run, index, "correlated"), value=correlated)
    x = axis_of(curve.x)
    unit = phrase("readings") if correlated is True else x.unit if correlated == x.column else phrase("of column '{column}'", column=correlated)
    return Lacks(float(scale or 0.0), along, unit, stated)


def check_lacks(source: CampaignFile, run: CurveRunTable, index: int, lacks: Lacks, noise: Noise, *, joint: bool) -> None:
    """Raises InputError where the errors of a run do not go with what its curve may lack."""
    key = _KEYS[0] if lacks.deviation else _KEYS[1]
    rule = None
    if noise.robust:
        rule = "does not go with 'robust' errors: it takes those of the readings as normal"
    elif np.any(noise.x_gain() > 0.0):
        rule = "does not go with errors of x: leave out 'u_x'"
    elif noise.parameters:
        rule = "does not go with a 'u_y' that has an uncertainty itself: state a number, or leave 'u_y' out"
    elif joint and lacks.deviation:
        rule = "does not go with a joint fit, which needs a deviation that runs share: fit the runs one by one"
    if rule is not None:
        raise source.places.error(rule, _path(run, index, key))


def refuse_lacks(source: CampaignFile, curve: CurveTable, runs: Sequence[CurveRunTable], command: str) -> None:
    """Raises InputError where a curve may lack something, which `command` does not know."""
    for index, run in enumerate(runs):
        for key in _KEYS:
            if getattr(curve if getattr(run, key) is None else run, key):
                raise _error_of(source, run, index, key, command)


def _error_of(source: CampaignFile, run: CurveRunTable, index: int, key: str, command: str) -> InputError:
    return source.places.error(f"does not go with {command}, which takes the curve as complete: leave it out for that", _path(run, index, key))


def _path(run: CurveRunTable, index: int, key: str) -> Place:
    return ("runs", index, key) if getattr(run, key) is not None else ("curve", key)
