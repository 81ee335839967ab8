"""Are there several separate solutions?  Optima that the search found beside that of the fit,
weighted by the draws, or without any.

Two optima are separate modes where no path leads from one to the other on which the density stays
near that of the lower of the two, and each holds a share of the posterior that matters.  Two paths
are tried: the straight line, and the ridge (the parameter in which they differ most is moved from
one value to the other, all others re-optimised), for a ridge may be bent.  A mode that no start, no
scan (`estim.fitting.further_optima`) and no walker has met stays unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray, all_finite, positive_or
from estim.fitting import Fit, ProfileSearch, Start, information, minima, search_of
from estim.sampling import Optima

_VALLEY = 2.0  # drop of the log density between two modes
_N_RIDGE = 32  # points along a ridge
_SHARE = 0.01  # of the posterior
_NEGLIGIBLE = 1e-4  # the same by the normal distribution: optima that are not looked at


@dataclass(frozen=True, eq=False)
class Modes:
    """Separate modes of a posterior, that of the fit first; further ones that together hold less
    than 1 % are left out.

    values : (n_mode, n_par).
    shares : (n_mode,) of the posterior: of the draws nearest to each, or of the normal
        distributions at each.
    covs : (n_mode, n_par, n_par) covariances of those.
    """

    values: FloatArray
    shares: FloatArray
    covs: FloatArray

    @property
    def several(self) -> bool:
        return self.values.shape[0] > 1


def optima(fit: Fit) -> Modes:
    """All optima of a fit, separate or not, each with the normal distribution there (Laplace:
    height times root of the determinant).
    """
    values, covs, heights = [fit.values], [fit.cov], [_log_volume(fit, fit.values, fit.cov)]
    for other in fit.others:
        with np.errstate(all="ignore"):
            matrix = information(fit.posterior, other)
            cov = (
                np.asarray(np.linalg.pinv(matrix, hermitian=True), dtype=np.float64)
                if all_finite(matrix)
                else fit.cov
            )
        height = _log_volume(fit, other, cov)
        if math.isfinite(height):
            values.append(other)
            covs.append(cov)
            heights.append(height)
    shares = (
        np.exp(np.array(heights) - np.max(heights))
        if math.isfinite(heights[0])
        else np.eye(len(heights))[0]
    )
    return Modes(np.array(values), shares / np.sum(shares), np.array(covs))


def optima_of(fit: Fit) -> Optima:
    """Where the posterior of a fit is known to be high, for its proposals."""
    all_optima = optima(fit)
    # optima with so small a share have no ridges that are followed
    modes = tuple(all_optima.values[1:][all_optima.shares[1:] > 1e-3])
    starts = (
        *all_optima.values[1:],
        *(mean for discrepancy in fit.lacking for mean in discrepancy.parts.means),
    )
    covs = (
        *all_optima.covs[1:],
        *(cov for discrepancy in fit.lacking for cov in discrepancy.parts.covs),
    )
    return Optima(fit.values, fit.cov, starts, covs, modes, fit.parts)


def find_modes(fit: Fit, draws: FloatArray | None = None) -> Modes:
    """The separate modes of a fit and their shares of posterior draws (n_draw, n_par); None: by the
    normal distribution at each.
    """
    candidates = optima(fit)
    separate = _separate_modes(fit, candidates)
    values, shares = candidates.values[separate], candidates.shares[separate]
    if draws is not None:
        scale = positive_or(fit.scale, 1.0)
        distances = np.array([np.sum(((draws - mode) / scale) ** 2, axis=1) for mode in values])
        nearest = np.argmin(distances, axis=0)
        shares = np.bincount(nearest, minlength=len(separate)).astype(np.float64)
    return _that_matter(Modes(values, shares / np.sum(shares), candidates.covs[separate]))


def _log_volume(fit: Fit, values: FloatArray, cov: FloatArray) -> float:
    """log of the posterior density times the root of the determinant of `cov`."""
    sign, log_det = np.linalg.slogdet(cov)
    return fit.posterior.height(values) + 0.5 * float(log_det) if sign > 0.0 else -math.inf


def _separate_modes(fit: Fit, candidates: Modes) -> list[int]:
    """Which optima are separate from that of the fit and from each other."""
    separate, search = [0], search_of(fit.posterior, fit.values, fit.cov)
    scale = positive_or(search.scale, 1.0)
    for k in np.flatnonzero(candidates.shares[1:] > _NEGLIGIBLE) + 1:
        other = candidates.values[k]
        near = sorted(
            separate, key=lambda i: float(np.max(np.abs(candidates.values[i] - other) / scale))
        )
        if all(_separate(search, candidates.values[i], other) for i in {near[0], 0}):
            separate.append(int(k))
    return separate


def _that_matter(modes: Modes) -> Modes:
    """Without the smallest further modes, as long as those left out hold less than 1 % together."""
    order = 1 + np.argsort(-modes.shares[1:], kind="stable")
    remaining = np.array([np.sum(modes.shares[order[i:]]) for i in range(order.size)])
    matters = np.concatenate([[0], order[remaining >= _SHARE]]).astype(int)
    return Modes(modes.values[matters], modes.shares[matters], modes.covs[matters])


def _separate(search: ProfileSearch, a: FloatArray, b: FloatArray) -> bool:
    return not (_level(search, a, b) or _ridge(search, a, b) or _ridge(search, b, a))


def _level(search: ProfileSearch, a: FloatArray, b: FloatArray) -> bool:
    """Whether the density stays up along the straight line."""
    heights = search.objectives(a + np.linspace(0.0, 1.0, 65)[:, None] * (b - a))
    return bool(np.max(heights) <= max(heights[0], heights[-1]) + 2.0 * _VALLEY)


def _ridge(search: ProfileSearch, a: FloatArray, b: FloatArray) -> bool:
    """Whether it stays up along the ridge that starts at `a`, and that ridge meets `b`."""
    profiled = int(np.argmax(np.abs(b - a) / search.scale))
    highest = max(search.objective(a), search.objective(b)) + 2.0 * _VALLEY
    before, current, near = a, a, None
    for at in np.linspace(a[profiled], b[profiled], _N_RIDGE + 1)[1:]:
        guess = 2.0 * current - before  # straight on
        guess[profiled] = at
        (near,) = minima(search, [Start(guess, (profiled,), near)])
        if not near.objective <= highest:
            return False
        before, current = current, near.values
    return _level(search, current, b)
