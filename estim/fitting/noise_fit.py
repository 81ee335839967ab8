"""The noise parameters of the posterior mode, those of the curve held: one of the two halves of a
round of `estim.fitting.least_squares`.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.problem import Posterior

_LEAST = 1e-6  # of a prior's standard deviation: the smallest size


def fit_noise(posterior: Posterior, values: FloatArray) -> FloatArray:
    """The noise parameters that maximise the posterior, those of the curve held."""
    from scipy.optimize import minimize

    problem = posterior.problem
    free = [i for i, p in enumerate(problem.parameters) if p.name in problem.noise_names]
    if not free:
        return values
    priors = [problem.parameters[i].prior for i in free]
    # a likelihood depends on the square of a size: it is level at 0 even where it rises beside it
    squared = problem.sizes_from_zero[free]
    sds = np.array([prior.sd for prior in priors])
    scale = np.where(squared & (values[free] > 10.0 * _LEAST * sds), values[free], sds)

    def filled(places: FloatArray) -> FloatArray:
        full = values.copy()
        full[free] = np.where(squared, np.sqrt(np.abs(places)), places) * scale
        return full

    def objective(places: FloatArray) -> tuple[float, FloatArray]:
        full = filled(places)
        off = posterior.prior_residuals(full)[free]
        minus = 0.5 * float(off @ off) - float(posterior.log_likelihood(full[None, :])[0])
        slopes = scale / np.where(squared, 2.0 * full[free] / scale, 1.0)
        return minus, slopes * (
            problem.prior_gradient(full[None, :])[0, free]
            - posterior.log_density_noise_gradient(full)[free]
        )

    def scaled(at: FloatArray) -> FloatArray:
        return np.where(squared, np.square(at / scale), at / scale)

    low = scaled(np.maximum([prior.low for prior in priors], _LEAST * sds))
    high = scaled(np.array([prior.high for prior in priors]))
    start = np.clip(scaled(values[free]), low, high)
    result = minimize(
        objective,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(low, high, strict=True)),
        options={"ftol": 1e-14, "gtol": 1e-9, "maxiter": 500},
    )
    return filled(result.x)
