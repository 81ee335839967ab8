"""Fisher information: what data and priors together know at a point, and in which units to compare
it.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import BoolArray, FloatArray, finite_or, sds_of
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


def on_limit(posterior: Posterior, values: FloatArray) -> BoolArray:
    """(n_par,) which parameters lie on a limit of their priors.

    Those within 1 % of the standard deviation that they have when all others are held: one that
    another on its limit makes uncertain may lie far from its own.
    """
    low, high = posterior.problem.support()
    room = np.minimum(values - low, high - values)
    if np.all(room == np.inf):
        return np.zeros(values.size, dtype=bool)
    known = np.sqrt(np.diag(information(posterior, values)))
    felt = known > 0.0
    return (room <= 0.0) | (felt & (room * np.where(felt, known, 1.0) <= _ON_LIMIT))


def beside_limits(posterior: Posterior, values: FloatArray) -> FloatArray:
    """(n_par,) `values`, but for parameters on a limit at which the curve does not depend on them
    to first order (the b of sqrt(a^2 + b^2 x^2) at 0), or not at all on another one (the t of a
    exp(-x/t) where a is 0).  Such a one lies inside, where the density has fallen by half a unit.
    """
    low, high = posterior.problem.support()
    limits, inside = np.flatnonzero(on_limit(posterior, values)), values.copy()
    if not limits.size:
        return inside
    known = np.sqrt(np.diag(information(posterior, values)))
    silent = bool(np.any(known[list(posterior.problem.of_curve)] == 0.0))
    for i in limits:
        below = values[i] - low[i] < high[i] - values[i]
        room = high[i] - values[i] if below else values[i] - low[i]
        reach = min(room, 1.0 / known[i] if known[i] > 0.0 else np.inf)
        anywhere = max(1.0, abs(values[i])) * _ANYWHERE
        steps = reach * _FALLING if reach < anywhere[0] else anywhere
        places = np.tile(values, (1 + steps.size, 1))
        places[1:, i] += steps if below else -steps
        with np.errstate(all="ignore"):
            heights = posterior.log_density(places)
        fallen = heights[0] - heights[1:] > 0.5
        if (silent or heights[0] - heights[1] > _MUCH) and not np.all(fallen):
            inside[i] = places[1 + np.argmin(fallen), i]
    return inside


def known_from_data(posterior: Posterior, values: FloatArray) -> FloatArray:
    """(n_par, n_par) what the data tell about the parameters at `values`: the Fisher information,
    of those that `beside_limits` moves, and of what they hide, that inside.
    """
    matrix, inside = posterior.information(values), beside_limits(posterior, values)
    moved = inside != values
    if np.any(moved):
        matrix[moved], matrix[:, moved] = 0.0, 0.0
        alone = np.diag(matrix)
        beside = np.diag(posterior.information(inside))
        own = np.where(alone <= _SILENT * beside, beside, alone)
        np.fill_diagonal(matrix, own)
    return matrix


def prior_sds(problem: Problem, cov: FloatArray) -> FloatArray:
    """(n_par,) standard deviations of the priors; of a flat one without limits 1000 posterior
    standard deviations (`cov`).
    """
    sds = np.array([p.prior.sd for p in problem.parameters])
    return finite_or(sds, 1e3 * sds_of(cov))
