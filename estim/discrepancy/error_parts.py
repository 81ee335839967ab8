"""What the errors of the readings are made of, and what each part contributes to quantities of a
fit.

Errors with C = sum_k C_k move a quantity whose parameters respond by `along` = S g (S the
covariance, g the gradient) with the variances

    a^T C_k a,    a = C^-1 J S g,    J the derivatives of the curve.

Parts are separated where a covariance was made of them: what the curve lacks, a free start, bad
frames.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.common import later
from estim.discrepancy.likelihood import MixtureErrors
from estim.problem import Group, Named, Posterior

FORCE = later("unmodelled force")
DEVIATION = later("the unmodelled deviation")
START = later("start")
FRAMES = later("bad frames")


def parts_of_errors(
    posterior: Posterior, values: FloatArray, along: FloatArray
) -> dict[str, FloatArray]:
    """Part -> its standard uncertainty (n_quantity,) in each quantity, for `along` (n_par,
    n_quantity) at values (n_par,).

    Independent errors of the readings are no part; they are what remains.
    """
    problem = posterior.problem
    named = posterior.problem.named(values)
    squares = dict[str, FloatArray]()
    for group, likelihood in zip(problem.groups, posterior.likelihoods, strict=True):
        if not isinstance(likelihood, MixtureErrors):
            continue
        for name, square in _parts(
            group, likelihood, named, likelihood.gradient(named, problem.names) @ along
        ).items():
            squares[name] = squares.get(name, np.zeros(along.shape[1])) + square
    return {name: np.sqrt(square) for name, square in squares.items()}


def _parts(
    group: Group, likelihood: MixtureErrors, named: Named, moved: FloatArray
) -> dict[str, FloatArray]:
    """Variances (n_quantity,), for the response of the points `moved` (n_obs, n_quantity)."""
    mixture, residuals = likelihood.mixture, likelihood.residuals_at(named)
    likely, coloured = mixture.likely(residuals), mixture.deviation.root.coloured
    weighted = likely.turned_back(likely.whiten(moved.T)).T
    basis, lifted, _ = mixture.lifted(residuals)
    forced = group.runs[0].force > 0.0
    parts = {
        FORCE if forced else DEVIATION: np.sum(
            lifted[:, None] * np.square(coloured(basis.T) @ weighted), axis=0
        )
    }
    n_start = len(group.runs) if forced else 0
    for name, columns in (
        (START, mixture.columns[:, :n_start]),
        (FRAMES, mixture.columns[:, n_start:]),
    ):
        if columns.shape[1]:
            parts[name] = np.sum(np.square(coloured(columns.T) @ weighted), axis=0)
    return parts
