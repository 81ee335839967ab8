"""How well draws stand for a posterior: rank-normalised R-hat, effective sizes and Monte-Carlo
standard errors, autocorrelation time.

R-hat and effective sizes are those of Vehtari, Gelman, Simpson, Carpenter, Buerkner, Bayesian
Analysis 16 (2021) 667: draws are ranked once for both, and autocovariances are averaged over chains
before they are transformed back.  Tests hold them against arviz-stats.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from estim.arrays import FloatArray, IntArray, all_finite

_LOW, _HIGH = 0.05, 0.95  # quantiles whose effective size is that of the tails
_LEAST_STEPS = 4


@dataclass(frozen=True, eq=False)
class Mixing:
    """rhat : (n_par,) rank-normalised split R-hat between ensembles.  ess_bulk, ess_tail : (n_par,)
    effective sample sizes, with every walker of every ensemble as a chain.
    """

    rhat: FloatArray
    ess_bulk: FloatArray
    ess_tail: FloatArray


def mixing_of(draws: FloatArray) -> Mixing:
    """How well draws (n_ensemble, n_step, n_walker, n_par) mix.  Of an odd number of steps the
    first is left out, so that the two halves are equally long.
    """
    draws = draws[:, draws.shape[1] % 2 :]
    each = np.array([_mixing(draws[..., i]) for i in range(draws.shape[-1])])
    return Mixing(*np.ascontiguousarray(each.T))


def effective_size(draws: FloatArray) -> FloatArray:
    """(n_par,) effective sample size of the mean, with every walker of every ensemble as a
    chain.
    """
    few = draws.shape[1] < _LEAST_STEPS
    return np.array(
        [
            math.nan if few else _size(_halves(_chains(draws[..., i])))
            for i in range(draws.shape[-1])
        ]
    )


def mcse_mean(draws: FloatArray) -> FloatArray:
    """(n_par,) Monte-Carlo standard error of the mean."""
    return np.std(draws.reshape(-1, draws.shape[-1]), axis=0, ddof=1) / np.sqrt(
        effective_size(draws)
    )


def autocorrelation_time(draws: FloatArray) -> float:
    """Longest integrated autocorrelation time, steps, averaged over the ensembles; nan while it
    cannot be estimated.

    As `emcee.autocorr.integrated_time`, the walkers transformed together.  draws (n_ensemble,
    n_step, n_walker, n_par).
    """
    # a walker that never moved has no autocorrelation: nan
    with np.errstate(divide="ignore", invalid="ignore"):
        times = np.array(
            [[_integrated(ensemble[:, :, i]) for i in range(draws.shape[-1])] for ensemble in draws]
        )
    return float(np.max(np.mean(times, axis=0))) if all_finite(times) else math.nan


def _integrated(series: FloatArray) -> float:
    """Integrated autocorrelation time of series (n_step, n_walker), in Sokal's window of five times
    itself.
    """
    n_step = series.shape[0]
    walkers = np.ascontiguousarray(series.T)
    power = (
        np.abs(
            np.fft.rfft(
                walkers - np.mean(walkers, axis=1, keepdims=True),
                n=2 << (n_step - 1).bit_length(),
                axis=1,
            )
        )
        ** 2
    )
    acf = np.fft.irfft(power, axis=1)[:, :n_step]
    times = 2.0 * np.cumsum(np.mean(acf / acf[:, :1], axis=0)) - 1.0
    inside = np.arange(n_step) < 5.0 * times
    return float(times[np.argmin(inside) if np.any(inside) else n_step - 1])


def _mixing(draws: FloatArray) -> tuple[float, float, float]:
    """R-hat, and effective sizes in bulk and tails, of one parameter's draws (n_ensemble, n_step,
    n_walker), n_step even; nan where they are too few.
    """
    n_ensemble, n_step, n_walker = draws.shape
    flat = draws.ravel()
    if np.isnan(flat).any() or n_step * n_walker < _LEAST_STEPS:
        return math.nan, math.nan, math.nan
    order = np.argsort(flat)
    ordered = flat[order]
    scores = _normal_scores(order, ordered).reshape(draws.shape)
    rhat = math.nan
    if n_ensemble > 1:
        folded = _folded_scores(order, ordered)
        with np.errstate(divide="ignore", invalid="ignore"):  # nan where no walker moved
            rhat = max(
                _split_r_hat(_halves(values.reshape(n_ensemble, -1))) for values in (scores, folded)
            )
    if n_step < _LEAST_STEPS:
        return rhat, math.nan, math.nan
    indicators = (_chains(draws) <= ordered[int(p * (flat.size - 1))] for p in (_LOW, _HIGH))
    tails = [_size(_halves(indicator).astype(float)) for indicator in indicators]
    return rhat, _size(_halves(_chains(scores))), min(tails)


def _normal_scores(order: IntArray, ordered: FloatArray) -> FloatArray:
    """Normal quantiles (n,) of the ranks of values, equal ones with their mean rank (Blom's
    offset); ordered : the values in their `order`, (n,).
    """
    ends = np.append(np.flatnonzero(ordered[1:] != ordered[:-1]) + 1, ordered.size)
    starts = np.concatenate([[0], ends[:-1]])
    scores = ndtri((0.5 * (starts + ends + 1) - 0.375) / (ordered.size + 0.25))
    quantiles = np.empty(ordered.size)
    quantiles[order] = np.repeat(scores, ends - starts)
    return quantiles


def _folded_scores(order: IntArray, ordered: FloatArray) -> FloatArray:
    """The same of the distances from the median: two rows in order already, those below it and
    those above.
    """
    middle = ordered.size // 2
    median = (
        0.5 * (ordered[middle - 1] + ordered[middle]) if ordered.size % 2 == 0 else ordered[middle]
    )
    distances = np.abs(ordered - median)
    merged = np.argsort(distances, kind="stable")
    return _normal_scores(order[merged], distances[merged])


def _chains(draws: FloatArray) -> FloatArray:
    """(n_ensemble * n_walker, n_step) of draws (n_ensemble, n_step, n_walker)."""
    return np.swapaxes(draws, 1, 2).reshape(-1, draws.shape[1])


def _halves(chains: NDArray) -> NDArray:  # type: ignore[type-arg]
    """(2 n_chain, n_step // 2): first and second halves as chains of their own."""
    half = chains.shape[1] // 2
    return np.vstack([chains[:, :half], chains[:, -half:]])


def _split_r_hat(chains: FloatArray) -> float:
    """R-hat of chains (n_chain, n_step)."""
    n_step = chains.shape[1]
    between = n_step * np.var(np.mean(chains, axis=1), ddof=1)
    return float(
        np.sqrt((between / np.mean(np.var(chains, axis=1, ddof=1)) + n_step - 1.0) / n_step)
    )


def _size(chains: FloatArray) -> float:
    """Effective sample size of chains (n_chain, n_step) by Geyer's initial monotone sequence; of
    all draws where none differs.
    """
    n_chain, n_step = chains.shape
    spread = float(np.ptp(chains))
    if math.isnan(spread) or not spread > np.finfo(float).resolution:
        return spread if math.isnan(spread) else float(chains.size)
    means = np.mean(chains, axis=1)
    transformed = np.fft.rfft(chains - means[:, None], n=2 << (n_step - 1).bit_length(), axis=1)
    power = np.mean(np.square(transformed.real) + np.square(transformed.imag), axis=0)
    covariance = np.fft.irfft(power)[:n_step] / n_step
    within = covariance[0] * n_step / (n_step - 1.0)
    rho = 1.0 - (within - covariance) / (
        covariance[0] + (float(np.var(means, ddof=1)) if n_chain > 1 else 0.0)
    )
    rho[0] = 1.0
    pairs = rho[: n_step // 2 * 2 : 2] + rho[1::2]
    ends = np.flatnonzero(pairs <= 0.0)
    # the pair behind those that count
    last = min(int(ends[0]) if ends.size else n_step, max(0, (n_step - 3) // 2))
    half = float(rho[2 * last]) if rho[2 * last] > 0.0 or pairs[last] >= 0.0 else 0.0
    tau = -1.0 + 2.0 * float(np.sum(np.minimum.accumulate(pairs[:last]))) + half
    return chains.size / max(tau, 1.0 / math.log10(chains.size))
