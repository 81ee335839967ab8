"""Ensembles that advance together, kept on disk as they go, stopped where it is safe, and resumed bit for bit.

It drives samplers that `estim.sampling.chain` made (emcee's, whose chain lies in `sampler.backend`), one step of each in turn, so
that every ensemble has the same number of steps at any moment at which the chain may be cut.  An ensemble has its own
random numbers: the order of the ensembles changes nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, Interrupted
from estim.sampling.checkpoint import Record, Store
from estim.sampling.chunk import Chunk
from estim.sampling.keys import sampling_key

Stop = Callable[[], bool]
"""Called after every step; true asks sampling to save and end."""

_SPREAD = 1000  # draws of the whole chain that are computed again
_SAME = 1e-8  # relative: the log density of the same draw in a batch of another size differs by rounding


@dataclass(frozen=True, eq=False)
class _State:
    """Where a sampler goes on; what emcee asks of a state."""

    coords: FloatArray
    log_prob: FloatArray
    random_state: tuple[Any, ...]
    blobs: None = None


class Walk:
    """The ensembles on their way; `n_step` is how far they are."""

    def __init__(self, samplers: Sequence[Any], starts: Sequence[Any], *, record: Record | None, stop: Stop | None) -> None:
        self._samplers, self._states, self._record, self._stop = list(samplers), list(starts), record, stop
        self.n_step = 0

    def advance(self, n_step: int) -> None:
        """Bring every ensemble to `n_step` steps: those that are kept first, then new ones, which are kept when this returns.

        Raises Interrupted when asked to stop, with everything kept up to the last step; EstimError where it cannot be written.
        """
        self._replay(n_step)
        walks = [
            sampler.sample(state, iterations=n_step - self.n_step, skip_initial_state_check=True)
            for sampler, state in zip(self._samplers, self._states, strict=True)
        ]
        while self.n_step < n_step:
            self._states = [next(walk) for walk in walks]
            self.n_step += 1
            stopping = self._stop is not None and self._stop()
            if self._record is not None and (stopping or self.n_step == n_step or self._record.due()):
                self._record.append(self._chunk(self._record.n_step))
            if stopping:
                raise Interrupted
        for walk in walks:
            walk.close()

    def _replay(self, n_step: int) -> None:
        """Put kept steps into the samplers, up to `n_step`; where they end, the samplers are as they were then."""
        saved = None if self._record is None else self._record.saved
        if saved is None or self.n_step >= saved.n_step:
            return
        first, last = self.n_step, min(n_step, saved.n_step)
        for i, sampler in enumerate(self._samplers):
            backend = sampler.backend
            backend.grow(last - first, None)
            backend.chain[first:last] = saved.draws[i, first:last]
            backend.log_prob[first:last] = saved.log_density[i, first:last]
            backend.accepted[:] = saved.accepted[i]
            backend.iteration = last
        if last == saved.n_step:
            self._states = [_State(saved.draws[i, -1], saved.log_density[i, -1], saved.random_state(i)) for i in range(len(self._samplers))]
        self.n_step = last

    def _chunk(self, first: int) -> Chunk:
        """The steps from `first` on, with the samplers as they are."""
        samplers = self._samplers
        states = [sampler.random_state for sampler in samplers]
        return Chunk(
            draws=np.stack([sampler.get_chain(discard=first) for sampler in samplers]),
            log_density=np.stack([sampler.get_log_prob(discard=first) for sampler in samplers]),
            accepted=np.stack([sampler.backend.accepted for sampler in samplers]),
            random_key=np.stack([state[1] for state in states]),
            random_place=np.array([[state[2], state[3]] for state in states], dtype=np.int64),
            random_normal=np.array([state[4] for state in states], dtype=np.float64),
        )


def start_walk(
    density: Any, samplers: Sequence[Any], starts: Sequence[Any], *, target: Any, rng: np.random.Generator, store: Store | None, stop: Stop | None
) -> Walk:
    """A walk from `starts` (for each ensemble (n_walker, n_par), or a state of emcee's), or from where `store` can resume it.

    target : the record of settings, any dataclass.  Raises InputError where the store holds a chain that depends on anything
    else, or whose log densities are not those of `density`: emcee trusts stored values, so every walker would freeze.
    """
    if store is None:
        return Walk(samplers, starts, record=None, stop=stop)
    points = [np.asarray(getattr(start, "coords", start)) for start in starts]
    settings = {**dataclasses.asdict(target), "n_ensemble": len(points), "n_walker": points[0].shape[0], "n_par": points[0].shape[1]}
    moves = [(sampler._moves, sampler._weights) for sampler in samplers]
    key = sampling_key(density, settings=settings, moves=moves, rng=rng, starts=points)
    record = store.record(key, accept=lambda folder, saved: _check_density(density, saved, folder))
    return Walk(samplers, starts, record=record, stop=stop)


def _check_density(density: Any, saved: Chunk, folder: Path) -> None:
    """Raises InputError where the log densities of the last walkers, of the largest and smallest values and of draws in between are others."""
    draws, log_density = saved.draws.reshape(-1, saved.draws.shape[-1]), saved.log_density.ravel()
    last = np.arange(log_density.size).reshape(saved.log_density.shape)[:, -1].ravel()
    between = np.linspace(0, log_density.size - 1, min(_SPREAD, log_density.size)).astype(int)
    chosen = np.unique(np.concatenate([last, between, np.argmin(draws, axis=0), np.argmax(draws, axis=0)]))
    stored = log_density[chosen]
    apart = np.abs(density.log_density(draws[chosen]) - stored)
    if not np.all(apart <= _SAME * np.maximum(1.0, np.abs(stored))):
        rule = "cannot continue: the log density of the stored walkers has changed; fit without --resume to start anew (largest change"
        raise InputError(f"{rule} {np.max(apart):.3g})", field="resume", file=folder)
