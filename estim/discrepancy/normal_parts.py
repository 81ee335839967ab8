"""The linearised posterior of runs with unmodelled forces as a few normal distributions: whether
each force is there, and how large it may be.

Each force that may be absent gives a narrow posterior without it and wide ones with it; the
posterior of all is a sum over their combinations.  One normal distribution, however adapted, is too
wide where most of the probability lies and too narrow in the tails.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from estim.arrays import FloatArray, inverse_of
from estim.discrepancy.linearised import Linearised
from estim.discrepancy.noise_with_force import NormalParts, TrialInformation, likelihood_of_normal

_WIDE = 3  # groups of the components with a force, from narrow to wide
_MOST = 24  # combinations that are kept


def normal_parts(
    groups: Sequence[tuple[Linearised, TrialInformation]],
    known: TrialInformation,
    values: FloatArray,
) -> NormalParts:
    """The most probable combinations of the components of each group, about `values` (n_par,).

    groups : each linearised beside what is known of the parameters without it, which goes with it.
    known : the information that no group has.
    """
    combined = [(1.0, *known)]
    for linear, external in groups:
        parts = [
            (weight, *likelihood_of_normal(mean, cov, external))
            for weight, mean, cov in _parts(linear, values.size)
        ]
        combined = [
            (weight * own_weight, information + own_information, score + own_score)
            for weight, information, score in combined
            for own_weight, own_information, own_score in parts
        ]
        combined = sorted(combined, key=lambda part: -part[0])[:_MOST]
    weights = np.array([weight for weight, _, _ in combined])
    covs = np.array([inverse_of(information) for _, information, _ in combined])
    steps = np.array([cov @ score for cov, (_, _, score) in zip(covs, combined, strict=True)])
    return NormalParts(weights / weights.sum(), values + steps, covs)


def _parts(linear: Linearised, n_par: int) -> list[tuple[float, FloatArray, FloatArray]]:
    """Probability, step and covariance of the first parameters: without the force, and with it in a
    few groups.
    """
    own = linear.first(n_par)
    order = own.from_narrow_to_wide()
    absent = own.deviation.column("amplitude")[order] == 0.0
    present = order[~absent]
    below = np.cumsum(own.weights[present])
    wide = np.split(present, np.searchsorted(below, below[-1] * np.arange(1, _WIDE) / _WIDE))
    groups = (order[absent], *wide)
    return [own.moments(group) for group in groups if own.weights[group].sum() > 0.0]
