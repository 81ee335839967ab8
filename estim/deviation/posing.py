"""From a fit with white errors and a free start to noise with an unmodelled force, made once and held: what a chain samples under.

    white fit with a free start -> linearise -> which forces are how probable -> `WithForce`, and the force for a reader
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.deviation.completed import Completed
from estim.deviation.components import diagonalise
from estim.deviation.course import Course
from estim.deviation.force import force_shapes
from estim.deviation.found import Force, find_force
from estim.deviation.generic import stated_is_conservative
from estim.deviation.grid import SCALES, prior_grid
from estim.deviation.linearised import Linearised, linearise
from estim.deviation.mixture import keep_probable
from estim.deviation.noise import WithForce, normal_covariance
from estim.problem import Observations, Problem

_PARTS = (0.5, 0.9, 0.99, 0.999)  # of the linearised posterior: the wide components hold its tails


@dataclass(frozen=True, eq=False)
class FoundForce:
    """The unmodelled force of one run.

    unit : of positions.  scale : of the prior of its amplitude.  force : in units of the weight.
    growth : parameter -> its standard deviation over that with the stated noise alone and an exact start, both linearised.
    upright : cosine of the tilt.
    means, covs : (n, n_par), (n, n_par, n_par) of normal distributions that make up the linearised posterior, the narrowest first.
    noise : quantiles 0.16, 0.5, 0.84 of the size of the readings' noise in units of what was stated.
    larger, too_large : probability that it is larger than stated, and as large as the grid goes, or more.
    conservative : whether the readings scatter by far less than stated.
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
    means: FloatArray
    covs: FloatArray
    completed: Completed | None = None


@dataclass(frozen=True, eq=False)
class Posed:
    """noise : of the run, with the force.  step, cov : (n_par,), (n_par, n_par) where the posterior then is, from the white fit, linearised."""

    noise: WithForce
    found: FoundForce
    step: FloatArray
    cov: FloatArray


def pose_force(run: Observations, course: Course, problem: Problem, values: FloatArray, *, without: FloatArray) -> Posed:
    """The force of `run`, linear about `values` (n_par,), those of a fit with white errors and a free start.

    without : (n_par,) standard deviations with the stated noise alone and an exact start.
    Raises InputError where the body hardly moves somewhere along the track.
    """
    named, base = problem.named(values), run.noise
    along = course.along(run.points, named, base)
    stated = normal_covariance(base, run.points, named)
    shapes = force_shapes(along.track, along.response, radius=along.radian)
    deviation = diagonalise(stated.covariance, shapes, prior_grid(run.force))
    residuals = run.y - stated.shift - np.ravel(np.broadcast_to(run.points.value(named), (1, run.n_obs)))
    jacobian = np.column_stack([run.points.gradient(named, problem.names), along.push])
    precision, pull = _priors(problem, values)
    linear = linearise(deviation, residuals, jacobian, precision=precision, pull=pull)
    mixture = keep_probable(linear, columns=along.push[:, None])
    noise = WithForce(base, mixture, _whitener(linear, along.push), stated.shift)
    force = find_force(linear, along.track, along.response, radius=along.radian)
    means, covs = _groups(linear)
    found = FoundForce(
        run=run.name, unit=run.x_unit, scale=run.force, force=force, noise=linear.size("scale"),
        larger=linear.p_noise(float(np.nextafter(1.0, 2.0))), too_large=linear.p_noise(max(SCALES)), conservative=stated_is_conservative(linear),
        growth=_growth(problem, linear, without), upright=along.upright, means=values + means, covs=covs,
        completed=Completed(run.points, run.body, mixture, stated.shift, along),
    )
    return Posed(noise, found, linear.mean[:-1], linear.covariance[:-1, :-1])


def _growth(problem: Problem, linear: Linearised, without: FloatArray) -> dict[str, float]:
    sds = np.sqrt(np.diag(linear.covariance)[:-1])
    return {name: float(sd / before) for name, sd, before in zip(problem.names, sds, without, strict=True) if before > 0.0}


def _groups(linear: Linearised) -> tuple[FloatArray, FloatArray]:
    """Steps (n, n_par) and covariances (n, n_par, n_par) of the components in a few groups, from narrow to wide."""
    steps, covariances = linear.steps[:, :-1], linear.covariances[:, :-1, :-1]
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
            covs.append(np.einsum("k,kij->ij", weights, covariances[group]) + (weights[:, None] * off).T @ off)
    return np.array(means), np.array(covs)


def _priors(problem: Problem, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Precision (n_par + 1, n_par + 1) and pull (n_par + 1,) of the priors at `values`, the energy at release last, in its own sds."""
    priors = list(zip(problem.parameters, values, strict=True))
    slope = np.array([p.prior.residual_slope(float(v)) for p, v in priors] + [1.0])
    off = np.array([p.prior.residual(float(v)) for p, v in priors] + [0.0])
    return np.diag(slope**2), -np.divide(off, slope, out=np.zeros_like(off), where=slope != 0.0)


def _whitener(linear: Linearised, push: FloatArray) -> FloatArray:
    """L^-1 with L L^T the most probable covariance and that of the push, in units of the stated noise at least."""
    size = min(float(linear.scales[linear.best]), 1.0)
    covariance = linear.best_covariance() / size**2 + np.outer(push, push)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
