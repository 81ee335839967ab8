"""Fisher information: what data and priors together know at a point, and in which units to compare
it.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import BoolArray, FloatArray, finite_or, sds_of
from estim.problem import Posterior, Problem

_ON_LIMIT = 1e-2  # standard deviations


def information(posterior: Posterior, values: FloatArray) -> FloatArray:
    """(n_par, n_par) Fisher information at `values`, priors included; its inverse is the Gaussian
    covariance.
    """
    return posterior.information(values) + np.diag(np.square(posterior.prior_slopes(values)))


def on_limit(posterior: Posterior, values: FloatArray) -> BoolArray:
    """(n_par,) which parameters lie on a limit of their priors.

    Those within 1 % of the standard deviation that they have when all others are held: one that
    another on its limit makes uncertain may lie far from its own.
    """
    low, high = posterior.problem.support()
    known = np.sqrt(np.diag(information(posterior, values)))
    room = np.minimum(values - low, high - values)
    felt = known > 0.0
    return (room <= 0.0) | (felt & (room * np.where(felt, known, 1.0) <= _ON_LIMIT))


def prior_sds(problem: Problem, cov: FloatArray) -> FloatArray:
    """(n_par,) standard deviations of the priors; of a flat one without limits 1000 posterior
    standard deviations (`cov`).
    """
    sds = np.array([p.prior.sd for p in problem.parameters])
    return finite_or(sds, 1e3 * sds_of(cov))
