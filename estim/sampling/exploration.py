"""Where else a posterior may have mass: a proposal that follows its ridges, made without a draw.

For every parameter the conditional maxima of all others are followed both ways from the mode (`estim.sampling.walk`), until
the density has fallen by e^-10 or a limit is met.  Each point of the way becomes a Student-t component as wide as the density is there
and as the step to its neighbours; the faint ones get the square root of their share, so that long tails are drawn often.
It shares nothing with a proposal that was adapted to draws of itself (`estim.sampling.proposal`), and misses what that one finds and the reverse:
weights of one over the mixture of both (the balance heuristic; Owen and Zhou, J. Am. Stat. Assoc. 95 (2000) 135) are right where
either is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray
from estim.sampling.factors import lower_factor
from estim.sampling.importance import log_sum_exp
from estim.sampling.proposal import Proposal, grown
from estim.sampling.protocol import Density, Support, log_density_in_batches
from estim.sampling.ridge import Frame, framed, reordered, separate_modes
from estim.sampling.walk import Rule, follow

_RULE = Rule(depth=10.0, fall=2.0, tolerance=1e-2)
_POWER = 0.5  # of the share that a point of a ridge has
_OVERLAP = 0.6  # of the distance between neighbours, standard deviation along the ridge
_LONGEST_STAY = 40.0  # largest density over proposal, both normalised, at a draw of the posterior
_EVEN = 0.25  # effective share of its draws below which a proposal is grown anew
_N_COMPONENT = (1, 6, 12)


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
    factors = np.array([lower_factor(scale[np.ix_(order, order)]) for scale, order in zip(scales, back, strict=True)])
    weights = _POWER * log_masses + np.log(np.maximum(gaps, 1e-300) / first)
    return Proposal(np.exp(weights - log_sum_exp(weights)), at.original(points), factors)


def both(a: Proposal, b: Proposal) -> Proposal:
    """Half of the draws from each; limits, bend and tails are those of `a`, and `b` is one that is not bent."""
    return replace(
        a, weights=0.5 * np.concatenate([a.weights, b.weights]), means=np.vstack([a.means, b.means]),
        factors=np.concatenate([a.factors, b.factors]), bent=np.concatenate([a.follows, np.zeros(b.weights.size, dtype=bool)]),
    )


def repaired(
    density: Density, adapted: Proposal, ridges: Proposal, draws: FloatArray, log_evidence: float, *, rng: np.random.Generator
) -> Proposal:
    """The `adapted` proposal, or a better one where it leaves out what `draws` (n_draw, n_par) of the posterior hold.

    What counts is the density over the proposal at draws of the posterior, which come from elsewhere: its mean is the reciprocal of
    the effective share of the proposal's draws, its largest value how long a chain of such steps would stay in what the proposal
    leaves out.  Tried are mixtures with the `ridges`, of the adapted one and of others fitted to half of the draws.
    """
    train, test = np.split(draws, [len(draws) // 2])
    heights = log_density_in_batches(density, test) - log_evidence
    share, longest = _worth(adapted, test, heights)
    if share > _EVEN and longest < _LONGEST_STAY:
        return adapted
    grown_ones = [grown(train, n_component, rng, adapted.limits) for n_component in _N_COMPONENT]
    candidates = [adapted, *grown_ones, *(both(one, ridges) for one in (adapted, *grown_ones))]
    worths = [_worth(one, test, heights) for one in candidates]
    return candidates[int(np.argmax([share * min(1.0, _LONGEST_STAY / longest) for share, longest in worths]))]


def _worth(proposal: Proposal, draws: FloatArray, heights: FloatArray) -> tuple[float, float]:
    """Effective share of the draws of `proposal`, and the largest density over proposal, by draws of the posterior and their log densities."""
    ratio = np.exp(np.minimum(heights - proposal.log_density(draws), 600.0))
    return 1.0 / max(float(np.mean(ratio)), 1e-300), float(np.max(ratio))
