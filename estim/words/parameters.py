"""Parameters in words: how the search for them ended, what else draws the same curve, what nothing determines, and their edges."""

from __future__ import annotations

import math
from types import MappingProxyType

from estim.common import Amount, Finding, Kind, Label, format_p, format_rounded, percentage
from estim.words.table import Table

_MOST_NAMED = 5
_PLACES = {math.pi: "pi", 2.0 * math.pi: "2 pi", 0.5 * math.pi: "pi/2"}


def behind(shown: Label) -> str:
    """The unit as it stands behind a number."""
    return "" if shown.unit == "1" else f" {shown.unit}"


def value_words(amount: Amount) -> str:
    """'60.1 °'."""
    shown = amount.label
    return f"{amount.value:.6g}" if shown is None else f"{amount.value * shown.factor:.4g}{behind(shown)}"


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
    return f"{_equal(f)} ({percentage(f.size)} of the posterior)"


def _several(f: Finding) -> str:
    more = f"; and {f.size - len(f.parts):.0f} more" if f.size > len(f.parts) else ""
    return f"the data allow {f.size:.0f} separate solutions: {'; or '.join(map(_solution, f.parts))}{more}"


def _moves(f: Finding) -> str:
    """A step along a direction: 'γ up by 3 %, φ down by 0.2 °'."""
    parts = []
    for amount in f.parameters:
        assert amount.label is not None
        step = abs(amount.value)
        size = f"{step * amount.label.factor:.2g}{behind(amount.label)}" if math.isnan(amount.whole) else f"{100.0 * step / amount.whole:.2g} %"
        parts.append(f"{amount.label.symbol} {'up' if amount.value > 0.0 else 'down'} by {size}")
    return ", ".join(parts)


def _silent(f: Finding) -> str:
    seen = "nothing that was measured" if f.size < 1e-6 else f"what was measured by only {math.sqrt(f.size):.2g} of its noise in all"
    return f"{_moves(f)} {'together change' if len(f.parameters) > 1 else 'changes'} {seen}"


def _exchanged(f: Finding) -> str:
    exchanges = "; or ".join(_exchange(part) for part in f.parts)
    return f"the same curve with components exchanged ({exchanges}): order them by bounds to choose"


def _exchange(f: Finding) -> str:
    return " and ".join(f"{a} with {b}" for a, b in zip(f.names[::2], f.names[1::2], strict=True))


def _image(f: Finding) -> str:
    return ", ".join(_change(amount) for amount in f.parameters)


def _change(amount: Amount) -> str:
    """A parameter mapped to sign * parameter + shift: `value` the shift, `whole` the sign."""
    if amount.value == 0.0:
        return f"-{amount.name}"
    shift = next((text for number, text in _PLACES.items() if abs(amount.value - number) < 1e-9), f"{amount.value:g}")
    return f"{shift} - {amount.name}" if amount.whole < 0.0 else f"{amount.name} + {shift}"


def _listed(f: Finding) -> str:
    return "; or ".join(_equal(part) for part in f.parts)


def _edge(f: Finding) -> str:
    (edge,) = f.parameters
    place = f"{symbol(edge)} lies at the edge of its prior, {value_words(edge)}"
    return f"{place}, and the data ask for values beyond it ({format_p(f.p)})"


def _pressed(f: Finding) -> str:
    (limit,) = f.parameters
    return f"{limit.name} lies on its limit {limit.value:.6g}, and the data ask for values beyond it ({format_p(f.p)}): is the limit right?"


def _limit(f: Finding) -> str:
    (edge,) = f.parameters
    assert edge.label is not None
    cell = one_sided(f.test, f.size, edge.value, factor=edge.label.factor, unit=behind(edge.label))
    return f"{edge.label.symbol} {cell}: its most probable value is the edge of its range, {value_words(edge)}"


def _held(f: Finding) -> str:
    which, more = ", ".join(f.names[:_MOST_NAMED]), f" and {len(f.names) - _MOST_NAMED} more" if len(f.names) > _MOST_NAMED else ""
    return (
        f"the covariance of {which}{more} was held, because it swings with the curve: its own values may be off by {f.size:.2g} of their standard "
        f"deviations, all others by {f.numbers['felt']:.1g}"
    )


def _not_settled(f: Finding) -> str:
    if f.names:
        return f"the least-squares fit did not settle: {_held(f)}"
    return f"the least-squares fit did not settle: its last round still moved a parameter by {f.size:.2g} standard deviations"


WORDS: Table = MappingProxyType(
    {
        Kind.FIT_UNSETTLED: _not_settled,
        Kind.COVARIANCE_HELD: _held,
        Kind.STEP_UNSETTLED: lambda f: f"the search did not settle: its last step was {f.size:.2g} standard deviations",
        Kind.STARTS_ELSEWHERE: lambda f: f"{f.size:.0f} of {f.numbers['starts']:.0f} starts of the fit ended elsewhere than at the best optimum",
        Kind.EXCHANGED: _exchanged,
        Kind.EXCHANGE: _exchange,
        Kind.IMAGES: lambda f: f"the same curve with {'; or '.join(map(_image, f.parts))}: the solution closest to the start is given",
        Kind.IMAGE: _image,
        Kind.OTHER_NUMBERS: lambda f: f"the same curve with other numbers ({_listed(f)}): the solution closest to the start is given",
        Kind.FASTER_CURVES: lambda f: (
            f"faster curves pass through the same points ({_listed(f)}): if one of them is meant, say so by bounds"
        ),
        Kind.VALUES: _equal,
        Kind.SEVERAL_SOLUTIONS: _several,
        Kind.SOLUTION: _solution,
        Kind.DIRECTION_FLAT: lambda f: (
            f"data and priors do not fix a combination of parameters, only the edges of their ranges do: {_silent(f)}"
        ),
        Kind.DIRECTION_LEARNT: lambda f: f"learnt from the data: {_moves(f)}",
        Kind.DIRECTION_SILENT: _silent,
        Kind.SINGULAR: "a combination of the parameters is determined neither by the data nor by the priors",
        Kind.UNDETERMINED: "the data do not determine a combination of the parameters: no standard deviations",
        Kind.PRESSED_EDGE: _edge,
        Kind.PRESSED_LIMIT: _pressed,
        Kind.LIMIT: _limit,
        Kind.TAKEN_AS_EXACT: lambda f: f"run {f.run}: {' and '.join(f.names)} taken as exact: every result is only as good as that",
    }
)
