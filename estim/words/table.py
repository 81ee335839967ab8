"""What the tables of this package hold: a sentence, which names in braces what it says of
a finding (`facts`), or where one sentence is not enough how to make it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from estim.common import (
    OF_BODY,
    Amount,
    Finding,
    Kind,
    behind,
    format_p,
    format_quantity,
    phrase,
    signed,
)

Table = Mapping[Kind, str | Callable[[Finding], str]]


class _Difference(float):
    """A number whose sign is that of print where a sentence asks for one, {size:+.1f}."""

    def __format__(self, spec: str, /) -> str:
        text = super().__format__(spec)
        return signed(text) if spec.startswith("+") else text


def filled(table: Table, finding: Finding) -> str:
    """The sentence of a finding whose kind stands in `table`, as do the kinds of its parts."""
    words = table[finding.kind]
    if not isinstance(words, str):
        return words(finding)
    parts = [filled(table, part) for part in finding.parts]
    return worded(finding, words, parts="; ".join(parts), either=phrase("; or ").join(parts))


def worded(finding: Finding, words: str, /, **further: object) -> str:
    """A sentence of a finding, in which `further` words stand too."""
    return phrase(words, **{**facts(finding), **further})


def facts(f: Finding) -> dict[str, object]:
    """What a sentence may contain of a finding: its run, numbers and names; `name`, `symbol`,
    `value` and, in the unit of a reader, `shown` of its first parameter.

    of_run : how the sentence begins where the finding is about one run.
    who : that run, or the runs of a body.  p : in words; prob : the number.  A number that has its
        standard uncertainty beside it (x, u_x) is shown with it.
    """
    amount = f.parameters[0] if f.parameters else Amount(next(iter(f.names), ""))
    n = f.numbers.get("runs", 1)
    return {
        "run": f.run,
        "of_run": phrase("run {run}: ", run=f.run) if f.run else "",
        "who": phrase("run {run}", run=f.run)
        if n == 1
        else phrase("the {n:.0f} runs of body {body}", n=n, body=f.run.removeprefix(OF_BODY)),
        "test": phrase(f.test),
        "p": format_p(f.p, f.numbers.get("least", 0.0)),
        "prob": f.p,
        "size": _Difference(f.size),
        "n": f.size,
        "names": phrase(" and ").join(f.names),
        "name": amount.name,
        "symbol": symbol(amount),
        "value": amount.value,
        "shown": value_words(amount),
        **{name: _Difference(value) for name, value in f.numbers.items()},
        **{
            name: format_quantity(value, f.numbers[f"u_{name}"])
            for name, value in f.numbers.items()
            if f"u_{name}" in f.numbers
        },
    }


def value_words(amount: Amount) -> str:
    """'60.1 °'."""
    label = amount.label
    return (
        f"{amount.value:.6g}"
        if label is None
        else f"{amount.value * label.factor:.4g}{behind(label.unit)}"
    )


def symbol(amount: Amount) -> str:
    return amount.name if amount.label is None else amount.label.symbol
