"""The same runs analysed under one assumption after another, side by side: models of a body
(`models`), or of the noise (`comparison`).

Estimates and widths can be compared across all of them, leave-one-out predictive densities only
between fits of the same points: speeds and positions are not the same data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from estim.checks import INFLUENTIAL, LeaveOneOut, difference
from estim.pipeline import Analysis
from estim.problem import Problem

LOO_DRAWS = 2000


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
            run.name: run.x[k > INFLUENTIAL].tolist() for run, k in pairs if np.any(k > INFLUENTIAL)
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


def same_points(a: Problem, b: Problem) -> bool:
    """Whether two problems of the same runs have the same data."""
    return all(
        p.positions == q.positions and np.array_equal(p.x, q.x) and np.array_equal(p.y, q.y)
        for p, q in zip(a.runs, b.runs, strict=True)
    )
