"""A curve whose starts are left to the points, a model by name or a formula: what stands in for them until there are points, and what these give."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray
from estim.curves.formula import Formula, read_formula
from estim.curves.guesses import guess_starts
from estim.curves.models import Limits, named_model, names_only
from estim.curves.models import ModelSum as ModelSum
from estim.curves.models import read_model as read_model
from estim.curves.posing import CurveProblem
from estim.curves.projected import linear_in as linear_in
from estim.curves.starts import find_starts
from estim.problem import Flat, Parameter


@dataclass(frozen=True, eq=False)
class BareFormula:
    """A formula of the user's, some of whose parameters have no start; it is asked what a `ModelSum` is."""

    formula: Formula

    @property
    def expression(self) -> str:
        return self.formula.text

    @property
    def called(self) -> str:
        return ""

    @property
    def parameters(self) -> tuple[str, ...]:
        return self.formula.names

    @property
    def limits(self) -> dict[str, Limits]:
        return {}


Unstarted = ModelSum | BareFormula


def unstarted(curve: object, start: Collection[str], fixed: Collection[str], tied: Collection[str]) -> Unstarted | None:
    """What finds the starts that are not given, of models by name or of a formula of x; None where none is missing, or nothing can."""
    asked = called_by_name(curve, start, fixed, tied)
    if asked is not None or tied or not (isinstance(curve, str) and curve.strip() and isinstance(start, Mapping) and isinstance(fixed, Mapping)):
        return asked
    formula = read_formula(curve, field="curve")
    return BareFormula(formula) if formula.uses_x and {*formula.names} - {*start, *fixed} else None


def called_by_name(curve: object, *named: Collection[str]) -> ModelSum | None:
    """The models that the text `curve` names; None where a name in it is that of a parameter, in one of the collections `named`.

    Raises InputError for names of nothing: no starts, and names alone.
    """
    asked = named_model(curve) if any(named) or not names_only(curve) else read_model(curve)
    if asked is None or any(word.strip() in names for word in asked.text.split("+") for names in named):
        return None
    return asked


def provisional(
    asked: Unstarted, start: Mapping[str, float], bounds: Mapping[str, Limits], priors: Collection[str], fixed: Collection[str]
) -> tuple[dict[str, float], dict[str, Limits]]:
    """Starts, those of the user and others within limits, and limits, those of the user and of the models."""
    free = [name for name in asked.parameters if name not in fixed]
    limits = {name: ends for name, ends in asked.limits.items() if name in free and name not in priors} | dict(bounds)
    return {name: _inside(limits.get(name)) for name in free} | dict(start), limits


def started(posed: CurveProblem, asked: Unstarted, *, held: Collection[str]) -> CurveProblem:
    """The problem with starts found from its points but for the parameters `held`, whose starts are the user's.  Raises InputError."""
    counted = posed.counted
    gain, bins = (posed.relative, None) if counted is None else (counted.noise.reading_gain(), counted.bins)
    named = {p.name for p in posed.parameters if p.name in asked.parameters and p.name not in held and isinstance(p.prior, Flat)}
    if not named:
        return posed
    return replace(posed, parameters=with_starts(asked, posed.parameters, named, posed.x, posed.y, gain, bins, known=posed.fixed))


def with_starts(
    asked: Unstarted, parameters: tuple[Parameter, ...], sought: Collection[str], x: FloatArray, y: FloatArray, gain: FloatArray,
    bins: FloatArray | None, *, known: Mapping[str, float],
) -> tuple[Parameter, ...]:
    """`parameters`, named as in the models, with starts for those `sought`, which have flat priors; the others are held where they start.

    x, y, gain : (n_obs,) points and relative errors of y.  bins : (n_obs, 2) of counts, so that the curve is their density.
    known : exact values.
    """
    width = np.ones(y.size) if bins is None else bins[:, 1] - bins[:, 0]
    centres = {p.name: p.prior.centre for p in parameters if p.name in asked.parameters and p.name not in sought}
    limits = {p.name: (_finite(p.prior.low), _finite(p.prior.high)) for p in parameters if p.name in sought}
    held = {**centres, **known}
    if isinstance(asked, ModelSum):
        found = find_starts(asked, x, y / width, gain / width, known=held, limits=limits)
    else:
        found = guess_starts(asked.formula, x, y / width, gain / width, known=held, limits=limits)
    return tuple(replace(p, prior=Flat(p.prior.low, p.prior.high, found[p.name])) if p.name in sought else p for p in parameters)


def _finite(end: float) -> float | None:
    return end if math.isfinite(end) else None


def _inside(limits: Limits | None) -> float:
    low, high = limits if isinstance(limits, tuple) and len(limits) == 2 else (None, None)
    if low is not None and high is not None:
        return 0.5 * (low + high)
    return low + 1.0 if low is not None else high - 1.0 if high is not None else 1.0
