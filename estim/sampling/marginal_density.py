"""The density of what runs share, each run integrated out, for `estim.sampling.marginal`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estim.arrays import FloatArray, IntArray
from estim.common import phrase
from estim.problem import Measure, Problem
from estim.sampling.chain import Progress
from estim.sampling.conditional import Around, RunTerm


@dataclass(frozen=True, eq=False)
class Marginal:
    """Log density of the sampled parameters, the runs' own ones integrated out; `columns`
    (n_sampled,) of the problem.

    weight : the measure of readings and, to first order, Jeffreys' prior; None where there is
        neither.
    """

    problem: Problem
    columns: IntArray
    terms: tuple[RunTerm, ...]
    weight: Measure | None

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.problem.names[i] for i in self.columns)

    @cached_property
    def priors(self) -> Problem:
        """The sampled parameters alone."""
        return Problem(tuple(self.problem.parameters[i] for i in self.columns), ())

    def of_run(self, term: RunTerm, shared: FloatArray) -> FloatArray:
        """The columns of shared (n_draw, n_sampled) that one run uses."""
        return shared[:, np.searchsorted(self.columns, term.columns[term.shared])]

    def log_prior(self, shared: FloatArray) -> FloatArray:
        """(n_draw,) of the sampled parameters, with the measure."""
        log_p = self.priors.log_prior(shared)
        return (
            log_p
            if self.weight is None
            else log_p
            + self.weight.log(shared[:, np.searchsorted(self.columns, self.weight.columns)])
        )

    def at_runs(
        self, shared: FloatArray, *, n_node: int, progress: Progress | None = None
    ) -> Iterator[tuple[FloatArray, Around]]:
        """Of every run the marginal (n_draw,) at shared (n_draw, n_sampled), and its own parameters
        there.
        """
        for i, term in enumerate(self.terms):
            if progress is not None:
                progress(0, phrase("run {k} of {n}", k=i + 1, n=len(self.terms)))
            of_run = self.of_run(term, shared)
            around = term.around(of_run)
            yield term.log_marginal(of_run, around, n_node=n_node), around

    def log_density(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log p(y, s) in Laplace's approximation; -inf outside the priors' support."""
        log_p = self.log_prior(draws)
        inside = np.isfinite(log_p)
        for log_marginal, _ in self.at_runs(draws[inside], n_node=1):
            log_p[inside] += log_marginal
        return log_p
