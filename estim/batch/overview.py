"""How the values of one quantity spread over a batch, and which stand apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.batch.rows import Row

_FEWEST = 5  # values from which a spread means something
_APART = 5.0  # of the spread and the own uncertainty together
_TO_SD = 1.482602218505602  # median absolute deviation of a normal distribution to its sd


@dataclass(frozen=True, eq=False)
class Spread:
    """One quantity in all runs that are ok.

    rows : (n,) which rows.  mean, sd : (n,) of the posteriors.  informed : share of the runs in which the data narrowed it.
    median : of the means.  scatter : robust sd of the means (1.48 times the median absolute deviation), nan for fewer than five.
    typical : median of the sds.  apart : rows more than 5 (scatter^2 + sd^2)^(1/2) from the median, of those in which the data narrowed it.
    """

    name: str
    unit: str
    rows: tuple[int, ...]
    mean: FloatArray
    sd: FloatArray
    informed: float
    median: float
    scatter: float
    typical: float
    apart: tuple[int, ...]


def spreads(rows: Sequence[Row]) -> list[Spread]:
    """Each quantity that a run which is ok has a value of, those that the data determine most often first."""
    found: dict[str, list[int]] = {}
    for i, row in enumerate(rows):
        for name in row.values:
            found.setdefault(name, []).append(i)
    made = [_spread(name, rows, chosen) for name, chosen in found.items()]
    return sorted(made, key=lambda one: -one.informed * len(one.rows))


def _spread(name: str, rows: Sequence[Row], chosen: Sequence[int]) -> Spread:
    values = [rows[i].values[name] for i in chosen]
    mean, sd = np.array([v.mean for v in values]), np.array([v.sd for v in values])
    median = float(np.median(mean))
    scatter = _TO_SD * float(np.median(np.abs(mean - median))) if mean.size >= _FEWEST else float("nan")
    informed = np.array([v.informed for v in values])
    far = informed & (np.abs(mean - median) > _APART * np.hypot(scatter, sd))
    apart = tuple(i for i, beyond in zip(chosen, far.tolist(), strict=True) if beyond)
    return Spread(name, values[0].unit, tuple(chosen), mean, sd, float(np.mean(informed)), median, scatter, float(np.median(sd)), apart)
