"""Which usual errors of clock and length scale a run has that its campaign does not speak of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from estim.campaign.levels import Levels
from estim.deviation import USUAL, WithUsualErrors
from estim.problem import Observations

USUAL_KEYS = {"length": "scale_x", "clock": "scale_t"}  # said at any level, also as 0, it is what was said


def with_usual_errors(run: Observations, levels: Levels, *, angular: bool) -> Observations:
    """`run` with room for them in its noise; as it is where it has none: all are said, its noise is not normal or its size is inferred.

    Angles of an encoder have no scale.
    """
    if run.noise.parameters or run.noise.robust or np.any(run.noise.x_gain() > 0.0):
        return run
    unsaid = {name: sd for name, sd in USUAL.items() if not (angular and name == "length") and not _said(levels, name)}
    sds: Mapping[str, float] = MappingProxyType(unsaid)
    return replace(run, noise=WithUsualErrors(run.noise, run.body, sds)) if sds else run


def _said(levels: Levels, name: str) -> bool:
    return any(getattr(level.table, USUAL_KEYS[name]) is not None for level in levels)
