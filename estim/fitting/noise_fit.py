"""The noise parameters of the posterior mode, those of the curve held: one of the two halves of a
round of `estim.fitting.least_squares`.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.fitting.profile_search import search_of
from estim.levenberg_marquardt import Start, minima
from estim.problem import Posterior


def fit_noise(posterior: Posterior, values: FloatArray) -> FloatArray:
    """The noise parameters that maximise the posterior, those of the curve held."""
    problem = posterior.problem
    if not problem.noise_names:
        return values
    search = search_of(posterior, values, np.eye(values.size), squared=True)
    start = Start(search.coordinates.of(values), tuple(problem.of_curve), tolerance=1e-12)
    (end,) = minima(search, [start])
    return search.coordinates.values(end.values)
