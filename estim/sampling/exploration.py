"""Where else a posterior may have mass: a proposal that follows its ridges, made without a draw.

For every parameter the conditional maxima of all others are followed both ways from the mode (`estim.sampling.ridge_paths`), until
the density has fallen by e^-10 or a limit is met.  Each point of the way becomes a Student-t component as wide as the density is there
and as the step to its neighbours; the faint ones get the square root of their share, so that long tails are drawn often.
It shares nothing with a proposal that was adapted to draws of itself (`estim.sampling.proposal`), and misses what that one finds and the reverse:
weights of one over the mixture of both (the balance heuristic; Owen and Zhou, J. Am. Stat. Assoc. 95 (2000) 135) are right where
either is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estim.arrays import FloatArray
from estim.sampling.factors import lower_factor
from estim.sampling.importance import log_sum_exp
from estim.sampling.proposal import Proposal, grown
from estim.sampling.protocol import Density, Support, log_density_in_batches
from estim.sampling.ridge import Frame, framed, reordered, separate_modes
from estim.sampling.ridge_paths import Rule, follow

_RULE = Rule(depth=10.0, fall=2.0, tolerance=1e-2, least=1e-2, quick=True)
_POWER = 0.5  # of the share that a point of a ridge has
_OVERLAP = 0.6  # of the distance between neighbours, standard deviation along the ridge
_UNEVEN = 2.0  # density over proposal, root mean square at draws of the posterior, from which others are tried
_N_COMPONENT = (1, 4, 8)
_TRAINED = 0.75  # of the draws; the others judge
_RIDGE_SHARES = (0.5, 0.2)  # of the draws of a mixture: a long tail needs many of them, an uneven middle fewer


def ridge_proposal(
    density: Density, start: FloatArray, cov: FloatArray, *, starts: Sequence[FloatArray] = (), support: Support | None = None
) -> Proposal:
    """Student-t components along the ridges of `density` through `start` (n_par,), a mode with covariance `cov`, and through further modes.

    Raises NumericalError where the density is not a number.
    """
    frame = framed(density, start, cov, support)
    return along_ridges(reordered(frame, separate_modes(frame, starts)))


def along_ridges(frames: Frame) -> Proposal:
    """Components along the ridges of the first parameter of stacked frames, all followed at once."""
    row, points, log_masses, precisions = follow(frames, _RULE)
    at = frames.rows(row)
    scales = np.zeros((len(points), frames.n_par, frames.n_par))
    scales[:, 1:, 1:] = np.linalg.inv(precisions)
    first = at.factor[:, 0, 0]
    gaps, slopes = first.copy(), at.factor[:, :, 0].copy()
    for ridge in np.split(np.arange(row.size), np.flatnonzero(np.diff(row)) + 1):
        if ridge.size > 1:
            gaps[ridge], slopes[ridge] = np.gradient(points[ridge, 0]), np.gradient(points[ridge], axis=0)
    scales += _OVERLAP**2 * slopes[:, :, None] * slopes[:, None, :]
    back = np.argsort(at.order, axis=1)
    factors = lower_factor(scales[np.arange(len(back))[:, None, None], back[:, :, None], back[:, None, :]])
    weights = _POWER * log_masses + np.log(np.maximum(gaps, 1e-300) / first)
    return Proposal(np.exp(weights - log_sum_exp(weights)), at.original(points), factors)


def both(a: Proposal, b: Proposal, share: float = 0.5) -> Proposal:
    """A `share` of the draws from `b`, the others from `a`."""
    weights = np.concatenate([(1.0 - share) * a.weights, share * b.weights])
    return Proposal(weights, np.vstack([a.means, b.means]), np.concatenate([a.factors, b.factors]))


def repaired(
    density: Density, adapted: Proposal, ridges: Proposal, draws: FloatArray, log_evidence: float, *, rng: np.random.Generator
) -> Proposal:
    """The `adapted` proposal, or a better one where it leaves out what `draws` (n_draw, n_par) of the posterior hold.

    What counts is the density over the proposal, both normalised, at draws of the posterior, which come from elsewhere: its mean is the reciprocal
    of the effective share of the proposal's draws, its largest values how long a chain of such steps would stay in what the proposal leaves out.
    The root of its mean square heeds both.  Tried are mixtures of the `ridges`, which guard the tails, with the adapted one and with others fitted
    to most of the draws.
    """
    train, test = np.split(draws, [int(_TRAINED * len(draws))])
    heights = log_density_in_batches(density, test) - log_evidence
    if _unevenness(adapted, test, heights) < _UNEVEN:
        return adapted
    grown_ones = [grown(train, n_component, rng) for n_component in _N_COMPONENT]
    candidates = [both(one, ridges, share) for one in (adapted, *grown_ones) for share in _RIDGE_SHARES]
    return min(candidates, key=lambda one: _unevenness(one, test, heights))


def _unevenness(proposal: Proposal, draws: FloatArray, heights: FloatArray) -> float:
    """Root mean square of density over proposal at draws of the posterior of log densities `heights`: 1 where both are the same, else more."""
    ratio = np.exp(np.minimum(heights - proposal.log_density(draws), 300.0))
    return float(np.sqrt(np.mean(ratio**2)))
