"""The fit of bodies with an unmodelled force, and that of a model without one that is compared with
it: the same points, noise and bad frames.

Two fits: one with white errors and a free start, which follows the data; one with the noise that
`estim.discrepancy` makes at it.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray
from estim.common import Finding, InputError, Kind, NumericalError, later, phrase
from estim.discrepancy import (
    BadFrames,
    ForceSize,
    FreeStart,
    Trajectory,
    bad_frames,
    by_itself,
    expected_root,
    pose_forces,
    pose_without_force,
    sharing_runs,
)
from estim.fitting.fisher_information import information
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.fitting.optimum import scanned_fit
from estim.problem import Problem

FORCE_KEY = "unmodelled_force"
# of fits in which bad frames are looked for; sds by which the last of them may move
_ROUNDS, _STILL = 6, 0.1


def complete_as(reason: str, run: str) -> Finding:
    """That the curve of a run is taken as complete, and why."""
    return Finding(Kind.CURVE_COMPLETE, run=run, names=(reason,))


def taken_as_complete(problem: Problem, reason: str) -> Problem:
    """`problem` without its forces."""
    runs = (
        replace(run, force=0.0, complete=complete_as(reason, run.name)) if run.force else run
        for run in problem.runs
    )
    return replace(problem, runs=tuple(runs))


def fit_with_forces(white: Fit, *, rng: np.random.Generator, scanned: bool = True) -> Fit:
    """The posterior mode with the unmodelled force of every run that has one, from the fit `white`
    without.

    scanned : whether further optima are looked for, where there are few parameters.  Where a run
        cannot be linearised the curves are taken as complete.  Raises InputError where its force
        was asked for.
    """
    problem = white.problem
    if white.singular:
        return _as_complete(
            white, later("some combination of the parameters is not determined at all")
        )
    try:
        free, bad = _free_fit(white)
        without = white.scale
        posed = pose_forces(
            problem,
            free.values,
            without=without,
            bad=bad,
            alone=_alone(free) if len(problem.runs) > 1 else {},
        )
    except InputError as error:
        return _as_complete(white, error.rule)
    start = np.clip(posed.start, *problem.support())
    fit = fit_least_squares(problem.with_noises(posed.noises, posed.shared), start=start)
    fit = scanned_fit(fit, rng=rng) if scanned else fit
    forces = posed.inferred_at(problem, fit.values, fit.cov)
    return replace(_as_found(white, fit), forces=forces, parts=posed.parts)


def fit_without_force(white: Fit, *, bad: Mapping[str, BadFrames], rng: np.random.Generator) -> Fit:
    """The posterior mode under the noise that runs have beside a force, from the fit `white` with
    the stated noise.

    bad : run -> the frames that are shifted.  A fit that does not determine its parameters stays as
        it is.
    """
    if white.singular:
        return white
    problem, fit = white.problem, white
    # noise is made again at its own fit: bad frames have pulled the first one
    for _ in range(2):
        noises, shared = pose_without_force(problem, fit.values, bad=bad)
        runs = tuple(
            replace(run, noise=noises.get(run.name, run.noise), force=0.0) for run in problem.runs
        )
        fit = fit_least_squares(Problem(problem.parameters, runs, shared), start=fit.values)
    return _as_found(white, scanned_fit(fit, rng=rng))


def _as_found(white: Fit, fit: Fit) -> Fit:
    """`fit`, with what the search for `white` found."""
    message = white.message if fit.success else fit.message
    return replace(fit, symmetry=white.symmetry, message=message)


def _as_complete(white: Fit, rule: str) -> Fit:
    """The fit without forces, which cannot be linearised by `rule`.  Raises InputError where one
    was asked for.
    """
    for run in white.problem.runs:
        if run.force and run.asked:
            raise InputError(f"cannot be linearised: {rule}", field=f"{FORCE_KEY}[{run.name}]")
    reason = phrase("an unmodelled force cannot be linearised: {rule}", rule=phrase(rule))
    problem = taken_as_complete(white.problem, reason)
    return replace(white, posterior=replace(white.posterior, problem=problem))


def _free_fit(white: Fit) -> tuple[Fit, Mapping[str, BadFrames]]:
    """The fit with a free start and the shifts of the frames that it shows to be bad, which are
    looked for again until they are the same.

    Frames of runs that are fit together are taken as good: each run by itself shows its bad ones.
    """
    problem = white.problem
    bad = {run.name: BadFrames() for run in problem.runs if run.force}
    values = white.values
    for _ in range(_ROUNDS):
        noises = {
            run.name: FreeStart(run.noise, Trajectory.of(run), bad[run.name])
            for run in problem.runs
            if run.force
        }
        free = fit_least_squares(problem.with_noises(noises), start=values)
        if len(problem.runs) > 1:
            return free, bad
        updated = {
            run.name: bad_frames(run, problem, free.values, known=bad[run.name])
            for run in problem.runs
            if run.force
        }
        still = np.max(np.abs(free.values - values) / free.scale) < _STILL
        if all(
            updated[name].same(bad[name]) and (still or not updated[name].jumps) for name in bad
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
            values[mine] = fit_least_squares(alone, start=free.values[mine]).values
        optima[run.name] = values
    return optima


def expected_information(
    problem: Problem, values: FloatArray, sizes: Mapping[str, ForceSize]
) -> FloatArray:
    """(n_par, n_par) information at `values` (n_par,), priors included, that runs give with a force
    of known size beside their curves; runs that share a force give theirs together.

    sizes : run -> how large its force is; other runs have none.  Raises InputError where a force
        cannot be linearised, or does not go with these runs.
    """
    for run in problem.runs:
        if run.name in sizes and not run.force:
            raise InputError(
                f"would take the curve of {run.name} as complete: "
                f"{'; '.join(run.complete.names) if run.complete else 'no force'}"
            )
    without_force = tuple(run for run in problem.runs if run.name not in sizes)
    total = information(Problem(problem.parameters, without_force).linearised(values), values)
    for runs in sharing_runs([run for run in problem.runs if run.name in sizes]).values():
        size = next(
            (sizes[run.name] for run in runs if sizes[run.name].several), sizes[runs[0].name]
        )
        root = expected_root(runs, problem, values, size)
        total = total + root.T @ root
    return total
