"""Fisher information: what data and priors together know at a point, the data alone, and in which units to compare them."""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.problem import Posterior, Problem


def information(posterior: Posterior, values: FloatArray) -> FloatArray:
    """(n_par, n_par) Fisher information at `values`, priors included; its inverse is the Gaussian covariance."""
    problem = posterior.problem
    pulls = [p.prior.residual_slope(float(v)) for p, v in zip(problem.parameters, values, strict=True)]
    return posterior.information(values) + np.diag(np.square(pulls))


def data_information(posterior: Posterior, values: FloatArray) -> FloatArray:
    """(n_par, n_par) Fisher information of the data alone at `values`, without the priors."""
    return information(posterior, values) - np.diag(np.square(prior_slopes(posterior.problem, values)))


def prior_sds(problem: Problem, cov: FloatArray) -> FloatArray:
    """(n_par,) standard deviations of the priors; of a flat one without limits 1000 posterior standard deviations (`cov`)."""
    sds = np.array([p.prior.sd for p in problem.parameters])
    return np.where(np.isfinite(sds), sds, 1e3 * np.sqrt(np.diag(cov)))


def prior_slopes(problem: Problem, values: FloatArray) -> FloatArray:
    """(n_par,) derivatives of the residuals of the priors at `values`; 0 for a uniform one."""
    return np.array([p.prior.residual_slope(float(v)) for p, v in zip(problem.parameters, values, strict=True)])
