"""The fit of a model without an unmodelled force that is to be compared with one that has it: the
same points, noise and bad frames.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from estim.campaign.forced import KEY, trajectory_of
from estim.campaign.levels import Levels
from estim.campaign.shared_force import sharing_runs
from estim.deviation import BadFrames, pose_without_force
from estim.fitting import Fit, fit_least_squares, scanned_fit
from estim.problem import Problem
from estim.reading import Run
from estim.sampling import MAX_PARAMETERS

_ROUNDS = 2  # the noise is made again at its own fit: bad frames have pulled the first one


def fit_without_force(
    white: Fit,
    tables: Mapping[str, Run],
    levels: Mapping[str, Levels],
    *,
    bad: Mapping[str, BadFrames],
    rng: np.random.Generator,
) -> Fit:
    """The posterior mode under the noise that runs have beside a force, from the fit `white` with
    the stated noise.

    bad : run -> the frames that are shifted.  A fit that does not determine its parameters stays as
        it is.
    """
    if white.singular:
        return white
    problem, fit = white.problem, white
    groups = tuple(sharing_runs(problem.runs, levels, KEY).values())
    courses = {run.name: trajectory_of(run, tables[run.name]) for run in problem.runs}
    for _ in range(_ROUNDS):
        noises, shared = pose_without_force(groups, courses, problem, fit.values, bad=bad)
        runs = tuple(
            replace(run, noise=noises.get(run.name, run.noise), force=0.0) for run in problem.runs
        )
        fit = fit_least_squares(
            Problem(problem.parameters, runs, shared), rng=rng, n_start=1, start=fit.values
        )
    fit = scanned_fit(fit, rng=rng) if problem.n_par <= MAX_PARAMETERS else fit
    message = white.message if fit.success else fit.message
    return replace(
        fit, symmetry=white.symmetry, n_start=white.n_start, n_same=white.n_same, message=message
    )
