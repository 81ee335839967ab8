"""The same runs analysed under one assumption after another, side by side: models of the noise
(`compare_noise`, for `estim fit --compare`), or of a body (`models`).

Estimates and widths can be compared across all of them, leave-one-out predictive densities only
between fits of the same points: speeds and positions are not the same data.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from estim.campaign import Campaign
from estim.checks import LeaveOneOut, difference, leave_one_out
from estim.common import PieceStore
from estim.pipeline import Analysis, analyse
from estim.problem import Parameter, Problem
from estim.sampling import K_HAT_LIMIT, Progress, Target

LOO_DRAWS = 2000
ProgressOf = Callable[[str], AbstractContextManager[Progress]]
"""Given what is being sampled, a context in which its progress is shown."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Refit:
    """An analysis and its leave-one-out predictive density.

    name, words : of what was assumed.
    behind, behind_se : elpd below that of the best of the same points, with its standard error; 0
        for the best one.
    """

    name: str
    words: str
    analysis: Analysis
    loo: LeaveOneOut
    behind: float = 0.0
    behind_se: float = 0.0

    @property
    def ok(self) -> bool:
        return self.analysis.diagnosis.ok

    @property
    def data(self) -> str:
        """ "positions" or "speeds"."""
        return "positions" if self.analysis.problem.runs[0].positions else "speeds"

    @property
    def influential(self) -> dict[str, list[float]]:
        """Run -> abscissas of the frames with k-hat above 0.7."""
        pairs = zip(self.analysis.problem.runs, self.loo.k_hat, strict=True)
        return {
            run.name: run.x[k > K_HAT_LIMIT].tolist() for run, k in pairs if np.any(k > K_HAT_LIMIT)
        }


AnyRefit = TypeVar("AnyRefit", bound=Refit)


def beside_the_best(refits: Sequence[AnyRefit]) -> tuple[AnyRefit, ...]:
    """Each beside the best of the same points; speeds of other frames have a best of their own."""
    rows = []
    for refit in refits:
        problem = refit.analysis.problem
        same = [other.loo for other in refits if same_points(other.analysis.problem, problem)]
        best = max(same, key=lambda loo: loo.elpd)
        behind, se = (0.0, 0.0) if best is refit.loo else difference(best, refit.loo)
        rows.append(replace(refit, behind=behind, behind_se=se))
    return tuple(rows)


def in_common(refits: Sequence[Refit]) -> list[Parameter]:
    """The unknowns of the curve that all have, in the order of the first."""
    problems = [refit.analysis.problem for refit in refits]
    names = set.intersection(*(set(p.names) - p.noise_names for p in problems))
    return [p for p in problems[0].parameters if p.name in names]


def same_points(a: Problem, b: Problem) -> bool:
    """Whether two problems of the same runs have the same data."""
    return all(
        p.positions == q.positions and np.array_equal(p.x, q.x) and np.array_equal(p.y, q.y)
        for p, q in zip(a.runs, b.runs, strict=True)
    )


def shown(progress_of: ProgressOf | None, name: str) -> AbstractContextManager[Progress | None]:
    """The context in which the progress of `name` is shown, where it is."""
    return nullcontext() if progress_of is None else progress_of(name)


def refit_of(name: str, words: str, analysis: Analysis) -> Refit:
    loo = leave_one_out(analysis.fit.posterior, analysis.chain.thinned(LOO_DRAWS))
    return Refit(name=name, words=words, analysis=analysis, loo=loo)


def compare_noise(
    campaign: Campaign,
    runs: Sequence[str],
    *,
    seed: int,
    target: Target | None = None,
    progress_of: ProgressOf | None = None,
    store: PieceStore | None = None,
) -> tuple[Refit, ...]:
    """Every candidate's analysis of `runs` (jointly), in the order of `Campaign.noise_models`.

    store : keeps the draws of each candidate (`analyse`).

    Raises InputError where the runs cannot be fit jointly, or where the noise table of the first
    one allows nothing to compare.
    """
    campaign.problem(runs)
    refits: list[Refit] = []
    for model in campaign.noise_models(runs[0]):
        with shown(progress_of, model.name) as progress:
            analysis = analyse(
                campaign,
                runs,
                seed=seed,
                target=target,
                progress=progress,
                noise=model.table,
                store=store,
            )
        refits.append(refit_of(model.name, model.words, analysis))
    return beside_the_best(refits)
