"""The posterior mode with another noise, from where the same curve has been fit to the same points: nothing has to be sought from afar again."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estim.arrays import FloatArray
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.problem import Problem


def fit_beside(problem: Problem, fits: Sequence[Fit], *, rng: np.random.Generator) -> Fit | None:
    """The mode of `problem` from the centre of its priors and from all optima of that of `fits` which has its points and its curve.

    None where none has, or where a curve lacks something, whose noise is no other noise alone.
    """
    known = next((fit for fit in fits if fit.success and not fit.singular and _alike(fit.problem, problem)), None)
    if known is None or any(run.force or run.lacks is not None for run in problem.runs):
        return None
    return fit_least_squares(problem, rng=rng, n_start=1, further=[_named(problem, known.names, place) for place in (known.values, *known.others)])


def _alike(a: Problem, b: Problem) -> bool:
    """Whether two problems have the same points, and the same unknowns but for those of the noise."""
    if set(a.names) - a.noise_names != set(b.names) - b.noise_names or len(a.runs) != len(b.runs):
        return False
    return all(np.array_equal(p.x, q.x) and np.array_equal(p.y, q.y) for p, q in zip(a.runs, b.runs, strict=True))


def _named(problem: Problem, names: Sequence[str], values: FloatArray) -> FloatArray:
    """(n_par,) a place of another problem in this one, what it does not know at the centre of its prior."""
    known = dict(zip(names, values.tolist(), strict=True))
    own = problem.noise_names
    return np.array([v if n in own else known[n] for n, v in zip(problem.names, problem.start().tolist(), strict=True)])
