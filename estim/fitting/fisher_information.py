"""Fisher information: what data and priors together know at a point, and in which units to compare
it.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.problem import Posterior, Problem


def information(posterior: Posterior, values: FloatArray) -> FloatArray:
    """(n_par, n_par) Fisher information at `values`, priors included; its inverse is the Gaussian
    covariance.
    """
    return posterior.information(values) + np.diag(np.square(posterior.prior_slopes(values)))


def prior_sds(problem: Problem, cov: FloatArray) -> FloatArray:
    """(n_par,) standard deviations of the priors; of a flat one without limits 1000 posterior
    standard deviations (`cov`).
    """
    sds = np.array([p.prior.sd for p in problem.parameters])
    return np.where(np.isfinite(sds), sds, 1e3 * np.sqrt(np.diag(cov)))
