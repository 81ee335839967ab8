"""Starts of descents beside the stated one (multistart): the best of many points around it."""

from __future__ import annotations

import math

import numpy as np

from estim.arrays import FloatArray
from estim.fitting.distinct_optima import distance
from estim.fitting.separable import SeparableSearch

N_START = 8
ALIKE = 0.01  # squared distance of starts that are not worth two searches
_N_SCREENED = 200


def starts_around(
    search: SeparableSearch, start: FloatArray, rng: np.random.Generator, n: int
) -> list[FloatArray]:
    """The best `n` of many points around the start, no two of them close."""
    scattered = _scattered(search, start, rng, _N_SCREENED)
    points, heights = search.squares.evaluate(scattered, np.arange(_N_SCREENED))
    points = points[np.argsort(heights, kind="stable")[: np.isfinite(heights).sum()]]
    chosen: list[FloatArray] = []
    while len(points) and len(chosen) < n:
        chosen.append(points[0])
        points = points[distance(search, points, points[0]) > ALIKE]
    return chosen


def _scattered(
    search: SeparableSearch, start: FloatArray, rng: np.random.Generator, n: int
) -> FloatArray:
    """(n, n_par) points around the start: each nonlinear parameter times a factor, or drawn between
    its limits or from its prior.
    """
    points = np.repeat(start[None, :], n, axis=0)
    for i in search.nonlinear:
        prior = search.posterior.problem.parameters[i].prior
        if math.isfinite(prior.sd) and math.isfinite(prior.low) == math.isfinite(prior.high):
            points[:, i] = prior.draw(rng, n)
            continue
        size = start[i] if start[i] != 0.0 else rng.choice([-1.0, 1.0], n)
        factors = size * 10.0 ** rng.standard_normal(n)
        points[:, i] = np.clip(factors, search.low[i], search.high[i])
    return points
