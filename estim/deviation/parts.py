"""What the errors of the readings are made of, and what each part contributes to quantities of a fit.

Errors with C = sum_k C_k move a quantity whose parameters answer by `along` = S g (S the covariance, g the gradient) with the variances

    a^T C_k a,    a = C^-1 J S g,    J the derivatives of the curve.

Parts are told apart where a covariance was made of them: what the curve lacks, a free start, bad frames, usual errors of clock and scale.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.common import later
from estim.deviation.errors import MixtureErrors
from estim.deviation.usual_errors import USUAL as USUAL
from estim.deviation.usual_errors import WithUsualErrors as WithUsualErrors
from estim.deviation.usual_errors import read_off as read_off
from estim.deviation.usual_errors import usual_errors_of
from estim.problem import Group, Likelihood, Named, Posterior

FORCE, DEVIATION, START, FRAMES = later("unmodelled force"), later("what the curve lacks"), later("start"), later("bad frames")


def parts_of_errors(posterior: Posterior, values: FloatArray, along: FloatArray) -> dict[str, FloatArray]:
    """Part -> its standard uncertainty (n_quantity,) in each quantity, for `along` (n_par, n_quantity) at values (n_par,).

    Independent errors of the readings are no part; they are what remains.
    """
    problem, named, squares = posterior.problem, posterior.problem.named(values), dict[str, FloatArray]()
    for group, likelihood in zip(problem.groups, posterior.likelihoods, strict=True):
        gradient = np.vstack([run.points.gradient(named, problem.names) for run in group.runs])
        parts = _mixed if isinstance(likelihood, MixtureErrors) else _usual
        for name, square in parts(group, likelihood, named, gradient @ along).items():
            squares[name] = squares.get(name, np.zeros(along.shape[1])) + square
    return {name: np.sqrt(square) for name, square in squares.items()}


def _mixed(group: Group, likelihood: Likelihood, named: Named, moved: FloatArray) -> dict[str, FloatArray]:
    """Variances (n_quantity,), for the answer of the points `moved` (n_obs, n_quantity)."""
    assert isinstance(likelihood, MixtureErrors)
    mixture, residuals = likelihood.mixture, likelihood.residuals_at(named)
    deviation = mixture.deviation
    weighed = mixture.weighed(deviation.whiten(moved.T), residuals).T
    basis, lifted, white = mixture.lifted(residuals)
    forced = group.runs[0].force > 0.0
    parts = {FORCE if forced else DEVIATION: np.sum(lifted[:, None] * np.square(basis.T @ weighed), axis=0)}
    n_start = len(group.runs) if forced else 0
    for name, columns in ((START, mixture.columns[:, :n_start]), (FRAMES, mixture.columns[:, n_start:])):
        if columns.shape[1]:
            parts[name] = np.sum(np.square(columns.T @ weighed), axis=0)
    for name, column in _columns(group, named):
        parts[name] = white * np.square(deviation.whiten(column) @ weighed)
    return parts


def _usual(group: Group, likelihood: Likelihood, named: Named, moved: FloatArray) -> dict[str, FloatArray]:
    if likelihood.normal is None or not (columns := _columns(group, named)):
        return {}
    root = likelihood.normal.root(named)
    weighed = root.turned_back(root.whiten(moved.T)).T
    return {name: np.square(column @ weighed) for name, column in columns}


def _columns(group: Group, named: Named) -> list[tuple[str, FloatArray]]:
    """What one standard deviation of each usual error does to the points (n_obs,) of a run by itself."""
    usual = usual_errors_of(group.runs[0].noise) if len(group.runs) == 1 else None
    return [] if usual is None else list(zip(usual.sds, usual.columns(group.runs[0].points, named).T, strict=True))
