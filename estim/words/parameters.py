"""Parameters in words: how the search for them ended, what else draws the same curve, what nothing
determines, and their edges.
"""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import (
    Amount,
    Finding,
    Kind,
    Label,
    format_p,
    format_rounded,
    later,
    percentage,
    phrase,
)
from estim.words.table import Table

_MOST_NAMED = 5
_PLACES = {math.pi: "pi", 2.0 * math.pi: "2 pi", 0.5 * math.pi: "pi/2"}


def behind(shown: Label) -> str:
    """The unit as it stands behind a number."""
    return "" if shown.unit == "1" else f" {shown.unit}"


def value_words(amount: Amount) -> str:
    """'60.1 °'."""
    label = amount.label
    return (
        f"{amount.value:.6g}"
        if label is None
        else f"{amount.value * label.factor:.4g}{behind(label)}"
    )


def symbol(amount: Amount) -> str:
    return amount.name if amount.label is None else amount.label.symbol


def one_sided(side: str, value: float, edge: float, *, factor: float, unit: str = "") -> str:
    """'< 0.31 (95 %)', in units of which one SI unit has `factor`; side "upper" or "lower"."""
    rounded = format_rounded(value * factor, 0.25 * abs(value - edge) * factor)
    return f"{'<' if side == 'upper' else '>'} {rounded}{unit} (95 %)"


def _equal(f: Finding) -> str:
    """'θ₀[r] = 60.1 °, φ = 4 °'."""
    return ", ".join(f"{symbol(amount)} = {value_words(amount)}" for amount in f.parameters)


def _solution(f: Finding) -> str:
    return phrase("{values} ({share} of the posterior)", values=_equal(f), share=percentage(f.size))


def _several(f: Finding) -> str:
    more = phrase("; and {n:.0f} more", n=f.size - len(f.parts)) if f.size > len(f.parts) else ""
    solutions = phrase("; or ").join(map(_solution, f.parts))
    return phrase(
        "the data allow {n:.0f} separate solutions: {solutions}{more}",
        n=f.size,
        solutions=solutions,
        more=more,
    )


def _moves(f: Finding) -> str:
    """A step along a direction: 'γ up by 3 %, φ down by 0.2 °'."""
    parts = []
    for amount in f.parameters:
        assert amount.label is not None
        step = abs(amount.value)
        size = (
            f"{step * amount.label.factor:.2g}{behind(amount.label)}"
            if math.isnan(amount.whole)
            else f"{100.0 * step / amount.whole:.2g} %"
        )
        up, symbol = amount.value > 0.0, amount.label.symbol
        parts.append(
            phrase("{symbol} up by {size}", symbol=symbol, size=size)
            if up
            else phrase("{symbol} down by {size}", symbol=symbol, size=size)
        )
    return ", ".join(parts)


def _silent(f: Finding) -> str:
    moves, together = _moves(f), len(f.parameters) > 1
    if f.size < 1e-6:
        if together:
            return phrase("{moves} together do not change the predicted data at all", moves=moves)
        return phrase("{moves} does not change the predicted data at all", moves=moves)
    noise = math.sqrt(f.size)
    if together:
        return phrase(
            "{moves} together change the predicted data by only {noise:.2g} of the total noise",
            moves=moves,
            noise=noise,
        )
    return phrase(
        "{moves} changes the predicted data by only {noise:.2g} of the total noise",
        moves=moves,
        noise=noise,
    )


def _exchanged(f: Finding) -> str:
    exchanges = phrase("; or ").join(_exchange(part) for part in f.parts)
    return phrase(
        "the curve is unchanged when components are exchanged ({exchanges}): set bounds "
        "that order them to select "
        "one solution",
        exchanges=exchanges,
    )


def _exchange(f: Finding) -> str:
    return phrase(" and ").join(
        phrase("{a} with {b}", a=a, b=b) for a, b in zip(f.names[::2], f.names[1::2], strict=True)
    )


def _image(f: Finding) -> str:
    return ", ".join(_change(amount) for amount in f.parameters)


def _change(amount: Amount) -> str:
    """A parameter mapped to sign * parameter + shift: `value` the shift, `whole` the sign."""
    if amount.value == 0.0:
        return f"-{amount.name}" if amount.whole < 0.0 else amount.name
    shift = next(
        (text for number, text in _PLACES.items() if abs(amount.value - number) < 1e-9),
        f"{amount.value:g}",
    )
    return f"{shift} - {amount.name}" if amount.whole < 0.0 else f"{amount.name} + {shift}"


def _listed(f: Finding) -> str:
    return phrase("; or ").join(_equal(part) for part in f.parts)


def _images(f: Finding) -> str:
    images = phrase("; or ").join(map(_image, f.parts))
    return phrase(
        "the curve is the same with {images}: of these equivalent solutions, the one "
        "closest to the stated starting values is "
        "given, or otherwise the one with positive amplitudes and small angles",
        images=images,
    )


def _other_numbers(f: Finding) -> str:
    return phrase(
        "the curve is the same with other parameter values ({values}): the solution "
        "closest to the starting values "
        "is given",
        values=_listed(f),
    )


def _faster(f: Finding) -> str:
    return phrase(
        "curves of higher frequency pass through the same points ({values}): if one of "
        "them is intended, select it "
        "by bounds",
        values=_listed(f),
    )


def _elsewhere(f: Finding) -> str:
    return phrase(
        "{n:.0f} of {starts:.0f} starting points of the fit did not lead to the best optimum",
        n=f.size,
        starts=f.numbers["starts"],
    )


def _flat(f: Finding) -> str:
    return phrase(
        "a combination of parameters is constrained neither by the data nor by the priors, "
        "but only by the edges of "
        "their ranges: {moves}",
        moves=_silent(f),
    )


_OPEN = {
    "above": later(
        "{name} is unbounded above, because other parameters compensate for any large "
        "value: with a flat prior without an "
        "upper limit it has no interval"
    ),
    "below": later(
        "{name} is unbounded below, because other parameters compensate for any small "
        "value: with a flat prior without a "
        "lower limit it has no interval"
    ),
}
_OPEN_BOTH = later(
    "{name} is unbounded on both sides, because other parameters compensate for any value, "
    "large or small: with a flat "
    "prior without limits it has no interval"
)


def _open(f: Finding) -> str:
    return phrase(_OPEN.get(f.test, _OPEN_BOTH), name=symbol(f.parameters[0]))


def _exact(f: Finding) -> str:
    return phrase(
        "run {run}: {names} taken as exact: every result relies on this",
        run=f.run,
        names=phrase(" and ").join(f.names),
    )


def _edge(f: Finding) -> str:
    (edge,) = f.parameters
    return phrase(
        "{symbol} lies at the edge of its prior, {value}, and the data favour values "
        "beyond it ({p})",
        symbol=symbol(edge),
        value=value_words(edge),
        p=format_p(f.p),
    )


def _pressed(f: Finding) -> str:
    (limit,) = f.parameters
    return phrase(
        "{name} lies at its limit {value:.6g}, and the data favour values beyond it ({p}): "
        "is the limit right?",
        name=limit.name,
        value=limit.value,
        p=format_p(f.p),
    )


def _limit(f: Finding) -> str:
    (edge,) = f.parameters
    assert edge.label is not None
    cell = one_sided(f.test, f.size, edge.value, factor=edge.label.factor, unit=behind(edge.label))
    return phrase(
        "{symbol} {limit}: its most probable value is the edge of its range, {edge}",
        symbol=edge.label.symbol,
        limit=cell,
        edge=value_words(edge),
    )


def _held(f: Finding) -> str:
    named = ", ".join(f.names[:_MOST_NAMED])
    which = (
        phrase("{names} and {n} more", names=named, n=len(f.names) - _MOST_NAMED)
        if len(f.names) > _MOST_NAMED
        else named
    )
    return phrase(
        "the covariance of {which} was kept constant, because it oscillates with the curve: its "
        "own values may be wrong by {size:.2g} of their standard deviations, all others by "
        "{felt:.1g}",
        which=which,
        size=f.size,
        felt=f.numbers["felt"],
    )


def _not_settled(f: Finding) -> str:
    if f.names:
        return phrase("the least-squares fit did not converge: {held}", held=_held(f))
    if f.parameters:
        moved = f.parameters[0].name
        return phrase(
            "the search did not converge: its last step still shifted {name} by {size:.2g} "
            "standard deviations",
            name=moved,
            size=f.size,
        )
    return phrase(
        "the least-squares fit did not converge: its last iteration still shifted a "
        "parameter by {size:.2g} standard "
        "deviations",
        size=f.size,
    )


def _undetermined(f: Finding) -> str:
    names = phrase(" and ").join(f.names)
    if len(f.names) == 1:
        return phrase(
            "the data do not determine {names}, so there are no standard deviations", names=names
        )
    return phrase(
        "the data do not determine {names} individually, only a combination of them, so "
        "there are no standard deviations",
        names=names,
    )


WORDS: Table = MappingProxyType(
    {
        Kind.FIT_UNSETTLED: _not_settled,
        Kind.COVARIANCE_HELD: _held,
        Kind.STEP_UNSETTLED: lambda f: phrase(
            "the search did not converge: its last step still shifted {name} by {size:.2g} "
            "standard "
            "deviations",
            name=f.parameters[0].name,
            size=f.size,
        ),
        Kind.VALUE_OUTSIDE: lambda f: phrase(
            "the {p:.0f} % interval of {name} does not contain its fitted value: the "
            "search met better solutions than the fit on the way",
            p=100.0 * f.p,
            name=symbol(f.parameters[0]),
        ),
        Kind.STARTS_ELSEWHERE: _elsewhere,
        Kind.EXCHANGED: _exchanged,
        Kind.EXCHANGE: _exchange,
        Kind.IMAGES: _images,
        Kind.IMAGE: _image,
        Kind.OTHER_NUMBERS: _other_numbers,
        Kind.FASTER_CURVES: _faster,
        Kind.VALUES: _equal,
        Kind.SEVERAL_SOLUTIONS: _several,
        Kind.SOLUTION: _solution,
        Kind.DIRECTION_FLAT: _flat,
        Kind.DIRECTION_LEARNT: lambda f: phrase(
            "constrained by the data: {moves}", moves=_moves(f)
        ),
        Kind.DIRECTION_SILENT: _silent,
        Kind.SINGULAR: later(
            "a combination of the parameters is determined neither by the data nor by the priors"
        ),
        Kind.UNDETERMINED: _undetermined,
        Kind.HARDLY_HELD: lambda f: phrase(
            "the data hardly constrain {name}: far from the fitted value, minus twice the "
            "log posterior density is only {size:.1f} above "
            "its minimum",
            name=f.parameters[0].name,
            size=f.size,
        ),
        Kind.OPEN_SIDE: _open,
        Kind.PRESSED_EDGE: _edge,
        Kind.PRESSED_LIMIT: _pressed,
        Kind.LIMIT: _limit,
        Kind.TAKEN_AS_EXACT: _exact,
    }
)
