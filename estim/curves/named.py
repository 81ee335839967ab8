"""A curve whose starts are left to the points, a model by name or a formula: what stands in for
them until there are points, and what these give.
"""

from __future__ import annotations

import math
import numbers
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, number
from estim.curves.curve_problem import CurveProblem
from estim.curves.formula import Formula, read_formula
from estim.curves.models import Limits, ModelSum, named_model, names_only, read_model
from estim.curves.several_abscissas import OfPoints, arguments_taken
from estim.curves.starting_values import guess_starts
from estim.problem import MOST_REWEIGHTED, Counted, Flat, errors_widened, typical_size

_SIZE = "size_of_density"
_FEW = 2  # parameters of models whose names are ordinary words
_ENOUGH = 3  # trials to either side that distinguish a share from a step
Points = tuple[FloatArray, FloatArray, FloatArray]
"""x, y and their standard uncertainties, or 1."""


def unstarted(
    curve: object, start: Collection[str], fixed: Collection[str], tied: Mapping[str, str]
) -> ModelSum | None:
    """What finds the starts that are not given, of models by name or of a formula of x, with what
    is tied in it replaced; None where none is missing, or nothing can.
    """
    if isinstance(curve, ModelSum):
        return curve
    models = called_by_name(curve, start, fixed, tied)
    if models is not None or not (
        isinstance(curve, str | Formula)
        and str(curve).strip()
        and all(isinstance(given, Mapping) for given in (start, fixed, tied))
    ):
        return models
    formula = read_formula(curve, field="curve")
    text = formula.text
    for name, relation in reversed([*tied.items()]):  # of those before it
        text = re.sub(rf"(?<!\w){re.escape(str(name))}(?!\w)", f"({relation})", text)
    if tied:
        own = {*formula.names, *start, *fixed}
        try:
            formula = read_formula(text)
        except InputError:  # is reported where the ties are read
            return None
        for name in formula.names:
            if name not in own:
                first = next(tie for tie in tied if name in str(tied[tie]))
                rule = f"names '{name}', which is no parameter of the curve: give it a start"
                raise InputError(rule, field=f"tied[{first}]", value=tied[first])
    constant = formula.names == (formula.text,)
    missing = {*formula.names} - {*start, *fixed}
    for name in sorted(missing):
        _refuse_model(name, formula.text)
    return ModelSum("", formula) if (formula.uses_x or constant) and missing else None


def _refuse_model(name: str, text: str) -> None:
    """Raises InputError for a parameter that is called like a model, which a formula cannot hold;
    short names (power, line, constant) may be meant.
    """
    model = named_model(name)
    if model is not None and len(model.parameters) > _FEW:
        rule = f"uses the model '{name}' inside a formula: write out its formula instead"
        raise InputError(f"{rule}: {model.formula.text}", field="curve", value=text)


def in_time(curve: Any, axis: str, *named: object) -> Any:
    """A formula without x whose `t`, or word of the name of its axis, no collection in `named` has:
    as a curve along that; every other curve as it is.
    """
    if not isinstance(curve, str) or not curve.strip() or names_only(curve):
        return curve
    formula = read_formula(curve, field="curve")
    used = {name for names in named if isinstance(names, Mapping) for name in names}
    words = [word for word in ("t", *axis.split()) if word in formula.names and word not in used]
    return formula.in_terms_of(words[0]) if words and not formula.uses_x else curve


def with_defaults(
    curve: object, start: Mapping[str, float] | None, *excluded: Collection[str] | None
) -> Mapping[str, float] | None:
    """The starts that were given; where none was, those of the numbers by default of a function of
    Python, but for the arguments `excluded`.  If any start was given, an argument with a default
    value is held at it.
    """
    if not callable(curve) or start:
        return start
    known = {
        p.name: float(p.default)
        for p in arguments_taken(curve)
        if isinstance(p.default, int | float)
        and not isinstance(p.default, bool)
        and not any(p.name in names for names in excluded if names)
    }
    return known or start


def arguments_of(curve: object, *named: Collection[str]) -> tuple[str, ...]:
    """Names of the parameters that a curve takes; those that a function of Python itself names.

    named : as for `called_by_name`.  Raises InputError.
    """
    if isinstance(curve, OfPoints) and curve.names:
        return curve.names
    if callable(curve):
        parameters = arguments_taken(getattr(curve, "rhs", curve))[1:]
        begin = [entry for entry in getattr(curve, "at_start", ()) if isinstance(entry, str)]
        return (*(p.name for p in parameters if p.kind is not p.VAR_KEYWORD), *begin)
    models = called_by_name(curve, *named)
    if models is not None:
        return models.parameters
    return read_formula(curve, field="curve").names


def called_by_name(curve: object, *named: Collection[str]) -> ModelSum | None:
    """The models that the text `curve` names; None where a name in it is that of a parameter, in
    one of the collections `named`.

    Raises InputError for names of nothing: no starts, and names alone.
    """
    if isinstance(curve, str) and len(curve.strip()) == 1:
        return None  # a constant
    models = named_model(curve) if any(named) or not names_only(curve) else read_model(curve)
    if models is None or any(
        word.strip() in names for word in models.text.split("+") for names in named
    ):
        return None
    return models


def provisional(
    models: ModelSum,
    start: Mapping[str, float],
    bounds: Mapping[str, Limits],
    priors: Collection[str],
    fixed: Collection[str],
) -> tuple[dict[str, float], dict[str, Limits]]:
    """Starts, those of the user and others within limits, and limits, those of the user and of the
    models.
    """
    free = [name for name in models.parameters if name not in fixed]
    limits = {
        name: ends for name, ends in models.limits.items() if name in free and name not in priors
    } | dict(bounds)
    return {name: within(limits.get(name)) for name in free} | dict(start), limits


def started(
    posed: CurveProblem,
    models: ModelSum,
    *,
    user_starts: Collection[str],
    further_points: Sequence[Points] = (),
) -> CurveProblem:
    """The problem with starts found from its points but for the parameters `user_starts`, whose
    starts are the user's.  Raises InputError.

    further_points : x, y and u_y of points of the same curve with the same parameters.
    """
    noise, counted = posed.noise, posed.noise.counted
    x, y, gain = _pooled((posed.x, posed.y, noise.reading_gain()), further_points)
    known = {p.name: p for p in posed.parameters if p.name in models.parameters}
    bins = None if counted is None else counted.bins
    width = np.ones(y.size) if bins is None else bins[:, 1] - bins[:, 0]
    near = y if counted is None else _with_neighbours(y, counted)
    limits = {
        name: (number(p.prior.low), number(p.prior.high))
        for name, p in known.items()
        if name not in user_starts and isinstance(p.prior, Flat)
    }
    if not limits:
        return posed
    fixed = {name: p.prior.centre for name, p in known.items() if name not in limits} | dict(
        posed.fixed
    )
    formula = models.formula
    if counted is not None and counted.single:  # the size of a density does not matter
        formula = read_formula(f"{_SIZE}*({formula.text})")

    def guessed(wider: FloatArray | float = 1.0) -> dict[str, float]:
        return guess_starts(
            formula, x, near / width, wider * gain / width, known=fixed, limits=limits
        )

    starts = _robust((x, y, gain), formula, guessed) if noise.robust else guessed()
    if starts.get(_SIZE, 1.0) < 0.0:  # of a negative density
        positive = {**limits, _SIZE: (0.0, None)}
        starts = guess_starts(formula, x, near / width, gain / width, known=fixed, limits=positive)
    starts = _in_order(models, starts, limits)
    priors = {
        name: Flat(known[name].prior.low, known[name].prior.high, starts[name], start_stated=False)
        for name in limits
    }
    return replace(
        posed,
        parameters=tuple(replace(p, prior=priors.get(p.name, p.prior)) for p in posed.parameters),
    )


def _with_neighbours(y: FloatArray, counted: Counted) -> FloatArray:
    """Counts y (n_obs,) in order of x; shares of few trials each the mean with its neighbours':
    least squares through single ones end at a step.
    """
    n_neighbours = (
        round(_ENOUGH / float(np.mean(counted.trials))) if counted.law.ceiling < math.inf else 0
    )
    window = np.ones(min(2 * n_neighbours + 1, y.size))
    return np.convolve(y, window, "same") / np.convolve(np.ones(y.size), window, "same")


def _pooled(own: Points, further_points: Sequence[Points]) -> Points:
    """The points with further ones, in order of x."""
    x, y, gain = (np.concatenate(each) for each in zip(own, *further_points, strict=True))
    order = np.argsort(x, kind="stable")
    return x[order], y[order], gain[order]


def _robust(
    points: Points, formula: Formula, guessed: Callable[[FloatArray], dict[str, float]]
) -> dict[str, float]:
    """Starts that a few outliers, however far off, do not decide: those of `guessed` for errors
    (n_obs,) that are as much wider as readings are far from the curve (`errors_widened`).

    All readings are equal first, and, for a curve that can meet a single reading, as far off as
    they are from the medians of five neighbours; the best of all that are found are taken.
    """
    x, y, gain = points
    smooth = [np.median(y[max(0, i - 2) : i + 3]) for i in range(y.size)]

    def residuals_from(starts: Mapping[str, float]) -> FloatArray:
        return np.nan_to_num((y - formula.value(x, starts)[0]) / gain)

    candidates = [guessed(np.ones(y.size))]
    for residuals in (residuals_from(candidates[0]), (y - smooth) / gain):
        wider = errors_widened(residuals)
        with suppress(InputError):  # starts that were found before are kept
            for _ in range(MOST_REWEIGHTED):
                candidates.append(guessed(wider))
                before, wider = wider, errors_widened(residuals_from(candidates[-1]))
                if np.allclose(before, wider, rtol=0.1):
                    break
    all_residuals = [residuals_from(starts) for starts in candidates]
    size = min(map(typical_size, all_residuals)) or 1.0
    costs = [float(np.sum(np.log1p(np.square(residuals / size)))) for residuals in all_residuals]
    return candidates[int(np.argmin(costs))]


def _in_order(
    models: ModelSum, starts: Mapping[str, float], limits: Mapping[str, Limits]
) -> dict[str, float]:
    """Starts whose terms of one model, where nothing else distinguishes them, come in the order of
    their positions, rates or frequencies; oscillations have positive amplitudes
    and phases within half a turn.
    """
    ordered = dict(starts)
    for size, turn in ((t.prefix + "amplitude", t.prefix + "phase") for t in models.terms):
        if limits.get(size) == limits.get(turn) == (None, None):
            phase = ordered[turn] + (math.pi if ordered[size] < 0.0 else 0.0)
            ordered |= {size: abs(ordered[size]), turn: math.remainder(phase, 2.0 * math.pi)}
    for model in {term.model.name: term.model for term in models.terms}.values():
        names = [
            [term.prefix + name for name in model.parameters]
            for term in models.terms
            if term.model is model
        ]
        ends = [[limits.get(name, "known") for name in own] for own in names]
        if any("known" in own or own != ends[0] for own in ends):
            continue
        values = sorted(([ordered[name] for name in own] for own in names), key=lambda own: own[1:])
        for own, ordered_values in zip(names, values, strict=True):
            ordered.update(zip(own, ordered_values, strict=True))
    return ordered


def within(limits: Limits | None) -> float:
    """A number within limits, to stand in for a start; what is no limit is refused later."""
    pair: Sequence[Any] = (
        limits if isinstance(limits, tuple | list) and len(limits) == 2 else (None, None)
    )
    low, high = (
        float(end) if isinstance(end, numbers.Real) and math.isfinite(end) else None for end in pair
    )
    if low is not None and high is not None:
        return 0.5 * (low + high)
    return low + 1.0 if low is not None else high - 1.0 if high is not None else 1.0
