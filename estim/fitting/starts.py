"""Where the starts of a search lead, all at once: one call of the curve for every start costs
little more than one for a single one.

A first look: what it leads to one place is searched from there once
(`estim.fitting.least_squares`), and a start that it leads nowhere goes its own way as if it had not
been looked at.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.fitting.separable import SeparableSearch
from estim.problem import Posterior, Problem

_NEAR = 9.0  # mean square of the whitened residuals
_SAME = 0.5  # in log density
_SETTLED, _N_STEP = 1e-9, 14


def stands_for(posterior: Posterior, values: FloatArray, led: FloatArray) -> bool:
    """Whether `led` need not be searched from beside the optimum `values` (n_par,) of `posterior`:
    its density is as high.

    Only where the curve passes near the points: elsewhere it may be flat, and a first look leads
    there whatever lies beyond.
    """
    heights = posterior.log_density(np.vstack([values, led]))
    return (
        float(np.mean(posterior.size_residuals(values) ** 2)) < _NEAR
        and abs(float(heights[1] - heights[0])) < _SAME
    )


def led_together(posterior: Posterior, starts: FloatArray) -> FloatArray:
    """(n_start, n_par) where least squares with the covariances of `posterior` lead from `starts`
    (n_start, n_par).

    They stay where they are under heavy tails and for counts, whose sums of squares change their
    curvature on the way; many runs are led one by one.
    """
    problem = posterior.problem
    if (
        len(starts) < 2
        or len(problem.runs) > 1
        or not _square(problem)
        or any(likelihood.creeps for likelihood in posterior.likelihoods)
    ):
        return starts
    low, high = problem.support()
    free = np.array(
        [i for i, p in enumerate(problem.parameters) if p.name not in problem.noise_names],
        dtype=np.int64,
    )
    search = SeparableSearch(posterior, starts[0], low, high, np.zeros(0, dtype=np.int64), free)
    return search.squares.descend(starts, share=_SETTLED, most=_N_STEP)[0]


def _square(problem: Problem) -> bool:
    return problem.for_search() is problem and not any(run.noise.robust for run in problem.runs)
