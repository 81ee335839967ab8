"""The density of what runs share, each run integrated out, for `estim.sampling.marginal`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estim.arrays import FloatArray, IntArray
from estim.common import phrase
from estim.problem import Measure, Problem
from estim.sampling.chain import Progress
from estim.sampling.conditional import Expansion, RunTerm

_DEEP = 6.0  # logarithms of the density below its maximum, from where on a place does not count
_MISSED = 0.05  # of the logarithm of the density, that polynomials may miss


@dataclass(frozen=True, eq=False)
class Marginal:
    """Log density of the sampled parameters, the runs' own ones integrated out; `columns`
    (n_sampled,) of the problem.

    weight : the measure of readings and, to first order, Jeffreys' prior; None where there is
        neither.
    expansions : of the runs.
    """

    problem: Problem
    columns: IntArray
    terms: tuple[RunTerm, ...]
    weight: Measure | None
    expansions: Sequence[Expansion] = ()

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

    def with_steps(self, points: FloatArray) -> Marginal:
        """With steps to the modes of all runs at each draw, if polynomials would distort the
        density at `points` (n_point, n_sampled), which reach into the tails.

        The errors of the runs occur at the same points, so that small ones add up.
        """
        points = points[np.isfinite(self.log_prior(points))]
        careful = replace(self, expansions=[replace(e, rough=True) for e in self.expansions])
        log_p, by_run = careful.terms_at(points, n_node=1)
        height = log_p + np.sum(by_run, axis=0)
        near = height > np.max(height, initial=-np.inf) - _DEEP
        missed = self.log_density(points[near]) - height[near]
        return self if np.std(missed) < _MISSED else careful

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
    ) -> tuple[FloatArray, FloatArray]:
        """`log_prior` (n_draw,) of the sampled parameters, -inf outside its support, and the
        marginal (n_run, n_draw) of every run, 0 there.
        """
        log_p = self.log_prior(shared)
        inside = np.flatnonzero(np.isfinite(log_p))
        by_run = np.zeros((len(self.terms), shared.shape[0]))
        for i, (term, expansion) in enumerate(zip(self.terms, self.expansions, strict=True)):
            if progress is not None:
                progress(0, phrase("run {k} of {n}", k=i + 1, n=len(self.terms)))
            by_run[i, inside] = term.log_marginal(
                self.given(term, shared[inside]), expansion, n_node=n_node
            )
        return log_p, by_run

    def log_density(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log p(y, s) in Laplace's approximation; -inf outside the priors' support."""
        log_p, by_run = self.terms_at(draws, n_node=1)
        return log_p + np.sum(by_run, axis=0)
