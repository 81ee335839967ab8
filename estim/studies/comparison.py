"""The same runs with several models of their noise, side by side (`estim fit --compare`).

Estimates and widths can be compared across all models.  Predictive densities (leave-one-out) and
evidences only between models of the same data: speeds and positions are not the same data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import numpy as np

from estim.campaign import Campaign, Candidate
from estim.checks import INFLUENTIAL, LeaveOneOut, difference, leave_one_out
from estim.common import PieceStore
from estim.pipeline import Analysis, analyse
from estim.sampling import Progress, Target

LOO_DRAWS = 2000


@dataclass(frozen=True, eq=False)
class Compared:
    """A candidate with its analysis and its leave-one-out predictive density.

    data : "positions" or "speeds".
    behind, behind_se : elpd below that of the best candidate of the same data, with its standard
        error; 0 for the best one.  The same data: the same points, so that speeds of other frames
        have a best of their own.
    influential : run -> abscissas of the frames with k-hat above 0.7.
    """

    candidate: Candidate
    analysis: Analysis
    loo: LeaveOneOut
    data: str
    behind: float
    behind_se: float
    influential: dict[str, list[float]]


def compare_noise(
    campaign: Campaign,
    runs: Sequence[str],
    *,
    seed: int,
    target: Target | None = None,
    progress_of: Callable[[str], AbstractContextManager[Progress]] | None = None,
    store: PieceStore | None = None,
) -> tuple[Compared, ...]:
    """Every candidate's analysis of `runs` (jointly), in the order of `Campaign.noise_models`.

    store : keeps the draws of each candidate (`analyse`).

    Raises InputError where the runs cannot be fit jointly, or where the noise table of the first
    one allows nothing to compare.
    """
    campaign.problem(runs)
    done: list[tuple[Candidate, Analysis, LeaveOneOut]] = []
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
                beside=[analysis.fit for _, analysis, _ in done],
            )
        done.append(
            (
                candidate,
                analysis,
                leave_one_out(analysis.fit.posterior, analysis.chain.thinned(LOO_DRAWS)),
            )
        )
    rows = []
    for candidate, analysis, loo in done:
        same = [other for _, a, other in done if _same_data(a, analysis)]
        best = max(same, key=lambda other: other.elpd)
        behind, se = difference(best, loo) if best is not loo else (0.0, 0.0)
        pairs = zip(analysis.problem.runs, loo.k_hat, strict=True)
        influential = {
            run.name: run.x[k > INFLUENTIAL].tolist() for run, k in pairs if np.any(k > INFLUENTIAL)
        }
        data = "positions" if analysis.problem.runs[0].positions else "speeds"
        rows.append(Compared(candidate, analysis, loo, data, behind, se, influential))
    return tuple(rows)


def _same_data(a: Analysis, b: Analysis) -> bool:
    return all(
        p.n_obs == q.n_obs and np.array_equal(p.y, q.y)
        for p, q in zip(a.problem.runs, b.problem.runs, strict=True)
    )
