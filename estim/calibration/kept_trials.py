"""Trials on disk, so that a calibration that was killed goes on with what it had."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.calibration.trial import PROBABILITIES, Plan, Trial
from estim.sampling import Key, Pieces, fingerprint, problem_key
from estim.versions import engine_versions


def trials_key(plan: Plan) -> Key:
    """What trials depend on; how many there are is no part of it."""
    return {
        **problem_key(plan.design.problem),
        "settings": {"what": plan.what, "engine": str(plan.engine), "reported": fingerprint(plan.reported)},
        "seed": {"": str(plan.seed)},
        "versions": engine_versions(),
        "density": {"": fingerprint((plan.design, plan.truth))},
    }


@dataclass(frozen=True)
class KeptTrials:
    """pieces : where they are.  n_reported : numbers of a trial."""

    pieces: Pieces
    n_reported: int

    def known(self, numbers: Sequence[int]) -> dict[int, Trial]:
        """Those of `numbers` that are kept whole."""
        found = {n: self._read(n) for n in numbers}
        return {n: trial for n, trial in found.items() if trial is not None}

    def keep(self, number: int, trial: Trial) -> None:
        words = json.dumps([trial.n_rejected, trial.how, trial.shortfall, trial.failure]).encode()
        arrays = {"truth": trial.truth, "rank": np.asarray(trial.rank, dtype=np.int64), "covered": trial.covered}
        self.pieces.keep(f"{number:06d}", {**arrays, "words": np.frombuffer(words, dtype=np.uint8)})

    def _read(self, number: int) -> Trial | None:
        arrays = self.pieces.kept(f"{number:06d}")
        if arrays is None or set(arrays) != {"truth", "rank", "covered", "words"}:
            return None
        shapes = {"truth": (self.n_reported,), "rank": (self.n_reported,), "covered": (self.n_reported, len(PROBABILITIES))}
        kinds = {"truth": np.float64, "rank": np.int64, "covered": np.bool_}
        if any(arrays[name].shape != shape or arrays[name].dtype != kinds[name] for name, shape in shapes.items()):
            return None
        n_rejected, how, shortfall, failure = json.loads(arrays["words"].tobytes())
        return Trial(arrays["truth"], arrays["rank"], arrays["covered"], int(n_rejected), str(how), str(shortfall), str(failure))
