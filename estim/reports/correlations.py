"""Correlations of draws for `result.json`: of all parameters, or of very many those that runs share and those of the runs that are tied most."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estim.pipeline import Analysis
from estim.reports.records import Correlation

_MOST = 150  # parameters: the matrix grows with their square


def correlation_of(analysis: Analysis) -> Correlation:
    """Of at most `_MOST` parameters, in their order."""
    kept = _told(analysis)
    matrix = np.atleast_2d(np.corrcoef(analysis.chain.flat[:, kept].T))
    return Correlation([analysis.problem.names[i] for i in kept], matrix.round(6).tolist())


def _told(analysis: Analysis) -> list[int]:
    """Places of half as many parameters in order, shared ones first, then whole runs by their strongest correlation."""
    problem, draws = analysis.problem, analysis.chain.flat
    if problem.n_par <= _MOST:
        return list(range(problem.n_par))
    kept = set(problem.foremost(_MOST // 2))
    uses = np.bincount(np.concatenate(problem.columns), minlength=problem.n_par)

    def strongest(used: NDArray[np.int64]) -> float:
        found = np.abs(np.atleast_2d(np.corrcoef(draws[:, used].T))) - np.eye(used.size)
        return float(np.max(found[:, uses[used] == 1], initial=0.0))

    for used in sorted(problem.columns, key=strongest, reverse=True):
        if len(kept.union(used.tolist())) <= _MOST:
            kept.update(used.tolist())
    return sorted(kept)
