"""A chain that advances, kept on disk as it goes, stopped where it is safe, and resumed bit for bit.

It drives a sampler that `estim.sampling.ensembles` made (emcee's, whose chain lies in `sampler.backend`), in which the walkers of all ensembles
lie one after the other.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, Interrupted, NumericalError
from estim.sampling.checkpoint import Record, Store
from estim.sampling.chunk import Chunk
from estim.sampling.keys import sampling_key

Stop = Callable[[], bool]
"""Called after every step; true asks sampling to save and end."""

_RUNAWAY = (
    "the walkers run away to infinity: neither the data nor a prior hold every parameter, so that no posterior exists to draw from; "
    "give limits (low, high) or a prior"
)
_FAR = 1e100  # beyond, in any unit
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
    """The walkers on their way; `n_step` is how far they are."""

    def __init__(self, sampler: Any, starts: FloatArray, *, record: Record | None, stop: Stop | None) -> None:
        self._sampler, self._record, self._stop = sampler, record, stop
        self._shape = starts.shape[:2]
        self._state: Any = starts.reshape(-1, starts.shape[-1])
        self.n_step = 0

    @property
    def draws(self) -> FloatArray:
        """(n_ensemble, n_step, n_walker, n_par) since the start."""
        return self._apart(self._sampler.get_chain())

    @property
    def log_density(self) -> FloatArray:
        """(n_ensemble, n_step, n_walker) of them."""
        return self._apart(self._sampler.get_log_prob())

    @property
    def accepted(self) -> FloatArray:
        """(n_ensemble, n_walker) moves accepted since the start."""
        return np.asarray(self._sampler.backend.accepted.reshape(self._shape))

    def advance(self, n_step: int) -> None:
        """Bring the walkers to `n_step` steps: those that are kept first, then new ones, which are kept when this returns.

        Raises Interrupted when asked to stop, with everything kept up to the last step; EstimError where it cannot be written; NumericalError
        where the walkers run away, so that there is no posterior.
        """
        self._replay(n_step)
        walk = self._sampler.sample(self._state, iterations=n_step - self.n_step, skip_initial_state_check=True)
        while self.n_step < n_step:
            try:
                self._state = next(walk)
            except ValueError:  # of emcee, where a walker is asked to go to infinity
                if np.max(np.abs(self._state.coords)) < _FAR:
                    raise
                raise NumericalError(_RUNAWAY) from None
            self.n_step += 1
            stopping = self._stop is not None and self._stop()
            if self._record is not None and (stopping or self.n_step == n_step or self._record.due()):
                self._record.append(self._chunk(self._record.n_step))
            if stopping:
                raise Interrupted
        walk.close()

    def _replay(self, n_step: int) -> None:
        """Put kept steps into the sampler, up to `n_step`; where they end, the sampler is as it was then."""
        saved = None if self._record is None else self._record.saved
        if saved is None or self.n_step >= saved.n_step:
            return
        first, last = self.n_step, min(n_step, saved.n_step)
        backend = self._sampler.backend
        backend.grow(last - first, None)
        backend.chain[first:last] = self._together(saved.draws[:, first:last])
        backend.log_prob[first:last] = self._together(saved.log_density[:, first:last])
        backend.accepted[:] = saved.accepted.ravel()
        backend.iteration = last
        if last == saved.n_step:
            coords, log_prob = self._together(saved.draws[:, -1:])[0], self._together(saved.log_density[:, -1:])[0]
            self._state = _State(coords, log_prob, saved.random_state())
        self.n_step = last

    def _chunk(self, first: int) -> Chunk:
        """The steps from `first` on, with the sampler as it is."""
        _, key, *place, normal = self._sampler.random_state
        return Chunk(
            draws=self._apart(self._sampler.get_chain(discard=first)), log_density=self._apart(self._sampler.get_log_prob(discard=first)),
            accepted=self.accepted, random_key=key, random_place=np.array(place, dtype=np.int64), random_normal=np.array([normal]),
        )

    def _apart(self, steps: FloatArray) -> FloatArray:
        """(n_ensemble, n_step, n_walker, ...) of steps (n_step, n_ensemble * n_walker, ...)."""
        return np.ascontiguousarray(np.moveaxis(steps.reshape(len(steps), *self._shape, *steps.shape[2:]), 1, 0))

    def _together(self, steps: FloatArray) -> FloatArray:
        """The reverse of `_apart`."""
        return np.moveaxis(steps, 0, 1).reshape(steps.shape[1], -1, *steps.shape[3:])


def start_walk(
    density: Any, sampler: Any, starts: FloatArray, *, target: Any, rng: np.random.Generator, store: Store | None, stop: Stop | None
) -> Walk:
    """A walk from `starts` (n_ensemble, n_walker, n_par), or from where `store` can resume it.

    target : the record of settings, any dataclass.  Raises InputError where the store holds a chain that depends on anything
    else, or whose log densities are not those of `density`: emcee trusts stored values, so every walker would freeze.
    """
    if store is None:
        return Walk(sampler, starts, record=None, stop=stop)
    settings = {**dataclasses.asdict(target), **dict(zip(("n_ensemble", "n_walker", "n_par"), starts.shape, strict=True))}
    key = sampling_key(density, settings=settings, moves=(sampler._moves, sampler._weights), rng=rng, starts=starts)
    record = store.record(key, accept=lambda folder, saved: _check_density(density, saved, folder))
    return Walk(sampler, starts, record=record, stop=stop)


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
