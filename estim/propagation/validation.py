"""Whether the linear method may be trusted: its coverage interval against the Monte-Carlo one (JCGM
101, section 8).

Use `compare` before a linear interval is quoted.  Ask for as many digits as u will be printed with:
one for a plot, two for a table.  Make the Monte-Carlo run one digit better than that (`n_digits=3`
there for two here), or the answer may be "undecided".
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from estim.arrays import BoolArray, FloatArray, all_finite, positive_or
from estim.common import InputError, phrase, require_one_of
from estim.given_numbers import check_whole
from estim.propagation.linear import LinearResult, frozen, how_many
from estim.propagation.monte_carlo import IntervalKind, MonteCarloResult, numerical_tolerance

Status = Literal["valid", "invalid", "undecided"]


@dataclass(frozen=True, eq=False)
class Validation:
    """Whether the linear interval agrees with the Monte-Carlo one.  "()" stands for () or (n_out,).

    status : ``valid`` (all outputs agree), ``invalid`` (at least one differs for certain),
        ``undecided`` (the Monte-Carlo errors of the ends are too large to decide, it has
        not stabilised, or a result is unknown).
    passes : () d_low <= tolerance and d_high <= tolerance, the test of JCGM 101, 8.1 as it stands;
        False where a result is unknown.
    decided : () whether the answer survives twice the Monte-Carlo error of both ends, and, where
        they agree, mean and u of the Monte Carlo have stabilised.
    d_low, d_high : () absolute differences of the ends.
    tolerance : () delta for `n_digits` digits of the linear u.
    kind : of the Monte-Carlo interval compared.   message : the status as a sentence.
    """

    status: Status
    passes: BoolArray
    decided: BoolArray
    d_low: FloatArray
    d_high: FloatArray
    tolerance: FloatArray
    n_digits: int
    kind: IntervalKind
    message: str


def compare(
    linear: LinearResult,
    monte_carlo: MonteCarloResult,
    *,
    n_digits: int = 2,
    kind: IntervalKind = "symmetric",
) -> Validation:
    """Validation of the linear result by the Monte-Carlo one (JCGM 101, 8.1).

    d_low = |y - U - y_low|, d_high = |y + U - y_high|; the linear result is valid if neither
    exceeds delta, half a unit in the last of `n_digits` significant digits of the linear u(y)
    (7.9.2; 0 for u = 0, where only a constant passes).  The ends y_low and y_high have errors of
    their own; JCGM 101, 8.2 asks for an accuracy of delta/5, and an answer that twice their
    standard error could turn is "undecided" here.  So is an agreement with a Monte Carlo whose mean
    and u have not stabilised to delta (7.9.4), or whose u does not exist; ends that differ for
    certain differ whether or not it does.

    linear, monte_carlo : of the same formula and inputs.
    kind : the interval of the draws, "symmetric" or "shortest".

    Raises InputError for results of different inputs, correlations, shapes or probabilities, and
    for a wrong choice.

    >>> import numpy as np
    >>> from estim import compare, propagate_linear, propagate_monte_carlo
    >>> inputs = {"L": "0.85(1)", "T": "1.851(3)"}
    >>> linear = propagate_linear("4*pi**2*L/T**2", inputs)
    >>> draws = propagate_monte_carlo("4*pi**2*L/T**2", inputs, rng=np.random.default_rng(1))
    >>> bool(compare(linear, draws).passes)
    True
    """
    _check_comparable(linear, monte_carlo, n_digits, kind)
    scalar = linear.value.ndim == 0
    interval = monte_carlo.symmetric if kind == "symmetric" else monte_carlo.shortest
    # matters for an output without uncertainty only
    rounding = 1e-12 * np.maximum(np.abs(linear.low), np.abs(linear.high))
    tolerance = np.atleast_1d(numerical_tolerance(linear.u, n_digits) + rounding)
    difference = np.abs(np.array([linear.low - interval.low, linear.high - interval.high])).reshape(
        2, -1
    )
    error = 2.0 * np.array([interval.low_error, interval.high_error]).reshape(2, -1)
    passes = np.all(difference <= tolerance, axis=0)
    fails_surely = np.any(difference - error > tolerance, axis=0)
    # NaN: u does not exist
    converged = np.atleast_1d(
        2.0 * np.maximum(monte_carlo.mean_error, monte_carlo.u_error) <= tolerance
    )
    decided = fails_surely | (np.all(difference + error <= tolerance, axis=0) & converged)
    status: Status = (
        "invalid" if fails_surely.any() else "valid" if (passes & decided).all() else "undecided"
    )
    shape = linear.value.shape
    return Validation(
        status=status,
        passes=frozen(passes, shape),
        decided=frozen(decided, shape),
        d_low=frozen(difference[0], shape),
        d_high=frozen(difference[1], shape),
        tolerance=frozen(tolerance, shape),
        n_digits=n_digits,
        kind=kind,
        message=_sentence(
            status,
            fails_surely,
            ~decided,
            difference,
            error,
            tolerance,
            n_digits,
            converged,
            scalar=scalar,
        )
        + (
            phrase(" (Monte Carlo conditional on the function being defined)")
            if monte_carlo.conditional
            else ""
        ),
    )


def _sentence(
    status: Status,
    fails: BoolArray,
    open_: BoolArray,
    difference: FloatArray,
    error: FloatArray,
    tolerance: FloatArray,
    n_digits: int,
    converged: BoolArray,
    *,
    scalar: bool,
) -> str:
    digits = phrase("1 digit") if n_digits == 1 else phrase("{n} digits", n=n_digits)
    if status == "valid":
        return phrase("the linear interval agrees with Monte Carlo to {digits} of u", digits=digits)
    affected = fails if status == "invalid" else open_
    excess = np.max(difference, axis=0) / positive_or(tolerance, 1.0)
    worst = int(np.argmax(np.where(affected & np.isfinite(excess), excess, -1.0)))
    where = how_many(affected, scalar=scalar)
    which = "" if scalar or affected.size == 1 else phrase(" (output {n})", n=worst)
    by = phrase(
        "its ends differ from Monte Carlo by {low:.2g} (low) and {high:.2g} (high){which}",
        low=difference[0, worst],
        high=difference[1, worst],
        which=which,
    )
    limit = phrase(
        "the tolerance is {tolerance:.2g} ({digits} of u)",
        tolerance=tolerance[worst],
        digits=digits,
    )
    if status == "invalid":
        return where + phrase(
            "the linear interval is not valid: {by}, while {limit}: quote the Monte-Carlo interval",
            by=by,
            limit=limit,
        )
    if not all_finite(difference[:, affected]):
        return where + phrase(
            "the linear interval cannot be assessed: a result is unknown there (see the "
            "notes of both)"
        )
    if not np.all(converged[affected]) and np.all(
        difference[:, affected] + error[:, affected] <= tolerance[affected]
    ):
        unsettled = phrase(
            "the linear interval cannot be assessed: mean and u from Monte Carlo have not "
            "stabilised there (see its notes)"
        )
        return where + unsettled
    known = np.max(error[:, worst])
    judged = phrase(
        "the linear interval cannot be assessed: {by}, with uncertainty {known:.2g}, and {limit}: "
        "use more draws",
        by=by,
        known=known,
        limit=limit,
    )
    return where + judged


def _check_comparable(
    linear: LinearResult, monte_carlo: MonteCarloResult, n_digits: object, kind: object
) -> None:
    def described(result: LinearResult | MonteCarloResult) -> list[tuple[str, float, float]]:
        return [(quantity.name, quantity.value, quantity.u) for quantity in result.inputs]

    if described(linear) != described(monte_carlo) or not np.array_equal(
        linear.correlation, monte_carlo.correlation
    ):
        raise InputError(
            "must come from the same inputs and correlations as linear", field="monte_carlo"
        )
    if linear.value.shape != monte_carlo.mean.shape:
        raise InputError(
            f"must have outputs shaped {linear.value.shape} as linear has",
            field="monte_carlo",
            value=monte_carlo.mean.shape,
        )
    if linear.probability != monte_carlo.probability:
        raise InputError(
            f"must be for probability {linear.probability} as linear is",
            field="monte_carlo",
            value=monte_carlo.probability,
        )
    check_whole(n_digits, "n_digits", 1)
    require_one_of(kind, get_args(IntervalKind), field="kind")
