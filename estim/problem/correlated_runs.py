"""Runs whose errors are not independent of each other, because they share what their curves lack:
one likelihood for all of them.

A posterior is a sum over groups.  Most hold one run, whose likelihood is that of its own noise;
runs that share something have a `SharedNoise` beside their own, which makes one likelihood of their
points below each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from estim.arrays import FloatArray, Named
from estim.problem.likelihood import Likelihood, StackedPoints
from estim.problem.observations import Observations


class SharedNoise(Protocol):
    """What some runs have in common beside the noise of each."""

    @property
    def runs(self) -> tuple[str, ...]:
        """Their names, in the order in which their points are stacked."""

    def likelihood(self, points: StackedPoints, named: Named) -> Likelihood:
        """The likelihood of all their points, whose curves pass near them at the values `named`."""


@dataclass(frozen=True, eq=False)
class Group:
    """Runs that have one likelihood; shared : what ties them together, None for a run alone."""

    runs: tuple[Observations, ...]
    shared: SharedNoise | None

    @property
    def run_names(self) -> tuple[str, ...]:
        return tuple(run.name for run in self.runs)

    @property
    def n_obs(self) -> int:
        return sum(run.n_obs for run in self.runs)

    @property
    def y(self) -> FloatArray:
        """(n_obs,) all ordinates."""
        return np.concatenate([run.y for run in self.runs])

    def likelihood(self, named: Named) -> Likelihood:
        """Of all points of the group, the curves taken at the values `named` where they matter
        little.
        """
        if self.shared is None:
            (run,) = self.runs
            return run.likelihood(named)
        return self.shared.likelihood(StackedPoints(tuple(run.points for run in self.runs)), named)

    def split(self, rows: FloatArray) -> list[FloatArray]:
        """Rows (n_obs, ...) of the group as those of each run."""
        return np.split(rows, np.cumsum([run.n_obs for run in self.runs])[:-1])


def grouped(runs: Sequence[Observations], shared: Sequence[SharedNoise]) -> tuple[Group, ...]:
    """The runs in groups, in the order of the first run of each."""
    by_name = {run.name: run for run in runs}
    tied = {name: noise for noise in shared for name in noise.runs}
    groups, assigned = [], set[str]()
    for run in runs:
        if run.name not in assigned:
            noise = tied.get(run.name)
            members = (run,) if noise is None else tuple(by_name[name] for name in noise.runs)
            assigned.update(member.name for member in members)
            groups.append(Group(members, noise))
    return tuple(groups)
