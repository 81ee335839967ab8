"""Whether a body rolled without slipping along the way that was measured: what friction that takes,
against what was stated.

The curve that is fit assumes rolling; a body that slips lags behind it.  For each posterior draw
the forces of the ramp follow from the motion (`estim.model.contact`), and with them the largest
|F|/N from the release to the farthest reading that is fit.  Rolling held if the coefficient of
friction is above it.  An unmodelled force beside the curve is not in it; it needs about its own
size more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, Named
from estim.checks.unmodelled_force import SURE
from estim.common import Finding, Kind
from estim.problem import Observations, Problem

_MUCH = 0.5  # coefficient of friction that few pairs of dry surfaces surpass


@dataclass(frozen=True, eq=False)
class Rolling:
    """Whether one run rolled without slipping.

    needed : (n_draw,) the largest coefficient of friction that rolling needs on the way; inf where
        the body would hop.
    where : the place of the largest need, as x is read, in `unit`; median.
    least_normal : (n_draw,) smallest N/(M g).
    stated : whether a coefficient of friction was stated.
    holds : the probability of rolling all the way with it, nan without.
    """

    run: str
    needed: FloatArray
    where: float
    unit: str
    least_normal: FloatArray
    stated: bool
    holds: float

    @property
    def enough(self) -> float:
        """A coefficient of friction that is enough with probability 95 %."""
        return float(np.quantile(self.needed, SURE, method="higher"))

    @property
    def typical(self) -> float:
        return float(np.quantile(self.needed, 0.5, method="higher"))

    @property
    def hops(self) -> float:
        """Probability that the ramp would have to pull."""
        return float(np.mean(np.isinf(self.needed)))

    @property
    def finding(self) -> Finding:
        """What it comes to."""
        numbers = {
            "enough": self.enough,
            "typical": self.typical,
            "hops": self.hops,
            "where": self.where,
        }
        kind = Kind.FRICTION_NEEDED
        if self.stated:
            kind = Kind.ROLLING_SURE if self.holds >= SURE else Kind.ROLLING_DOUBTFUL
        elif self.hops > 1.0 - SURE:
            kind = Kind.ROLLING_HOPS
        return Finding(kind, run=self.run, p=self.holds, numbers=numbers, names=(self.unit,))


def check_rolling(
    problem: Problem, draws: FloatArray, *, rng: np.random.Generator
) -> tuple[Rolling, ...]:
    """One record for each run of a body.  draws : (n_draw, n_par)."""
    named = problem.named(draws)
    return tuple(
        record
        for run in problem.runs
        if (record := _of_run(run, run.bind(named), len(draws), rng)) is not None
    )


def way_of(run: Observations) -> float:
    """The farthest reading of a run that is fit: the fit has no information beyond it."""
    return float(np.max(run.position))


def _of_run(
    run: Observations, arguments: Named, n_draw: int, rng: np.random.Generator
) -> Rolling | None:
    if run.motion is None:
        return None
    footing = run.motion.footing(way_of(run), arguments)
    needed = np.where(np.isnan(footing.needed), -np.inf, footing.needed)
    place = np.argmax(needed, axis=1)[:, None]
    largest = np.take_along_axis(needed, place, axis=1)[:, 0]
    moves = np.isfinite(largest) | (largest > 0.0)
    if not np.any(moves):
        return None
    where = float(np.median(np.take_along_axis(footing.along, place, axis=1)[moves]))
    largest, least = (
        np.broadcast_to(column, n_draw)
        for column in (largest, np.nanmin(np.where(moves[:, None], footing.normal, np.inf), axis=1))
    )
    grip, unit = run.motion.grip, run.y_unit if run.positions else run.x_unit
    if grip is None:
        return Rolling(run.name, largest, where, unit, least, False, math.nan)
    mu = np.full(n_draw, grip) if isinstance(grip, float) else grip.draw(rng, n_draw)
    return Rolling(run.name, largest, where, unit, least, True, float(np.mean(largest <= mu)))


def rolling_remarks(rolling: Sequence[Rolling]) -> list[Finding]:
    """The runs whose rolling is in doubt."""
    doubtful = (Kind.ROLLING_DOUBTFUL, Kind.ROLLING_HOPS)
    return [
        record.finding
        for record in rolling
        if record.finding.kind in doubtful or (not record.stated and record.enough > _MUCH)
    ]
