"""The density of what runs share, each run integrated out, for `estim.sampling.marginal`."""

from __future__ import annotations

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

    def given(self, term: RunTerm, shared: FloatArray) -> FloatArray:
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

    def terms_at(
        self, shared: FloatArray, *, n_node: int, progress: Progress | None = None
    ) -> tuple[FloatArray, FloatArray, list[Around]]:
        """`log_prior` (n_draw,) of the sampled parameters, -inf outside its support; the marginal
        (n_run, n_draw) of every run, 0 there; and the own parameters of each inside.
        """
        log_p = self.log_prior(shared)
        inside = np.flatnonzero(np.isfinite(log_p))
        by_run, own = np.zeros((len(self.terms), shared.shape[0])), []
        for i, term in enumerate(self.terms):
            if progress is not None:
                progress(0, phrase("run {k} of {n}", k=i + 1, n=len(self.terms)))
            given = self.given(term, shared[inside])
            own.append(term.around(given))
            by_run[i, inside] = term.log_marginal(given, own[-1], n_node=n_node)
        return log_p, by_run, own

    def log_density(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log p(y, s) in Laplace's approximation; -inf outside the priors' support."""
        log_p, by_run, _ = self.terms_at(draws, n_node=1)
        return log_p + np.sum(by_run, axis=0)
