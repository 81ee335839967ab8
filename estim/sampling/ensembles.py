"""Ensembles of walkers that never see each other and move together: emcee's sampler and moves, with
one call of the density for all of them.

The only file that imports emcee.
"""

from __future__ import annotations

import emcee
import numpy as np

from estim.arrays import FloatArray
from estim.common import NumericalError
from estim.sampling.independence_moves import IndependenceMoves, Moves
from estim.sampling.log_density import Density

_RUNAWAY = (
    "the walkers run away to infinity: neither the data nor a prior hold every parameter, "
    "so that no posterior exists to draw from; "
    "give limits (low, high) or a prior"
)


class Apart(emcee.moves.RedBlueMove):  # type: ignore[misc]
    """A red-blue move of emcee that each of `n_ensemble` ensembles makes by itself; they lie one
    after the other, of even and equal size.

    Every second walker moves by the others, then the others by these.  emcee shuffles the halves at
    each step; here they stay, as the walkers of an ensemble must.
    """

    def __init__(self, move: emcee.moves.RedBlueMove, n_ensemble: int) -> None:
        # the number of walkers in an ensemble is `sample_posterior`'s to choose
        super().__init__(randomize_split=False, live_dangerously=True)
        self.move, self.n_ensemble = move, n_ensemble

    def setup(self, coords: FloatArray) -> None:
        self.move.setup(coords)

    def get_proposal(
        self, sample: FloatArray, complement: list[FloatArray], random: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray]:
        halves = zip(
            np.split(sample, self.n_ensemble),
            np.split(np.concatenate(complement), self.n_ensemble),
            strict=True,
        )
        proposed = [self.move.get_proposal(half, [other], random) for half, other in halves]
        return np.concatenate([points for points, _ in proposed]), np.concatenate(
            [factors for _, factors in proposed]
        )


def sampler_of(
    density: Density, shape: tuple[int, int], independence: IndependenceMoves, *, seed: int
) -> emcee.EnsembleSampler:
    """A sampler of all walkers.  shape : (n_ensemble, n_walker).  independence : its
    independent moves.
    """
    moves = [
        (emcee.moves.DEMove(), 0.8),
        (emcee.moves.DEMove(gamma0=1.0), 0.1),
        (emcee.moves.StretchMove(), 0.1),
    ]
    others = [(Apart(move, shape[0]), share) for move, share in moves]
    sampler = emcee.EnsembleSampler(
        shape[0] * shape[1],
        len(density.names),
        density.log_density,
        vectorize=True,
        moves=Moves(independence, others),
    )
    # as it is: the one that emcee makes of it prints a traceback where a signal ends it
    sampler.log_prob_fn = density.log_density
    # emcee would start from NumPy's global state
    sampler.random_state = np.random.RandomState(seed).get_state()
    return sampler


class EnsembleRun:
    """The walkers of all ensembles on their way from `starts` (n_ensemble, n_walker, n_par)."""

    def __init__(self, sampler: emcee.EnsembleSampler, starts: FloatArray) -> None:
        self._sampler, self._shape = sampler, starts.shape[:2]
        self._state = emcee.State(starts.reshape(-1, starts.shape[-1]))

    def advance(self, n_step: int) -> None:
        """Bring the walkers to `n_step` steps.  Raises NumericalError where they run away, so that
        there is no posterior.
        """
        try:
            for state in self._sampler.sample(
                self._state,
                iterations=n_step - self._sampler.iteration,
                skip_initial_state_check=True,
            ):
                self._state = state
        except ValueError:  # of emcee, where a walker moves to infinity
            if np.max(np.abs(self._state.coords)) < 1e100:
                raise
            raise NumericalError(_RUNAWAY) from None

    @property
    def draws(self) -> FloatArray:
        """(n_ensemble, n_step, n_walker, n_par) since the start."""
        return self._by_ensemble(self._sampler.get_chain())

    @property
    def log_density(self) -> FloatArray:
        """(n_ensemble, n_step, n_walker) of them."""
        return self._by_ensemble(self._sampler.get_log_prob())

    @property
    def accepted(self) -> FloatArray:
        """(n_ensemble, n_walker) moves accepted since the start."""
        return self._sampler.backend.accepted.reshape(self._shape)

    def _by_ensemble(self, steps: FloatArray) -> FloatArray:
        """(n_ensemble, n_step, n_walker, ...) of steps (n_step, n_ensemble * n_walker, ...)."""
        return np.ascontiguousarray(
            np.moveaxis(steps.reshape(len(steps), *self._shape, *steps.shape[2:]), 1, 0)
        )
