"""Runs of a joint fit with unmodelled forces: what runs on one track share, and what each adds,
made once at a white fit with free starts.

    white fit -> the forces of each group of runs, linear about it -> how probable, beside what all
    other runs say -> noise that a chain samples under

Runs that share a force have one likelihood of all their points (`Together`): the force couples
them.  The track is that of the run that went farthest; places count from the release of each run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from estim.arrays import FloatArray
from estim.common import InputError, phrase
from estim.deviation.bad_frame_search import BadFrames
from estim.deviation.components import Deviation, diagonalise
from estim.deviation.errors import MixtureErrors
from estim.deviation.force import OWN, Response, Track, force_shapes, shared_force_shapes
from estim.deviation.generic import stated_is_conservative
from estim.deviation.grid import SCALES, prior_grid
from estim.deviation.inferred_force import OwnForce, find_force, find_own_force
from estim.deviation.linearised import Linearised, linearise
from estim.deviation.mixture import Mixture, keep_probable
from estim.deviation.noise import Stated, WithForce, formed_about
from estim.deviation.normal_parts import NormalParts as NormalParts
from estim.deviation.normal_parts import normal_parts
from estim.deviation.posing import (
    FoundForce,
    TrialInformation,
    as_prior,
    growth_over,
    information_of_run,
    likelihood_information,
    likely_root,
    linear_groups,
    priors_at,
    summed,
)
from estim.deviation.residuals import Residuals, stacked
from estim.deviation.trajectory import Along, Trajectory
from estim.problem import (
    Likelihood,
    Named,
    Noise,
    Observations,
    Points,
    Problem,
    Root,
    StackedPoints,
    Wording,
    stacked_root,
)


@dataclass(frozen=True, eq=False)
class Together:
    """Stated noise, free starts and forces of runs that share one, as a mixture over all their
    points.

    mixture, likely, formed : of `MixtureErrors`, the runs below each other.
    """

    runs: tuple[str, ...]
    mixture: Mixture
    likely: Root
    formed: Residuals

    def likelihood(self, points: StackedPoints, named: Named) -> MixtureErrors:
        return MixtureErrors(points, self.mixture, self.likely, self.formed)


@dataclass(frozen=True, eq=False)
class Sharing(Stated):
    """The noise of one of several runs that share a force; only all of them have a likelihood
    (`Together`).
    """

    others: tuple[str, ...]

    def likelihood(self, points: Points, named: Named) -> Likelihood:
        raise InputError(
            "shares an unmodelled force and has no likelihood without them",
            field="run",
            value=", ".join(self.others),
        )

    def for_search(self) -> Noise:
        """The stated noise alone."""
        return self.base

    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        stated = self.base.describe(x_unit=x_unit, y_unit=y_unit, words=words)
        return phrase(
            "{stated}; in addition, an unmodelled force along the track shared with "
            "{others}, one for this run alone, and a free start",
            stated=stated,
            others=", ".join(self.others),
        )


@dataclass(frozen=True, eq=False)
class JointlyPosed:
    """noises : run -> its noise with the force.  shared : what ties runs together.  found : one
    force a group.

    step, cov : (n_par,), (n_par, n_par) where the posterior of all runs then is, from the white
        fit, linearised.
    parts : the same posterior as normal distributions.
    """

    noises: Mapping[str, Noise]
    shared: tuple[Together, ...]
    found: tuple[FoundForce, ...]
    step: FloatArray
    cov: FloatArray
    parts: NormalParts

    def inferred_at(self, step: FloatArray) -> tuple[FoundForce, ...]:
        """What was found, where the mode lies `step` (n_par,) from the point of linearisation."""
        moved = float(np.max(np.abs(step - self.step) / np.sqrt(np.diag(self.cov))))
        return tuple(replace(force, moved=moved) for force in self.found)


@dataclass(frozen=True, eq=False)
class _Linearised:
    """A group of runs, linear about a white fit.

    track : the longest.
    responses : of each run, on its nodes.  pushes : (n_obs, n_run) what one sd of each energy at
        release does.
    """

    label: str
    runs: tuple[Observations, ...]
    alongs: tuple[Along, ...]
    track: Track
    responses: tuple[Response, ...]
    deviation: Deviation
    residuals: FloatArray
    jacobian: FloatArray
    pushes: FloatArray
    formed: Residuals

    def beside(self, precision: FloatArray, pull: FloatArray) -> Linearised:
        """The posterior of parameters and starts; precision, pull : (n_par, n_par), (n_par,) of all
        that is known beside.
        """
        columns, n = np.column_stack([self.jacobian, self.pushes]), len(self.runs)
        every = block_diag(precision, np.eye(n))  # each start in its own sds
        return linearise(
            self.deviation,
            self.residuals,
            columns,
            precision=every,
            pull=np.append(pull, np.zeros(n)),
        )


def pose_forces(
    groups: Mapping[str, Sequence[Observations]],
    courses: Mapping[str, Trajectory],
    problem: Problem,
    values: FloatArray,
    *,
    without: FloatArray,
    alone: Mapping[str, FloatArray],
) -> JointlyPosed:
    """The forces of `groups` of runs, linear about `values` (n_par,), those of a white fit with
    free starts.

    groups : what the runs of a group have in common -> its runs, which share a force where there
        are several.  Other runs lack nothing.
    without : (n_par,) standard deviations with the stated noise alone and exact starts.
    alone : run -> (n_par,) where a white fit of this run by itself ends.  Raises InputError where a
        body hardly moves somewhere along its track.
    """
    first = [
        _prepared(label, tuple(runs), courses, problem, values) for label, runs in groups.items()
    ]
    lacking = [  # now that the forces are known, the speeds are
        _prepared(group.label, group.runs, courses, problem, values, speeds=speeds)
        for group, speeds in zip(first, _speeds(first, problem, values), strict=True)
    ]
    precision, pull = priors_at(problem, values, n_start=0)
    prior = precision, precision @ pull
    forced = {run.name for group in lacking for run in group.runs}
    complete = [
        information_of_run(run, problem, values) for run in problem.runs if run.name not in forced
    ]
    information = [
        likelihood_information(group.beside(precision, pull), prior) for group in lacking
    ]
    each = [
        tuple(_told_alone(run, courses, problem, values, alone[run.name]) for run in group.runs)
        for group in lacking
    ]
    besides = [
        summed([prior, *complete, *information[:i], *information[i + 1 :]])
        for i in range(len(lacking))
    ]
    linear = [
        group.beside(*as_prior([beside])) for group, beside in zip(lacking, besides, strict=True)
    ]
    noises: dict[str, Noise] = {}
    for group, posterior in zip(lacking, linear, strict=True):
        noises |= _noises(group, posterior)
    shared = tuple(
        _together(group, posterior)
        for group, posterior in zip(lacking, linear, strict=True)
        if len(group.runs) > 1
    )
    data = summed([*complete, *information])
    forces = tuple(
        replace(_found(group, posterior, values, without, problem, data), alone=by_run)
        for group, posterior, by_run in zip(lacking, linear, each, strict=True)
    )
    n = problem.n_par
    parts = normal_parts(
        list(zip(linear, besides, strict=True)), summed([prior, *complete]), values
    )
    return JointlyPosed(
        noises, shared, forces, linear[0].mean[:n], linear[0].covariance[:n, :n], parts
    )


def _speeds(
    lacking: Sequence[_Linearised], problem: Problem, values: FloatArray
) -> list[tuple[FloatArray, ...]]:
    """Of each run of each group (n_obs,), as far as its data and the priors tell."""
    prior, inferred = priors_at(problem, values, n_start=0), []
    for group in lacking:
        read = (
            np.concatenate([run.y for run in group.runs])
            - group.formed.shift
            - group.beside(*prior).errors()
        )
        inferred.append(tuple(np.split(read, np.cumsum([run.n_obs for run in group.runs])[:-1])))
    return inferred


def _prepared(
    label: str,
    runs: tuple[Observations, ...],
    courses: Mapping[str, Trajectory],
    problem: Problem,
    values: FloatArray,
    *,
    speeds: Sequence[FloatArray | None] | None = None,
) -> _Linearised:
    named, speeds = problem.named(values), [None] * len(runs) if speeds is None else speeds
    about = [
        formed_about(courses[run.name], run.noise, run.points, named, scale=run.force, speed=speed)
        for run, speed in zip(runs, speeds, strict=True)
    ]
    each, stated = zip(*about, strict=True)
    alongs = tuple(
        courses[run.name].along(run.points, named, run.noise, about=residuals.speed)
        for run, residuals in zip(runs, each, strict=True)
    )
    longest = max(alongs, key=lambda along: along.track.length).track
    several = len(runs) > 1
    responses = tuple(
        along.response.carried(along.track, longest) if several else along.response
        for along in alongs
    )
    radius = alongs[0].radian
    shapes = (
        shared_force_shapes(longest, responses, radius=radius)
        if several
        else force_shapes(longest, responses[0], radius=radius)
    )
    points = StackedPoints(tuple(run.points for run in runs))
    root = stacked_root([errors.root for errors in stated])
    formed = stacked(each)
    return _Linearised(
        label,
        runs,
        alongs,
        longest,
        responses,
        diagonalise(root, shapes, prior_grid(runs[0].force)),
        residuals=formed.at(points, named)[0],
        jacobian=formed.gradient(points, named, problem.names),
        pushes=block_diag(*(along.push[:, None] for along in alongs)),
        formed=formed,
    )


def _told_alone(
    run: Observations,
    courses: Mapping[str, Trajectory],
    problem: Problem,
    values: FloatArray,
    there: FloatArray,
) -> TrialInformation:
    """What one of several runs says by itself, as in a fit of this run alone, linear about its own
    white fit `there`; for steps from `values`.
    """
    precision, pull = priors_at(problem, there, n_start=0)
    linear = _prepared(run.name, (by_itself(run, problem),), courses, problem, there).beside(
        precision, pull
    )
    information, score = likelihood_information(linear, (precision, precision @ pull))
    return information, score - information @ (values - there)


def by_itself(run: Observations, problem: Problem) -> Observations:
    """A run as it is without the others: a quantity that varies between runs does so by as much as
    was stated, for no run tells that.
    """
    spreads = {
        p.name: float(np.hypot(p.prior.expectation, p.prior.sd))
        for p in problem.parameters
        if p.between
    }
    return replace(
        run,
        arguments={
            a: spreads.get(source, source) if isinstance(source, str) else source
            for a, source in run.arguments.items()
        },
    )


def _noises(group: _Linearised, linear: Linearised) -> dict[str, Noise]:
    if len(group.runs) == 1:
        (run,) = group.runs
        mixture = keep_probable(linear, columns=group.pushes)
        return {
            run.name: WithForce(
                run.noise, mixture, likely_root(linear, group.pushes), group.formed, bad=BadFrames()
            )
        }
    names = [run.name for run in group.runs]
    return {
        run.name: Sharing(run.noise, tuple(name for name in names if name != run.name))
        for run in group.runs
    }


def _together(group: _Linearised, linear: Linearised) -> Together:
    names = tuple(run.name for run in group.runs)
    return Together(
        names,
        keep_probable(linear, columns=group.pushes),
        likely_root(linear, group.pushes),
        group.formed,
    )


def _found(
    group: _Linearised,
    linear: Linearised,
    values: FloatArray,
    without: FloatArray,
    problem: Problem,
    told: TrialInformation,
) -> FoundForce:
    run, along, several = group.runs[0], group.alongs[0], len(group.runs) > 1
    force = find_force(linear, group.track, Response.stacked(group.responses), radius=along.radian)
    means, covs = linear_groups(linear, problem.n_par)
    used = frozenset[str]().union(*(run.parameters for run in group.runs))
    growth = {
        name: factor
        for name, factor in growth_over(problem, linear, without).items()
        if name in used
    }
    return FoundForce(
        run=group.label,
        unit=run.y_unit if run.positions else run.x_unit,
        scale=run.force,
        force=force,
        noise=linear.size("scale"),
        larger=linear.p_noise(float(np.nextafter(1.0, 2.0))),
        too_large=linear.p_noise(max(SCALES)),
        conservative=stated_is_conservative(linear),
        growth=growth,
        upright=along.upright,
        about=values,
        told=told,
        means=values + means,
        covs=covs,
        bad=BadFrames(),
        reading_unit=run.x_unit if run.noise.made_of_positions else run.y_unit,
        step=run.noise.size.step,
        runs=tuple(run.name for run in group.runs),
        own=_own(group, linear) if several else (),
    )


def _own(group: _Linearised, linear: Linearised) -> tuple[OwnForce, ...]:
    # the order of `shared_force_shapes`
    ratios = OWN * (len(linear.deviation.families) // len(OWN))
    forces = []
    for i, (run, along) in enumerate(zip(group.runs, group.alongs, strict=True)):
        alone = [
            response if i == k else Response(0.0 * response.force, 0.0 * response.start)
            for k, response in enumerate(group.responses)
        ]
        end = group.track.start + along.track.length
        forces.append(
            find_own_force(
                linear,
                group.track,
                Response.stacked(alone),
                run=run.name,
                end=end,
                ratios=ratios,
                radius=along.radian,
            )
        )
    return tuple(forces)
