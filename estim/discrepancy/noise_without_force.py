"""Noise as it stands beside an unmodelled force, without the force: for curves that are to be
compared with one that has it.

A force comes with room for the size of the readings' noise (`grid`) and with the shifts of bad
frames.  A curve without a force is compared with it on the same terms only where it has that room
too:

    L = sum_s w_s N(r | 0, s^2 C0 + H H^T),    H the shifts of bad frames

Runs that would share a force share the size of their noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray
from estim.discrepancy.bad_frame_search import BadFrames
from estim.discrepancy.grid import noise_grid
from estim.discrepancy.joint_runs import (
    Beside,
    Stack,
    Together,
    mixtures_of,
    noises_of,
    sharing_runs,
)
from estim.discrepancy.likelihood import MixtureErrors
from estim.discrepancy.noise_with_discrepancy import formed_about
from estim.discrepancy.residuals import stacked
from estim.discrepancy.scale_mixture import Shape
from estim.discrepancy.trajectory import Trajectory
from estim.problem import Named, Noise, Observations, Problem, StackedPoints, stacked_root


def pose_without_force(
    problem: Problem, values: FloatArray, *, bad: Mapping[str, BadFrames]
) -> tuple[Mapping[str, Noise], tuple[Together, ...]]:
    """Run -> its noise, and what ties runs together; made about `values` (n_par,), those of a fit
    with the stated noise.

    bad : run -> its bad frames, of runs that are fit alone.
    """
    stacks = [_stack(runs, problem, values, bad) for runs in sharing_runs(problem.runs).values()]
    linear = Beside.of(stacks, problem, values).linear
    return noises_of(stacks, linear, mixtures_of(stacks, linear))


def _stack(
    runs: tuple[Observations, ...],
    problem: Problem,
    values: FloatArray,
    bad: Mapping[str, BadFrames],
) -> Stack:
    named = problem.named(values)
    frames = bad.get(runs[0].name, BadFrames()) if len(runs) == 1 else BadFrames()
    points = StackedPoints(tuple(frames.moved(run.points) for run in runs))
    about = [
        formed_about(Trajectory.of(run), run.noise, own, named, scale=None)
        for run, own in zip(runs, points.runs, strict=True)
    ]
    formed = stacked([residuals for residuals, _ in about])
    return Stack(
        runs,
        frames,
        points,
        stacked_root([errors.root for _, errors in about]),
        (Shape("none", 1.0, np.zeros((points.y.size, 1)), 0.0),),
        noise_grid(),
        formed.at(points, named)[0],
        formed.gradient(points, named, problem.names),
        frames.columns(points.y.size),
        formed,
    )


def log_rescaled(errors: MixtureErrors, named: Named, *, scale: float, factor: float) -> FloatArray:
    """(n_draw,) log of the likelihood with a prior of the size of the force `factor` times as wide,
    over that with the one of `scale`.

    A component of amplitude a > 0 then counts exp{-a^2 (factor^-2 - 1)/(2 scale^2)}/factor times as
    much.
    """
    logs = errors.mixture.log_components(errors.raw(named))
    size = errors.mixture.deviation.column("amplitude") / scale
    heavier = np.where(
        size > 0.0, -0.5 * np.square(size) * (factor**-2 - 1.0) - np.log(factor), 0.0
    )
    return np.logaddexp.reduce(logs + heavier[:, None]) - np.logaddexp.reduce(logs)


def log_restarted(errors: MixtureErrors, named: Named, *, n_run: int, factor: float) -> FloatArray:
    """(n_draw,) log of the likelihood with free starts whose energies are `factor` times as wide
    beforehand, over that with them as they are.

    factor : 0 for exactly at rest.
    n_run : of the runs below each other, whose starts are the first columns.
    """
    size = np.ones(errors.mixture.columns.shape[1])
    size[:n_run] = factor
    residuals = errors.raw(named)
    moved = replace(errors.mixture, columns=errors.mixture.columns * size)
    return moved.log_likelihood(residuals) - errors.mixture.log_likelihood(residuals)
