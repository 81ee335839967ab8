"""From a user's curve, points and what is known of them to a problem of inference; every argument
is checked here.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, IntArray, root_mean_square
from estim.common import InputError, Notation, phrase
from estim.curves.columns import column
from estim.curves.count_data import (
    MAX_OBS,
    CountedPoints,
    EventTimes,
    points_of_noise,
    refuse_common_errors,
)
from estim.curves.data_set import DataSet, stated_errors, what_is_given
from estim.curves.derived import SoughtQuantity, seek_of_fit
from estim.curves.discrepancy import discrepancy_of
from estim.curves.formula import Formula, read_formula
from estim.curves.full_turns import without_full_turns
from estim.curves.function import PythonCurve, wrap_function
from estim.curves.parameter_settings import (
    ParameterSettings,
    exact_values,
    fitted_parameters,
    starting_values,
    stated_prior,
)
from estim.curves.several_abscissas import OfPoints
from estim.curves.systematic_errors import Component, DistortedCurve
from estim.curves.tied import TiedCurve, followed, only_for_ties, read_tied
from estim.curves.units import AxisNames, check_units, refuse_degrees, units_of
from estim.given_numbers import check_lengths
from estim.problem import (
    Curve,
    Discrepancy,
    Noise,
    Observations,
    Parameter,
    Prior,
    Problem,
    Scale,
    Tails,
    Uniform,
    Unstated,
    plain_words,
    shape_of,
)

SIGMA, SIGMA_NOTATION = "sigma_y", Notation("σ_y")
JITTER = "jitter"
# standard deviation of ln sigma where nothing is known of it: a factor 20 either way
SIGMA_SPREAD = 3.0
MAX_DENSE = 3000  # of a covariance matrix that is diagonalised, errors of x


@dataclass(frozen=True, eq=False)
class CurveProblem:
    """A curve, its parameters and the points in order of x.

    x, y : (n_obs,).
    noise : of the readings or counts, of errors of y as u_y states them, or 1 where it does not.
    stated : whether the size of the errors is known.
    lacks : what the curve may lack, None for nothing.
    counted : the points where y are counts, else None.
    fixed : argument of the curve -> its exact value.
    text : the formula, or how the function is called.  called : a name it is known by, if any.
    sought : what is to be computed from the parameters.
    further : what is unknown of the scatter beside the stated errors, and of their shape.
    order : (n_obs,) the position of each point among those given; None of single events.
    places : name -> (n_obs,), the abscissas of points that have several: x are their numbers.
    notes : on how the errors were stated, and limits that are not used, in words.
    """

    text: str
    curve: Curve
    parameters: tuple[Parameter, ...]
    x: FloatArray
    y: FloatArray
    noise: Noise
    stated: bool
    axes: AxisNames
    fixed: Mapping[str, float]
    order: IntArray | None
    further: tuple[Parameter, ...]
    lacks: Discrepancy | None = None
    counted: CountedPoints | None = None
    sought: tuple[SoughtQuantity, ...] = ()
    called: str = ""
    places: Mapping[str, FloatArray] | None = None
    notes: tuple[str, ...] = ()

    @property
    def infers_errors(self) -> bool:
        """Whether anything is unknown of stated errors, or they leave room for outliers."""
        return bool(self.further) or self.noise.robust

    def with_sigma(self, sigma: float) -> Problem:
        """The problem whose errors are `sigma` times u_y (or times 1)."""
        return self._problem(Scale(sigma), ())

    def with_unknown_sigma(self, typical: float) -> Problem:
        """The problem in which the common standard deviation of y is one more parameter, known to
        be about `typical` to a factor 20.
        """
        unit = self.axes.y_unit
        unknown = Parameter(
            SIGMA,
            unit,
            Unstated(typical, SIGMA_SPREAD),
            phrase("standard deviation of one y"),
            SIGMA_NOTATION,
        )
        return self._problem(Scale(parameter=SIGMA), (unknown,))

    def _problem(self, sigma: Scale, further: tuple[Parameter, ...]) -> Problem:
        return Problem((*self.parameters, *further, *self.further), (self.observed(sigma),))

    def observed(self, sigma: Scale) -> Observations:
        """The points whose errors are `sigma` times u_y (or times 1)."""
        arguments: dict[str, str | float] = {p.name: p.name for p in self.parameters}
        arguments.update(self.fixed)
        return Observations(
            name="data",
            x=self.x,
            y=self.y,
            t=None,
            curve=self.curve,
            arguments=arguments,
            noise=self.noise.of_size(sigma),
            x_name=self.axes.x_name if self.places is None else phrase("number of the point"),
            x_unit=self.axes.x_unit if self.places is None else "1",
            y_name=self.axes.y_name,
            y_unit=self.axes.y_unit,
            excluded=(),
            excluded_points=np.zeros((0, 2)),
            motion=None,
            words=plain_words() if self.counted is None else self.counted.words,
            sought=self.sought,
            order=self.order,
            places=self.places,
            notes=self.notes,
        )


def require_points(parameters: Sequence[Parameter], n_obs: int, *, stated: bool = True) -> None:
    """Raises InputError where there are fewer points than the parameters that are fit need."""
    if not parameters:
        raise InputError(
            "must give a parameter that is fit its starting value, like {'a': 1.0}", field="start"
        )
    pulls = sum(p.prior.informative for p in parameters)
    if n_obs + pulls < len(parameters) + (0 if stated else 1):
        rule = f"must have at least as many points as parameters ({len(parameters)})"
        if not stated:
            rule = (
                f"must have more points than parameters ({len(parameters)}), one at "
                "least, where u_y is not given"
            )
        raise InputError(rule, field="x", value=n_obs)


def pose_curve(
    points: DataSet,
    settings: ParameterSettings,
    errors: Sequence[Component],
    *,
    deviation: float = 0.0,
    correlated: ArrayLike | bool = False,
    level: str = "",
) -> CurveProblem:
    """The problem that points, their curve and the settings of its parameters pose, as for
    `pose_points`, where each has a start.

    Raises InputError where an argument breaks a rule, naming it: "u_y", or "units[tau]" of a
    parameter, with the index of a value.
    """
    curve: Any = points.curve
    counting, axes = points.noise, points.axes or AxisNames()
    tied, units = settings.tied, settings.units
    _check_words(units, errors, axes)
    specified = what_is_given(points) | {
        "deviation": deviation != 0.0,
        "correlated": correlated is not False,
    }
    abscissas = curve.columns if isinstance(curve, OfPoints) else None
    if abscissas is not None:
        along_x = {
            "noise": isinstance(counting, EventTimes)
            or getattr(counting, "bins", None) is not None,
            "errors": any(component.kind.endswith("_x") for component in errors),
        }
        _refuse(
            specified | along_x,
            ("u_x", "cov_x", "deviation", *along_x),
            "cannot be combined with several abscissas",
        )
    counted = points_of_noise(
        counting,
        points.x,
        points.y,
        what=axes.y_name,
        reading_errors=[name for name, is_given in specified.items() if is_given],
    )
    events = counted is not None and counted.single
    given_order = None if events else np.argsort(column(points.x, "x"), kind="stable")
    readings = points if counted is None else counted
    x, y = column(readings.x, "x"), column(readings.y, "y")
    n_obs = x.size
    check_lengths(x, y)
    grouped = tuple(component for component in errors if component.groups is not None)
    errors = tuple(component for component in errors if component.groups is None)
    dense = specified["cov_y"] or specified["u_x"] or specified["cov_x"] or bool(grouped)
    most = MAX_DENSE if dense else MAX_OBS
    if not 1 <= n_obs <= most:
        cure = (
            ""
            if n_obs <= most or most == MAX_OBS
            else f"; with independent errors of y alone, {MAX_OBS}: take every so many of the "
            "points"
        )
        raise InputError(f"must have between 1 and {most} values{cure}", field="x", value=n_obs)
    order = np.argsort(x, kind="stable")
    point_errors = stated_errors(points, x, y, grouped, specified, counts=counted is not None)
    names, values = starting_values(settings.start)
    exact = exact_values(settings.fixed, names)
    following, all_of = {**tied, **settings.derived}, (*names, *exact)
    ties = read_tied(tied, all_of)
    only_in_ties = only_for_ties(curve, ties) if ties else set()
    starts, held = (
        {name: v for name, v in known.items() if name not in only_in_ties}
        for known in (values, exact)
    )
    starts |= {name: float(followed(ties, {**values, **exact})[name]) for name in ties}
    summed = counted is not None and counted.noise.own_density
    read = _curve(curve, x, starts, held, summed=summed)
    of_curve = units_of(
        read, axes, (*names, *ties), density=(density := counted is not None and counted.density)
    )
    refuse_degrees(read, axes)
    check_units(read, axes, units, density=density)
    parameter_units = {
        name: unit for name, unit in {**of_curve, **units}.items() if name not in following
    }
    parameters = fitted_parameters(names, values, exact, parameter_units, settings)
    shared = _shared(errors, (*all_of, *ties), axes)
    stated = specified["u_y"] or point_errors.cov is not None or counted is not None
    everything = (*parameters, *shared)
    if not stated and SIGMA in (p.name for p in everything):
        raise InputError(
            "is the name of the standard deviation of y, which is unknown here: choose another",
            field=f"start[{SIGMA}]",
        )
    scatter, tails, further = _errors_inferred(
        points.jitter, points.robust, y, axes.y_unit, level=level, stated=specified["u_y"]
    )
    if further or tails.robust:
        _refuse(
            specified | {"errors": bool(grouped)},
            ("cov_x", "cov_y", "errors", "deviation", "correlated"),
            "cannot be combined with 'jitter' or 'robust'",
        )
    for parameter in further:
        if parameter.name in (*all_of, *ties, *(p.name for p in shared)):
            rule = f"is the name of what is unknown of the errors of {axes.y_name}: choose another"
            raise InputError(rule, field=f"start[{parameter.name}]")
    # two points for each parameter of the errors, or any few on the curve pass for the good ones
    least = len(everything) + 2 * (1 + len(further))
    if further and not stated and order.size < least:
        rule = f"must have at least {least} points for robust errors whose size is not stated"
        raise InputError(f"{rule}: state u_y", field="x", value=order.size)
    full_curve: Curve = TiedCurve(read, ties) if ties else read
    free, unlimited = without_full_turns(full_curve, x, {**values, **exact}, parameters)
    everything = (*free, *shared)
    full_curve = DistortedCurve(full_curve, errors) if errors else full_curve
    if counted is not None:
        refuse_common_errors(counted, errors)
        full_curve = counted.expected(full_curve)
    text = (
        read.text
        if isinstance(read, Formula)
        else curve.text
        if isinstance(curve, OfPoints)
        else f"{getattr(curve, '__name__', type(curve).__name__)}(x, {', '.join((*starts, *held))})"
    )
    return CurveProblem(
        text=", ".join([text, *(f"{name} = {formula.text}" for name, formula in ties.items())]),
        curve=full_curve,
        parameters=everything,
        x=x[order],
        y=y[order],
        noise=point_errors.noise(order, scatter, tails, axes.y_name)
        if counted is None
        else counted.noise,
        stated=stated,
        axes=axes,
        fixed=exact,
        order=given_order,
        further=further,
        lacks=discrepancy_of(
            deviation,
            correlated,
            order,
            stated=stated,
            exact_x=not (specified["u_x"] or specified["cov_x"]),
        ),
        counted=counted,
        sought=seek_of_fit(
            following, units, [*all_of, *(p.name for p in shared)], {**of_curve, **parameter_units}
        ),
        places=abscissas,
        notes=(*filter(None, [point_errors.words]), *unlimited),
    )


def _refuse(specified: Mapping[str, bool], fields: Iterable[str], rule: str) -> None:
    """Raises InputError for the first of the fields that is specified."""
    for field in fields:
        if specified[field]:
            raise InputError(rule, field=field)


def _check_words(units: Mapping[str, str], errors: Sequence[Component], axes: AxisNames) -> None:
    for name, unit in units.items():
        if not isinstance(unit, str):
            raise InputError(f"must be text for '{name}', like \"m/s\"", field="units", value=unit)
    for component in errors:
        if not isinstance(component, Component):
            raise InputError(
                'must be a list of components, like [Component("zero_y", 0.5)]',
                field="errors",
                value=component,
            )
    if not isinstance(axes, AxisNames):
        raise InputError(
            'must be names and units, like AxisNames("time", "s", "angle", "rad")',
            field="axes",
            value=axes,
        )


def _curve(
    curve: str | Formula | Callable[..., Any],
    x: FloatArray,
    start: Mapping[str, float],
    fixed: Mapping[str, float],
    *,
    summed: bool,
) -> Formula | PythonCurve:
    names = (*start, *fixed)
    if callable(curve):
        if isinstance(curve, OfPoints):
            _check_formula(curve, start, fixed)
        _check_signature(curve, names, fixed)
        return wrap_function(curve, names, x, {**start, **fixed}, summed=summed)
    formula = read_formula(curve, field="curve")
    _check_formula(formula, start, fixed)
    return formula


def _check_formula(
    formula: Formula | OfPoints, start: Mapping[str, float], fixed: Mapping[str, float]
) -> None:
    """The parameters are those of the formula; of a function of several abscissas, which names
    none, any.
    """
    names = (*start, *fixed)
    for name in formula.names:
        if name not in names:
            if isinstance(formula, Formula) and not formula.uses_x:
                rule = "must hold x, its variable, or the name of its axis (axes)"
                raise InputError(rule, field="curve", value=formula.text)
            if isinstance(formula, OfPoints):
                rule = (
                    f"needs a starting value (start={{'{name}': ...}} or --start {name}=...): with "
                    "several abscissas there is no search"
                )
                raise InputError(rule, field=f"start[{name}]")
            raise InputError(
                f"has no starting value for '{name}' of the formula",
                field="start",
                value=", ".join(names),
            )
    for name in names if formula.names else ():
        if name not in formula.names:
            raise InputError(
                f"names '{name}', which is not in the formula",
                field="start" if name in start else "fixed",
                value=formula.text,
            )


def _check_signature(
    function: Callable[..., Any], names: tuple[str, ...], fixed: Collection[str]
) -> None:
    try:
        signature = inspect.signature(function)
    except (TypeError, ValueError):
        return  # a builtin without a signature; calling it will tell
    _, *parameters = signature.parameters or [""]
    required = [
        name
        for name in parameters
        for p in [signature.parameters[name]]
        if p.default is p.empty and p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY)
    ]
    without = {*required} - {*names}
    abscissas = function.columns if isinstance(function, OfPoints) else ()
    if separate := [name for name in abscissas if name in without]:
        rule = f"must take all abscissas as its first argument, and have x['{separate[0]}'] in it"
        raise InputError(rule, field="curve", value=f"{signature}")
    if without and {*names} <= {*parameters}:
        free = [name for name in required if name not in fixed]
        words = "{" + ", ".join(f"'{name}': 1.0" for name in free[:5]) + "}"
        rule = f"must give each parameter of a function a starting value, as {words}"
        raise InputError(rule, field="start", value=", ".join(names) or None)
    try:
        signature.bind(0.0, **dict.fromkeys(names, 0.0))
    except TypeError as error:
        raise InputError(
            f"cannot be called as curve(x, {', '.join(names)}): {error}", field="start"
        ) from None


def _errors_inferred(
    jitter: object, robust: str | None, y: FloatArray, unit: str, *, level: str, stated: bool
) -> tuple[Scale, Tails, tuple[Parameter, ...]]:
    """The scatter beside the stated errors, the shape of all errors, and their unknowns.

    A jitter of which nothing is known is anywhere between 0 and the range of y.
    """
    tails, unknown = shape_of(robust, level)
    if jitter is False or jitter is None:
        return Scale(), tails, unknown
    if not stated:
        raise InputError(
            "needs u_y: beside errors of unknown size it cannot be told from them", field="jitter"
        )
    if jitter is True:
        largest = float(np.ptp(y))
        if not largest > 0.0:
            raise InputError("needs values of y that differ, or a prior of its own", field="jitter")
        prior: Prior = Uniform(0.0, largest)
    else:
        prior = stated_prior(jitter, "jitter", low=0.0)
        if prior.low < 0.0:
            raise InputError("must have a prior that does not reach below 0", field="jitter")
    meaning = phrase("standard deviation of the errors beside the stated ones")
    size = Parameter(f"{JITTER}{level}", unit, prior, meaning, Notation(phrase("jitter")))
    return Scale(parameter=size.name), tails, (size, *unknown)


def _shared(
    errors: tuple[Component, ...], names: tuple[str, ...], axes: AxisNames
) -> tuple[Parameter, ...]:
    shared = tuple(
        component.parameter(x_unit=axes.x_unit, y_unit=axes.y_unit) for component in errors
    )
    used_names = [*names]
    for parameter in shared:
        if parameter.name in used_names:
            raise InputError(
                "has a name that is taken: give the component another name",
                field=f"errors[{parameter.name}]",
            )
        used_names.append(parameter.name)
    return shared


def roughness(y: FloatArray, *, robust: bool) -> float:
    """A rough standard deviation of one reading, from second differences of y (n_obs,) in order of
    x.  robust : from the smaller ones, of which a bad reading leaves the quarter alone.
    """
    second = np.abs(np.diff(y, 2)) / math.sqrt(6.0)
    # a quarter of normal deviations are smaller than 0.3186 of their standard deviation
    rough = float(np.quantile(second, 0.25)) / 0.3186 if robust and second.size else 0.0
    if not rough and second.size:
        rough = root_mean_square(second)
    return rough or float(np.std(y)) or 1.0
