"""The density of what runs share, each run integrated out, for `estim.sampling.marginal`.

Many runs: a flat measure of every run's own parameters is no small assumption any more.  If what is shared sets the scale of the tilts, the volume
that a run's own parameters have grows with that scale, and n of them pull the scale up by sqrt(n) times what one does: with 64 runs by two
standard deviations, with errors stated rightly (docs/statistics.md).  Beyond `MANY` runs each counts by its best fit instead: readings of its own
have the measure of Jeffreys, given what is shared, under which their volume is the same everywhere.

Source: Neyman and Scott, Econometrica 16 (1948) 1 (many incidental parameters); Berger, Liseo and Wolpert, Stat. Sci. 14 (1999) 1 (their cure).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.common import Finding, Kind, phrase
from estim.fitting import MANY
from estim.problem import MEASURED, Problem
from estim.sampling.conditional import Expansion, RunTerm
from estim.sampling.kept_marginal import NOWHERE, Stages

IndexArray = NDArray[np.int64]


def readings_of(problem: Problem) -> frozenset[str]:
    """Parameters, one a run, whose stated values are readings (they differ from run to run), where there are so many runs that their volume matters.

    One prior for all runs says how their true values are distributed: these are integrated as they are.  A name is "phi[run]".
    """
    if len(problem.groups) <= MANY or any(p.between for p in problem.parameters):
        return frozenset()
    stated: dict[str, dict[str, float]] = {}
    for parameter in problem.parameters:
        if parameter.name.endswith("]") and parameter.name not in problem.noise_names and isinstance(parameter.prior, MEASURED):
            stated.setdefault(parameter.name.split("[")[0], {})[parameter.name] = parameter.prior.centre
    return frozenset(name for one in stated.values() if len(set(one.values())) > 1 for name in one)


def felt_measure(shared: FloatArray, log_weights: FloatArray, measure: FloatArray, n_run: int) -> Finding:
    """What the measure of the runs' own parameters does: by how much a flat one would move a shared parameter, to first order."""
    weights = np.exp(log_weights)
    off = shared - weights @ shared
    drift = np.where(weights > 0.0, measure, 0.0)
    moved = (weights * (drift - weights @ drift)) @ off / np.sqrt(np.maximum(weights @ off**2, 1e-300))
    return Finding(Kind.RUNS_COUNT_ALIKE, size=float(np.max(np.abs(moved), initial=0.0)), numbers={"runs": n_run})


@dataclass(frozen=True, eq=False)
class Marginal:
    """Log density of the sampled parameters, the runs' own ones integrated out; `columns` (n_sampled,) of the problem.

    centre : (n_sampled,) the fit.  readings : parameters whose volume is taken as that at the fit everywhere.
    """

    problem: Problem
    columns: IndexArray
    terms: tuple[RunTerm, ...]
    centre: FloatArray
    readings: frozenset[str] = frozenset()

    def given(self, term: RunTerm, shared: FloatArray) -> FloatArray:
        """The columns of shared (n_draw, n_sampled) that one run uses."""
        return shared[:, np.searchsorted(self.columns, term.columns[term.shared])]

    def log_prior(self, shared: FloatArray) -> FloatArray:
        """(n_draw,) of the sampled parameters."""
        log_p = np.zeros(shared.shape[0])
        for i, column in enumerate(self.columns):
            log_p += self.problem.parameters[column].prior.log_density(shared[:, i])
        return log_p

    def terms_at(
        self, shared: FloatArray, expansions: Sequence[Expansion], *, n_node: int, stages: Stages = NOWHERE
    ) -> tuple[FloatArray, FloatArray]:
        """Log prior (n_draw,) of the sampled parameters, -inf outside its support, and the marginal (n_run, n_draw) of every run, 0 there."""
        log_p = self.log_prior(shared)
        inside = np.flatnonzero(np.isfinite(log_p))
        by_run = np.zeros((len(self.terms), shared.shape[0]))
        for i, (term, expansion) in enumerate(zip(self.terms, expansions, strict=True)):
            stages.say(phrase("run {k} of {n}", k=i + 1, n=len(self.terms)))
            log_marginal = partial(term.log_marginal, self.given(term, shared[inside]), expansion, n_node=n_node)
            by_run[i, inside] = stages.of_run(i, inside.size, log_marginal)
        return log_p, by_run

    def log_density(self, shared: FloatArray, expansions: Sequence[Expansion], *, n_node: int) -> FloatArray:
        """(n_draw,) log p(y, s); -inf outside the priors' support."""
        log_p, by_run = self.terms_at(shared, expansions, n_node=n_node)
        return np.asarray(log_p + self.measure(shared, expansions) + np.sum(by_run, axis=0))

    def measure(self, shared: FloatArray, expansions: Sequence[Expansion]) -> FloatArray:
        """(n_draw,) log of what takes out the volume of the readings of all runs, 0 at the fit."""
        total = np.zeros(shared.shape[0])
        if not self.readings:
            return total
        both = np.vstack([self.centre, shared])
        for term, expansion in zip(self.terms, expansions, strict=True):
            names = [term.posterior.names[i] for i in term.own]
            chosen = np.array([k for k, name in enumerate(names) if name in self.readings], dtype=np.int64)
            if chosen.size:
                volume = term.log_volume(self.given(term, both), expansion, chosen)
                total += volume[0] - volume[1:]
        return total
