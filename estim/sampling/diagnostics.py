"""How well draws stand for a posterior: rank-normalised R-hat, effective sizes and Monte-Carlo standard errors, from arviz-stats."""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray


def r_hat(draws: FloatArray) -> FloatArray:
    """(n_par,) rank-normalised split R-hat between ensembles; draws (n_ensemble, n_step, n_walker, n_par).

    Vehtari, Gelman, Simpson, Carpenter, Buerkner, Bayesian Analysis 16 (2021) 667; by arviz-stats.
    """
    from arviz_stats.base import array_stats

    n_ensemble, _, _, n_par = draws.shape
    with np.errstate(divide="ignore", invalid="ignore"):  # nan where no walker moved
        return np.array([float(array_stats.rhat(draws[..., i].reshape(n_ensemble, -1), chain_axis=0, draw_axis=1)) for i in range(n_par)])


def effective_size(draws: FloatArray, method: str) -> FloatArray:
    """(n_par,) effective sample size, `method` "bulk" or "tail", with every walker of every ensemble as a chain."""
    from arviz_stats.base import array_stats

    prob = (0.05, 0.95) if method == "tail" else None
    return np.array([float(array_stats.ess(c, chain_axis=0, draw_axis=1, method=method, prob=prob)) for c in _walkers(draws)])


def mcse_mean(draws: FloatArray) -> FloatArray:
    """(n_par,) Monte-Carlo standard error of the mean."""
    from arviz_stats.base import array_stats

    return np.array([float(array_stats.mcse(c, chain_axis=0, draw_axis=1, method="mean")) for c in _walkers(draws)])


def _walkers(draws: FloatArray) -> list[FloatArray]:
    """For each parameter, (n_ensemble * n_walker, n_step)."""
    moved = np.moveaxis(draws, 1, 2)
    return [moved[..., i].reshape(-1, draws.shape[1]) for i in range(draws.shape[-1])]
