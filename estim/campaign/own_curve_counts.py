"""Runs of a user's own curve whose y were counted: the table `noise` of `[curve]`, in place of `u_y`.

    noise = {model = "poisson", bins = ["low_us", "high_us"]}      # or a width; without it counts belong to single x
    noise = {model = "binomial", trials = "shots"}                 # or a number
    noise = {model = "event-times"}                                # x are times of single events within `window`; no y
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.campaign.campaign_file import CampaignFile
from estim.campaign.curve_tables import CountTable, CurveRunTable, CurveTable, Place, RangeTable, axis_of
from estim.common import InputError
from estim.curves import Binomial, CountedPoints, Counting, EventTimes, Poisson, counted_points, not_a_count
from estim.reading import Run

_READINGS = ("u_y", "u_x", "robust", "deviation", "correlated", "every")
_KEYS = {"poisson": "bins", "binomial": "trials", "event-times": "cells"}
_PATH: Place = ("curve", "noise")


def count_columns(table: CurveTable) -> list[str]:
    """Columns of the runs' files that the noise names."""
    noise = table.noise
    if noise is None:
        return []
    named = noise.bins if isinstance(noise.bins, list) else []
    return [*named, *([noise.trials] if isinstance(noise.trials, str) else [])]


def is_density(table: CurveTable) -> bool | None:
    """Whether the curve is y per unit of x; None where it is known up to a factor."""
    return None if table.noise is not None and table.noise.model == "event-times" else table.noise is not None and table.noise.bins is not None


def check_counts(source: CampaignFile, table: CurveTable, runs: Sequence[CurveRunTable]) -> None:
    """Raises InputError at the key where the table `noise` and the keys beside it do not go together, or y is missing."""
    noise, places = table.noise, source.places
    events = noise is not None and noise.model == "event-times"
    if table.y is None and not events:
        raise places.error("is missing", ("curve", "y"))
    if noise is None:
        return
    if events and table.y is not None:
        raise places.error("must be left out where x are times of single events", ("curve", "y"))
    for level, path in ((table, ("curve",)), *((run, ("runs", i)) for i, run in enumerate(runs))):
        for key in _READINGS:
            if getattr(level, key) is not None:
                raise places.error("does not go with 'noise', which says how counts scatter: leave it out", (*path, key))
    for model, key in _KEYS.items():
        if model != noise.model and getattr(noise, key) is not None:
            raise places.error(f"belongs to model = \"{model}\", not to \"{noise.model}\"", (*_PATH, key))
    if noise.model == "binomial" and noise.trials is None:
        raise places.error("is missing: the number of trials of each row, a column or a number", (*_PATH, "trials"))
    if isinstance(noise.bins, list) and len(noise.bins) != 2:
        raise places.error("must be a width, or the names of two columns with low and high edges", (*_PATH, "bins"), value=noise.bins)
    if noise.cells is not None and not 2 <= noise.cells <= 1000:
        raise places.error("must be between 2 and 1000", (*_PATH, "cells"), value=noise.cells)
    for name, error in table.errors.items():
        kind = name if isinstance(error, float | int) else error.kind
        if kind == "zero_y" and (events or noise.bins is not None):
            raise places.error("is no zero of counts in bins: a background is part of the formula", ("curve", "errors", name))
        if kind == "scale_y" and events:
            raise places.error("means nothing where only the density of the events counts", ("curve", "errors", name))


def window_of_events(source: CampaignFile, window: RangeTable | None, path: Place) -> tuple[float, float]:
    """Both ends of the window in which events were recorded.  Raises InputError."""
    if window is None or window.min is None or window.max is None:
        rule = "must state the 'min' and 'max' between which events were recorded: their density is normalised over it"
        raise source.places.error(rule, path, field="window")
    return window.min, window.max


def read_counts(
    source: CampaignFile, curve: CurveTable, table: Run, kept: NDArray[np.int64], *, what: str, window: tuple[float, float]
) -> CountedPoints:
    """The points of a run; kept: rows that are fit.  Raises InputError with file and row."""
    assert curve.noise is not None, "asked where a campaign has counts"
    x_column, noise = axis_of(curve.x).column, curve.noise
    x = table.columns[x_column][kept]
    try:
        if noise.model == "event-times":
            return counted_points(EventTimes(*window, noise.cells), x, None, what=what)
        y_column = axis_of(curve.y or "").column
        y = _whole(table, y_column, kept, "the number of " + ("events, not a rate or an average" if noise.model == "poisson" else "successes"))
        return counted_points(_counting(noise, table, kept, y, y_column), x, y, what=what)
    except InputError as error:
        if error.file is not None:
            raise
        if error.field == "y":
            raise InputError(error.rule, field=axis_of(curve.y or "").column, file=table.file) from None
        raise source.places.error(error.rule, (*_PATH, str(error.field)) if error.field in ("bins", "trials") else _PATH, value=error.value) from None


def _counting(noise: CountTable, table: Run, kept: NDArray[np.int64], y: FloatArray, y_column: str) -> Counting:
    if noise.model == "poisson":
        if not isinstance(noise.bins, list):
            if noise.bins is not None and not (math.isfinite(noise.bins) and noise.bins > 0.0):
                raise InputError("must be a width > 0, or the names of two columns", field="bins", value=noise.bins)
            return Poisson(noise.bins)
        low, high = (table.columns[name][kept] for name in noise.bins)
        if np.any(high <= low):
            raise table.error(f"must be above '{noise.bins[0]}'", noise.bins[1], int(kept[np.argmax(high <= low)]))
        return Poisson(np.column_stack([low, high]))
    if not isinstance(noise.trials, str):
        trials = np.full(kept.size, float(noise.trials or 0.0))
        if not_a_count(trials) is not None or trials[0] < 1.0:
            raise InputError("must be a whole number from 1, or the name of a column", field="trials", value=noise.trials)
    else:
        trials = _whole(table, noise.trials, kept, "the number of trials")
        if np.any(trials < 1.0):
            raise table.error("must be at least 1", noise.trials, int(kept[np.argmax(trials < 1.0)]))
    if np.any(y > trials):
        raise table.error("must not exceed the trials", y_column, int(kept[np.argmax(y > trials)]))
    return Binomial(trials)


def _whole(table: Run, column: str, kept: NDArray[np.int64], meaning: str) -> FloatArray:
    values = table.columns[column][kept]
    bad = not_a_count(values)
    if bad is not None:
        raise table.error(f"must be a whole number from 0 ({meaning})", column, int(kept[bad]))
    return np.asarray(np.rint(values))
