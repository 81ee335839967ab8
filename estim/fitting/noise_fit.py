"""The noise parameters of the posterior mode, those of the curve held: one of the two halves of a
round of `estim.fitting.least_squares`.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.problem import Posterior


def fit_noise(posterior: Posterior, values: FloatArray) -> FloatArray:
    """The noise parameters that maximise the posterior, those of the curve held."""
    from scipy.optimize import minimize

    problem = posterior.problem
    free = [i for i, p in enumerate(problem.parameters) if p.name in problem.noise_names]
    if not free:
        return values
    priors = [problem.parameters[i].prior for i in free]
    scale = np.array([prior.sd for prior in priors])

    def filled(scaled: FloatArray) -> FloatArray:
        full = values.copy()
        full[free] = scaled * scale
        return full

    def objective(scaled: FloatArray) -> tuple[float, FloatArray]:
        full = filled(scaled)
        off = posterior.prior_residuals(full)[free]
        minus = 0.5 * float(off @ off) - float(posterior.log_likelihood(full[None, :])[0])
        return minus, (
            problem.prior_gradient(full[None, :])[0, free]
            - posterior.log_density_noise_gradient(full)[free]
        ) * scale

    bounds = [
        (max(prior.low, 1e-6 * prior.sd) / s, prior.high / s)
        for prior, s in zip(priors, scale, strict=True)
    ]
    start = np.clip(values[free] / scale, [low for low, _ in bounds], [high for _, high in bounds])
    result = minimize(
        objective,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"ftol": 1e-14, "gtol": 1e-9, "maxiter": 500},
    )
    return filled(result.x)
