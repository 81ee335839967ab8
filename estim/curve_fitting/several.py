"""Several data sets fit together with one curve: `fit_curves`, the same engine as `fit_curve`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from estim.common import InputError
from estim.curve_fitting.result import CurveFit
from estim.curve_fitting.single import fit_stated
from estim.curves import (
    AxisNames,
    Component,
    CurveProblem,
    DataSet,
    Plain,
    in_time,
    join,
    of_data_set,
    pose_curve,
    provisional,
    refuse_quantities,
    started,
    unstarted,
    with_defaults,
    without_units,
)
from estim.fitting import N_START


def fit_curves(
    curve: str | Callable[..., Any],
    data: Mapping[str, DataSet],
    *,
    shared: Collection[str],
    start: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
    priors: Mapping[str, Any] | None = None,
    rng: np.random.Generator | None = None,
    errors: Sequence[Component] = (),
    units: Mapping[str, str] | None = None,
    axes: AxisNames | None = None,
    n_start: int | None = None,
    fixed: Mapping[str, float] | None = None,
    derived: Mapping[str, str] | None = None,
    tied: Mapping[str, str] | None = None,
) -> CurveFit:
    """The curve fit to several data sets at once.

    data : name -> `DataSet`, each with stated errors (u_y, cov_y or noise).
    shared : parameters that are one unknown for all; every other one is an unknown of each data
        set, "A[second]" in the result.
    start, bounds, priors, fixed : as for `fit_curve`; "A" speaks of all data sets, "A[second]" of
        one and has the last word.
    errors : errors common to the points of all data sets.  The other arguments are those of
        `fit_curve`.

    Raises InputError where an argument breaks a rule.
    """
    names = _checked(data)
    _check_shared({"start": start, "bounds": bounds, "priors": priors}, shared)
    rng = np.random.default_rng(1) if rng is None else rng
    start = with_defaults(curve, start, fixed, tied)
    curve = in_time(curve, start, fixed, bounds, priors, tied)
    parts: dict[str, CurveProblem] = {}
    for name, points in data.items():
        options = {"start": start, "bounds": bounds, "priors": priors, "fixed": fixed}
        settings = {
            field: of_data_set({} if given is None else given, name, names, field)
            for field, given in options.items()
        }
        refuse_quantities(cov_y=points.cov_y)
        seen = AxisNames() if axes is None else axes
        plain = without_units(
            Plain(
                points.x,
                points.y,
                points.u_x,
                points.u_y,
                settings["start"],
                settings["fixed"],
                settings["bounds"],
                units or {},
                seen,
            )
        )
        begin = {item: value for item, value in plain.start.items() if item not in plain.fixed}
        named = unstarted(curve, begin, plain.fixed, tied or {})
        limits = plain.bounds
        if named is not None:
            held, (begin, limits) = (
                begin,
                provisional(
                    named, begin, plain.bounds, settings["priors"], {*plain.fixed, *(tied or {})}
                ),
            )
        try:
            posed = pose_curve(
                curve if named is None else named.expression,
                plain.x,
                plain.y,
                start=begin,
                u_y=plain.u_y,
                cov_y=points.cov_y,
                u_x=plain.u_x,
                bounds=limits,
                priors=settings["priors"],
                errors=tuple(errors),
                units=plain.units,
                axes=plain.axes,
                fixed=plain.fixed,
                noise=points.noise,
                derived=derived or {},
                tied=tied or {},
                chosen={*begin} - {*plain.start},
            )
            posed.require_points()
            parts[name] = (
                posed
                if named is None
                else started(replace(posed, called=named.called), named, held=held)
            )
        except InputError as error:
            raise InputError(
                f"of data set '{name}' {error.rule}", field=error.field, value=error.value
            ) from None
    if len({(part.axes.x_unit, part.axes.y_unit) for part in parts.values()}) > 1:
        raise InputError(
            "must have x and y in the same units: quantities in all data sets, or in none",
            field="data",
            value=", ".join(names),
        )
    joint = join(parts, shared=shared, common=[item.parameter_name for item in errors])
    return fit_stated(
        joint, rng, getattr(curve, "n_start", N_START) if n_start is None else n_start
    )


def _check_shared(given: Mapping[str, Mapping[str, Any] | None], shared: Collection[str]) -> None:
    """What all data sets share is not one thing for one of them."""
    for field, entries in given.items():
        for written in entries if isinstance(entries, Mapping) else ():
            parameter, _, level = str(written).partition("[")
            if level and parameter in shared:
                raise InputError(
                    f"refers to one data set, but '{parameter}' is shared by all",
                    field=field,
                    value=written,
                )


def _checked(data: Mapping[str, DataSet]) -> list[str]:
    if not isinstance(data, Mapping) or not data:
        raise InputError(
            'must map names to data sets, like {"first": DataSet(x, y, u_y=0.1)}',
            field="data",
            value=data,
        )
    for name, points in data.items():
        if not isinstance(name, str) or not name.strip() or set(name) & set("[]"):
            raise InputError("must have names without [ and ]", field="data", value=name)
        if not isinstance(points, DataSet):
            raise InputError(
                "must be a DataSet, like DataSet(x, y, u_y=0.1)",
                field=f"data[{name}]",
                value=type(points).__name__,
            )
    return list(data)
