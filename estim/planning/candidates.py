"""What might be measured next: one record for all of it, and the list that a campaign itself
suggests.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from estim.campaign import NewRun
from estim.common import phrase, split_level, with_unit
from estim.problem import Parameter, Problem, uses_of

Group = Literal["a quantity measured better", "the same runs, measured otherwise", "more data"]
BETTER: Group = "a quantity measured better"
OTHERWISE: Group = "the same runs, measured otherwise"
MORE: Group = "more data"


@dataclass(frozen=True, eq=False)
class FurtherReadings:
    """Further readings of a user's own curve: `n` of run `run` at abscissa `x`."""

    run: str
    x: float
    n: int


@dataclass(frozen=True, eq=False)
class Change:
    """Something that might be measured; all of it together where several changes are stated.

    words : what it is, for a reader.
    own : whether the campaign's [plan] requests it.
    u : parameter -> standard uncertainty with which it would be stated, own unit.
    frames : times as many frames (readings of one's own curve).
    error : times as large an error of a reading.  reach : times as far.
    runs, readings : further ones.
    which : they are, where their number stands before it (" of heavy at φ = 4°"), for another
        number of them.
    """

    words: str
    group: Group
    own: bool = False
    u: Mapping[str, float] = field(default_factory=dict)
    frames: float = 1.0
    error: float = 1.0
    reach: float = 1.0
    runs: tuple[NewRun, ...] = ()
    readings: tuple[FurtherReadings, ...] = ()
    which: str = ""


def by_quantity(parameters: Iterable[Parameter]) -> dict[str, tuple[Parameter, ...]]:
    """Quantity -> its parameters at all levels."""
    groups: dict[str, list[Parameter]] = {}
    for parameter in parameters:
        groups.setdefault(split_level(parameter.name)[0], []).append(parameter)
    return {name: tuple(every) for name, every in groups.items()}


def measured_better(
    problem: Problem, effects: Collection[str], *, factor: float = 0.5
) -> tuple[Change, ...]:
    """For each quantity of the curves that was measured: `factor` times its stated uncertainty,
    wherever it stands.

    effects : parameters that a spread between runs scales: nobody measured them.
    """
    stated = [
        p
        for p in problem.parameters
        if p.prior.measured
        and p.name not in problem.noise_names
        and p.name not in effects
        and uses_of(problem.runs)[p.name]
    ]
    return tuple(
        Change(better_words(every, u), BETTER, u=u)
        for every in by_quantity(stated).values()
        for u in [{p.name: factor * p.prior.sd for p in every}]
    )


def better_words(parameters: Sequence[Parameter], u: Mapping[str, float]) -> str:
    """'φ to ±0.2° (from 0.4°), in every run'."""
    first = parameters[0]
    label = first.bare_label if len(parameters) > 1 else first.label
    new = sorted({f"{u[p.name] * label.factor:.2g}" for p in parameters})
    old = sorted({f"{p.prior.sd * label.factor:.2g}" for p in parameters if p.prior.measured})
    n = len(parameters)
    several = "" if n == 1 else phrase(", both") if n == 2 else phrase(", all {n}", n=n)
    before = phrase(" (from {size})", size=with_unit(_range(old), label.unit)) if old else ""
    return phrase(
        "{symbol} to ±{size}{before}{several}",
        symbol=label.symbol,
        size=with_unit(_range(new), label.unit),
        before=before,
        several=several,
    )


def _range(numbers: Sequence[str]) -> str:
    return (
        numbers[0] if len(numbers) == 1 else f"{min(numbers, key=float)}–{max(numbers, key=float)}"
    )


def measured_otherwise(*, moving: bool) -> tuple[Change, ...]:
    """Of every run: more frames, smaller errors, and (of a moving body) a longer way."""
    more = (
        (phrase("twice the frame rate"), phrase("four times the frame rate"))
        if moving
        else (phrase("twice as many readings"), phrase("four times as many readings"))
    )
    changes = [
        Change(words, OTHERWISE, frames=n) for words, n in zip(more, (2.0, 4.0), strict=True)
    ]
    changes.append(Change(phrase("half the error of a reading"), OTHERWISE, error=0.5))
    if moving:
        farther = phrase("1.5 times the path length, where the body reaches that far")
        changes.append(Change(farther, OTHERWISE, reach=1.5))
    return tuple(changes)


def which_place(problem: Problem, run: str, x: float) -> str:
    """' at T = 3 K in run-1', where further readings are; without the run where it is the only
    one.
    """
    axis = next(one for one in problem.runs if one.name == run)
    return phrase(
        " at {name} = {x} in {run}" if len(problem.runs) > 1 else " at {name} = {x}",
        name=axis.x_name,
        x=with_unit(f"{x:g}", axis.x_unit),
        run=run,
    )


def further(
    which: str,
    *,
    own: bool = False,
    runs: tuple[NewRun, ...] = (),
    readings: tuple[FurtherReadings, ...] = (),
) -> Change:
    """Further runs, or '3 additional readings at x = 3'."""
    n = readings[0].n if readings else len(runs)
    if readings:
        words = (
            phrase("{n} additional readings{which}", n=n, which=which)
            if n > 1
            else phrase("{n} additional reading{which}", n=n, which=which)
        )
    elif n > 1:
        words = phrase("{n} runs{which}", n=n, which=which)
    else:
        words = phrase("a run{which}", which=which)
    return Change(words, MORE, own, runs=runs, readings=readings, which=which)
