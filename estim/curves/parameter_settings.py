"""What is stated of the parameters of a curve: starting values, limits, priors, exact values; each
is checked here.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import compress
from typing import Any

import numpy as np

from estim.arrays import sds_of
from estim.common import InputError, Quantity, phrase, read_quantity
from estim.curves.formula import check_names
from estim.curves.models import Limits
from estim.given_numbers import real_number, real_numbers
from estim.problem import (
    Flat,
    JointNormal,
    Parameter,
    Prior,
    as_prior,
    check_covariance,
    of_other_package,
)


@dataclass(frozen=True, eq=False)
class ParameterSettings:
    """What is stated of the parameters of a curve, name by name, as `fit_curve` takes it.

    tied : formulas of other parameters.  derived : what is to be computed from them, as formulas.
    """

    start: Mapping[str, Any] = field(default_factory=dict)
    bounds: Mapping[str, Any] = field(default_factory=dict)
    priors: Mapping[str, Any] = field(default_factory=dict)
    fixed: Mapping[str, Any] = field(default_factory=dict)
    tied: Mapping[str, str] = field(default_factory=dict)
    derived: Mapping[str, str] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)


def starting_values(start: Mapping[str, float]) -> tuple[tuple[str, ...], dict[str, float]]:
    """Names, and finite values."""
    check_names(start, field="start")
    values = {}
    for name, value in start.items():
        values[name] = real_number(value, "start", f"must be a number for '{name}'")
        if not math.isfinite(values[name]):
            raise InputError(f"must be finite for '{name}'", field="start", value=value)
    return tuple(values), values


def exact_values(fixed: Mapping[str, float], names: tuple[str, ...]) -> dict[str, float]:
    """Exact values of parameters that are not fit."""
    check_names(fixed, field="fixed")
    for name in fixed:
        if name in names:
            raise InputError(
                f"names '{name}', which has a starting value too: give it one of the two",
                field="fixed",
            )
    values = {}
    for name, value in fixed.items():
        rule = f"must be a finite number for '{name}' (a value with an uncertainty is a prior)"
        values[name] = real_number(value, "fixed", rule)
        if not math.isfinite(values[name]):
            raise InputError(rule, field="fixed", value=value)
    return values


def fitted_parameters(
    names: tuple[str, ...],
    start: Mapping[str, float],
    fixed: Mapping[str, float],
    units: Mapping[str, str],
    settings: ParameterSettings,
) -> tuple[Parameter, ...]:
    """Those that are fit, with their limits or priors.  start, fixed, units : as they were read."""
    bounds, priors = settings.bounds, settings.priors
    for table, entries in (("bounds", bounds), ("priors", priors), ("units", units)):
        for name in entries:
            if name in fixed and table != "units":
                raise InputError(f"names '{name}', which is fixed", field=table)
            if name not in names and name not in fixed:
                raise InputError(
                    f"names '{name}', which is not a parameter ({', '.join(names)})", field=table
                )
    for name in priors:
        if name in bounds:
            raise InputError(
                f"cannot be combined with a prior for '{name}': truncate the prior instead",
                field="bounds",
            )
    return tuple(
        Parameter(
            name,
            units.get(name, "1"),
            _prior(name, start[name], bounds.get(name), priors.get(name)),
            phrase("parameter of the curve"),
        )
        for name in names
    )


def with_joint_priors(priors: Any) -> Any:
    """Priors name by name: those of several names, (means, cov) or a frozen multivariate_normal of
    scipy, and ufloats that vary together as a `JointNormal` each; anything else as it is.

    Raises InputError.
    """
    if not isinstance(priors, Mapping):
        return priors
    single = {name: prior for name, prior in priors.items() if not isinstance(name, tuple)}
    joint = {name: prior for name, prior in priors.items() if name not in single}
    ufloats = {
        name: ufloat for name, ufloat in single.items() if hasattr(ufloat, "error_components")
    }
    if len(ufloats) > 1:
        from uncertainties import covariance_matrix

        across = np.array(covariance_matrix([*ufloats.values()]))
        np.fill_diagonal(across, 0.0)
        together = tuple(compress(ufloats, np.any(across, axis=0)))
        stated = [single.pop(name) for name in together]
        if stated:
            joint[together] = [ufloat.nominal_value for ufloat in stated], covariance_matrix(stated)
    for names, prior in joint.items():
        field = f"priors[{', '.join(map(str, names))}]"
        try:
            means, cov = (prior.mean, prior.cov) if hasattr(prior, "cov") else prior
        except (TypeError, ValueError):
            raise InputError(
                "must be (means, cov) of these parameters", field=field, value=prior
            ) from None
        means, cov = real_numbers(means, field), check_covariance(cov, len(names), field=field)
        if means.shape != (len(names),):
            raise InputError("must have as many means as names", field=field, value=means.size)
        sds = sds_of(cov)
        correlation = cov / np.outer(sds, sds)  # one for all: it shows which go together
        for index, name in enumerate(names):
            if name in single:
                raise InputError(f"states '{name}' again, which has a prior", field=field)
            single[name] = JointNormal(
                float(means[index]), float(sds[index]), correlation=correlation, place=index
            )
    return single


def stated_prior(prior: object, field: str, *, low: float, hint: str = "") -> Prior:
    """A prior as it is, or the one that text like "9.81(2)", a ufloat or a frozen distribution of
    scipy stands for, a measured value impossible below `low`; hint : what to do with an exact
    number.
    """
    stated = prior
    if isinstance(prior, str):
        prior = read_quantity(prior, field=field)
    prior = of_other_package(prior, field)
    if isinstance(prior, Quantity):
        if prior.exact:
            hint = " (an exact number goes into `fixed`)" if hint else ""
            rule = 'must have an uncertainty, like "9.81(2)"'
            raise InputError(rule + hint, field=field, value=stated)
        return as_prior(prior, low=low)
    if not isinstance(prior, Prior) or isinstance(prior, type):
        rule = 'must be a prior, or text like "9.81(2)"'
        raise InputError(
            rule + (hint if isinstance(prior, int | float) else ""), field=field, value=prior
        )
    return prior


def _prior(name: str, start: float, limits: Limits | None, prior: object) -> Prior:
    if prior is not None:
        hint = f" (an exact value is held by fixed={{'{name}': {prior}}})"
        return stated_prior(prior, f"priors[{name}]", low=-math.inf, hint=hint)
    try:
        low, high = (None, None) if limits is None else limits
        ends = [
            unlimited if end is None else real_number(end, "bounds")
            for end, unlimited in ((low, -math.inf), (high, math.inf))
        ]
        return Flat(ends[0], ends[1], start)
    except InputError as error:
        raise InputError(
            f"of '{name}' {error.rule}",
            field="start" if error.field == "start" else "bounds",
            value=error.value,
        ) from None
    except (TypeError, ValueError):
        raise InputError(
            f"must be (low, high) for '{name}'", field="bounds", value=limits
        ) from None
