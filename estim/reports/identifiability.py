"""What the data can tell, as a reader sees it: the rows of its table and its sentences (`templates/identifiability.md.j2`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.checks import CONFLICT, PRIOR_DOMINATED, THRESHOLD, Identifiability, Sensitivity
from estim.common import Label, Markdown, format_rounded, phrase, signed, significant
from estim.fitting import ProfileInterval
from estim.problem import Problem


@dataclass(frozen=True)
class IdentifyRow:
    """One line of the table, every cell as text; `unit` applies to all but `ratio`."""

    symbol: str
    unit: str
    prior_sd: str
    posterior_sd: str
    ratio: str
    profile_68: str
    profile_95: str
    verdict: str


@dataclass(frozen=True, eq=False)
class IdentifySection:
    """What `identifiability.md.j2` shows under the name `identify`.

    sentences : what the data tell and do not.  rows : the table.  doubts : what went wrong with single intervals.
    prior_dominated, threshold : the two limits that the words refer to.  flat : whether a prior has no width.
    """

    sentences: tuple[str, ...]
    rows: tuple[IdentifyRow, ...]
    doubts: tuple[str, ...]
    prior_dominated: float
    threshold: float
    flat: bool


def identify_section(
    problem: Problem, found: Identifiability, intervals: Sequence[ProfileInterval], sensitivity: Sequence[Sensitivity], draws: FloatArray
) -> IdentifySection:
    """The section of a report; `intervals` with probabilities 0.68 and 0.95 of some parameters, `sensitivity` of every one; draws (n_draw, n_par)."""
    profiles = {interval.name: interval for interval in intervals}
    posterior_sds = draws.std(axis=0, ddof=1)
    rows, doubts = [], []
    for i, (parameter, leaning) in enumerate(zip(problem.parameters, sensitivity, strict=True)):
        interval = profiles.get(parameter.name)
        shown = parameter.label
        sd = float(posterior_sds[i])
        prior_sd = significant(parameter.prior.sd * shown.factor, 2) if np.isfinite(parameter.prior.sd) else phrase("flat")
        rows.append(
            IdentifyRow(
                symbol=shown.symbol, unit="" if shown.unit == "1" else shown.unit, prior_sd=prior_sd,
                posterior_sd=significant(sd * shown.factor, 2),
                ratio=f"{sd / parameter.prior.sd:.2f}" if np.isfinite(parameter.prior.sd) else "—",
                profile_68=_cell(interval, 0.68, sd, shown), profile_95=_cell(interval, 0.95, sd, shown),
                verdict=_verdict(problem, leaning, float(draws[:, i].mean())),
            )
        )
        if interval is not None and (interval.n_failed or interval.found_better or interval.pieces):
            doubts.append(interval.sentence)
    k_hat = max((s.k_hat for s in sensitivity), default=-np.inf)
    if k_hat >= 0.7:
        doubts.append(phrase("the weights of the power-scaling are unreliable (Pareto k {k_hat:.2f}): the last column says nothing", k_hat=k_hat))
    flat = any(not np.isfinite(p.prior.sd) for p in problem.parameters)
    return IdentifySection(found.sentences, tuple(rows), tuple(doubts), PRIOR_DOMINATED, THRESHOLD, flat)


def _cell(interval: ProfileInterval | None, p: float, sd: float, shown: Label) -> str:
    """'[0.181, 0.199]', '< 0.0107' or '> 0.3' where one side is open, 'open' where both are; '—' where it was not computed."""
    if interval is None:
        return "—"
    low, high = (format_rounded(end * shown.factor, sd * shown.factor) for end in (interval.low[p], interval.high[p]))
    if interval.open_low[p] and interval.open_high[p]:
        return phrase("open on both sides")
    if interval.open_low[p]:
        return phrase("< {high} (open below)", high=high)
    return Markdown(phrase("> {low} (open above)", low=low)) if interval.open_high[p] else f"[{low}, {high}]"


def _verdict(problem: Problem, leaning: Sensitivity, mean: float) -> str:
    """The verdict, with the pull of the posterior `mean` where it is a conflict, and whose prior matters most where that is another parameter's."""
    words = phrase(leaning.verdict)
    if leaning.verdict == CONFLICT:
        prior = problem.parameters[problem.names.index(leaning.name)].prior
        pull = signed(f"{(mean - prior.expectation) / prior.sd:+.1f}")
        words = phrase("data and prior disagree (conflict): the posterior lies {pull} prior sd from the mean of the prior", pull=pull)
    if leaning.strongest is None or leaning.strongest == leaning.name:
        return words
    strongest = problem.parameters[problem.names.index(leaning.strongest)]
    return phrase("{words}; most that of {symbol}", words=words, symbol=strongest.label.symbol)
