"""From points and the settings of parameters to a problem, whose starts are found where nobody
stated any: for `fit_curve`, each data set of `fit_curves` and each run of a campaign.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import all_finite
from estim.common import InputError
from estim.curves.curve_problem import CurveProblem, pose_curve
from estim.curves.data_set import DataSet
from estim.curves.named import Points, provisional, started, unstarted, within
from estim.curves.parameter_settings import ParameterSettings
from estim.curves.quantities import refuse_quantities, without_units
from estim.curves.several_abscissas import OfPoints
from estim.curves.systematic_errors import Component


def pose_points(
    points: DataSet,
    settings: ParameterSettings,
    errors: Sequence[Component],
    *,
    deviation: float = 0.0,
    correlated: ArrayLike | bool = False,
    level: str = "",
    further_points: Sequence[Points] = (),
) -> CurveProblem:
    """The problem of one data set, with starts found from its points where none is given.

    further_points : x, y and u_y of other data sets of the same curve, that help to find starts.
    settings : of the parameters of its curve.
    level : behind the names of what is unknown of its errors.  Raises InputError.
    """
    curve: Any = points.curve
    for field, mapping in vars(settings).items():
        if not isinstance(mapping, Mapping):
            rule = "must be a mapping from names of parameters to what is said of each"
            raise InputError(rule, field=field, value=mapping)
    refuse_quantities(
        cov_y=points.cov_y,
        cov_x=points.cov_x,
        r_xy=points.r_xy,
        deviation=deviation,
        correlated=correlated,
    )
    points, settings = without_units(points, settings)
    start, bounds, fixed = settings.start, settings.bounds, settings.fixed
    if isinstance(curve, OfPoints):  # is searched for none
        known = {**fixed, **settings.tied}
        ends = bounds if isinstance(bounds, Mapping) else {}
        free = (name for name in curve.linear if name not in known)
        start = {**{name: within(ends.get(name)) for name in free}, **start}
    named = unstarted(curve, start, fixed, settings.tied)
    begin, limits = (
        (start, bounds)
        if named is None
        else provisional(named, start, bounds, settings.priors, {*fixed, *settings.tied})
    )
    if named is not None and (named.terms or named is curve):
        curve = named.formula
    posed = pose_curve(
        replace(points, curve=curve),
        replace(settings, start=begin, bounds=limits),
        errors,
        deviation=deviation,
        correlated=correlated,
        level=level,
    )
    if named is None:
        return posed
    if posed.counted is not None and posed.counted.noise.own_density:
        rule = "must give each parameter of a log density its starting value, like {'a': 1.0}"
        raise InputError(rule, field="start")
    return started(
        replace(posed, called=named.text), named, user_starts=start, further_points=further_points
    )


def pose_sets(
    sets: Mapping[str, DataSet],
    settings: Mapping[str, ParameterSettings],
    arguments: Mapping[str, Collection[str]],
    own: Mapping[str, Collection[str]],
    pose: Callable[..., CurveProblem],
    known_starts: Mapping[str, float] | None,
) -> dict[str, CurveProblem]:
    """Name -> problem of its data set.

    settings : data set -> those of its parameters.  arguments : the parameters of its curve; own :
        those of them that no other data set shares.
    pose : makes the problem of one data set from its name, settings and `further_points`.
    known_starts : parameter -> start that is known already.  A shared parameter then starts where
        the first data set put it, as it does where all points are pooled.  None: each data set
        finds its own starts.
    """
    parts: dict[str, CurveProblem] = {}
    points = _pooled(sets, settings, own)
    known_starts = {} if known_starts is None and points else known_starts
    for name in sets:
        of_set = settings[name]
        known = {*of_set.start, *of_set.fixed, *of_set.tied, *own[name]}
        missing = {*arguments[name]} - known
        inherited = {key: start for key, start in (known_starts or {}).items() if key in missing}
        further_points = [others for other, others in points.items() if other != name]
        parts[name] = pose(
            name,
            replace(of_set, start={**of_set.start, **inherited}),
            further_points=further_points,
        )
        if known_starts is not None:
            shared = (p for p in parts[name].parameters if p.name not in own[name])
            known_starts = {**{p.name: p.prior.centre for p in shared}, **known_starts}
    return parts


def _pooled(
    sets: Mapping[str, DataSet],
    settings: Mapping[str, ParameterSettings],
    own: Mapping[str, Collection[str]],
) -> dict[str, Points]:
    """The points of data sets that have one curve and all parameters in common; nothing where any
    has parameters of its `own` or other exact values than the others, counts, other errors than
    u_y, or units.
    """
    first, *others = settings.values()
    curve, *curves = (getattr(points.curve, "text", points.curve) for points in sets.values())
    if (
        any(own.values())
        or any(other != curve for other in curves)
        or any(other.fixed != first.fixed or other.tied != first.tied for other in others)
    ):
        return {}
    points_of: dict[str, Points] = {}
    known = {points.u_y is None for points in sets.values()}
    for name, points in sets.items():
        raw: list[Any] = [points.x, points.y, 1.0 if points.u_y is None else points.u_y]
        if len(known) > 1 or points.noise or any(hasattr(column, "units") for column in raw):
            return {}
        try:
            columns = np.asarray(np.broadcast_arrays(*raw), dtype=np.float64)
        except (TypeError, ValueError):  # other errors than u_y; an error is raised elsewhere
            return {}
        if columns.ndim != 2 or np.iscomplexobj(raw[1]) or not all_finite(columns):
            return {}
        points_of[name] = columns[0], columns[1], columns[2]
    return points_of
