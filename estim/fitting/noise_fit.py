"""The noise parameters of the posterior mode, those of the curve held: one of the two halves of a
round of `estim.fitting.least_squares`.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.problem import Coordinates, Posterior

_LEAST = 1e-6  # of a prior's standard deviation: the smallest size


def fit_noise(posterior: Posterior, values: FloatArray) -> FloatArray:
    """The noise parameters that maximise the posterior, those of the curve held."""
    from scipy.optimize import minimize

    problem = posterior.problem
    free = [i for i, p in enumerate(problem.parameters) if p.name in problem.noise_names]
    if not free:
        return values
    priors = [problem.parameters[i].prior for i in free]
    sds, squared = np.array([prior.sd for prior in priors]), problem.sizes_from_zero[free]
    known = np.where(values[free] > 10.0 * _LEAST * sds, values[free], sds)
    coordinates = Coordinates(known, np.zeros_like(squared), np.where(squared, known, 0.0))
    scale = np.where(squared, 1.0, sds)

    def filled(coordinates_scaled: FloatArray) -> FloatArray:
        full = values.copy()
        full[free] = coordinates.values(coordinates_scaled * scale)
        return full

    def objective(coordinates_scaled: FloatArray) -> tuple[float, FloatArray]:
        full = filled(coordinates_scaled)
        residuals = posterior.prior_residuals(full)[free]
        minus = 0.5 * float(residuals @ residuals) - float(
            posterior.log_likelihood(full[None, :])[0]
        )
        slopes = (
            problem.prior_gradient(full)[free] - posterior.log_density_noise_gradient(full)[free]
        )
        return minus, coordinates.slopes(full[free]) * scale * slopes

    low, high = (
        coordinates.of(ends) / scale
        for ends in (
            np.maximum([prior.low for prior in priors], _LEAST * sds),
            np.array([prior.high for prior in priors]),
        )
    )
    start = np.clip(coordinates.of(values[free]) / scale, low, high)
    result = minimize(
        objective,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(low, high, strict=True)),
        # the gradient, by differences, is no better than the rounding of all terms
        options={"ftol": 1e-14, "gtol": 1e-8 * problem.n_obs, "maxiter": 500},
    )
    return filled(result.x)
