"""How well a model predicts frames that it was not fitted to: leave-one-out cross-validation from
one set of draws.

Vehtari, Gelman, Gabry, Stat. Comput. 27 (2017) 1413: the draws are reweighted by 1/p(y_i | all
else), the weights Pareto-smoothed.  A frame whose k-hat is above 0.7 decides the fit by itself; its
term cannot be trusted, and it is named.  Only models of the same data can be compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, log_sum_exp
from estim.problem import Posterior
from estim.sampling import pareto_smoothed


@dataclass(frozen=True, eq=False)
class LeaveOneOut:
    """Expected log predictive density for a new frame, summed over the frames.

    elpd, se : sum and its standard error from the spread between frames.
    p_loo : effective number of parameters.
    pointwise : for each run (n_obs,) terms of the sum.
    k_hat : for each run (n_obs,).
    """

    elpd: float
    se: float
    p_loo: float
    pointwise: tuple[FloatArray, ...]
    k_hat: tuple[FloatArray, ...]


def leave_one_out(posterior: Posterior, draws: FloatArray) -> LeaveOneOut:
    """PSIS-LOO from posterior draws (n_draw, n_par); where errors are correlated, each frame given
    all others of its run.
    """
    terms, shapes, total = [], [], 0.0
    for log_density in posterior.pointwise(draws):
        smoothed = [pareto_smoothed(-column)[:2] for column in log_density.T]  # weights 1/density
        terms.append(
            log_sum_exp(
                np.array([log_weights for log_weights, _ in smoothed]).T + log_density, axis=0
            )
        )
        shapes.append(np.array([k_hat for _, k_hat in smoothed]))
        total += float(np.sum(log_sum_exp(log_density, axis=0) - np.log(draws.shape[0])))
    flat = np.concatenate(terms)
    return LeaveOneOut(
        elpd=float(flat.sum()),
        se=float(np.sqrt(flat.size * np.var(flat, ddof=1))),
        p_loo=total - float(flat.sum()),
        pointwise=tuple(terms),
        k_hat=tuple(shapes),
    )


def difference(a: LeaveOneOut, b: LeaveOneOut) -> tuple[float, float]:
    """elpd of `a` minus that of `b` and its standard error, from the paired differences of the
    frames.
    """
    paired = np.concatenate(a.pointwise) - np.concatenate(b.pointwise)
    return float(paired.sum()), float(np.sqrt(paired.size * np.var(paired, ddof=1)))
