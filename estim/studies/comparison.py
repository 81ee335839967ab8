"""The same runs with several models of their noise, side by side (`estim fit --compare`)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext

from estim.campaign import Campaign
from estim.checks import leave_one_out
from estim.common import PieceStore
from estim.pipeline import analyse
from estim.sampling import Progress, Target
from estim.studies.refits import LOO_DRAWS, Refit, beside_the_best


def compare_noise(
    campaign: Campaign,
    runs: Sequence[str],
    *,
    seed: int,
    target: Target | None = None,
    progress_of: Callable[[str], AbstractContextManager[Progress]] | None = None,
    store: PieceStore | None = None,
) -> tuple[Refit, ...]:
    """Every candidate's analysis of `runs` (jointly), in the order of `Campaign.noise_models`.

    store : keeps the draws of each candidate (`analyse`).

    Raises InputError where the runs cannot be fit jointly, or where the noise table of the first
    one allows nothing to compare.
    """
    campaign.problem(runs)
    refits: list[Refit] = []
    for candidate in campaign.noise_models(runs[0]):
        with nullcontext() if progress_of is None else progress_of(candidate.name) as progress:
            analysis = analyse(
                campaign,
                runs,
                seed=seed,
                target=target,
                progress=progress,
                noise=candidate.table,
                store=store,
                beside=[refit.analysis.fit for refit in refits],
            )
        loo = leave_one_out(analysis.fit.posterior, analysis.chain.thinned(LOO_DRAWS))
        refits.append(Refit(name=candidate.name, words=candidate.words, analysis=analysis, loo=loo))
    return beside_the_best(refits)
