"""From a fit with white errors and a free start to noise with an unmodelled force, made once and
held: what a chain samples under.

    white fit with a free start -> linearise -> which forces are how probable
        -> `WithMixture`, and the force for a reader
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, inverse_of, sds_of
from estim.discrepancy.bad_frame_search import BadFrames
from estim.discrepancy.force_bands import Completed
from estim.discrepancy.inferred_force import Force, OwnForce
from estim.discrepancy.linearised import Linearised
from estim.problem import Observations, Prior, Problem, Root

_PARTS = (0.5, 0.9, 0.99, 0.999)  # of the linearised posterior: the wide components hold its tails

TrialInformation = tuple[FloatArray, FloatArray]
"""Information (n_par, n_par) and score (n_par,) at values of the parameters: that of some
runs, or of their priors.
"""


@dataclass(frozen=True, eq=False)
class NormalParts:
    """Normal distributions that make up a linearised posterior.

    weights : (n,), sum 1.  means, covs : (n, n_par), (n, n_par, n_par).
    """

    weights: FloatArray
    means: FloatArray
    covs: FloatArray


@dataclass(frozen=True, eq=False)
class FoundForce:
    """The unmodelled force of one run, or the one that several share.

    run : its name, or what those that share the force have in common.
    unit : of positions.  positions : whether these are what the curve gives, not speeds.
    scale : of the prior of its amplitude.  force : in units of the weight.
    growth : parameter -> its standard deviation over that with the stated noise alone and an exact
        start, both linearised.
    upright : cosine of the tilt.
    about, information : (n_par,) the point of linearisation, and the information of all data
        there as one normal distribution, whatever the size of forces.
    parts : of the linearised posterior, the narrowest first.
    bad : frames that are shifted.
    reading_unit : of them.  step : of a digital reading, 0 where there is none.
    moved : how far from the posterior mode that of a linear curve would lie, in sds of the
        parameter that is farthest off.
    noise : quantiles 0.16, 0.5, 0.84 of the size of the readings' noise in units of what was
        stated.
    larger, too_large : probability that it is larger than stated, and as large as the grid goes, or
        more.
    conservative : whether the readings scatter by far less than stated.
    runs : names of the runs that share the force, or the one that has it.
    own : what each of several adds to it.
    alone : the information of each of `runs` at `about` by itself, with a force of its own whose
        mean over the track is removed; of runs fit together.
    completed : the curve together with the force, for bands; None where that is not known.
    """

    run: str
    unit: str
    positions: bool
    scale: float
    force: Force
    noise: tuple[float, float, float]
    larger: float
    too_large: float
    conservative: bool
    growth: Mapping[str, float]
    upright: float
    about: FloatArray
    information: TrialInformation
    parts: NormalParts
    bad: BadFrames
    reading_unit: str
    step: float
    runs: tuple[str, ...]
    own: tuple[OwnForce, ...] = ()
    alone: tuple[TrialInformation, ...] = ()
    moved: float = 0.0
    completed: Completed | None = None


def information_of_run(run: Observations, problem: Problem, values: FloatArray) -> TrialInformation:
    """The information of a run whose noise is known."""
    named = problem.named(values)
    jacobian, residuals = run.likelihood(named).scoring(named, problem.names)
    return jacobian.T @ jacobian, -jacobian.T @ residuals


def likelihood_information(linear: Linearised, prior: TrialInformation) -> TrialInformation:
    """The information of observations beyond the `prior` that they were linearised with, as one
    normal distribution; with it the mean is that of all.
    """
    n_par = prior[1].size
    return likelihood_of_normal(linear.mean[:n_par], linear.covariance[:n_par, :n_par], prior)


def likelihood_of_normal(
    mean: FloatArray, cov: FloatArray, prior: TrialInformation
) -> TrialInformation:
    """What makes a normal posterior of `mean` (n_par,), from the point of linearisation, and `cov`
    of the `prior`.
    """
    scale = sds_of(cov)
    excess = np.linalg.inv(cov / np.outer(scale, scale)) - prior[0] * np.outer(scale, scale)
    spectrum, basis = np.linalg.eigh(excess)
    information = (basis * np.maximum(spectrum, 0.0)) @ basis.T / np.outer(scale, scale)
    return information, information @ mean + prior[0] @ mean - prior[1]


def summed(known: Sequence[TrialInformation]) -> TrialInformation:
    """The information of several sources together."""
    return np.sum([source[0] for source in known], axis=0), np.sum(
        [source[1] for source in known], axis=0
    )


def as_prior(known: Sequence[TrialInformation]) -> TrialInformation:
    """Precision and pull of several sources together: of a normal prior with that
    information and score.
    """
    precision, score = summed(known)
    return precision, inverse_of(precision, rcond=1e-12) @ score


def growth_over(problem: Problem, linear: Linearised, without: FloatArray) -> dict[str, float]:
    sds = sds_of(linear.covariance)[: problem.n_par]
    return {
        name: float(sd / before)
        for name, sd, before in zip(problem.names, sds, without, strict=True)
        if before > 0.0
    }


def linear_groups(linear: Linearised, values: FloatArray) -> NormalParts:
    """The components in a few groups, from narrow to wide, about `values` (n_par,) of the first
    parameters.
    """
    own = linear.first(values.size)
    order = own.from_narrow_to_wide()
    groups = np.split(order, np.searchsorted(np.cumsum(own.weights[order]), _PARTS))
    weights, steps, covs = map(
        np.array, zip(*(own.moments(g) for g in groups if own.weights[g].sum() > 0.0), strict=True)
    )
    return NormalParts(weights, values + steps, covs)


def priors_at(problem: Problem, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Precision (n_par, n_par) and pull (n_par,) of the priors at `values`."""
    slope, residual = np.array(
        [_bounded(p.prior, float(v)) for p, v in zip(problem.parameters, values, strict=True)]
    ).T
    pull = -np.divide(residual, slope, out=np.zeros_like(residual), where=slope != 0.0)
    return np.diag(slope**2), pull


def _bounded(prior: Prior, value: float) -> tuple[float, float]:
    """Slope and residual of a prior at a value; of one without a pull, those of a normal prior of
    its centre and sd: a linear step stays inside.
    """
    slope = prior.residual_slope(value)
    if slope != 0.0 or not np.isfinite(prior.sd):
        return float(slope), float(prior.residual(value))
    return 1.0 / prior.sd, (value - prior.centre) / prior.sd


def likely_root(
    linear: Linearised, columns: FloatArray | None = None, *, stated: bool = True
) -> Root:
    """Of the most probable covariance and that of `columns` (push and bad frames), in units of the
    stated noise at least, where it was stated.
    """
    size = min(float(linear.scales[linear.best]), 1.0) if stated else 1.0
    return linear.best_root(columns, size=size)
