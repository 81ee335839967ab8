"""From a fit with white errors and a free start to noise with an unmodelled force, made once and
held: what a chain samples under.

    white fit with a free start -> linearise -> which forces are how probable -> `WithForce`, and
    the force for a reader
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from estim.arrays import FloatArray
from estim.deviation.bad_frame_search import BadFrames, find_bad_frames
from estim.deviation.completed import Completed
from estim.deviation.components import Shape, diagonalise
from estim.deviation.force import force_shapes
from estim.deviation.generic import stated_is_conservative
from estim.deviation.grid import SCALES, prior_grid
from estim.deviation.inferred_force import Force, OwnForce, find_force
from estim.deviation.linearised import Linearised, linearise
from estim.deviation.mixture import keep_probable
from estim.deviation.noise import StatedErrors, WithForce, formed_about
from estim.deviation.residuals import Residuals, points_about
from estim.deviation.trajectory import Along, Trajectory
from estim.problem import Observations, Points, Prior, Problem, Root

_PARTS = (0.5, 0.9, 0.99, 0.999)  # of the linearised posterior: the wide components hold its tails
# where frames are judged the noise may be any larger than stated
_ANY_SCALE, _COARSE = (1.0, 1.6, 2.5, 4.0, 6.3, 10.0), 12


TrialInformation = tuple[FloatArray, FloatArray]
"""Information (n_par, n_par) and score (n_par,) at values of the parameters: what some runs,
or their priors, say of them.
"""


@dataclass(frozen=True, eq=False)
class FoundForce:
    """The unmodelled force of one run, or the one that several share.

    run : its name, or what those that share the force have in common.
    unit : of positions.
    scale : of the prior of its amplitude.  force : in units of the weight.
    growth : parameter -> its standard deviation over that with the stated noise alone and an exact
        start, both linearised.
    upright : cosine of the tilt.
    about, told : (n_par,) the point of linearisation, and what all data say there as one normal
        distribution, whatever the size of forces.
    means, covs : (n, n_par), (n, n_par, n_par) of normal distributions that make up the linearised
        posterior, the narrowest first.
    bad : frames that are shifted.
    reading_unit : of them.  step : of a digital reading, 0 where there is none.
    moved : how far the posterior mode lies from the linearised mean, in sds of the parameter that
        is farthest off.
    noise : quantiles 0.16, 0.5, 0.84 of the size of the readings' noise in units of what was
        stated.
    larger, too_large : probability that it is larger than stated, and as large as the grid goes, or
        more.
    conservative : whether the readings scatter by far less than stated.
    runs : names of the runs that share the force, or the one that has it.
    own : what each of several adds to it.
    alone : what each of `runs` says at `about` by itself, with a force of its own whose mean over
        the track is removed; of runs fit together.
    completed : the curve together with the force, for bands; None where that is not known.
    """

    run: str
    unit: str
    scale: float
    force: Force
    noise: tuple[float, float, float]
    larger: float
    too_large: float
    conservative: bool
    growth: Mapping[str, float]
    upright: float
    about: FloatArray
    told: TrialInformation
    means: FloatArray
    covs: FloatArray
    bad: BadFrames
    reading_unit: str
    step: float
    runs: tuple[str, ...]
    own: tuple[OwnForce, ...] = ()
    alone: tuple[TrialInformation, ...] = ()
    moved: float = 0.0
    completed: Completed | None = None


@dataclass(frozen=True, eq=False)
class Posed:
    """noise : of the run, with the force.  step, cov : (n_par,), (n_par, n_par) where the posterior
    then is, from the white fit, linearised.
    """

    noise: WithForce
    found: FoundForce
    step: FloatArray
    cov: FloatArray

    shared = ()

    @property
    def noises(self) -> Mapping[str, WithForce]:
        return {self.found.run: self.noise}

    def inferred_at(self, step: FloatArray) -> tuple[FoundForce, ...]:
        """What was found, where the mode lies `step` (n_par,) from the point of linearisation."""
        return (
            replace(
                self.found,
                moved=float(np.max(np.abs(step - self.step) / np.sqrt(np.diag(self.cov)))),
            ),
        )


def pose_force(
    run: Observations,
    course: Trajectory,
    problem: Problem,
    values: FloatArray,
    *,
    without: FloatArray,
    bad: BadFrames,
) -> Posed:
    """The force of `run`, linear about `values` (n_par,), those of a fit with white errors and a
    free start.

    without : (n_par,) standard deviations with the stated noise alone and an exact start.
    bad : frames whose shifts are unknown too.  Raises InputError where the body hardly moves
        somewhere along the track.
    """
    here = _linear(run, course, problem, values, bad)
    linear, columns = _weighed(run, here, bad)
    if here.formed.speed is not None:  # now that the force is known, the speeds are
        speed = here.points.y - here.formed.shift - linear.errors()
        here = _linear(run, course, problem, values, bad, speed=speed)
        linear, columns = _weighed(run, here, bad)
    n = problem.n_par
    mixture = keep_probable(linear, columns=columns)
    noise = WithForce(run.noise, mixture, likely_root(linear, columns), here.formed, bad=bad)
    force = find_force(linear, here.along.track, here.along.response, radius=here.along.radian)
    means, covs = linear_groups(linear, n)
    prior = here.precision[:n, :n]
    unit = run.y_unit if run.positions else run.x_unit
    summary = FoundForce(
        run=run.name,
        unit=unit,
        scale=run.force,
        force=force,
        noise=linear.size("scale"),
        larger=linear.p_noise(float(np.nextafter(1.0, 2.0))),
        too_large=linear.p_noise(max(SCALES)),
        conservative=stated_is_conservative(linear),
        growth=growth_over(problem, linear, without),
        upright=here.along.upright,
        about=values,
        told=likelihood_information(linear, (prior, prior @ here.pull[:n])),
        means=values + means,
        covs=covs,
        bad=bad,
        reading_unit=unit if run.positions or run.noise.made_of_positions else run.y_unit,
        step=run.noise.size.step,
        runs=(run.name,),
        completed=None
        if run.positions
        else Completed(here.points, run.body, mixture, here.formed, here.along),
    )
    return Posed(noise, summary, linear.mean[:n], linear.covariance[:n, :n])


def _weighed(run: Observations, here: _Linear, bad: BadFrames) -> tuple[Linearised, FloatArray]:
    """How probable each force is, and what a push and the shifts of bad frames do to the points
    (n_obs, n_column).
    """
    deviation = diagonalise(here.stated.root, here.shapes, prior_grid(run.force))
    columns = np.column_stack([here.along.push, bad.columns(run.n_obs)])
    extra = columns.shape[1] - 1
    precision, pull = block_diag(here.precision, np.eye(extra)), np.r_[here.pull, np.zeros(extra)]
    jacobian = np.column_stack([here.jacobian, columns[:, 1:]])
    return linearise(deviation, here.residuals, jacobian, precision=precision, pull=pull), columns


def bad_frames(
    run: Observations, course: Trajectory, problem: Problem, values: FloatArray, *, known: BadFrames
) -> BadFrames:
    """The frames of `run` that are shifted, linear about `values` as above.  Raises InputError as
    `pose_force` does.

    known : what was found about other values: it is kept where it still has a size.
    """
    here = _linear(run, course, problem, values, known)
    about = (
        here.points if here.formed.speed is None else points_about(here.points, here.formed.speed)
    )
    frames = course.frames(about, here.named, run.noise)
    if frames is None:
        return BadFrames()
    deviation = diagonalise(
        here.stated.root, here.shapes, prior_grid(run.force, scales=_ANY_SCALE, n_amplitude=_COARSE)
    )
    return find_bad_frames(
        deviation,
        frames,
        here.residuals,
        here.jacobian,
        precision=here.precision,
        pull=here.pull,
        known=known,
    )


@dataclass(frozen=True, eq=False)
class _Linear:
    """A run, linear about values of its parameters; the energy at release is the last column of
    jacobian, precision and pull.
    """

    points: Points
    named: Mapping[str, FloatArray]
    along: Along
    stated: StatedErrors
    formed: Residuals
    shapes: tuple[Shape, ...]
    residuals: FloatArray
    jacobian: FloatArray
    precision: FloatArray
    pull: FloatArray


def _linear(
    run: Observations,
    course: Trajectory,
    problem: Problem,
    values: FloatArray,
    bad: BadFrames,
    *,
    speed: FloatArray | None = None,
) -> _Linear:
    """speed : (n_obs,) where more is known of the speeds than the curve at `values` says."""
    named, points = problem.named(values), bad.moved(run.points)
    formed, stated = formed_about(course, run.noise, points, named, scale=run.force, speed=speed)
    along = course.along(points, named, run.noise, about=formed.speed)
    residuals = formed.at(points, named)[0]
    jacobian = np.column_stack([formed.gradient(points, named, problem.names), along.push])
    shapes = force_shapes(along.track, along.response, radius=along.radian)
    return _Linear(
        points,
        named,
        along,
        stated,
        formed,
        shapes,
        residuals,
        jacobian,
        *priors_at(problem, values),
    )


def information_of_run(run: Observations, problem: Problem, values: FloatArray) -> TrialInformation:
    """What a run says whose noise is known."""
    named = problem.named(values)
    jacobian, residuals = run.likelihood(named).scoring(named, problem.names)
    return jacobian.T @ jacobian, -jacobian.T @ residuals


def likelihood_information(linear: Linearised, prior: TrialInformation) -> TrialInformation:
    """What observations say beyond the `prior` that they were linearised with, as one normal
    distribution; with it the mean is that of all.
    """
    n_par = prior[1].size
    return likelihood_of_normal(linear.mean[:n_par], linear.covariance[:n_par, :n_par], prior)


def likelihood_of_normal(
    mean: FloatArray, cov: FloatArray, prior: TrialInformation
) -> TrialInformation:
    """What makes a normal posterior of `mean` (n_par,), from the point of linearisation, and `cov`
    of the `prior`.
    """
    scale = np.sqrt(np.diag(cov))
    beyond = np.linalg.inv(cov / np.outer(scale, scale)) - prior[0] * np.outer(scale, scale)
    spectrum, basis = np.linalg.eigh(0.5 * (beyond + beyond.T))
    information = (basis * np.maximum(spectrum, 0.0)) @ basis.T / np.outer(scale, scale)
    return information, information @ mean + prior[0] @ mean - prior[1]


def summed(known: Sequence[TrialInformation]) -> TrialInformation:
    """What several sources say together."""
    return np.sum([source[0] for source in known], axis=0), np.sum(
        [source[1] for source in known], axis=0
    )


def as_prior(known: Sequence[TrialInformation]) -> TrialInformation:
    """Precision and pull of what several sources say together: of a normal prior with that
    information and score.
    """
    precision, score = summed(known)
    scale = np.sqrt(np.maximum(np.diag(precision), 0.0))
    scale = np.where(scale > 0.0, scale, 1.0)
    pull = (
        np.linalg.lstsq(precision / np.outer(scale, scale), score / scale, rcond=1e-12)[0] / scale
    )
    return precision, pull


def growth_over(problem: Problem, linear: Linearised, without: FloatArray) -> dict[str, float]:
    sds = np.sqrt(np.diag(linear.covariance)[: problem.n_par])
    return {
        name: float(sd / before)
        for name, sd, before in zip(problem.names, sds, without, strict=True)
        if before > 0.0
    }


def linear_groups(linear: Linearised, n_par: int) -> tuple[FloatArray, FloatArray]:
    """Steps (n, n_par) and covariances (n, n_par, n_par) of the components in a few groups, from
    narrow to wide; of the first parameters.
    """
    steps, covariances = linear.steps[:, :n_par], linear.covariances[:, :n_par, :n_par]
    order = np.argsort(np.linalg.slogdet(covariances)[1])
    below = np.cumsum(linear.weights[order])
    means, covs = [], []
    for group in np.split(order, np.searchsorted(below, _PARTS)):
        weights = linear.weights[group]
        if weights.sum() > 0.0:
            weights = weights / weights.sum()
            mean = weights @ steps[group]
            off = steps[group] - mean
            means.append(mean)
            covs.append(
                np.einsum("k,kij->ij", weights, covariances[group])
                + (weights[:, None] * off).T @ off
            )
    return np.array(means), np.array(covs)


def priors_at(
    problem: Problem, values: FloatArray, *, n_start: int = 1
) -> tuple[FloatArray, FloatArray]:
    """Precision (n, n) and pull (n,) of the priors at `values`, n = n_par + n_start: the energies
    at release last, in their own sds.
    """
    priors = list(zip(problem.parameters, values, strict=True))
    slope = np.array([_bounded(p.prior, float(v))[0] for p, v in priors] + [1.0] * n_start)
    off = np.array([_bounded(p.prior, float(v))[1] for p, v in priors] + [0.0] * n_start)
    return np.diag(slope**2), -np.divide(off, slope, out=np.zeros_like(off), where=slope != 0.0)


def _bounded(prior: Prior, value: float) -> tuple[float, float]:
    """Slope and residual of a prior at a value; of one without a pull, those of a normal prior of
    its centre and sd: a linear step stays inside.
    """
    slope = prior.residual_slope(value)
    if slope != 0.0 or not np.isfinite(prior.sd):
        return float(slope), float(prior.residual(value))
    return 1.0 / prior.sd, (value - prior.centre) / prior.sd


def likely_root(linear: Linearised, columns: FloatArray) -> Root:
    """Of the most probable covariance and that of push and bad frames, in units of the stated noise
    at least.
    """
    return linear.best_root(columns, size=min(float(linear.scales[linear.best]), 1.0))
