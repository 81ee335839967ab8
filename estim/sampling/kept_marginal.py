"""The stages of a marginal over runs on disk: the adapted proposal with the runs' expansions and the state of the random numbers, then run by run."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.common import Interrupted
from estim.fitting import Fit
from estim.sampling.chain import Progress
from estim.sampling.conditional import Expansion
from estim.sampling.keys import sampling_key
from estim.sampling.pieces import Pieces, PieceStore
from estim.sampling.proposal import Proposal
from estim.sampling.stepping import Stop

_OF_EXPANSION = ("centre", "whiten", "coefficients")


@dataclass(frozen=True)
class Stages:
    """What a marginal tells and keeps on its way.  pieces : where; None: nowhere.  name : of this attempt, in small letters and digits."""

    name: str = ""
    pieces: Pieces | None = None
    progress: Progress | None = None
    stop: Stop | None = None

    def say(self, message: str) -> None:
        """Tells a person what is being done.  Raises Interrupted where the work is to stop."""
        if self.progress is not None:
            self.progress(0, message)
        if self.stop is not None and self.stop():
            raise Interrupted

    def adapted(
        self, n_run: int, rng: np.random.Generator, adapt: Callable[[], tuple[Proposal, list[Expansion]]]
    ) -> tuple[Proposal, list[Expansion]]:
        """What `adapt` returns, or what it returned when it was kept; `rng` is then where it was after it."""
        kept = None if self.pieces is None else self.pieces.kept(f"{self.name}adapted")
        if kept is not None and set(kept) == set(_names(n_run)):
            rng.bit_generator.state = json.loads(kept["random"].tobytes())
            expansions = [
                Expansion(kept[f"centre{i}"], kept[f"whiten{i}"], kept[f"coefficients{i}"], int(kept[f"n_own{i}"]), float(kept[f"error{i}"]))
                for i in range(n_run)
            ]
            return Proposal(kept["weights"], kept["means"], kept["factors"]), expansions
        proposal, found = adapt()
        if self.pieces is not None:
            state = np.frombuffer(json.dumps(rng.bit_generator.state).encode(), dtype=np.uint8)
            arrays: dict[str, NDArray[Any]] = {"weights": proposal.weights, "means": proposal.means, "factors": proposal.factors, "random": state}
            for i, expansion in enumerate(found):
                arrays |= {f"{part}{i}": getattr(expansion, part) for part in _OF_EXPANSION}
                arrays |= {f"n_own{i}": np.array(expansion.n_own), f"error{i}": np.array(expansion.error)}
            self.pieces.keep(f"{self.name}adapted", arrays)
        return proposal, found

    def of_run(self, number: int, n_draw: int, compute: Callable[[], FloatArray]) -> FloatArray:
        """(n_draw,) what `compute` returns for a run, or what it returned when it was kept."""
        name = f"{self.name}run{number:06d}"
        kept = None if self.pieces is None else self.pieces.kept(name)
        if kept is not None and set(kept) == {"log"} and kept["log"].shape == (n_draw,) and kept["log"].dtype == np.float64:
            return kept["log"]
        found = compute()
        if self.pieces is not None:
            self.pieces.keep(name, {"log": found})
        return found


NOWHERE = Stages()


def _names(n_run: int) -> list[str]:
    return ["weights", "means", "factors", "random", *(f"{part}{i}" for part in (*_OF_EXPANSION, "n_own", "error") for i in range(n_run))]


def pieces_of(store: PieceStore, fit: Fit, rng: np.random.Generator, *, n_draw: int) -> Pieces:
    """The pieces of the marginal of a fit."""
    return store.under(sampling_key(fit.sampled, settings={"n_draw": n_draw}, moves="marginal", rng=rng, starts=[fit.values, fit.cov]))
