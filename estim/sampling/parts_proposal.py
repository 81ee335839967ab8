"""A proposal from normal distributions that a density is nearly made of, moved to where it is.

A spike and wide parts beside it in twenty dimensions cannot be found by fitting mixtures to draws:
a covariance rests on hundreds of them, and the parts are narrow in some directions alone.  Known
from a linearised posterior, their widths are nearly right; what is not linear moves them together.
It shows in the heaviest part, which most draws belong to.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from estim.arrays import FloatArray
from estim.discrepancy import NormalParts
from estim.sampling.cholesky import lower_factor
from estim.sampling.importance import kish_ess, tempered
from estim.sampling.log_density import Density, log_density_in_batches
from estim.sampling.proposal import Proposal

_DOF = 20  # of parts that are nearly normal
# more of the draws for the light parts; share and width of one around all
_TAILS, _GUARD, _GUARD_FACTOR = 1.5, 0.03, 1.5


def proposal_of_parts(
    density: Density, parts: NormalParts, *, rng: np.random.Generator
) -> Proposal | None:
    """The best of a few rounds of weighted draws; None where their weights stay uneven."""
    heaviest = int(np.argmax(parts.weights))
    weights = parts.weights * np.where(np.arange(parts.weights.size) == heaviest, 1.0, _TAILS)
    factors = lower_factor((_DOF - 2.0) / _DOF * parts.covs)
    mixture = Proposal(weights / weights.sum(), parts.means, factors, dof=_DOF)
    best = None
    # effective share of the draws of a proposal that is worth having
    most = 0.05
    for n_draw in (3000, 3000, 4000, 8000, 3000):
        proposal = mixture.guarded(_GUARD, _GUARD_FACTOR)
        draws = proposal.draw(rng, n_draw)
        log_ratio = log_density_in_batches(density, draws) - proposal.log_density(draws)
        share = kish_ess(log_ratio) / n_draw
        if share > most:
            best, most = proposal, share
        if not share > 0.0:
            break
        mixture = _adapted(
            mixture, heaviest, draws, tempered(log_ratio, least=20.0 * proposal.n_par)
        )
    return best


def _adapted(mixture: Proposal, heaviest: int, draws: FloatArray, weights: FloatArray) -> Proposal:
    """All parts moved with the heaviest, whose mean is that of its share of weighted draws, as far
    as it is known.
    """
    distances = mixture.distances(draws)
    parts = mixture.component_log_densities(distances)
    share = weights * np.exp(parts[heaviest] - np.logaddexp.reduce(parts, axis=0))
    pull = share * (mixture.dof + mixture.n_par) / (mixture.dof + distances[heaviest])
    size = float(np.sum(share) ** 2 / max(float(np.sum(share**2)), 1e-300))
    mean = pull @ draws / np.sum(pull)
    moved = size / (size + mixture.n_par) * (mean - mixture.means[heaviest])
    return replace(mixture, means=mixture.means + moved)
