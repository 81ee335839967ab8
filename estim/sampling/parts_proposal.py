"""A proposal from normal distributions that a density is nearly made of, moved to where it is.

A spike and wide parts beside it in twenty dimensions cannot be found by fitting mixtures to draws:
a covariance rests on hundreds of them, and the parts are narrow in some directions alone.  Known
from a linearised posterior, their widths are nearly right; what is not linear moves them together.
It shows in the heaviest part, which lies about the mode.
"""

from __future__ import annotations

import numpy as np

from estim.arrays import FloatArray
from estim.discrepancy import NormalParts
from estim.sampling.cholesky import lower_factor
from estim.sampling.importance import kish_ess
from estim.sampling.log_density import Density, log_density_in_batches
from estim.sampling.proposal import Proposal

_DOF = 20  # of parts that are nearly normal
# more of the draws for the light parts; share and width of one around all
_TAILS, _GUARD, _GUARD_FACTOR = 1.5, 0.03, 1.5
_N_DRAW, _LEAST = 3000, 0.05  # effective share of these draws that a proposal is worth having for


def proposal_of_parts(
    density: Density, parts: NormalParts, mode: FloatArray, *, rng: np.random.Generator
) -> Proposal | None:
    """The parts moved together, the heaviest to the mode (n_par,); None where weighted draws of
    them are uneven.
    """
    heaviest = int(np.argmax(parts.weights))
    weights = parts.weights * np.where(np.arange(parts.weights.size) == heaviest, 1.0, _TAILS)
    means = parts.means + (mode - parts.means[heaviest])
    factors = lower_factor((_DOF - 2.0) / _DOF * parts.covs)
    proposal = Proposal(weights / weights.sum(), means, factors, dof=_DOF).guarded(
        _GUARD, _GUARD_FACTOR
    )
    draws = proposal.draw(rng, _N_DRAW)
    log_ratio = log_density_in_batches(density, draws) - proposal.log_density(draws)
    return proposal if kish_ess(log_ratio) > _LEAST * _N_DRAW else None
