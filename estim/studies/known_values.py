"""What is known of bodies and runs, as draws: of what a campaign states, or of a fit that was
kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.campaign import EFFECTS, Campaign
from estim.common import InputError, Stream, stream
from estim.problem import Observations, Parameter

_N_DRAW = 2000


@dataclass(frozen=True, eq=False)
class FittedValues:
    """Parameters of a fit as a normal distribution: names, (n_par,) means, (n_par, n_par)
    covariance, and where it stands.
    """

    names: tuple[str, ...]
    mean: FloatArray
    cov: FloatArray
    place: str


@dataclass(frozen=True, eq=False)
class KnownValues:
    """Draws (n_draw, 1) of every parameter of the runs, by name; one name is one unknown, whichever
    runs depend on it.

    fitted : the fit that some of them come from, None where all are as stated.
    """

    draws: dict[str, FloatArray]
    fitted: FittedValues | None = None

    def additional_effects(self, runs: Sequence[Observations]) -> tuple[str, ...]:
        """Symbols of the effects of the runs in addition to weight and rolling resistance."""
        return tuple(
            kind.notation.symbol
            for name, kind in EFFECTS.items()
            if any(name in run.arguments for run in runs)
        )


def known_values(
    campaign: Campaign, names: Sequence[str], *, seed: int, fitted: FittedValues | None
) -> KnownValues:
    """Draws of the parameters of the runs `names`: from their priors, and from a fit for those that
    it has.

    A draw of the fit that a prior does not allow is drawn again.  Raises InputError where the fit
    has none of the parameters.
    """
    parameters: dict[str, Parameter] = {}
    for name in names:
        problem = campaign.problem([name])
        used = problem.runs[0].curve_parameters
        parameters.update({p.name: p for p in problem.parameters if p.name in used})
    rng = stream(seed, Stream.REGIMES)
    draws = {
        name: parameter.prior.draw(rng, _N_DRAW)[:, None] for name, parameter in parameters.items()
    }
    if fitted is None:
        return KnownValues(draws)
    chosen = [i for i, name in enumerate(fitted.names) if name in parameters]
    if not chosen:
        raise InputError(
            "must be a fit of these runs: it has none of their parameters",
            field="--fit",
            value=fitted.place,
        )
    of_fit = _allowed(fitted, chosen, [parameters[fitted.names[i]] for i in chosen], rng)
    return KnownValues(
        draws | {fitted.names[i]: of_fit[:, [k]] for k, i in enumerate(chosen)}, fitted
    )


def _allowed(
    fitted: FittedValues, chosen: list[int], parameters: list[Parameter], rng: np.random.Generator
) -> FloatArray:
    """(n_draw, n_chosen) normal draws inside the priors' support."""
    mean, cov = fitted.mean[chosen], fitted.cov[np.ix_(chosen, chosen)]
    low = np.array([p.prior.low for p in parameters])
    high = np.array([p.prior.high for p in parameters])
    accepted: list[FloatArray] = []
    for _ in range(200):
        proposals = rng.multivariate_normal(mean, cov, size=_N_DRAW, method="eigh")
        accepted.append(proposals[np.all((proposals >= low) & (proposals <= high), axis=1)])
        if sum(len(rows) for rows in accepted) >= _N_DRAW:
            return np.vstack(accepted)[:_N_DRAW]
    raise InputError(
        "must be a fit with these priors, under which its values are very improbable",
        field="--fit",
        value=fitted.place,
    )
