"""Several data sets fit together, with one curve or each with its own: `fit_curves`, the same
engine as `fit_curve`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from estim.common import InputError
from estim.curve_fitting.result import CurveFit
from estim.curve_fitting.single import fit_errors, fit_stated, without_fitted_effects
from estim.curves import (
    AxisNames,
    Component,
    CurveProblem,
    DataSet,
    ParameterSettings,
    arguments_of,
    in_time,
    join,
    numbered,
    of_data_set,
    pose_points,
    pose_sets,
    read_formula,
    require_points,
    seek,
    with_defaults,
    with_joint_priors,
)
from estim.given_numbers import random_generator
from estim.problem import JointNormal


def fit_curves(
    curve: str | Callable[..., Any] | None,
    data: Mapping[str, DataSet],
    *,
    shared: Collection[str] | None = None,
    start: Mapping[str, float] | None = None,
    bounds: Mapping[str, tuple[float | None, float | None]] | None = None,
    priors: Mapping[str, Any] | None = None,
    rng: np.random.Generator | int | None = None,
    errors: Sequence[Component] = (),
    units: Mapping[str, str] | None = None,
    axes: AxisNames | None = None,
    scan: bool | None = None,
    fixed: Mapping[str, float] | None = None,
    derived: Mapping[str, str] | None = None,
    tied: Mapping[str, str] | None = None,
    jitter: Any = False,
    robust: str | None = None,
) -> CurveFit:
    """The curve fit to several data sets at once, or curves that have parameters in common.

    units, axes, rng, scan, tied : as for `fit_curve`.
    curve : of the data sets that have none of their own (`DataSet(curve=...)`); None where all
        have.
    data : name -> `DataSet`, each with stated errors (u_y, cov_y or noise).
    shared : parameters that are one unknown for all; every other one is an unknown of each data
        set, "A[second]" in the result.  None: parameters of the same name are one unknown.
    start, bounds, priors, fixed : as for `fit_curve`; "A" applies to all data sets, "A[second]" to
        one and takes precedence.  An argument of a function that another curve fits is fit.
    errors : errors common to the points of all data sets.  The other arguments are those of
        `fit_curve`.
    jitter, robust : of every data set that states no other; each has its own, "jitter[second]".
    derived : as for `fit_curve`; also of parameters of several data sets, "A[first]/A[second]".

    Raises InputError where an argument breaks a rule.

    >>> import numpy as np
    >>> from estim import DataSet, fit_curves
    >>> t = np.linspace(0.0, 4.0, 9)
    >>> swing = np.exp(-0.5 * t) + 0.01 * np.cos(7.0 * t)
    >>> data = {
    ...     "angle": DataSet(t, swing, u_y=0.01, curve="A*exp(-k*t)"),
    ...     "energy": DataSet(t, 3.0 * swing**2, u_y=0.05, curve="E*exp(-2*k*t)"),
    ... }
    >>> fit = fit_curves(None, data)
    >>> sorted(fit.names)
    ['A', 'E', 'k']
    """
    _checked(data, curve)
    priors = with_joint_priors(priors)
    _check_shared({"start": start, "bounds": bounds, "priors": priors}, shared)
    rng = random_generator(rng)
    written: dict[str, Any] = {
        "start": start,
        "bounds": bounds,
        "priors": priors,
        "fixed": fixed,
        "tied": tied,
        "derived": derived,
        "units": units,
    }
    for field, entries in written.items():
        of_data_set({} if entries is None else entries, "", list(data), field)  # refuses the others
    for name, text in (tied or {}).items():
        if "[" in str(text):
            rule = (
                "names a parameter of another data set: give each DataSet a curve of its own, with "
                "names of its own, and tie these"
            )
            raise InputError(rule, field="tied", value=f"{name} = {text}")
    with_numbers = {
        name: numbered(curve if points.curve is None else points.curve, points.x)
        for name, points in data.items()
    }
    sets = {
        name: replace(
            points,
            x=with_numbers[name][1],
            curve=in_time(
                with_numbers[name][0],
                getattr(points.axes or axes, "x_name", ""),
                start,
                fixed,
                bounds,
                priors,
                tied,
            ),
            axes=points.axes or axes or AxisNames(),
            jitter=jitter if points.jitter is None else points.jitter,
            robust=robust if points.robust is None else points.robust,
        )
        for name, points in data.items()
    }
    arguments, foreign = _names(sets, written)
    settings = {name: _of_one(written, name, sets, foreign[name]) for name in sets}
    own = {
        name: set() if shared is None else {*arguments[name], *settings[name].start} - {*shared}
        for name in sets
    }
    starts: dict[str, float] | None = None
    if any(points.curve is not None for points in data.values()):
        starts = {}
        for entry in settings.values():
            starts = {**entry.start, **starts}

    def pose(name: str, settings: ParameterSettings, **other_sets: Any) -> CurveProblem:
        with _named(name):
            return pose_points(sets[name], settings, errors, level=f"[{name}]", **other_sets)

    first = sorted(sets, key=lambda name: -len(foreign[name]))
    parts = pose_sets({name: sets[name] for name in first}, settings, arguments, own, pose, starts)
    unknown = sorted({p.name for part in parts.values() for p in part.parameters})
    for parameter in shared or ():
        if parameter not in unknown:
            rule = f"names '{parameter}', which is not a fitted parameter ({', '.join(unknown)})"
            raise InputError(rule, field="shared")
    common = [item.parameter_name for item in errors]
    if shared is not None:  # with those that a function takes without naming them
        own = {
            name: {p.name for p in part.parameters} - {*shared, *common}
            for name, part in parts.items()
        }
    axis_units = {
        (part.axes.x_unit, part.axes.y_unit)
        for name, part in parts.items()
        if data[name].curve is None and data[name].axes is None
    }
    if (
        len(axis_units) > 1
        or len({part.axes is sets[name].axes for name, part in parts.items()}) > 1
    ):
        raise InputError(
            "must have x and y in the same units: quantities in all data sets, or in none",
            field="data",
            value=", ".join(data),
        )
    joint = join(
        parts,
        own=own,
        common=common,
        derived={
            name: text
            for name, text in (derived or {}).items()
            if all(name in names for names in foreign.values())
        },
        units=units or {},
        order=data,
    )
    require_points(joint.parameters, joint.y.size, stated=joint.stated)
    if scan is None:
        scan = all(getattr(points.curve, "scanned", True) for points in sets.values())
    fitted = fit_errors if joint.infers_errors else fit_stated
    return without_fitted_effects(fitted(joint, joint.with_sigma(1.0), rng, scan))


@contextmanager
def _named(name: str) -> Iterator[None]:
    """An InputError from within names the data set that it refers to."""
    try:
        yield
    except InputError as error:
        raise InputError(
            f"of data set '{name}' {error.rule}", field=error.field, value=error.value
        ) from None


def _names(
    sets: Mapping[str, DataSet], written: Mapping[str, Any]
) -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """Of each data set the names that its curve takes, or that a tie of its own needs, and those
    that only other data sets have, with what follows from them.  Raises InputError.
    """
    tied, derived = ({**(written[field] or {})} for field in ("tied", "derived"))
    arguments = {}
    for name, points in sets.items():
        with _named(name):
            defaults = written["start"] or (), written["fixed"] or (), tied
            arguments[name] = {*arguments_of(points.curve, *defaults)}
        for tie in reversed(tied):
            if tie in arguments[name]:
                arguments[name] |= {*read_formula(tied[tie], field=f"tied[{tie}]").names}
    foreign = {name: set().union(*arguments.values()) - own for name, own in arguments.items()}
    for quantity_name, text in derived.items():
        quantity = seek(quantity_name, text)
        for others in foreign.values():
            if quantity.of_levels or others.intersection(quantity.own):
                others.add(quantity_name)
    return arguments, foreign


def _of_one(
    written: Mapping[str, Any], name: str, sets: Mapping[str, DataSet], foreign: Collection[str]
) -> ParameterSettings:
    """The settings of one data set.  Raises InputError."""
    own: dict[str, Any] = {
        field: {
            key: value
            for key, value in ({} if entries is None else entries).items()
            if str(key).partition("[")[0] not in foreign
        }
        for field, entries in written.items()
    }
    own["start"] = with_defaults(sets[name].curve, own["start"], own["fixed"], own["tied"])
    own = {field: of_data_set(entries, name, list(sets), field) for field, entries in own.items()}
    start = {key: value for key, value in own["start"].items() if key not in own["fixed"]}
    return ParameterSettings(**own | {"start": start})


def _check_shared(
    settings: Mapping[str, Mapping[str, Any] | None], shared: Collection[str] | None
) -> None:
    """What all data sets share is not one thing for one of them."""
    for field, entries in settings.items():
        for written, stated in entries.items() if isinstance(entries, Mapping) else ():
            parameter, _, level = str(written).partition("[")
            if level and (shared is None or parameter in shared):
                raise InputError(
                    f"refers to one data set, but '{parameter}' is shared by all",
                    field=field,
                    value=written,
                )
            unshared = not level and shared is not None and parameter not in shared
            if unshared and isinstance(stated, JointNormal):
                rule = (
                    f"are joint for '{parameter}', an unknown of each data set: name that of one, "
                    f"'{parameter}[...]'"
                )
                raise InputError(rule, field=field, value=stated)


def _checked(data: Mapping[str, DataSet], curve: object) -> None:
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
        if curve is None and points.curve is None:
            rule = "is missing: give a curve for all data sets, or DataSet(x, y, curve=...)"
            raise InputError(rule, field=f"data[{name}].curve")
