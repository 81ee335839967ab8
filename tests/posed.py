"""The problem of a curve and its points, without a search for starts or a fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from estim import DataSet
from estim.curves import CurveProblem, ParameterSettings, pose_points


def curve_problem(
    curve: str,
    x: Any,
    y: Any,
    *,
    start: Mapping[str, float],
    bounds: Mapping[str, Any] | None = None,
    priors: Mapping[str, Any] | None = None,
    **errors: Any,
) -> CurveProblem:
    """errors : of a `DataSet`."""
    settings = ParameterSettings(start, bounds or {}, priors or {})
    return pose_points(DataSet(x, y, curve=curve, **errors), settings, ())
