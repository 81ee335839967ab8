"""A proposal from normal distributions that a density is nearly made of, moved to where it is.

A spike and wide parts beside it in twenty dimensions cannot be found by fitting mixtures to draws: a covariance rests on hundreds of them, and the
parts are narrow in some directions alone.  Known from a linearised posterior, their widths are nearly right; their place is off by what is not
linear, which moves them together.  Most draws are those of the heaviest part, whose covariance is adapted too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray
from estim.deviation import NormalParts
from estim.sampling.factors import lower_factor
from estim.sampling.importance import flattened, kish_size
from estim.sampling.proposal import Proposal
from estim.sampling.protocol import Density, log_density_in_batches

_DOF = 20.0  # of parts that are nearly normal
_TAILS, _GUARD, _GUARD_FACTOR = 1.5, 0.03, 1.5  # more of the draws for the light parts; share and width of one around all
_ROUNDS, _N_ROUND = 4, 3000
_LEAST = 0.05  # effective share of the draws of a proposal that is worth having


def proposal_of_parts(density: Density, parts: NormalParts, *, rng: np.random.Generator) -> Proposal | None:
    """Student-t parts of a few rounds of weighted draws; None where their weights stay uneven."""
    scale = (_DOF - 2.0) / _DOF
    heaviest = int(np.argmax(parts.weights))
    weights = parts.weights * np.where(np.arange(parts.weights.size) == heaviest, 1.0, _TAILS)
    mixture = Proposal(weights / weights.sum(), parts.means, np.array([lower_factor(scale * cov) for cov in parts.covs]), dof=_DOF)
    best, most = None, _LEAST
    for _ in range(_ROUNDS):
        proposal = mixture.guarded(_GUARD, _GUARD_FACTOR)
        draws = proposal.draw(rng, _N_ROUND)
        log_ratio = log_density_in_batches(density, draws) - proposal.log_density(draws)
        share = kish_size(log_ratio) / log_ratio.size
        if share > most:
            best, most = proposal, share
        if not share > 0.0:
            break
        mixture = _moved(mixture, heaviest, draws, flattened(log_ratio, least=20.0 * proposal.n_par)[0])
    return best


def _moved(mixture: Proposal, heaviest: int, draws: FloatArray, weights: FloatArray) -> Proposal:
    """All parts moved with the heaviest, whose mean and covariance are those of its share of the draws, as far as these are known."""
    parts, n_par = mixture.component_log_densities(draws), mixture.n_par
    share = weights * np.exp(parts[heaviest] - np.logaddexp.reduce(parts, axis=0))
    size = float(np.sum(share) ** 2 / max(float(np.sum(share**2)), 1e-300))
    pull = share * (mixture.dof + n_par) / (mixture.dof + mixture.distances(draws)[heaviest])
    mean = pull @ draws / np.sum(pull)
    known = size / (size + n_par)
    moved = known * (mean - mixture.means[heaviest])
    off = draws - (mixture.means[heaviest] + moved)
    found, before = (pull[:, None] * off).T @ off / np.sum(share), mixture.factors[heaviest]
    known = size / (size + n_par**2)
    factors = mixture.factors.copy()
    factors[heaviest] = lower_factor(known * found + (1.0 - known) * before @ before.T)
    return replace(mixture, means=mixture.means + moved, factors=factors)
