"""Which frames are outliers, where the noise leaves room for some (`robust`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.problem import Posterior

NAMED = 0.5  # a frame is named as an outlier above this probability


@dataclass(frozen=True, eq=False)
class Outliers:
    """Posterior probability that each frame of a run is an outlier, (n_obs,), and the frames with more than one half."""

    run: str
    probability: FloatArray

    @property
    def frames(self) -> NDArray[np.int64]:
        """Indices of the frames that are named."""
        return np.flatnonzero(self.probability > NAMED)


def find_outliers(posterior: Posterior, draws: FloatArray) -> tuple[Outliers, ...]:
    """One record for each run with robust noise, averaged over posterior draws (n_draw, n_par)."""
    named = posterior.problem.named(draws)
    by_run = posterior.by_run(likelihood.outlier_probability(named).mean(axis=0) for likelihood in posterior.likelihoods)
    return tuple(
        Outliers(run.name, probability)
        for run, probability in zip(posterior.problem.runs, by_run, strict=True) if run.noise.robust
    )
