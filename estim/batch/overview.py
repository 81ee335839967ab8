"""How the values of one quantity spread over a batch, and which are outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.batch.rows import RunRow
from estim.common import Label
from estim.reading import odd_intervals


@dataclass(frozen=True, eq=False)
class RunScatter:
    """One quantity in all runs that are ok, in SI units.

    label : how people read it.
    rows : (n,) which rows.
    mean, sd : (n,) of the posteriors.  informed : share of the runs in which the data narrowed it.
    median : of the means.
    scatter : robust sd of the means (1.48 times the median absolute deviation), nan for fewer than
        five.
    typical : median of the sds.
    apart : rows more than 5 (scatter^2 + sd^2)^(1/2) from the median, of those in which the data
        narrowed it.
    """

    name: str
    unit: str
    label: Label
    rows: tuple[int, ...]
    mean: FloatArray
    sd: FloatArray
    informed: float
    median: float
    scatter: float
    typical: float
    apart: tuple[int, ...]


def spreads(rows: Sequence[RunRow]) -> list[RunScatter]:
    """Each quantity that a run which is ok has a value of, those that the data determine most often
    first.

    A name that stands for different units in different campaigns is as many quantities.
    """
    by_quantity: dict[tuple[str, str], list[int]] = {}
    for i, row in enumerate(rows):
        for name, value in row.values.items():
            by_quantity.setdefault((name, value.unit), []).append(i)
    results = [_spread(name, unit, rows, chosen) for (name, unit), chosen in by_quantity.items()]
    return sorted(results, key=lambda spread: -spread.informed * len(spread.rows))


def odd_runs(rows: Sequence[RunRow]) -> list[tuple[RunRow, str]]:
    """Runs whose frame interval is not that of most runs of their campaign, each with a sentence:
    what no run shows by itself.
    """
    of_campaign: dict[str, dict[int, float]] = {}
    for i, row in enumerate(rows):
        if row.interval is not None:
            of_campaign.setdefault(row.campaign, {})[i] = row.interval
    sentences = {
        int(i): words
        for intervals in of_campaign.values()
        for i, words in odd_intervals({str(i): dt for i, dt in intervals.items()}).items()
    }
    return [(rows[i], sentences[i]) for i in sorted(sentences)]


def _spread(name: str, unit: str, rows: Sequence[RunRow], chosen: Sequence[int]) -> RunScatter:
    values = [rows[i].values[name] for i in chosen]
    mean, sd = np.array([v.mean for v in values]), np.array([v.sd for v in values])
    median = float(np.median(mean))
    scatter = (
        # values from which a spread means something
        # median absolute deviation of a normal distribution to its sd
        1.482602218505602 * float(np.median(np.abs(mean - median)))
        if mean.size >= 5
        else float("nan")
    )
    informed = np.array([v.informed for v in values])
    # of the spread and the own uncertainty together
    far = informed & (np.abs(mean - median) > 5.0 * np.hypot(scatter, sd))
    apart = tuple(i for i, outlying in zip(chosen, far.tolist(), strict=True) if outlying)
    return RunScatter(
        name,
        unit,
        values[0].label or Label(name, name, unit, 1.0),
        tuple(chosen),
        mean,
        sd,
        float(np.mean(informed)),
        median,
        scatter,
        float(np.median(sd)),
        apart,
    )
