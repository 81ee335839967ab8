"""Which runs point to the same cause, and whether they agree about its size: a slip of one run is
no law of the apparatus.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estim.common import Finding, Kind, split_level
from estim.explanation.candidates import Estimated
from estim.explanation.explaining import FOUND, Explanation, RefitCandidate
from estim.fitting import chi2_p


@dataclass(frozen=True, eq=False)
class CauseOfRuns:
    """A candidate in runs fit one by one.

    found_in : the runs that show it by themselves.
    n_run : of how many.  gain : the sum of all.
    means : of its numbers, weighted.
    p : probability of values that differ as much if all runs have the same; nan where no two can be
        compared.
    """

    words: str
    found_in: tuple[str, ...]
    n_run: int
    gain: float
    means: tuple[Estimated, ...]
    p: float


def across_runs(explanations: Sequence[Explanation]) -> tuple[CauseOfRuns, ...]:
    """The candidates that two runs or more show together, the strongest first; `explanations` are
    of single runs.
    """
    by_name: dict[str, list[tuple[str, RefitCandidate]]] = {}
    for explanation in explanations:
        for cause in (candidate for candidate in explanation.candidates if not candidate.slip):
            by_name.setdefault(split_level(cause.name)[0], []).append((explanation.runs[0], cause))
    causes = []
    for entries in by_name.values():
        gain = sum(cause.gain for _, cause in entries)
        if (
            len(entries) > 1
            and gain >= FOUND
            and entries[0][1].numbers
            and math.isfinite(entries[0][1].numbers[0].sd)
        ):
            means, p = _together([cause for _, cause in entries])
            showing = tuple(run for run, cause in entries if cause.found)
            causes.append(
                CauseOfRuns(entries[0][1].words, showing, len(explanations), gain, means, p)
            )
    return tuple(sorted(causes, key=lambda cause: -cause.gain))


def _together(candidates: Sequence[RefitCandidate]) -> tuple[tuple[Estimated, ...], float]:
    means, chi2, dof = [], 0.0, 0
    for numbers in zip(*(item.numbers for item in candidates), strict=True):
        informative = [item for item in numbers if item.sd > 0.0]  # nan: on an edge
        if not informative:
            continue
        values = np.array([item.value for item in informative])
        weights = np.array([item.sd for item in informative]) ** -2.0
        mean = float(np.sum(weights * values) / np.sum(weights))
        sd = float(np.sum(weights) ** -0.5)
        means.append(replace(numbers[0], value=mean, sd=sd))
        chi2, dof = chi2 + float(np.sum(weights * (values - mean) ** 2)), dof + len(informative) - 1
    return tuple(means), chi2_p(chi2, dof) if dof > 0 else math.nan


def verdict(explanation: Explanation) -> Finding:
    """What the candidates show together."""
    tied = explanation.tied
    answers = tuple(candidate for candidate in tied if candidate.explains)
    first = next(iter(answers or tied), None)
    kind = Kind.CAUSE_UNKNOWN
    if first is not None:
        kind = (
            Kind.CAUSE_IN_PART
            if not answers
            else Kind.CAUSES_ALIKE
            if len(answers) > 1
            else Kind.CAUSE_NAMED
        )
    names = tuple(candidate.words for candidate in answers or tied)
    gain = math.nan if first is None else first.gain
    return Finding(kind, size=gain, names=names, numbers={"tried": len(explanation.candidates)})
