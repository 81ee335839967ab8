"""Parameters in words: how the search for them ended, what else draws the same curve, what nothing
determines, and their edges.
"""

from __future__ import annotations

import math

from estim.common import Amount, Finding, Kind, behind, format_rounded, later, percentage, phrase
from estim.words.table import Table, symbol, value_words, worded

_MOST_NAMED = 5
_STILL_SHIFTED = later(
    "the search did not converge: its last step still shifted {name} by {size:.2g} "
    "standard deviations"
)
_PLACES = {math.pi: "pi", 2.0 * math.pi: "2 pi", 0.5 * math.pi: "pi/2"}


def one_sided(side: str, value: float, edge: float, *, factor: float, unit: str = "") -> str:
    """'< 0.31 (95 %)', in units of which one SI unit has `factor`; side "upper" or "lower"."""
    rounded = format_rounded(value * factor, 0.25 * abs(value - edge) * factor)
    return f"{'<' if side == 'upper' else '>'} {rounded}{unit} (95 %)"


def _equal(f: Finding) -> str:
    """'θ₀[r] = 60.1 °, φ = 4 °'."""
    return ", ".join(f"{symbol(amount)} = {value_words(amount)}" for amount in f.parameters)


def _solution(f: Finding) -> str:
    return worded(
        f, "{values} ({share} of the posterior)", values=_equal(f), share=percentage(f.size)
    )


def _moves(f: Finding) -> str:
    """A step along a direction: 'γ up by 3 %, φ down by 0.2 °'."""
    parts = []
    for amount in f.parameters:
        assert amount.label is not None
        step = abs(amount.value)
        size = (
            f"{step * amount.label.factor:.2g}{behind(amount.label.unit)}"
            if math.isnan(amount.whole)
            else f"{100.0 * step / amount.whole:.2g} %"
        )
        up, symbol = amount.value > 0.0, amount.label.symbol
        parts.append(
            phrase(
                "{symbol} up by {size}" if up else "{symbol} down by {size}",
                symbol=symbol,
                size=size,
            )
        )
    return ", ".join(parts)


def _silent(f: Finding) -> str:
    together, still = len(f.parameters) > 1, f.size < 1e-6
    return worded(
        f,
        (
            "{moves} together do not change the predicted data at all"
            if still
            else "{moves} together change the predicted data by only {noise:.2g} of the total noise"
        )
        if together
        else "{moves} does not change the predicted data at all"
        if still
        else "{moves} changes the predicted data by only {noise:.2g} of the total noise",
        moves=_moves(f),
        noise=math.sqrt(f.size),
    )


def _exchange(f: Finding) -> str:
    pairs = zip(f.names[::2], f.names[1::2], strict=True)
    return phrase(" and ").join(phrase("{a} with {b}", a=a, b=b) for a, b in pairs)


def _change(amount: Amount) -> str:
    """A parameter mapped to sign * parameter + shift: `value` the shift, `whole` the sign."""
    if amount.value == 0.0:
        return f"-{amount.name}" if amount.whole < 0.0 else amount.name
    shift = next(
        (text for number, text in _PLACES.items() if abs(amount.value - number) < 1e-9),
        f"{amount.value:g}",
    )
    return f"{shift} - {amount.name}" if amount.whole < 0.0 else f"{amount.name} + {shift}"


_OPEN = {
    "above": later(
        "{symbol} is unbounded above, because other parameters compensate for any large "
        "value: without a stated prior or an upper limit it has no interval"
    ),
    "below": later(
        "{symbol} is unbounded below, because other parameters compensate for any small "
        "value: without a stated prior or a lower limit it has no interval"
    ),
    "counts": later(
        "nothing limits {symbol} on a side where the likelihood does not fall to 0, and the prior "
        "of counts is flat, so that no posterior exists to draw from: state a limit there (low, "
        "high) or a prior; the intervals of `fit_curve` need neither"
    ),
    "decades": later(
        "{symbol} may be many times larger or smaller than fitted, and the flat prior of counts "
        "favours large values, which would shift all results: write exp(b) in its place, or x/x0 "
        "for x, with x0 among the points"
    ),
}
_OPEN_BOTH = later(
    "{symbol} is unbounded on both sides, because other parameters compensate for any value, "
    "large or small: without a stated prior or limits it has no interval"
)


def _limit(f: Finding) -> str:
    (edge,) = f.parameters
    assert edge.label is not None
    cell = one_sided(
        f.test, f.size, edge.value, factor=edge.label.factor, unit=behind(edge.label.unit)
    )
    return worded(
        f, "{symbol} {limit}: its most probable value is the edge of its range, {shown}", limit=cell
    )


def _held(f: Finding) -> str:
    named, n = ", ".join(f.names[:_MOST_NAMED]), len(f.names) - _MOST_NAMED
    return worded(
        f,
        "the covariance of {which} was kept constant, because it oscillates with the curve: "
        "its own values may be wrong by {size:.2g} of their standard deviations, all others by "
        "{felt:.1g}",
        which=phrase("{names} and {n} more", names=named, n=n) if n > 0 else named,
    )


def _not_settled(f: Finding) -> str:
    if f.names:
        return phrase("the least-squares fit did not converge: {held}", held=_held(f))
    return worded(
        f,
        _STILL_SHIFTED
        if f.parameters
        else "the least-squares fit did not converge: its last iteration still shifted a parameter "
        "by {size:.2g} standard deviations",
    )


WORDS: Table = {
    Kind.FIT_UNSETTLED: _not_settled,
    Kind.COVARIANCE_HELD: _held,
    Kind.STEP_UNSETTLED: _STILL_SHIFTED,
    Kind.VALUE_OUTSIDE: lambda f: phrase(
        "the {p:.0f} % interval of {name} does not contain its fitted value: the "
        "search met better solutions than the fit on the way",
        p=100.0 * f.p,
        name=symbol(f.parameters[0]),
    ),
    Kind.BETTER_ELSEWHERE: lambda f: phrase(
        "the search for the intervals met a better point than the fit: there, minus twice the log "
        "density is lower by {size:.2g} ({values})",
        size=f.size,
        values=", ".join(f"{symbol(amount)} = {amount.value:.6g}" for amount in f.parameters),
    ),
    Kind.EXCHANGED: (
        "the curve is unchanged when components are exchanged ({either}): set "
        "bounds that order them to select one solution"
    ),
    Kind.EXCHANGE: _exchange,
    Kind.IMAGES: (
        "the curve is the same with {either}: of these equivalent solutions, the "
        "one closest to the stated starting values is given, or otherwise the "
        "one with positive frequencies, widths and amplitudes, and small angles"
    ),
    Kind.IMAGE: lambda f: ", ".join(_change(amount) for amount in f.parameters),
    Kind.OTHER_NUMBERS: (
        "the curve is the same with other parameter values ({either}): the "
        "solution closest to the starting values is given"
    ),
    Kind.FASTER_CURVES: (
        "curves that vary faster between the points pass through them too ({either}): if "
        "one of them is intended, select it by bounds"
    ),
    Kind.VALUES: _equal,
    Kind.SEVERAL_SOLUTIONS: lambda f: worded(
        f,
        "the data allow {n:.0f} separate solutions: {solutions}{more}",
        solutions=phrase("; or ").join(map(_solution, f.parts)),
        more=phrase("; and {n:.0f} more", n=f.size - len(f.parts)) if f.size > len(f.parts) else "",
    ),
    Kind.SOLUTION: _solution,
    Kind.DIRECTION_FLAT: lambda f: phrase(
        "a combination of parameters is constrained neither by the data nor by the priors, "
        "but only by the edges of "
        "their ranges: {moves}",
        moves=_silent(f),
    ),
    Kind.DIRECTION_LEARNT: lambda f: phrase("constrained by the data: {moves}", moves=_moves(f)),
    Kind.DIRECTION_SILENT: _silent,
    Kind.SINGULAR: (
        "a combination of the parameters is determined neither by the data nor by the priors"
    ),
    Kind.UNDETERMINED: lambda f: worded(
        f,
        "{name} has no standard deviation at its best value, {value:.6g}: the curve is the same on "
        "both sides of it, so that it does not change there to first order; give it the limit "
        "{value:.6g}"
        if f.parameters
        else "the data do not determine {names}, so there are no standard deviations"
        if len(f.names) == 1
        else "the data do not determine {names} individually, only a combination of them, so there "
        "are no standard deviations",
    ),
    Kind.HARDLY_HELD: (
        "the data hardly constrain {name}: far from the fitted value, minus "
        "twice the log posterior density is only {size:.1f} above its minimum"
    ),
    Kind.STEPS_OPEN: (
        "the curve is the same after each step of {size:.4g} in {name}, and so far from the data "
        "several of these steps are within its uncertainty"
    ),
    Kind.OPEN_SIDE: lambda f: worded(f, _OPEN.get(f.test, _OPEN_BOTH)),
    Kind.PRESSED_EDGE: (
        "{symbol} lies at the edge of its prior, {shown}, and the data favour "
        "values beyond it ({p})"
    ),
    Kind.PRESSED_LIMIT: (
        "{name} lies at its limit {value:.6g}, and the data favour values beyond "
        "it ({p}): is the limit right?"
    ),
    Kind.LIMIT: _limit,
    Kind.TAKEN_AS_EXACT: "run {run}: {names} taken as exact: every result relies on this",
}
