"""Which frames are bad: outliers, where the noise leaves room for some (`robust`), and shifts that
were found beside an unmodelled force.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, IntArray, in_blocks
from estim.checks.unmodelled_force import LIKELY
from estim.common import Finding, Kind
from estim.discrepancy import FoundForce, Jump
from estim.problem import Likelihood, Posterior, Problem

_KINDS = {"frame": Kind.FRAME_OFF, "step": Kind.STEP_STAYS, "clock": Kind.FRAMES_LOST}


_BLOCK = 4_000_000  # values at once


@dataclass(frozen=True, eq=False)
class Outliers:
    """Posterior probability that each frame of a run is an outlier, (n_obs,), and the frames with
    more than one half.
    """

    run: str
    probability: FloatArray

    @property
    def frames(self) -> IntArray:
        """Indices of the frames that are named."""
        return np.flatnonzero(self.probability > LIKELY)


def find_outliers(posterior: Posterior, draws: FloatArray) -> tuple[Outliers, ...]:
    """One record for each run with robust noise, averaged over posterior draws (n_draw, n_par)."""
    if not posterior.problem.robust:
        return ()
    by_run = posterior.by_run(
        _average(likelihood, posterior.problem, draws) for likelihood in posterior.likelihoods
    )
    return tuple(
        Outliers(run.name, probability)
        for run, probability in zip(posterior.problem.runs, by_run, strict=True)
        if run.noise.robust
    )


def _average(likelihood: Likelihood, problem: Problem, draws: FloatArray) -> FloatArray:
    """(n_obs,) mean over draws."""

    def total(some: FloatArray) -> FloatArray:
        return likelihood.outlier_probability(problem.named(some)).sum(axis=0)[None]

    return in_blocks(total, draws, _BLOCK // problem.n_obs).sum(axis=0) / len(draws)


def bad_frame(run: str, unit: str, step: float, jump: Jump) -> Finding:
    """One bad frame.  unit : of readings.  step : of a digital reading, 0 where there is none."""
    counts = jump.size / step if step and jump.kind != "clock" else 0.0
    numbers = {
        "sd": jump.sd,
        "t": jump.t,
        "x": jump.x,
        "line": float(jump.line),
        "before": jump.before,
        "after": jump.after,
        "counts": counts,
        "frames": jump.size / jump.interval,
        "sd_frames": jump.sd / jump.interval,
    }
    return Finding(
        _KINDS[jump.kind],
        run=run,
        p=jump.probability,
        size=jump.size,
        numbers=numbers,
        names=(unit,),
    )


def bad_frames_found(force: FoundForce) -> tuple[Finding, ...]:
    """One finding for each bad frame of a run."""
    return tuple(
        bad_frame(force.run, force.reading_unit, force.step, jump) for jump in force.bad.jumps
    )


def too_many_bad_frames(force: FoundForce) -> tuple[Finding, ...]:
    """That there are more bad frames than can be single ones."""
    return (
        (Finding(Kind.FRAMES_CROWD, run=force.run, size=len(force.bad.jumps)),)
        if force.bad.crowd
        else ()
    )
