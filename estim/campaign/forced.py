"""The unmodelled force of a campaign: what the key `unmodelled_force` says of a run, where it may
stand, and the fit with it.

Where nothing is said it stands beside the curve of every run that it goes with; elsewhere the curve
is taken as complete, and the reason is kept.  Two fits: one with white errors and a free start,
which follows the data; one with the noise that `estim.deviation` makes at it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray
from estim.campaign.levels import Level, Levels
from estim.campaign.points import Observed
from estim.campaign.shared_force import MOST_POINTS, sharing_runs
from estim.common import Finding, InputError, Kind, NumericalError, later, phrase
from estim.deviation import (
    FORCE_SCALE,
    BadFrames,
    FreeStart,
    Rows,
    Trajectory,
    bad_frames,
    by_itself,
    pose_forces,
)
from estim.fitting import Fit, fit_least_squares, refit, scanned_fit
from estim.problem import Observations, Problem
from estim.reading import Run
from estim.sampling import MAX_PARAMETERS

KEY = "unmodelled_force"
# of fits in which bad frames are looked for; sds by which the last of them may move
_ROUNDS, _STILL = 6, 0.1
_LARGEST = 1.0  # a force as large as the weight is no small thing that was left out


@dataclass(frozen=True, eq=False)
class Circumstances:
    """What decides whether a force can stand beside the curve of a run.

    joint : whether the run is fit together with others.
    tied : number of points of those that would share its force, 0 where it shares none.
    replaced : whether its noise is not the one that the campaign states.
    """

    observed: Observed
    joint: bool
    tied: int
    replaced: bool

    @property
    def inferred(self) -> str:
        """The first size of the noise that is inferred, "" where all are stated."""
        return next((name.partition("[")[0] for name in self.observed.noise.parameters), "")

    @property
    def named(self) -> dict[str, object]:
        """What the words of an obstacle may name."""
        return {"inferred": self.inferred, "tied": self.tied, "most": MOST_POINTS}


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Where a force does not go.  what : it does not go with.  instead : what to do where one was
    asked for.
    """

    stands: Callable[[Circumstances], bool]
    what: str
    instead: str


OBSTACLES = (
    Obstacle(
        lambda c: c.observed.noise.robust,
        later("'robust' noise"),
        "omit it: in a fit with a force single bad frames are detected and named",
    ),
    Obstacle(
        lambda c: bool(np.any(c.observed.noise.x_gain() > 0.0)),
        later("errors of the positions of independent speeds"),
        "take their standard deviation out",
    ),
    Obstacle(
        lambda c: bool(c.inferred),
        later("a '{inferred}' that is inferred, which would absorb the force"),
        "state the error of the instrument, or omit it",
    ),
    Obstacle(lambda c: c.replaced, later("a comparison of noise models"), "set it to 0 for that"),
    Obstacle(
        lambda c: c.joint and c.observed.positions,
        later("noise model 'positions' in a joint fit yet"),
        "fit the runs one by one",
    ),
    Obstacle(
        lambda c: c.tied > MOST_POINTS,
        later("runs that share it and have {tied} points, more than {most}"),
        "fit fewer runs, or state it for each run, which gives each a force of its own",
    ),
)


@dataclass(frozen=True, eq=False)
class Stance:
    """scale : of the prior of a force, in units of the weight, 0 for none.  complete : why there is
    none; None where there is one.
    """

    scale: float
    complete: Finding | None = None


def force_scale(levels: Levels, circumstances: Circumstances) -> Stance:
    """Whether a force stands beside the curve of a run, and how large it may be: as stated, else
    the default wherever nothing is in its way.

    Raises InputError at the key's line where one is asked for that has an obstacle, or is no share
    of the weight.
    """
    level = _stated(levels)
    stated = None if level is None else level.table.unmodelled_force
    if stated == 0.0:
        return Stance(0.0, complete_as(phrase("as stated"), levels.run.name))
    obstacle = next((obstacle for obstacle in OBSTACLES if obstacle.stands(circumstances)), None)
    if level is None or stated is None:
        if obstacle is None:
            return Stance(FORCE_SCALE)
        reason = phrase(
            "an unmodelled force cannot be combined with {what}",
            what=phrase(obstacle.what, **circumstances.named),
        )
        return Stance(0.0, complete_as(reason, levels.run.name))
    scale = float(stated)
    if not (math.isfinite(scale) and 0.0 < scale <= _LARGEST):
        raise _error(
            levels,
            level,
            "is a share of the weight: it must lie between 0 (none) and 1; where nothing "
            "is said it is 0.02",
            value=scale,
        )
    if obstacle is not None:
        raise _error(
            levels,
            level,
            f"does not go with {obstacle.what.format(**circumstances.named)}: {obstacle.instead}",
        )
    return Stance(scale)


def possible_force(levels: Levels, circumstances: Circumstances) -> Stance:
    """The same for a comparison of models: as stated, the default also where 0 is stated; none
    where there is an obstacle.
    """
    level = _stated(levels)
    if (
        level is not None
        and not level.table.unmodelled_force
        and not any(obstacle.stands(circumstances) for obstacle in OBSTACLES)
    ):
        return Stance(FORCE_SCALE)
    return force_scale(levels, circumstances)


def complete_as(reason: str, run: str) -> Finding:
    """That the curve of a run is taken as complete, and why."""
    return Finding(Kind.CURVE_COMPLETE, run=run, names=(reason,))


def refuse_force(levels: Levels, command: str) -> None:
    """Raises InputError where a run has an unmodelled force, which `command` does not know."""
    level = _stated(levels)
    if level is not None and level.table.unmodelled_force:
        raise _error(
            levels,
            level,
            f"is not supported by {command}, which assumes that the curve is complete: set "
            "it to 0 for that",
        )


def as_complete(problem: Problem, command: str) -> Problem:
    """`problem` without the forces that nobody asked for, as `command` takes its curves."""
    reason = phrase("{command} does not support an unmodelled force", command=command)
    runs = (
        replace(run, force=0.0, complete=complete_as(reason, run.name)) if run.force else run
        for run in problem.runs
    )
    return replace(problem, runs=tuple(runs))


def fit_with_forces(
    white: Fit,
    tables: Mapping[str, Run],
    levels: Mapping[str, Levels],
    *,
    rng: np.random.Generator,
    scanned: bool = True,
) -> Fit:
    """The posterior mode with the unmodelled force of every run that has one, from the fit `white`
    without.

    scanned : whether further optima are looked for, where there are few parameters.  Where a run
        cannot be linearised the curves are taken as complete.  Raises InputError where its force
        was asked for.
    """
    problem = white.problem
    courses = {run.name: trajectory_of(run, tables[run.name]) for run in problem.runs if run.force}
    if white.singular:
        return _without_force(
            white,
            {name: levels[name] for name in courses},
            later("some combination of the parameters is not determined at all"),
        )
    try:
        free, bad = _free_fit(white, courses, rng=rng)
        without = np.sqrt(np.diag(white.cov))
        posed = pose_forces(
            sharing_runs(problem.runs, levels, KEY),
            courses,
            problem,
            free.values,
            without=without,
            bad=bad,
            alone=_alone(free) if len(problem.runs) > 1 else {},
        )
    except InputError as error:
        return _without_force(white, {name: levels[name] for name in courses}, error.rule)
    runs = tuple(replace(run, noise=posed.noises.get(run.name, run.noise)) for run in problem.runs)
    low, high = problem.support()
    start = np.clip(free.values + posed.step, low, high)
    fit = fit_least_squares(
        Problem(problem.parameters, runs, posed.shared), rng=rng, n_start=1, start=start
    )
    fit = scanned_fit(fit, rng=rng) if scanned and problem.n_par <= MAX_PARAMETERS else fit
    # of the many starts, of which the best led here
    message = white.message if fit.success else fit.message
    forces = posed.inferred_at(fit.values - free.values)
    return replace(
        fit,
        forces=forces,
        parts=posed.parts,
        symmetry=white.symmetry,
        n_start=white.n_start,
        n_same=white.n_same,
        message=message,
    )


def _without_force(white: Fit, levels: Mapping[str, Levels], rule: str) -> Fit:
    """The fit without forces, which cannot be linearised by `rule`.  Raises InputError where one
    was asked for.
    """
    for run_levels in levels.values():
        level = _stated(run_levels)
        if level is not None:
            raise _error(run_levels, level, f"cannot be linearised: {rule}")
    reason = phrase("an unmodelled force cannot be linearised: {rule}", rule=phrase(rule))
    runs = (
        replace(run, force=0.0, complete=complete_as(reason, run.name)) if run.force else run
        for run in white.problem.runs
    )
    return replace(
        white, posterior=replace(white.posterior, problem=replace(white.problem, runs=tuple(runs)))
    )


def _free_fit(
    white: Fit, courses: Mapping[str, Trajectory], *, rng: np.random.Generator
) -> tuple[Fit, Mapping[str, BadFrames]]:
    """The fit with a free start and the shifts of the frames that it shows to be bad, which are
    looked for again until they are the same.

    Frames of runs that are fit together are taken as good: each run by itself shows its bad ones.
    """
    problem = white.problem
    bad = {name: BadFrames() for name in courses}
    values = white.values
    for _ in range(_ROUNDS):
        noises = {
            run.name: FreeStart(run.noise, courses[run.name], bad[run.name])
            for run in problem.runs
            if run.force
        }
        runs = tuple(replace(run, noise=noises.get(run.name, run.noise)) for run in problem.runs)
        free = fit_least_squares(
            Problem(problem.parameters, runs), rng=rng, n_start=1, start=values
        )
        if len(problem.runs) > 1:
            return free, bad
        updated = {
            run.name: bad_frames(run, courses[run.name], problem, free.values, known=bad[run.name])
            for run in problem.runs
            if run.force
        }
        still = np.max(np.abs(free.values - values) / np.sqrt(np.diag(free.cov))) < _STILL
        if all(
            updated[name].same(bad[name]) and (still or not updated[name].jumps) for name in courses
        ):
            break
        bad, values = updated, free.values
    return free, updated


def _alone(free: Fit) -> Mapping[str, FloatArray]:
    """Run -> (n_par,) where its fit by itself ends, with its free start; what it does not depend
    on, and runs without such a fit, as they are.
    """
    optima = {}
    for run in free.problem.runs:
        alone = free.problem.restricted((by_itself(run, free.problem),))
        mine = np.array([free.names.index(name) for name in alone.names], dtype=np.int64)
        values = free.values.copy()
        with suppress(NumericalError):
            values[mine] = refit(alone, free.values[mine]).values
        optima[run.name] = values
    return optima


def trajectory_of(run: Observations, table: Run) -> Trajectory:
    """The motion of a run and its readings: all rows of the table where the points are made of
    them, else those that are fit.
    """
    t = table.columns.get("t_s")
    every = np.arange(run.n_obs)
    if run.t is None or t is None:
        return Trajectory(run.body, None, Rows(np.full(run.n_obs, np.nan), 0 * every, every))
    rows = np.searchsorted(t, run.t)
    if run.noise.made_of_positions:
        return Trajectory(run.body, table.columns[table.coordinate], Rows(t, table.lines, rows))
    return Trajectory(run.body, None, Rows(run.t, table.lines[rows], every))


def _stated(levels: Levels) -> Level | None:
    """The level that says how large a force may be, None where nothing is said."""
    return next((level for level in levels if getattr(level.table, KEY) is not None), None)


def _error(levels: Levels, level: Level, rule: str, *, value: object = None) -> InputError:
    return levels.error(rule, (*level.path, KEY), value=value)
