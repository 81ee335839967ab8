"""How well draws stand for a posterior: rank-normalised R-hat, effective sizes and Monte-Carlo standard errors, from arviz-stats."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.sampling.normal_scores import folded, in_halves, normal_scores

_WINDOW = 5.0  # autocorrelation times


@dataclass(frozen=True, eq=False)
class Mixing:
    """rhat, ess_bulk, ess_tail : (n_par,) `r_hat` and `effective_size` of some draws."""

    rhat: FloatArray
    ess_bulk: FloatArray
    ess_tail: FloatArray


def mixing_of(draws: FloatArray) -> Mixing:
    """How well draws (n_ensemble, n_step, n_walker, n_par) mix."""
    return Mixing(r_hat(draws), effective_size(draws, "bulk"), effective_size(draws, "tail"))


def r_hat(draws: FloatArray) -> FloatArray:
    """(n_par,) rank-normalised split R-hat between ensembles; draws (n_ensemble, n_step, n_walker, n_par).

    Vehtari, Gelman, Simpson, Carpenter, Buerkner, Bayesian Analysis 16 (2021) 667; by arviz-stats.
    """
    from arviz_stats.base import array_stats

    n_ensemble, _, _, n_par = draws.shape
    hats = np.empty(n_par)
    with np.errstate(divide="ignore", invalid="ignore"):  # nan where no walker moved
        for i in range(n_par):
            values = in_halves(draws[..., i].reshape(n_ensemble, -1))
            parts = (normal_scores(values), normal_scores(folded(values)))
            hats[i] = max(float(array_stats.rhat(part, chain_axis=0, draw_axis=1, method="split")) for part in parts)
    return hats


def effective_size(draws: FloatArray, method: str) -> FloatArray:
    """(n_par,) effective sample size, `method` "bulk" or "tail", with every walker of every ensemble as a chain."""
    from arviz_stats.base import array_stats

    if method == "bulk":
        scores = (normal_scores(in_halves(c)) for c in _walkers(draws))
        return np.array([float(array_stats.ess(c, chain_axis=0, draw_axis=1, method="mean")) for c in scores])
    prob = (0.05, 0.95) if method == "tail" else None
    return np.array([float(array_stats.ess(c, chain_axis=0, draw_axis=1, method=method, prob=prob)) for c in _walkers(draws)])


def mcse_mean(draws: FloatArray) -> FloatArray:
    """(n_par,) Monte-Carlo standard error of the mean."""
    from arviz_stats.base import array_stats

    return np.array([float(array_stats.mcse(c, chain_axis=0, draw_axis=1, method="mean")) for c in _walkers(draws)])


def autocorrelation_time(draws: FloatArray) -> float:
    """Longest integrated autocorrelation time, steps, averaged over the ensembles; nan while it cannot be told.

    As `emcee.autocorr.integrated_time`, the walkers transformed together.  draws (n_ensemble, n_step, n_walker, n_par).
    """
    with np.errstate(divide="ignore", invalid="ignore"):  # a walker that never moved has no autocorrelation: nan
        times = np.array([[_integrated(ensemble[:, :, i]) for i in range(draws.shape[-1])] for ensemble in draws])
    return float(np.max(np.mean(times, axis=0))) if np.all(np.isfinite(times)) else math.nan


def _integrated(series: FloatArray) -> float:
    """Integrated autocorrelation time of series (n_step, n_walker), in Sokal's window of five times itself."""
    n_step = series.shape[0]
    walkers = np.ascontiguousarray(series.T)
    power = np.abs(np.fft.rfft(walkers - np.mean(walkers, axis=1, keepdims=True), n=2 << (n_step - 1).bit_length(), axis=1)) ** 2
    acf = np.fft.irfft(power, axis=1)[:, :n_step]
    times = 2.0 * np.cumsum(np.mean(acf / acf[:, :1], axis=0)) - 1.0
    inside = np.arange(n_step) < _WINDOW * times
    return float(times[np.argmin(inside) if np.any(inside) else n_step - 1])


def _walkers(draws: FloatArray) -> list[FloatArray]:
    """For each parameter, (n_ensemble * n_walker, n_step)."""
    moved = np.moveaxis(draws, 1, 2)
    return [moved[..., i].reshape(-1, draws.shape[1]) for i in range(draws.shape[-1])]
