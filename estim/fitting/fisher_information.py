"""Fisher information: what data and priors together determine at a point, and in which units to
compare it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import BoolArray, FloatArray, finite_or, positive_or, sds_of
from estim.problem import Posterior, Problem

_ON_LIMIT = 1e-2  # standard deviations
_SILENT = 1e-24  # part of the information beside a limit, that on it
_MUCH = 4.0  # of the logarithm of the density, over a standard deviation that should make it 0.5
_FALLING = np.geomspace(1.0, 1e-12, 121)  # steps, of the farthest
_ANYWHERE = np.geomspace(1e12, 1e-12, 241)


def information(posterior: Posterior, values: FloatArray) -> FloatArray:
    """(n_par, n_par) Fisher information at `values`, priors included; its inverse is the Gaussian
    covariance.
    """
    return posterior.information(values) + posterior.problem.prior_information(values)


@dataclass(frozen=True, eq=False)
class DataInformation:
    """The information of the data about the parameters at a point.

    matrix : (n_par, n_par) the Fisher information without priors; of those that `inside` moves, and
        of what they hide, that inside.
    on_limit : (n_par,) which parameters lie on a limit of their priors (`on_limit`).
    inside : (n_par,) the point, but for parameters on a limit at which the curve does not depend on
        them to first order (the b of sqrt(a^2 + b^2 x^2) at 0), or not at all on another one (the t
        of a exp(-x/t) where a is 0).  Such a one lies inside, where the density has fallen by half
        a unit.
    """

    matrix: FloatArray
    on_limit: BoolArray
    inside: FloatArray


def on_limit(problem: Problem, values: FloatArray, matrix: FloatArray) -> BoolArray:
    """(n_par,) which parameters lie on a limit of their priors.

    Those within 1 % of the standard deviation that they have when all others are held: one that
    another on its limit makes uncertain may lie far from its own.

    matrix : (n_par, n_par) information at `values`, priors included.
    """
    known, room = np.sqrt(np.diag(matrix)), problem.room(values)
    return (room <= 0.0) | ((known > 0.0) & (room * positive_or(known, 1.0) <= _ON_LIMIT))


def known_from_data(posterior: Posterior, values: FloatArray) -> DataInformation:
    """The information of the data about the parameters at `values` (n_par,)."""
    problem, matrix = posterior.problem, posterior.information(values)
    full = matrix + problem.prior_information(values)
    at_limit = on_limit(problem, values, full)
    inside = _beside_limits(posterior, values, np.sqrt(np.diag(full)), at_limit)
    moved = inside != values
    if np.any(moved):
        matrix[moved], matrix[:, moved] = 0.0, 0.0
        alone = np.diag(matrix)
        diagonal_inside = np.diag(posterior.information(inside))
        own = np.where(alone <= _SILENT * diagonal_inside, diagonal_inside, alone)
        np.fill_diagonal(matrix, own)
    return DataInformation(matrix, at_limit, inside)


def _beside_limits(
    posterior: Posterior, values: FloatArray, known: FloatArray, at_limit: BoolArray
) -> FloatArray:
    """(n_par,) `DataInformation.inside`.  known : (n_par,) roots of the information of each."""
    low, high = posterior.problem.support()
    inside = values.copy()
    silent = bool(np.any(known[list(posterior.problem.of_curve)] == 0.0))
    for i in np.flatnonzero(at_limit):
        below = values[i] - low[i] < high[i] - values[i]
        room = high[i] - values[i] if below else values[i] - low[i]
        reach = min(room, 1.0 / known[i] if known[i] > 0.0 else np.inf)
        anywhere = max(1.0, abs(values[i])) * _ANYWHERE
        steps = reach * _FALLING if reach < anywhere[0] else anywhere
        points = np.tile(values, (1 + steps.size, 1))
        points[1:, i] += steps if below else -steps
        with np.errstate(all="ignore"):
            heights = posterior.log_density(points)
        fallen = heights[0] - heights[1:] > 0.5
        if (silent or heights[0] - heights[1] > _MUCH) and not np.all(fallen):
            inside[i] = points[1 + np.argmin(fallen), i]
    return inside


def prior_sds(problem: Problem, cov: FloatArray) -> FloatArray:
    """(n_par,) standard deviations of the priors; of a flat one without limits 1000 posterior
    standard deviations (`cov`).
    """
    sds = np.array([p.prior.sd for p in problem.parameters])
    return finite_or(sds, 1e3 * sds_of(cov))
