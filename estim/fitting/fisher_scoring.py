"""The end of a search that creeps (`Likelihood.creeps`): steps by the Fisher information, between
the limits of the parameters.
"""

from __future__ import annotations

import math

import numpy as np

from estim.arrays import FloatArray, all_finite
from estim.problem import Posterior

SILENT = 1e-11  # ratio of singular values


def finished(
    posterior: Posterior, values: FloatArray, free: list[int], *, tolerance: float
) -> FloatArray:
    """`values` (n_par,) after steps in the parameters `free` as long as they help, until one is
    shorter than `tolerance` standard deviations.
    """
    priors = posterior.problem.parameters
    low = np.array([priors[i].prior.low for i in free])
    high = np.array([priors[i].prior.high for i in free])
    height = float(np.sum(posterior.residuals(values) ** 2))
    for _ in range(20):
        slopes = np.diag(posterior.prior_slopes(values))
        pairs = [*posterior.scoring(values), (slopes, posterior.prior_residuals(values))]
        rows = np.vstack([pair[0] for pair in pairs])[:, free]
        aim = np.concatenate([pair[1] for pair in pairs])
        if not (all_finite(rows) and all_finite(aim)):
            break
        step = step_between(rows, aim, low - values[free], high - values[free])
        length, reached = 1.0, math.inf
        while length > 1e-3 and not reached < height:
            trial = values.copy()
            trial[free] = np.clip(values[free] + length * step, low, high)
            reached, length = float(np.sum(posterior.residuals(trial) ** 2)), 0.5 * length
        if not reached < height:
            break
        values, height = trial, reached
        if float(np.linalg.norm(rows @ step)) < tolerance:
            break
    return values


def step_between(
    rows: FloatArray, aim: FloatArray, low: FloatArray, high: FloatArray, *, silent: float = SILENT
) -> FloatArray:
    """(n_par,) step s of least |rows s + aim| with low <= s <= high; low <= 0 <= high.

    The free step, merely cut off at a limit, leads nowhere where parameters are correlated: what
    the others do for the one that is held must be taken back.

    rows : (n, n_par).
    aim : (n,).  silent : ratio of singular values of unit columns that counts as 0.
    """
    from scipy.optimize import lsq_linear

    scale = np.linalg.norm(rows, axis=0)
    scale[scale == 0.0] = 1.0
    scaled = rows / scale
    step = np.asarray(np.linalg.lstsq(scaled, -aim, rcond=silent)[0] / scale)
    if np.all((step >= low) & (step <= high)):
        return step
    # what the data are silent about stays where it is
    still = silent * np.linalg.norm(scaled, 2) * np.eye(scale.size)
    result = lsq_linear(
        np.vstack([scaled, still]),
        np.append(-aim, np.zeros(scale.size)),
        bounds=(low * scale, high * scale),
        method="bvls",
    )
    return np.clip(result.x / scale, low, high)
