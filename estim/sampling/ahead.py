"""Independent moves of a chain, drawn and evaluated ahead: those of many steps and all walkers in one batch.

An independence move proposes what does not depend on where a walker is (Tierney, Ann. Stat. 22 (1994) 1701), so that its density can be
computed before.  Which steps make such a move, and what they propose, follow from a seed and the number of the step alone: a chain that is
taken up again goes on as it would have.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.sampling.proposal import Proposal
from estim.sampling.protocol import Density, log_density_in_batches

STEPS_AHEAD = 20  # a block
_MOST_AGAIN = 20  # times that draws beyond the support are drawn; what is beyond it after that is a move that no walker makes


@dataclass(frozen=True, eq=False)
class _Block:
    """Proposals of some steps; n_move of them independent.

    place : (STEPS_AHEAD,) which of the moves a step makes, -1 for none.  points : (n_move, n_walker, n_par).
    log_density, log_proposal : (n_move, n_walker), of what is sampled and of the proposal.
    """

    number: int
    place: NDArray[np.int64]
    points: FloatArray
    log_density: FloatArray
    log_proposal: FloatArray


@dataclass(eq=False)
class Ahead:
    """What independence moves propose at each step.

    share : of the steps that make such a move.  n_walker : of all ensembles.  seed : of all proposals.
    """

    proposal: Proposal
    share: float
    n_walker: int
    seed: int
    density: Density = field(compare=False)  # no part of the moves: a chain's key holds it by itself
    _block: _Block | None = field(default=None, compare=False)

    def at(self, step: int) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Points (n_walker, n_par), their log densities and those of the proposal; None where `step` makes another move."""
        number, within = divmod(step, STEPS_AHEAD)
        if self._block is None or self._block.number != number:
            self._block = self._drawn(number)
        block, place = self._block, self._block.place[within]
        return None if place < 0 else (block.points[place], block.log_density[place], block.log_proposal[place])

    def _drawn(self, number: int) -> _Block:
        rng = np.random.default_rng([self.seed, number])
        chosen = rng.random(STEPS_AHEAD) < self.share
        n_move = int(np.sum(chosen))
        points, log_density = self._inside(rng, n_move * self.n_walker)
        shape = (n_move, self.n_walker)
        log_proposal = self.proposal.log_density(points)
        place = np.where(chosen, np.cumsum(chosen) - 1, -1)
        return _Block(number, place, points.reshape(*shape, self.proposal.n_par), log_density.reshape(shape), log_proposal.reshape(shape))

    def _inside(self, rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
        """Draws (n, n_par) of the proposal and their log densities (n,); those beyond the support are drawn again.

        Inside the support that is the same proposal but for a factor, which a ratio of two of its densities does not have.
        """
        points, log_density = np.empty((n, self.proposal.n_par)), np.full(n, -np.inf)
        outside = np.arange(n)
        for _ in range(_MOST_AGAIN):
            if outside.size == 0:
                break
            points[outside] = self.proposal.draw(rng, outside.size)
            log_density[outside] = log_density_in_batches(self.density, points[outside])
            outside = outside[np.isneginf(log_density[outside])]
        return points, log_density


@dataclass(eq=False)
class Moves:
    """The moves of the walkers, as emcee asks for them: independent ones where `ahead` has them, else one of `others`.

    others : moves with their probabilities, sum 1.  n_step : of the steps that the chain has made.
    """

    ahead: Ahead
    others: Sequence[tuple[Any, float]]
    n_step: Callable[[], int] = field(compare=False)
    _known: tuple[FloatArray, FloatArray] | None = field(default=None, compare=False)  # where walkers were, log densities of the proposal there

    def propose(self, model: Any, state: Any) -> tuple[Any, NDArray[np.bool_]]:
        """The state after one step, and which walkers moved."""
        proposed = self.ahead.at(self.n_step())
        if proposed is None:
            which = model.random.choice(len(self.others), p=[weight for _, weight in self.others])
            return self.others[which][0].propose(model, state)
        points, log_density, log_proposal = proposed
        before = self._log_proposal(state.coords)
        ratio = log_density - log_proposal
        accepted = np.log(model.random.rand(ratio.size)) < ratio - (state.log_prob - before)
        state.coords[accepted], state.log_prob[accepted] = points[accepted], log_density[accepted]
        self._known = state.coords.copy(), np.where(accepted, log_proposal, before)
        return state, accepted

    def _log_proposal(self, coords: FloatArray) -> FloatArray:
        """(n_walker,) log density of the proposal where the walkers are (n_walker, n_par); new only of those that other moves have moved."""
        if self._known is None:
            return self.ahead.proposal.log_density(coords)
        moved = np.any(coords != self._known[0], axis=1)
        found = self._known[1].copy()
        if np.any(moved):
            found[moved] = self.ahead.proposal.log_density(coords[moved])
        return found
