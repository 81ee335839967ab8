"""How well a model predicts frames that it has not seen: leave-one-out cross-validation from one set of draws.

Vehtari, Gelman, Gabry, Stat. Comput. 27 (2017) 1413: the draws are reweighted by 1/p(y_i | all else), the weights
Pareto-smoothed.  A frame whose k-hat is above 0.7 decides the fit by itself; its term cannot be trusted, and it is named.
Only models of the same data can be compared.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.problem import Posterior

INFLUENTIAL = 0.7  # of k-hat


@dataclass(frozen=True, eq=False)
class LeaveOneOut:
    """Expected log predictive density for a new frame, summed over the frames.

    elpd, se : sum and its standard error from the spread between frames.  p_loo : effective number of parameters.
    pointwise : for each run (n_obs,) terms of the sum.  k_hat : for each run (n_obs,).
    """

    elpd: float
    se: float
    p_loo: float
    pointwise: tuple[FloatArray, ...]
    k_hat: tuple[FloatArray, ...]


def leave_one_out(posterior: Posterior, draws: FloatArray) -> LeaveOneOut:
    """PSIS-LOO from posterior draws (n_draw, n_par); where errors are correlated, each frame given all others of its run."""
    from arviz_stats.base import array_stats
    from scipy.special import logsumexp

    terms, shapes, total = [], [], 0.0
    for log_density in posterior.pointwise(draws):
        # weights 1/density: arviz-stats takes minus the log weights
        with np.errstate(over="ignore"):  # arviz-stats 0.6 computes weights of a grid as 1/exp(...), where inf rightly gives 0
            log_weights, k_hat = array_stats.psislw(log_density.T)
        terms.append(np.asarray(logsumexp(log_weights + log_density.T, axis=-1)))
        shapes.append(np.asarray(k_hat))
        total += float(np.sum(logsumexp(log_density, axis=0) - np.log(draws.shape[0])))
    flat = np.concatenate(terms)
    return LeaveOneOut(
        elpd=float(flat.sum()), se=float(np.sqrt(flat.size * np.var(flat, ddof=1))), p_loo=total - float(flat.sum()),
        pointwise=tuple(terms), k_hat=tuple(shapes),
    )


def difference(a: LeaveOneOut, b: LeaveOneOut) -> tuple[float, float]:
    """elpd of `a` minus that of `b` and its standard error, from the paired differences of the frames."""
    paired = np.concatenate(a.pointwise) - np.concatenate(b.pointwise)
    return float(paired.sum()), float(np.sqrt(paired.size * np.var(paired, ddof=1)))
