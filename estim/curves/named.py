"""A curve asked for by name: what stands in for its starts until there are points, and the starts that these give."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray
from estim.curves.models import Limits, named_model, names_only
from estim.curves.models import ModelSum as ModelSum
from estim.curves.models import read_model as read_model
from estim.curves.posing import CurveProblem
from estim.curves.starts import find_starts
from estim.problem import Flat, Parameter


def called_by_name(curve: object, *named: Collection[str]) -> ModelSum | None:
    """The models that the text `curve` names; None where a name in it is that of a parameter, in one of the collections `named`.

    Raises InputError for names of nothing: no starts, and names alone.
    """
    asked = named_model(curve) if any(named) or not names_only(curve) else read_model(curve)
    if asked is None or any(word.strip() in names for word in asked.text.split("+") for names in named):
        return None
    return asked


def provisional(
    asked: ModelSum, start: Mapping[str, float], bounds: Mapping[str, Limits], priors: Collection[str], fixed: Collection[str]
) -> tuple[dict[str, float], dict[str, Limits]]:
    """Starts, those of the user and others within limits, and limits, those of the user and of the models."""
    free = [name for name in asked.parameters if name not in fixed]
    limits = {name: ends for name, ends in asked.limits.items() if name in free and name not in priors} | dict(bounds)
    return {name: _inside(limits.get(name)) for name in free} | dict(start), limits


def started(posed: CurveProblem, asked: ModelSum, *, held: Collection[str]) -> CurveProblem:
    """The problem with starts found from its points but for the parameters `held`, whose starts are the user's.  Raises InputError."""
    counted = posed.counted
    gain, bins = (posed.relative, None) if counted is None else (counted.noise.reading_gain(), counted.bins)
    named = {p.name for p in posed.parameters if p.name in asked.parameters and p.name not in held and isinstance(p.prior, Flat)}
    if not named:
        return posed
    return replace(posed, parameters=with_starts(asked, posed.parameters, named, posed.x, posed.y, gain, bins, known=posed.fixed))


def with_starts(
    asked: ModelSum, parameters: tuple[Parameter, ...], sought: Collection[str], x: FloatArray, y: FloatArray, gain: FloatArray,
    bins: FloatArray | None, *, known: Mapping[str, float],
) -> tuple[Parameter, ...]:
    """`parameters`, named as in the models, with starts for those `sought`, which have flat priors; the others are held where they start.

    x, y, gain : (n_obs,) points and relative errors of y.  bins : (n_obs, 2) of counts, so that the curve is their density.
    known : exact values.
    """
    width = np.ones(y.size) if bins is None else bins[:, 1] - bins[:, 0]
    centres = {p.name: p.prior.centre for p in parameters if p.name in asked.parameters and p.name not in sought}
    limits = {p.name: (_finite(p.prior.low), _finite(p.prior.high)) for p in parameters if p.name in sought}
    found = find_starts(asked, x, y / width, gain / width, known={**centres, **known}, limits=limits)
    return tuple(replace(p, prior=Flat(p.prior.low, p.prior.high, found[p.name])) if p.name in sought else p for p in parameters)


def _finite(end: float) -> float | None:
    return end if math.isfinite(end) else None


def _inside(limits: Limits | None) -> float:
    low, high = limits if isinstance(limits, tuple) and len(limits) == 2 else (None, None)
    if low is not None and high is not None:
        return 0.5 * (low + high)
    return low + 1.0 if low is not None else high - 1.0 if high is not None else 1.0
