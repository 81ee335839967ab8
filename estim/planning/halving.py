"""What it would take to halve a standard deviation, by one thing alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from estim.arrays import FloatArray
from estim.common import phrase
from estim.planning.candidates import (
    MORE,
    OTHERWISE,
    Change,
    better_words,
    by_quantity,
    measured_better,
)
from estim.planning.expected_uncertainty import Option, sds_with, weigh
from estim.planning.planned_readings import Basis
from estim.planning.rolling import Outlook
from estim.planning.suggestions import repeated
from estim.problem import Parameter

_HALF = 0.5
_EXACT = 1e-4  # of a stated uncertainty


@dataclass(frozen=True, eq=False)
class HalvingWay:
    """One way: how much of it in `words`, and the `ratio` that is reached: at most a half where it
    is enough.
    """

    words: str
    ratio: float

    @property
    def enough(self) -> bool:
        return self.ratio <= _HALF + 1e-6


@dataclass(frozen=True, eq=False)
class Halving:
    """The ways for one target: those that are enough, stated quantities before data, then the
    others, the best first.
    """

    target: Parameter
    ways: tuple[HalvingWay, ...]


def ways_to_halve(
    basis: Basis,
    present: Outlook,
    targets: Sequence[Parameter],
    now: FloatArray,
    options: Sequence[Option],
) -> tuple[Halving, ...]:
    """For each target: each stated quantity measured better, more frames, smaller errors, and the
    best further run or reading many times.
    """

    @cache
    def of_readings(frames: float, error: float) -> Option:
        change = Change("", OTHERWISE, frames=frames, error=error)
        return weigh(basis, change, targets, now)

    _, effects = basis.fit.spreads_and_effects
    halvings = []
    for k, target in enumerate(targets):
        sd = float(now[k])
        ways = [
            _better(present, change, target, sd)
            for change in measured_better(present.problem, effects, factor=1.0)
        ]
        ways += _steps(of_readings, present, k)
        more = [
            option
            for option in options
            if option.change.group == MORE
            and (len(option.change.runs) == 1 or option.change.readings)
        ]
        more = [option for option in more if option.change.runs or not option.change.own] or more
        if more:
            ways.append(_many(basis, min(more, key=lambda option: option.ratio[k]), target, sd))
        halvings.append(
            Halving(target, tuple(sorted(ways, key=lambda way: 0.0 if way.enough else way.ratio)))
        )
    return tuple(halvings)


def _better(present: Outlook, change: Change, target: Parameter, now: float) -> HalvingWay:
    """A stated quantity as well known as it takes, or as it can be."""
    parameters = [p for p in present.problem.parameters if p.name in change.u]

    def ratio(factor: float) -> float:
        return (
            float(
                sds_with(present, {name: factor * u for name, u in change.u.items()}, [target])[0]
            )
            / now
        )

    least = ratio(_EXACT)
    if least > _HALF:
        name = next(iter(by_quantity(parameters)))
        label = parameters[0].bare_label if len(parameters) > 1 else parameters[0].label
        return HalvingWay(phrase("{symbol} known exactly", symbol=label.symbol or name), least)
    low, high = _EXACT, 1.0
    for _ in range(40):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if ratio(middle) <= _HALF else (low, middle)
    rounded = {name: float(f"{low * u:.2g}") for name, u in change.u.items()}
    return HalvingWay(better_words(parameters, rounded), _HALF)


def _steps(
    of_readings: Callable[[float, float], Option], present: Outlook, k: int
) -> list[HalvingWay]:
    """More frames and smaller errors, for the target at place k."""

    def of(frames: float = 1.0, error: float = 1.0) -> float:
        option = of_readings(frames, error)
        return float("inf") if option.reason else float(option.ratio[k])

    more = (
        phrase("{n} times as many readings")
        if present.problem.runs[0].motion is None
        else phrase("{n} times as many frames")
    )
    return [
        _doubled(lambda n: (more.format(n=n), of(frames=float(n)))),
        _doubled(lambda n: (phrase("1/{n} of the error of a reading", n=n), of(error=1.0 / n))),
    ]


def _many(basis: Basis, best: Option, target: Parameter, now: float) -> HalvingWay:
    def of(n: int) -> tuple[str, float]:
        several = repeated(best.change, n)
        option = weigh(basis, several, [target], np.array([now]))
        return several.words, float("inf") if option.reason else float(option.ratio[0])

    return _doubled(of, between=True)


def _doubled(of: Callable[[int], tuple[str, float]], *, between: bool = False) -> HalvingWay:
    """The first of 2, 4, 8, 16 times that is enough, else the best of them that can be had.
    between: or the least number of times.
    """
    ways: list[HalvingWay] = []
    for i in range(1, 5):
        ways.append(HalvingWay(*of(2**i)))
        if ways[-1].enough:
            break
    else:
        return min(ways, key=lambda way: way.ratio)
    low, high, least = 2 ** (i - 1), 2**i, ways[-1]
    while between and high - low > 1:
        middle = (low + high) // 2
        way = HalvingWay(*of(middle))
        low, high, least = (low, middle, way) if way.enough else (middle, high, least)
    return least
