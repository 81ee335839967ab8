"""The force of a fit for a reader, and what making it needs of priors and components: `estim.deviation.joint` goes from a fit to noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from estim.arrays import FloatArray
from estim.deviation.found import Force, OwnForce
from estim.deviation.linearised import Linearised
from estim.problem import Problem

_PARTS = (0.5, 0.9, 0.99, 0.999)  # of the linearised posterior: the wide components hold its tails


@dataclass(frozen=True, eq=False)
class FoundForce:
    """The unmodelled force of one run, or the one that several share.

    run : its name, or what those that share the force have in common.  unit : of positions.  scale : of the prior of its amplitude.
    force : in units of the weight.
    without : parameter of these runs -> its standard deviation with the stated noise alone and an exact start.  upright : cosine of the tilt.
    means, covs : (n, n_par), (n, n_par, n_par) of normal distributions that make up the linearised posterior, the narrowest first.
    noise : quantiles 0.16, 0.5, 0.84 of the size of the readings' noise in units of what was stated.
    conservative : whether the readings scatter by far less than stated.
    runs : names of the runs that share the force, or the one that has it.  own : what each of several adds to it.
    """

    run: str
    unit: str
    scale: float
    force: Force
    noise: tuple[float, float, float]
    conservative: bool
    without: Mapping[str, float]
    upright: float
    means: FloatArray
    covs: FloatArray
    runs: tuple[str, ...]
    own: tuple[OwnForce, ...]


def narrow_to_wide(linear: Linearised, n_par: int) -> tuple[FloatArray, FloatArray]:
    """Steps (n, n_par) and covariances (n, n_par, n_par) of the first `n_par` parameters, components in a few groups, from narrow to wide."""
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
            covs.append(np.einsum("k,kij->ij", weights, covariances[group]) + (weights[:, None] * off).T @ off)
    return np.array(means), np.array(covs)


def priors_at(problem: Problem, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Precision (n_par, n_par) and pull (n_par,) of the priors at `values`."""
    priors = list(zip(problem.parameters, values, strict=True))
    slope = np.array([p.prior.residual_slope(float(v)) for p, v in priors])
    off = np.array([p.prior.residual(float(v)) for p, v in priors])
    return np.diag(slope**2), -np.divide(off, slope, out=np.zeros_like(off), where=slope != 0.0)


def with_starts(precision: FloatArray, pull: FloatArray, n_start: int) -> tuple[FloatArray, FloatArray]:
    """Precision and pull with `n_start` energies at release behind the parameters, in their own sds."""
    return block_diag(precision, np.eye(n_start)), np.append(pull, np.zeros(n_start))


def whitener(linear: Linearised, pushes: FloatArray) -> FloatArray:
    """L^-1 with L L^T the most probable covariance and that of the pushes (n_obs, n_start), in units of the stated noise at least."""
    size = min(float(linear.scales[linear.best]), 1.0)
    covariance = linear.best_covariance() / size**2 + pushes @ pushes.T
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
