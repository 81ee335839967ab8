"""Runs of a joint fit with unmodelled forces: what runs on one track share, and what each adds,
made once at a white fit with free starts.

    white fit -> the forces of each group of runs, linear about it
        -> how probable, with the information of all other runs -> noise that a chain samples under

Runs that share a force have one likelihood of all their points (`Together`): the force couples
them.  The track is that of the run that went farthest; places count from the release of each run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from estim.arrays import FloatArray, sds_of
from estim.common import InputError, later, phrase
from estim.discrepancy.bad_frame_search import BadFrames, find_bad_frames
from estim.discrepancy.curve_covariances import stated_is_conservative
from estim.discrepancy.force import OWN, ForceTrack, Response, force_shapes, shared_force_shapes
from estim.discrepancy.force_bands import Completed
from estim.discrepancy.grid import SCALES, Grid, prior_grid
from estim.discrepancy.inferred_force import OwnForce, find_force, find_own_force
from estim.discrepancy.likelihood import MixtureErrors
from estim.discrepancy.linearised import Linearised, linearise_with_effects
from estim.discrepancy.mixture_likelihood import Mixture, keep_probable
from estim.discrepancy.noise_with_discrepancy import (
    ShiftedErrors,
    Stated,
    WithMixture,
    formed_about,
)
from estim.discrepancy.noise_with_force import (
    FoundForce,
    NormalParts,
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
from estim.discrepancy.normal_parts import normal_parts
from estim.discrepancy.residuals import Residuals, points_about, stacked
from estim.discrepancy.scale_mixture import Deviation, Shape, diagonalise
from estim.discrepancy.trajectory import TrackResponse, Trajectory
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
    parameters_of,
    stacked_root,
)

_FORCE = later("an unmodelled force along the track and a free start")
# of weighted least squares, to a share of a standard deviation
_ROUNDS, _CONVERGED = 30, 0.01
# where frames are tested the noise may be any larger than stated
_ANY_SCALE, _COARSE = (1.0, 1.6, 2.5, 4.0, 6.3, 10.0), 12


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
class Line:
    """The residuals of a stack of runs, and the straight lines that were put in their place.

    about : (n_par,) where.
    precision : (n_par, n_par) of all that is known beside.
    """

    stack: Stack
    mixture: Mixture
    about: FloatArray
    precision: FloatArray

    def moves(self, problem: Problem, values: FloatArray, cov: FloatArray) -> float:
        """How far the mode of the straight lines lies from that of the curve, `values` (n_par,), of
        covariance `cov` (n_par, n_par), in sds of the parameter that is farthest off.

        The mean of the linearised posterior is no measure of that, as far as the posterior is
        skew, or cut off by an edge.
        """
        stack, mixture, named = self.stack, self.mixture, problem.named(values)
        slopes = stack.formed.gradient(stack.points, named, problem.names)
        balance = slopes.T @ mixture.pull(stack.formed.at(stack.points, named)[0])
        rows, step = mixture.deviation.whiten(stack.jacobian.T), np.zeros_like(values)
        for _ in range(_ROUNDS):
            residuals = stack.residuals - stack.jacobian @ (values + step - self.about)
            score = stack.jacobian.T @ mixture.pull(residuals) - balance - self.precision @ step
            information = mixture.pulls(rows, residuals) @ rows.T + self.precision
            further = np.linalg.solve(information, score)
            step = step + further
            if np.max(np.abs(further) / sds_of(cov)) < _CONVERGED:
                break
        return float(np.max(np.abs(step) / sds_of(cov)))


@dataclass(frozen=True, eq=False)
class Posed:
    """noises : run -> its noise with the force.  shared : what ties runs together.  forces : one
    force a group.

    start : (n_par,) mean of the linearised posterior of all runs, with the force of the first group
        where it is more likely than not, else without: between the two there may be a valley.
    lines : of each group, `Line`.
    parts : the linearised posterior as normal distributions; None for a run alone.
    """

    noises: Mapping[str, Noise]
    shared: tuple[Together, ...]
    forces: tuple[FoundForce, ...]
    start: FloatArray
    lines: tuple[Line, ...]
    parts: NormalParts | None

    def inferred_at(
        self, problem: Problem, values: FloatArray, cov: FloatArray
    ) -> tuple[FoundForce, ...]:
        """What was found, where the mode of `problem` is `values` (n_par,) with covariance `cov`
        (n_par, n_par).
        """
        return tuple(
            replace(force, moved=line.moves(problem, values, cov))
            for force, line in zip(self.forces, self.lines, strict=True)
        )


@dataclass(frozen=True, eq=False)
class Stack:
    """Runs that have one likelihood, linear about values of the parameters.

    bad : frames of a run alone.  points : without their shifts.
    root : of the stated covariance.  shapes, grid : of what may be beside it.
    columns : (n_obs, n_column) further errors, each of unit size: the energy at release of each
        run, if it is free, then bad frames.
    """

    runs: tuple[Observations, ...]
    bad: BadFrames
    points: StackedPoints
    root: Root
    shapes: tuple[Shape, ...]
    grid: Grid
    residuals: FloatArray
    jacobian: FloatArray
    columns: FloatArray
    formed: Residuals

    @cached_property
    def deviation(self) -> Deviation:
        return diagonalise(self.root, self.shapes, self.grid)

    def posterior(self, precision: FloatArray, pull: FloatArray) -> Linearised:
        """The posterior of parameters and `columns`; precision, pull : (n_par, n_par), (n_par,) of
        all that is known beside.
        """
        return linearise_with_effects(
            self.deviation,
            self.residuals,
            self.jacobian,
            self.columns,
            precision=precision,
            pull=pull,
        )


@dataclass(frozen=True, eq=False)
class Beside:
    """Stacks of runs, each together with the information of the others and of the priors.

    linear : the posterior of each.  external : the information that it was linearised with.
    known : that of priors and of runs that stand in no stack.  data : that of all runs.
    """

    linear: tuple[Linearised, ...]
    external: tuple[TrialInformation, ...]
    known: TrialInformation
    data: TrialInformation

    @classmethod
    def of(cls, stacks: Sequence[Stack], problem: Problem, values: FloatArray) -> Beside:
        precision, pull = priors_at(problem, values)
        prior = precision, precision @ pull
        inside = {run.name for stack in stacks for run in stack.runs}
        others = [
            information_of_run(run, problem, values)
            for run in problem.runs
            if run.name not in inside
        ]
        information = [
            likelihood_information(stack.posterior(precision, pull), prior) for stack in stacks
        ]
        external = tuple(
            summed([prior, *others, *information[:i], *information[i + 1 :]])
            for i in range(len(stacks))
        )
        linear = tuple(
            stack.posterior(*as_prior([given]))
            for stack, given in zip(stacks, external, strict=True)
        )
        return cls(linear, external, summed([prior, *others]), summed([*others, *information]))


def mixtures_of(stacks: Sequence[Stack], linear: Sequence[Linearised]) -> list[Mixture]:
    """Of each stack, what is probable in its posterior."""
    return [
        keep_probable(posterior, columns=stack.columns)
        for stack, posterior in zip(stacks, linear, strict=True)
    ]


def noises_of(
    stacks: Sequence[Stack],
    linear: Sequence[Linearised],
    mixtures: Sequence[Mixture],
    *lacking: str,
) -> tuple[dict[str, Noise], tuple[Together, ...]]:
    """Run -> its noise, and what ties runs together.  lacking : as of `WithMixture`, for a run that
    shares nothing.
    """
    noises: dict[str, Noise] = {}
    shared = []
    for stack, posterior, mixture in zip(stacks, linear, mixtures, strict=True):
        likely = likely_root(posterior, stack.columns)
        names = tuple(run.name for run in stack.runs)
        if len(names) == 1:
            noises[names[0]] = WithMixture(
                stack.runs[0].noise, mixture, likely, stack.formed, lacking, stack.bad
            )
            continue
        shared.append(Together(names, mixture, likely, stack.formed))
        for run in stack.runs:
            noises[run.name] = Sharing(run.noise, tuple(n for n in names if n != run.name))
    return noises, tuple(shared)


def sharing_runs(runs: Sequence[Observations]) -> dict[str, tuple[Observations, ...]]:
    """Name of the run, or what runs that share a force have in common -> these runs; those without
    a force are left out.
    """
    groups: dict[str, list[Observations]] = {}
    for run in runs:
        if run.force:
            groups.setdefault(run.track, []).append(run)
    return {
        track if len(members) > 1 else members[0].name: tuple(members)
        for track, members in groups.items()
    }


@dataclass(frozen=True, eq=False, kw_only=True)
class _Forced(Stack):
    """label : what the runs have in common.  tracked : what a force does to them."""

    label: str
    tracked: Tracked


def pose_forces(
    problem: Problem,
    values: FloatArray,
    *,
    without: FloatArray,
    bad: Mapping[str, BadFrames],
    alone: Mapping[str, FloatArray],
) -> Posed:
    """The forces of the runs of a problem, linear about `values` (n_par,), those of a white fit
    with free starts.

    without : (n_par,) standard deviations with the stated noise alone and exact starts.
    bad : run -> frames whose shifts are unknown too, of a run that shares nothing.
    alone : run -> (n_par,) where a white fit of this run by itself ends; of runs fit together.
        Raises InputError where a body hardly moves somewhere along its track.
    """
    prior, groups = priors_at(problem, values), []
    for label, runs in sharing_runs(problem.runs).items():
        group = _forced(label, runs, problem, values, bad)
        if group.formed.speed is not None:  # now that the force is known, the speeds are
            read = group.points.y - group.formed.shift - group.posterior(*prior).errors()
            speeds = np.split(read, np.cumsum([run.n_obs for run in runs])[:-1])
            group = _forced(label, runs, problem, values, bad, speeds=speeds)
        groups.append(group)
    posterior = Beside.of(groups, problem, values)
    mixtures = mixtures_of(groups, posterior.linear)
    noises, shared = noises_of(groups, posterior.linear, mixtures, _FORCE)
    forces = []
    for group, linear, mixture in zip(groups, posterior.linear, mixtures, strict=True):
        force = _described(group, linear, values, without, problem, posterior.data)
        each = tuple(
            _information_alone(run, problem, values, alone[run.name])
            for run in group.runs
            if run.name in alone
        )
        completed = None
        if len(problem.runs) == 1 and not group.runs[0].positions:
            completed = Completed(
                group.points.runs[0],
                group.runs[0].body,
                mixture,
                group.formed,
                group.tracked.alongs[0],
            )
        forces.append(replace(force, alone=each, completed=completed))
    lines = tuple(
        Line(group, mixture, values, precision)
        for group, mixture, (precision, _) in zip(groups, mixtures, posterior.external, strict=True)
    )
    parts = (
        normal_parts(
            list(zip(posterior.linear, posterior.external, strict=True)), posterior.known, values
        )
        if len(problem.runs) > 1
        else None
    )
    first = posterior.linear[0].first(problem.n_par)
    start = values + first.moments(first.likelier)[1]
    return Posed(noises, shared, tuple(forces), start, lines, parts)


def bad_frames(
    run: Observations, problem: Problem, values: FloatArray, *, known: BadFrames
) -> BadFrames:
    """The frames of `run` that are shifted, linear about `values` as above.  Raises InputError as
    `pose_forces` does.

    known : what was found about other values: it is kept where it still has a size.
    """
    group = _forced(run.name, (run,), problem, values, {run.name: known})
    (about,) = group.points.runs
    if group.formed.speed is not None:
        about = points_about(about, group.formed.speed)
    frames = Trajectory.of(run).frames(about, problem.named(values), run.noise)
    if frames is None:
        return BadFrames()
    precision, pull = priors_at(problem, values)
    return find_bad_frames(
        diagonalise(
            group.root, group.shapes, prior_grid(run.force, scales=_ANY_SCALE, n_amplitude=_COARSE)
        ),
        frames,
        group.residuals,
        np.column_stack([group.jacobian, group.columns[:, 0]]),
        precision=block_diag(precision, 1.0),
        pull=np.append(pull, 0.0),
        known=known,
    )


@dataclass(frozen=True, eq=False)
class Tracked:
    """Runs on one track, linear about values of the parameters.

    formed : of each run.  stated : the errors of its readings.
    track : that of the run that went farthest.  responses : of each run, on its nodes.
    pushes : (n_obs, n_run) what one sd of each energy at release does.
    """

    formed: tuple[Residuals, ...]
    stated: tuple[ShiftedErrors, ...]
    alongs: tuple[TrackResponse, ...]
    track: ForceTrack
    responses: tuple[Response, ...]
    pushes: FloatArray

    @classmethod
    def of(
        cls,
        runs: Sequence[Observations],
        points: StackedPoints,
        named: Named,
        *,
        scale: float,
        speeds: Sequence[FloatArray | None] | None = None,
    ) -> Tracked:
        """speeds : of each run (n_obs,), where more is known than by the curve at `named`.

        scale : of the prior of the force.
        """
        formed, stated, alongs = [], [], []
        for run, own, speed in zip(runs, points.runs, speeds or [None] * len(runs), strict=True):
            trajectory = Trajectory.of(run)
            residuals, errors = formed_about(
                trajectory, run.noise, own, named, scale=scale, speed=speed
            )
            formed.append(residuals)
            stated.append(errors)
            alongs.append(trajectory.along(own, named, run.noise, about=residuals.speed))
        longest = max(alongs, key=lambda along: along.track.length).track
        responses = [
            along.response.carried(along.track, longest) if len(runs) > 1 else along.response
            for along in alongs
        ]
        pushes = block_diag(*(along.push[:, None] for along in alongs))
        return cls(tuple(formed), tuple(stated), tuple(alongs), longest, tuple(responses), pushes)


def _forced(
    label: str,
    runs: tuple[Observations, ...],
    problem: Problem,
    values: FloatArray,
    bad: Mapping[str, BadFrames],
    *,
    speeds: Sequence[FloatArray | None] | None = None,
) -> _Forced:
    """speeds : of each run (n_obs,), where more is known than by the curve at `values`."""
    named, several = problem.named(values), len(runs) > 1
    frames = BadFrames() if several else bad.get(runs[0].name, BadFrames())
    points = StackedPoints(tuple(frames.moved(run.points) for run in runs))
    tracked = Tracked.of(runs, points, named, scale=runs[0].force, speeds=speeds)
    radius = tracked.alongs[0].radian
    shapes = (
        shared_force_shapes(tracked.track, tracked.responses, radius=radius)
        if several
        else force_shapes(tracked.track, tracked.responses[0], radius=radius)
    )
    formed = stacked(tracked.formed)
    return _Forced(
        runs,
        frames,
        points,
        stacked_root([errors.root for errors in tracked.stated]),
        shapes,
        prior_grid(runs[0].force),
        formed.at(points, named)[0],
        formed.gradient(points, named, problem.names),
        np.column_stack([tracked.pushes, frames.columns(points.y.size)]),
        formed,
        label=label,
        tracked=tracked,
    )


def _information_alone(
    run: Observations, problem: Problem, values: FloatArray, white_fit: FloatArray
) -> TrialInformation:
    """The information of one of several runs by itself, as in a fit of this run alone, linear about
    its own `white_fit`; for steps from `values`.
    """
    precision, pull = priors_at(problem, white_fit)
    linear = _forced(run.name, (by_itself(run, problem),), problem, white_fit, {}).posterior(
        precision, pull
    )
    information, score = likelihood_information(linear, (precision, precision @ pull))
    return information, score - information @ (values - white_fit)


def by_itself(run: Observations, problem: Problem) -> Observations:
    """A run as it is without the others: a quantity that varies between runs does so by as much as
    was stated, for no run constrains that.
    """
    spreads = {
        p.name: float(np.hypot(p.prior.expectation, p.prior.sd))
        for p in problem.parameters
        if p.between
    }
    return run.renamed(spreads)


def _described(
    group: _Forced,
    linear: Linearised,
    values: FloatArray,
    without: FloatArray,
    problem: Problem,
    information: TrialInformation,
) -> FoundForce:
    run, tracked = group.runs[0], group.tracked
    along, lever = tracked.alongs[0], Response.stacked(tracked.responses)
    force = find_force(linear, tracked.track, lever, radius=along.radian)
    used = parameters_of(group.runs)
    growth = {
        name: factor
        for name, factor in growth_over(problem, linear, without).items()
        if name in used
    }
    return FoundForce(
        run=group.label,
        unit=run.y_unit if run.positions else run.x_unit,
        positions=run.positions,
        scale=run.force,
        force=force,
        noise=linear.size("scale"),
        larger=linear.p_noise(float(np.nextafter(1.0, 2.0))),
        too_large=linear.p_noise(max(SCALES)),
        conservative=stated_is_conservative(linear),
        growth=growth,
        upright=along.upright,
        about=values,
        information=information,
        parts=linear_groups(linear, values),
        bad=group.bad,
        reading_unit=run.x_unit if run.noise.made_of_positions else run.y_unit,
        step=run.noise.size.step,
        runs=tuple(run.name for run in group.runs),
        own=_own(group, linear) if len(group.runs) > 1 else (),
    )


def _own(group: _Forced, linear: Linearised) -> tuple[OwnForce, ...]:
    # the order of `shared_force_shapes`
    ratios = OWN * (len(linear.deviation.families) // len(OWN))
    forces = []
    for i, (run, along) in enumerate(zip(group.runs, group.tracked.alongs, strict=True)):
        alone = [
            response if i == k else Response(0.0 * response.force, 0.0 * response.start)
            for k, response in enumerate(group.tracked.responses)
        ]
        end = group.tracked.track.start + along.track.length
        forces.append(
            find_own_force(
                linear,
                group.tracked.track,
                Response.stacked(alone),
                run=run.name,
                end=end,
                ratios=ratios,
                radius=along.radian,
            )
        )
    return tuple(forces)
