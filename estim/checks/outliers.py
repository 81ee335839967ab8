"""Which frames are bad: outliers, where the noise leaves room for some (`robust`), and shifts that were found beside an unmodelled force."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.common import Finding, Kind
from estim.deviation import FoundForce, Jump
from estim.problem import Posterior

NAMED = 0.5  # a frame is named as an outlier above this probability
_KINDS = MappingProxyType({"frame": Kind.FRAME_OFF, "step": Kind.STEP_STAYS, "clock": Kind.FRAMES_LOST})


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


def bad_frame(run: str, unit: str, step: float, jump: Jump) -> Finding:
    """One bad frame.  unit : of readings.  step : of a digital reading, 0 where there is none."""
    counts = jump.size / step if step and jump.kind != "clock" else 0.0
    numbers = {
        "sd": jump.sd, "t": jump.t, "x": jump.x, "line": float(jump.line), "before": jump.before, "counts": counts,
        "frames": jump.size / jump.interval, "sd_frames": jump.sd / jump.interval,
    }
    return Finding(_KINDS[jump.kind], run=run, p=jump.probability, size=jump.size, numbers=numbers, names=(unit,))


def bad_frames_found(found: FoundForce) -> tuple[Finding, ...]:
    """One finding for each bad frame of a run."""
    return tuple(bad_frame(found.run, found.reading_unit, found.step, jump) for jump in found.bad.jumps)


def too_many_bad_frames(found: FoundForce) -> tuple[Finding, ...]:
    """That there are more bad frames than can be single ones."""
    return (Finding(Kind.FRAMES_CROWD, run=found.run, size=len(found.bad.jumps)),) if found.bad.crowd else ()
