"""Several data sets fit together with one curve: `fit_curves`, the same engine as `fit_curve`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from estim.common import InputError
from estim.curve_fit import fit_stated
from estim.curve_result import CurveFit
from estim.curves import AxisNames, Component, CurveProblem, DataSet, join, of_data_set, pose_curve, provisional, started, unstarted
from estim.fitting import N_START
from estim.problem import Prior


def fit_curves(
    curve: str | Callable[..., Any],
    data: Mapping[str, DataSet],
    *,
    shared: Collection[str],
    start: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
    priors: Mapping[str, Prior | str] | None = None,
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
    shared : parameters that are one unknown for all; every other one is an unknown of each data set, "A[second]" in the result.
    start, bounds, priors, fixed : as for `fit_curve`; "A" speaks of all data sets, "A[second]" of one and has the last word.
    errors : errors common to the points of all data sets.  The other arguments are those of `fit_curve`.

    Raises InputError where an argument breaks a rule.
    """
    names = _checked(data)
    rng = np.random.default_rng(1) if rng is None else rng
    parts: dict[str, CurveProblem] = {}
    for name, points in data.items():
        said = {"start": start, "bounds": bounds, "priors": priors, "fixed": fixed}
        own = {field: of_data_set({} if given is None else given, name, names, field) for field, given in said.items()}
        begin = {one: value for one, value in own["start"].items() if one not in own["fixed"]}
        named = unstarted(curve, begin, own["fixed"], tied or {})
        limits = own["bounds"]
        if named is not None:
            held, (begin, limits) = begin, provisional(named, begin, own["bounds"], own["priors"], {*own["fixed"], *(tied or {})})
        try:
            posed = pose_curve(
                curve if named is None else named.expression, points.x, points.y, start=begin, u_y=points.u_y, cov_y=points.cov_y, u_x=points.u_x,
                bounds=limits, priors=own["priors"], errors=tuple(errors), units=units or {}, axes=AxisNames() if axes is None else axes,
                fixed=own["fixed"], noise=points.noise, derived=derived or {}, tied=tied or {},
            )
            parts[name] = posed if named is None else started(replace(posed, called=named.called), named, held=held)
        except InputError as error:
            raise InputError(f"of data set '{name}' {error.rule}", field=error.field, value=error.value) from None
    joint = join(parts, shared=shared, common=[one.parameter_name for one in errors])
    return fit_stated(joint, rng, getattr(curve, "n_start", N_START) if n_start is None else n_start)


def _checked(data: Mapping[str, DataSet]) -> list[str]:
    if not isinstance(data, Mapping) or not data:
        raise InputError('must map names to data sets, like {"first": DataSet(x, y, u_y=0.1)}', field="data", value=data)
    for name, points in data.items():
        if not isinstance(name, str) or not name.strip() or set(name) & set("[]"):
            raise InputError("must have names without [ and ]", field="data", value=name)
        if not isinstance(points, DataSet):
            raise InputError("must be a DataSet, like DataSet(x, y, u_y=0.1)", field=f"data[{name}]", value=type(points).__name__)
    return list(data)
