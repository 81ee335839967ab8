"""The information of each run of a joint fit about what the runs share, apart from the others: a
quadratic in copies of the shared parameters, one for each run; and all of it as measurements with
unit errors.  `estim.checks.consistency` tests whether one value fits all copies.

The information of a run with an unmodelled force is that of a fit of its own, where the mean of its
force over the track is part of the rolling resistance.  The joint fit gives each run a force of its
own with a mean: under that, runs whose resistances differ would never disagree.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag, eigh

from estim.arrays import FloatArray, IntArray, diagonal_scale, inverse_of
from estim.common import later
from estim.fitting import ALONE, Fit
from estim.problem import Group, parameters_of

PRIORS = later("stated values")
_LEAST_SHARE = 1e-3  # of the information in a direction: a source that has less has none
# the same beside what was stated, where a mixture was taken as one normal distribution, a few per
# cent of whose covariance mean nothing
LEAST_OF_MIXTURE = 0.1
# share of the information in a direction that comes from runs; below, it is known from what was
# stated
_LEAST_RUN_SHARE = 0.1


Quadratic = tuple[FloatArray, FloatArray]
"""Information (d, d) and score (d,) at the fit: minus log density = -score . u + u .
information . u/2 with u = s - fit.
"""


@dataclass(frozen=True, eq=False)
class LinearMeasurements:
    """Measurements t (n_row,) = design (n_row, n_shared) . s with unit errors, s common to all
    sources.

    moves : source -> (n_row, n) what values of its own would do to t, in directions that the runs
        constrain; no columns where it has next to no information.
    """

    t: FloatArray
    design: FloatArray
    moves: Mapping[str, FloatArray]

    def between(self, freed: Sequence[str], more: Sequence[str]) -> tuple[float, int]:
        """By how much the least squares fall where `more` sources than those `freed` have values of
        their own, and its degrees of freedom.
        """
        before, rank = self._least(freed)
        after, higher = self._least((*freed, *(name for name in more if name not in freed)))
        return (max(before - after, 0.0), higher - rank) if higher > rank else (0.0, 0)

    def _least(self, freed: Sequence[str]) -> tuple[float, int]:
        """The smallest sum of squares, and the number of unknowns that it is the smallest over."""
        unknown = np.hstack([self.design, *(self.moves[name] for name in freed)])
        basis, singular, _ = np.linalg.svd(unknown, full_matrices=False)
        basis = basis[:, singular > 1e-6]
        return float(np.sum((self.t - basis @ (basis.T @ self.t)) ** 2)), int(basis.shape[1])


@dataclass(frozen=True, eq=False)
class SourceCopies:
    """The information of some sources about the shared parameters, each source with a copy of its
    own: a quadratic in all the copies at the fit.

    sources : names.
    information, score : (n_source n_shared, n_source n_shared), (n_source n_shared,) as in
        `Quadratic`.
    """

    sources: tuple[str, ...]
    information: FloatArray
    score: FloatArray

    def of(self, name: str) -> IntArray:
        """Indices of the copy of a source."""
        d = self.score.size // len(self.sources)
        return np.arange(d) + d * self.sources.index(name)

    @cached_property
    def together(self) -> Quadratic:
        """With one value for all."""
        return _tied(self.information, self.score, len(self.sources))

    def alone(self, name: str) -> Quadratic:
        """The information of one source where the others may have any values."""
        mine = self.of(name)
        return fitted(
            self.information, self.score, mine, np.setdiff1d(np.arange(self.score.size), mine)
        )

    def without(self, name: str) -> Quadratic:
        """The information of the others together where this one may have any value."""
        mine = self.of(name)
        if len(self.sources) == 1:
            return np.zeros((mine.size, mine.size)), np.zeros(mine.size)
        return _tied(
            *fitted(
                self.information, self.score, np.setdiff1d(np.arange(self.score.size), mine), mine
            ),
            len(self.sources) - 1,
        )


def _tied(information: FloatArray, score: FloatArray, n: int) -> Quadratic:
    """A quadratic in `n` copies as one in their common value."""
    d = score.size // n
    return information.reshape(n, d, n, d).sum(axis=(0, 2)), score.reshape(n, d).sum(axis=0)


def fitted(
    information: FloatArray, score: FloatArray, retained: IntArray, free: IntArray
) -> Quadratic:
    """A quadratic in those `retained`, the `free` ones fitted (Schur complement); what nothing
    determines takes nothing with it.
    """
    if not free.size:
        return information[np.ix_(retained, retained)], score[retained]
    inverse = inverse_of(information[np.ix_(free, free)], rcond=ALONE)
    across = information[np.ix_(retained, free)] @ inverse
    return information[np.ix_(retained, retained)] - across @ information[
        np.ix_(free, retained)
    ], score[retained] - across @ score[free]


def copies_of(fit: Fit, group: Group, shared: IntArray) -> tuple[SourceCopies, ...]:
    """The runs of a group, each with its own values of the shared parameters; their own parameters
    of the curve fitted with their priors.
    """
    names = group.run_names
    force = next(
        (candidate for candidate in fit.forces if candidate.alone and candidate.runs == names), None
    )
    if force is None:
        return (_tied_copies(fit, group, shared),)
    problem = fit.problem
    pulls = problem.prior_information(fit.values)
    gradient = problem.prior_gradient(fit.values)
    moved, copies, stated = fit.values - force.about, [], copies_of_priors(fit, shared).information
    for run, (information, score) in zip(group.runs, force.alone, strict=True):
        nuisance = np.array(_own(fit, run.parameters, shared), dtype=np.int64)
        own = np.isin(np.arange(fit.values.size), nuisance)
        prior, pull = pulls * np.outer(own, own), -gradient * own
        alone = fitted(information + prior, score - information @ moved + pull, shared, nuisance)
        used = np.array([fit.names[i] in run.parameters for i in shared])
        mine = alone[0] * np.outer(used, used), alone[1] * used  # of the rest it holds rounding
        copies.append(SourceCopies((run.name,), *_informative_part(mine, stated)))
    return tuple(copies)


def _informative_part(alone: Quadratic, stated: FloatArray) -> Quadratic:
    """The information of a run, without the directions in which it has next to none beside what
    was `stated`.
    """
    information, score = alone
    root = _root(information + stated)
    shares, vectors = eigh(information, root @ root.T)
    informative = shares > LEAST_OF_MIXTURE
    shares, vectors = shares[informative], vectors[:, informative]
    columns = root @ root.T @ vectors
    return (columns * shares) @ columns.T, columns @ (vectors.T @ score)


def _root(matrix: FloatArray) -> FloatArray:
    """L with L L^T = `matrix` (n, n), but for rounding in directions that nothing determines."""
    scale = diagonal_scale(matrix)
    unit = matrix / np.outer(scale, scale) + ALONE * np.eye(len(matrix))
    return np.linalg.cholesky(unit) * scale[:, None]


def _own(fit: Fit, used: Collection[str], shared: IntArray) -> list[int]:
    """Indices of the parameters of the curve that are `used` and not shared."""
    noise = fit.problem.noise_names
    every = enumerate(fit.problem.parameters)
    return [
        i
        for i, p in every
        if p.name in used and i not in shared and p.name not in noise and not p.between
    ]


def _tied_copies(fit: Fit, group: Group, shared: IntArray) -> SourceCopies:
    """The runs of a group as its likelihood ties them."""
    problem = fit.problem
    common = [problem.names[i] for i in shared]
    named: dict[str, FloatArray] = problem.named(fit.values)
    runs, copied = [], []
    for run in group.runs:
        renamed = {name: f"{name} of {run.name}" for name in common}
        runs.append(run.renamed(renamed))
        copied += list(renamed.values())
        named |= {copy: named[name] for name, copy in renamed.items()}
    nuisance = _own(fit, parameters_of(group.runs), shared)
    jacobian, residuals = (
        Group(tuple(runs), group.shared)
        .likelihood(named)
        .scoring(named, [*copied, *(problem.names[i] for i in nuisance)])
    )
    slopes = np.hstack(
        [np.zeros((len(nuisance), len(copied))), fit.prior_jacobian[np.ix_(nuisance, nuisance)]]
    )
    rows = np.vstack([jacobian, slopes])
    z = np.append(residuals, fit.posterior.prior_residuals(fit.values)[nuisance])
    retained = np.arange(len(copied))
    alone = fitted(rows.T @ rows, -rows.T @ z, retained, np.arange(len(copied), rows.shape[1]))
    return SourceCopies(tuple(run.name for run in runs), *alone)


def copies_of_priors(fit: Fit, shared: IntArray) -> SourceCopies:
    """The priors of the shared parameters as residuals; a uniform one has no information."""
    problem = fit.problem
    information = problem.prior_information(fit.values)[np.ix_(shared, shared)]
    return SourceCopies((PRIORS,), information, -problem.prior_gradient(fit.values)[shared])


def total_of(quadratics: Sequence[Quadratic]) -> Quadratic:
    return np.asarray(sum(q[0] for q in quadratics)), np.asarray(sum(q[1] for q in quadratics))


def measurements(copies: Sequence[SourceCopies]) -> LinearMeasurements:
    """Quadratics as measurements with unit errors, in coordinates where all sources together have
    unit information.

    Sources may have values of their own only in directions in which the runs together add
    information to what was stated: in the others they cannot but agree, and would only add degrees
    of freedom.
    """
    total = total_of([copy.together for copy in copies])[0]
    # s = transform . coordinates
    transform = np.asarray(np.linalg.inv(_root(total)).T, dtype=np.float64)
    runs = [copy.together for copy in copies if copy.sources != (PRIORS,)]
    shares, vectors = np.linalg.eigh(transform.T @ total_of(runs)[0] @ transform)
    directions = vectors[:, shares > _LEAST_RUN_SHARE]
    blocks = [_block(copy, transform, directions) for copy in copies]
    above, n_row = 0, sum(t.size for t, _, _ in blocks)
    moves = {}
    for t, _, block_moves in blocks:
        for name, columns in block_moves.items():
            moves[name] = np.zeros((n_row, columns.shape[1]))
            moves[name][above : above + t.size] = columns
        above += t.size
    return LinearMeasurements(
        np.concatenate([t for t, _, _ in blocks]),
        np.vstack([design for _, design, _ in blocks]),
        moves,
    )


def _block(
    copies: SourceCopies, transform: FloatArray, directions: FloatArray
) -> tuple[FloatArray, FloatArray, dict[str, FloatArray]]:
    """t, design and moves of the sources of one quadratic, as far as they have information; the
    moves in `directions`.
    """
    every = block_diag(*[transform] * len(copies.sources))
    spectrum, vectors = np.linalg.eigh(every.T @ copies.information @ every)
    informative = spectrum > _LEAST_SHARE
    half = np.sqrt(spectrum[informative])
    rows = half[:, None] * vectors[:, informative].T
    t = vectors[:, informative].T @ (every.T @ copies.score) / half
    design, moves = np.zeros((t.size, transform.shape[1])), {}
    for name in copies.sources:
        mine = rows[:, copies.of(name)]
        design += mine
        shares, axes = np.linalg.eigh(
            directions.T @ transform.T @ copies.alone(name)[0] @ transform @ directions
        )
        moves[name] = mine @ (directions @ axes[:, shares > _LEAST_SHARE])
    return t, design, moves
