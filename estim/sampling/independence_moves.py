"""Independent moves of a chain, drawn and evaluated ahead: those of many steps and all walkers in
one batch.

An independence move proposes what does not depend on where a walker is (Tierney, Ann. Stat. 22
(1994) 1701), so that its density can be computed before.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

from estim.arrays import BoolArray, FloatArray
from estim.sampling.log_density import Density, log_density_in_batches
from estim.sampling.proposal import Proposal

STEPS_AHEAD = 20  # a block

Proposed = tuple[FloatArray, FloatArray, FloatArray]
"""Points (n_walker, n_par), their log densities (n_walker,) and those of the proposal
(n_walker,).
"""


@dataclass(frozen=True, eq=False)
class IndependenceMoves:
    """What independence moves propose.

    share : of the steps that make such a move.
    n_walker : of all ensembles.  seed : of all proposals.
    """

    proposal: Proposal
    share: float
    n_walker: int
    seed: int
    density: Density

    def steps(self) -> Iterator[Proposed | None]:
        """What each step proposes, without end; None where a step makes another move."""
        for block in count():
            rng = np.random.default_rng([self.seed, block])
            chosen = rng.random(STEPS_AHEAD) < self.share
            shape = int(np.sum(chosen)), self.n_walker
            points, log_density = self._inside(rng, shape[0] * shape[1])
            log_proposal = self.proposal.log_density(points)
            moves = zip(
                points.reshape(*shape, self.proposal.n_par),
                log_density.reshape(shape),
                log_proposal.reshape(shape),
                strict=True,
            )
            for independent in chosen:
                yield next(moves) if independent else None

    def _inside(self, rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
        """Draws (n, n_par) of the proposal and their log densities (n,); those beyond the support
        are drawn again.

        Inside the support that is the same proposal but for a factor, which a ratio of two of its
        densities does not have.
        """
        points, log_density = np.empty((n, self.proposal.n_par)), np.full(n, -np.inf)
        outside = np.arange(n)
        # times that draws beyond the support are drawn; what is beyond it after that is a move that
        # no walker makes
        for _ in range(20):
            if outside.size == 0:
                break
            points[outside] = self.proposal.draw(rng, outside.size)
            log_density[outside] = log_density_in_batches(self.density, points[outside])
            outside = outside[np.isneginf(log_density[outside])]
        return points, log_density


class Moves:
    """The moves of the walkers, as emcee calls them: independent ones where
    `independence` has them, else one of `others`.

    others : moves with their probabilities, sum 1.
    """

    def __init__(
        self, independence: IndependenceMoves, others: Sequence[tuple[Any, float]]
    ) -> None:
        self._proposal, self._others = independence.proposal, others
        self._steps = independence.steps()
        # log densities of the proposal where the walkers are, as far as known from the last step
        self._before: FloatArray | None = None

    def propose(self, model: Any, state: Any) -> tuple[Any, BoolArray]:
        """The state after one step, and which walkers moved."""
        proposed = next(self._steps)
        if proposed is None:
            self._before = None
            which = model.random.choice(len(self._others), p=[weight for _, weight in self._others])
            return self._others[which][0].propose(model, state)
        points, log_density, log_proposal = proposed
        before = self._before
        if before is None:
            before = self._before = self._proposal.log_density(state.coords)
        ratio = log_density - log_proposal
        accepted = np.log(model.random.rand(ratio.size)) < ratio - (state.log_prob - before)
        state.coords[accepted], state.log_prob[accepted] = points[accepted], log_density[accepted]
        before[accepted] = log_proposal[accepted]
        return state, accepted
