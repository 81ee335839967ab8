"""The unmodelled force of a campaign: what the key `unmodelled_force` says of a run, where it may stand, and the fit with it.

Two fits: one with white errors and a free start, which follows the data; one with the noise that `estim.deviation` makes at it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from estim.campaign.levels import Level, Levels
from estim.campaign.points import Observed
from estim.common import InputError
from estim.deviation import BadFrames, Course, FreeStart, Rows, bad_frames, pose_force
from estim.fitting import Fit, fit_least_squares, scanned_fit
from estim.problem import Observations, Problem
from estim.reading import Run
from estim.sampling import MAX_PARAMETERS

KEY = "unmodelled_force"
_ROUNDS, _STILL = 6, 0.1  # of fits in which bad frames are looked for; sds by which the last of them may move
_LARGEST = 1.0  # a force as large as the weight is no small thing that was left out


def force_scale(levels: Levels, observed: Observed, *, joint: bool, replaced: bool) -> float:
    """Scale of the prior of an unmodelled force in units of the weight, 0 for none.

    joint : whether the run is fit together with others.  replaced : whether its noise is not the one that the campaign states.
    Raises InputError at the key's line where it does not go with the noise of the run, or is no share of the weight.
    """
    level = next((level for level in levels if getattr(level.table, KEY) is not None), None)
    if level is None or not level.table.unmodelled_force:
        return 0.0
    scale = float(level.table.unmodelled_force)
    if not (math.isfinite(scale) and 0.0 < scale <= _LARGEST):
        raise _error(levels, level, "is a share of the weight: it must lie between 0 (none) and 1; 0.02 is a good choice", value=scale)
    if observed.noise.robust:
        raise _error(levels, level, "does not go with 'robust' noise: it takes the errors of the readings as normal")
    if np.any(observed.noise.x_gain() > 0.0):
        raise _error(levels, level, "does not go with errors of the positions of independent speeds: take their standard deviation out")
    if observed.noise.parameters:
        name = observed.noise.parameters[0].partition("[")[0]
        rule = f"does not go with a '{name}' that is inferred, which would swallow the force: state what the instrument does, or leave it out"
        raise _error(levels, level, rule)
    if replaced:
        raise _error(levels, level, "does not go with a comparison of noise models: set it to 0 for that")
    if joint:
        raise _error(levels, level, "does not go with a joint fit yet, which needs a force that runs share: fit the runs one by one")
    return scale


def refuse_force(levels: Levels, command: str) -> None:
    """Raises InputError where a run has an unmodelled force, which `command` does not know."""
    level = next((level for level in levels if getattr(level.table, KEY) is not None), None)
    if level is not None and level.table.unmodelled_force:
        raise _error(levels, level, f"does not go with {command}, which takes the curve as complete: set it to 0 for that")


def fit_with_forces(white: Fit, tables: Mapping[str, Run], levels: Mapping[str, Levels], *, rng: np.random.Generator) -> Fit:
    """The posterior mode with the unmodelled force of every run that has one, from the fit `white` without.  Raises InputError."""
    problem = white.problem
    courses = {run.name: _course(run, tables[run.name]) for run in problem.runs if run.force}
    try:
        free, bad = _free_fit(white, courses, rng=rng)
        without = np.sqrt(np.diag(white.cov))
        forced = [run for run in problem.runs if run.force]
        posed = {run.name: pose_force(run, courses[run.name], problem, free.values, without=without, bad=bad[run.name]) for run in forced}
    except InputError as error:
        name = next(iter(courses))
        raise levels[name].error(f"cannot be linearised: {error.rule}; end the window before the body comes to rest", _path(levels[name])) from None
    runs = tuple(replace(run, noise=posed[run.name].noise) if run.force else run for run in problem.runs)
    low, high = problem.support()
    start = np.clip(free.values + sum(one.step for one in posed.values()), low, high)
    fit = fit_least_squares(Problem(problem.parameters, runs), rng=rng, n_start=1, start=start)
    fit = scanned_fit(fit, rng=rng) if problem.n_par <= MAX_PARAMETERS else fit
    return replace(fit, forces=tuple(one.found_at(fit.values - free.values) for one in posed.values()), symmetry=white.symmetry)


def _free_fit(white: Fit, courses: Mapping[str, Course], *, rng: np.random.Generator) -> tuple[Fit, Mapping[str, BadFrames]]:
    """The fit with a free start and the shifts of the frames that it shows to be bad, which are looked for again until they are the same."""
    problem = white.problem
    bad = {name: BadFrames() for name in courses}
    values = white.values
    for _ in range(_ROUNDS):
        noises = {run.name: FreeStart(run.noise, courses[run.name], bad[run.name]) for run in problem.runs if run.force}
        runs = tuple(replace(run, noise=noises.get(run.name, run.noise)) for run in problem.runs)
        free = fit_least_squares(Problem(problem.parameters, runs), rng=rng, n_start=1, start=values)
        found = {run.name: bad_frames(run, courses[run.name], problem, free.values, known=bad[run.name]) for run in problem.runs if run.force}
        still = np.max(np.abs(free.values - values) / np.sqrt(np.diag(free.cov))) < _STILL
        if all(found[name].same(bad[name]) and (still or not found[name].jumps) for name in courses):
            break
        bad, values = found, free.values
    return free, found


def _course(run: Observations, table: Run) -> Course:
    """The motion of a run and its readings: all rows of the table where the points are made of them, else those that are fit."""
    t = table.columns.get("t_s")
    every = np.arange(run.n_obs)
    if run.t is None or t is None:
        return Course(run.body, None, Rows(np.full(run.n_obs, np.nan), 0 * every, every))
    kept = np.searchsorted(t, run.t)
    if run.noise.made_of_positions:
        return Course(run.body, table.columns[table.coordinate], Rows(t, table.lines, kept))
    return Course(run.body, None, Rows(run.t, table.lines[kept], every))


def _path(levels: Levels) -> tuple[str | int, ...]:
    return next((*level.path, KEY) for level in levels if getattr(level.table, KEY) is not None)


def _error(levels: Levels, level: Level, rule: str, *, value: object = None) -> InputError:
    return levels.error(rule, (*level.path, KEY), value=value)
