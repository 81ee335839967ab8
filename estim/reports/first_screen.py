"""The first screen of a report, and what the terminal and `print` say at the end: what the data gave, what they did not, and what to mind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from estim.checks import Estimate, not_measured, p_sentence, result_table, screen_lines
from estim.common import listed, phrase, signed, split_level
from estim.reading import lines_told
from estim.reports.budget import UncertaintyBudget
from estim.reports.deviation import ForceSummary
from estim.reports.explanation import ExplanationSummary
from estim.reports.labels import Labels
from estim.reports.lacks import DeviationSummary
from estim.reports.parameters import ParameterSummary
from estim.reports.records import Correlation, FitSummary, RunSummary, StatedValues, WhatIf
from estim.studies import PRIOR, READINGS, STATED

_HALF = 0.5  # share of the variance from which one source is what limits
_TIED = 0.6  # correlation that is worth its number
_FELT = 0.05  # posterior standard deviations
_SURE = 0.95  # probability of a force that the curve lacks
_WHERE = {
    "poor-fit": "curve", "contradiction": "values", "at-bound": "limits", "not-identified": "limits", "multimodal": "limits",
    "not-converged": "computing", "methods-disagree": "computing",
}
MOST_MINDS, _MOST_ERRORS = 2, 3
_MOST_REASONS, _MOST_LETTERS = 3, 380  # of reasons why there is no result


@dataclass(frozen=True)
class Screen:
    """What stands first; every entry but the title and rows that were left out (in `minds`) is empty where the status is not ok.

    estimates : of all parameters that are not a single run's among several, and what was sought.  head, rows : the table of those measured.
    left : the others in words.  elsewhere : which are single runs'.  minds : what to mind.
    sensitivity : what errors would do that no residual shows.
    """

    title: str
    tests: str
    estimates: tuple[Estimate, ...]
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    left: str
    elsewhere: str
    minds: tuple[str, ...]
    sensitivity: str

    @property
    def lines(self) -> list[str]:
        """What a terminal shows."""
        return screen_lines(self.estimates, tests=self.tests, minds=self.minds)


class Told(Protocol):
    """What a result holds that the first screen shows; `estim.reports.result.Result` is one."""

    @property
    def title(self) -> str: ...

    @property
    def formula(self) -> str | None: ...

    @property
    def status(self) -> str: ...

    @property
    def runs(self) -> Mapping[str, RunSummary]: ...

    @property
    def parameters(self) -> Mapping[str, ParameterSummary]: ...

    @property
    def labels(self) -> Labels: ...

    @property
    def fit(self) -> FitSummary: ...

    @property
    def stated_values(self) -> StatedValues: ...

    @property
    def correlation(self) -> Correlation: ...

    @property
    def budget(self) -> Mapping[str, UncertaintyBudget] | None: ...

    @property
    def what_if(self) -> Sequence[WhatIf]: ...

    @property
    def deviation(self) -> Mapping[str, ForceSummary] | None: ...

    @property
    def curve_deviation(self) -> Mapping[str, DeviationSummary] | None: ...

    @property
    def explanation(self) -> ExplanationSummary | None: ...


def first_screen(result: Told) -> Screen:
    """The first screen of a result."""
    runs = ", ".join(result.runs)
    title = f"{result.title}: {runs}" if result.title not in ("", runs) else runs
    if result.status != "ok":
        return Screen(title, "", (), (), (), "", "", _left_out(result), "")
    counted = [check.p_value for run in result.runs.values() for name, check in run.checks.items() if name == "chi2"]
    p_curve = result.fit.p_value if result.fit.p_value is not None else counted[0] if len(counted) == 1 else None
    tests = p_sentence(p_curve, result.stated_values.p_value if result.stated_values.dof else None)
    shown = [name for name in result.parameters if not _of_one_run(name, result)]
    estimates = tuple([_estimate(name, result) for name in shown] + _sought(result))
    head, rows = result_table(estimates)
    elsewhere = list(dict.fromkeys(result.labels.symbol(split_level(name)[0]) for name in result.parameters if name not in shown))
    noise = [one.noise_words for one in (result.deviation or {}).values() if one.noise_words]
    minds = [words for words in (_warnings(result), _forces(result), _limits(shown, result), *noise) if words]
    return Screen(
        title, tests, estimates, head, tuple(rows), not_measured(estimates), listed(elsewhere) if elsewhere else "",
        (*_left_out(result), *_without_a_value(estimates), *minds[:MOST_MINDS]), sensitivity_words([result]),
    )


def result_lines(result: Told) -> list[str]:
    """What a terminal says of a result; of one whose status is not ok, no more than which rows were left out."""
    return first_screen(result).lines


def first_reasons(reasons: Sequence[str]) -> list[str]:
    """Those of `reasons`, gravest first, that the first screen has room for: one at least."""
    length = np.cumsum([len(words) for words in reasons])
    return list(reasons[: max(1, min(_MOST_REASONS, int(np.sum(length <= _MOST_LETTERS))))])


def opened_by(result: Told) -> frozenset[str]:
    """The parts of a report that stand open: the one that holds the reason where there is no result, and what is suspicious about the data."""
    doubtful = {"data"} if any(run.warnings or run.bad_frames or run.outliers for run in result.runs.values()) else set[str]()
    if result.status == "ok":
        return frozenset(doubtful | ({"curve"} if result.explanation is not None else set()))
    return frozenset(doubtful | {_WHERE.get(result.status, "computing")})


def _of_one_run(name: str, result: Told) -> bool:
    return len(result.runs) > 1 and split_level(name)[1].strip("[]") in result.runs


def _estimate(name: str, result: Told) -> Estimate:
    p = result.parameters[name]
    shown = (result.labels.bare if len(result.runs) == 1 else result.labels.parameters)[name]
    unit = "" if shown.unit == "1" else f" {shown.unit}"
    inferred = "" if p.stated or p.prior_sd is None else p.prior + unit  # a prior with a width that nobody stated
    return Estimate(shown, p, p.stated, bool(p.measured), p.upper_95, p.true, inferred)


def _sought(result: Told) -> list[Estimate]:
    """What a user wanted computed: once where it is the same for all runs, else run by run."""
    found: dict[str, dict[str, Estimate]] = {}
    for run, one in result.runs.items():
        for name in one.sought:
            found.setdefault(name, {})[run] = Estimate(result.labels.derived[run][name], one.derived[name], "", True)
    shown = []
    for by_run in found.values():
        first = next(iter(by_run.values()))
        if len(by_run) == len(result.runs) and len({(one.summary.mean, one.summary.sd) for one in by_run.values()}) == 1:
            shown.append(first)
        else:
            shown += [replace(one, label=replace(one.label, symbol=f"{one.label.symbol}[{run}]")) for run, one in by_run.items()]
    return shown


def _limits(shown: Sequence[str], result: Told) -> str:
    """What holds back the first quantity that the data measure: one thing that was stated, or the readings."""
    symbols = result.labels.bare if len(result.runs) == 1 else result.labels.parameters
    for name in shown:
        budget = (result.budget or {}).get(name)
        if budget is None or not result.parameters[name].measured or not budget.sources:
            continue
        first, symbol = budget.sources[0], symbols[name].symbol
        if first.share < _HALF or first.source == name:
            continue
        if first.kind == READINGS and result.stated_values.dof:
            return phrase(
                "the readings are {share:.0f} % of the variance of {symbol}: more or better ones narrow it", share=100.0 * first.share, symbol=symbol
            )
        if first.kind in (STATED, PRIOR) and first.source in symbols:
            other = symbols[first.source].symbol
            told = result.correlation.names  # of hundreds of runs not all
            r = result.correlation.matrix[told.index(name)][told.index(first.source)] if {name, first.source} <= set(told) else 0.0
            tied = phrase(
                "{symbol} and {other} are tied ({r}): measure {other} better, not more readings", symbol=symbol, other=other, r=signed(f"{r:+.2f}")
            )
            leans = phrase("{symbol} leans on what was stated of {other}: measure {other} better, not more readings", symbol=symbol, other=other)
            return tied if abs(r) >= _TIED else leans
    return ""


def _forces(result: Told) -> str:
    """Whether the curve lacks something for sure."""
    found = [one for one in (result.deviation or {}).values() if one.probability > _SURE]
    if found:
        size = 100.0 * max(one.typical for one in found)
        return phrase("the curve lacks a force, about {size:.2g} % of the weight; the intervals have room for it", size=size)
    if any(one.probability > _SURE for one in (result.curve_deviation or {}).values()):
        return phrase(
            "the curve lacks something that is larger than the errors; the intervals allow for something irregular, not for another curve"
        )
    complete = [run.complete for run in result.runs.values() if run.complete is not None]
    if complete and result.formula is None:
        return phrase("the curve is taken as complete: no interval has room for what it lacks")
    return complete[0] if complete else ""


def _left_out(result: Told) -> tuple[str, ...]:
    """Which rows have no value, where there are some."""
    blank = {name: run.blank for name, run in result.runs.items() if run.blank}
    n, lines = sum(map(len, blank.values())), [line for found in blank.values() for line in found]
    if not blank:
        return ()
    if len(result.runs) > 1:
        return (phrase("rows without a value left out: {n} ({runs})", n=n, runs=listed(list(blank))),)
    if n == 1:
        return (phrase("1 row without a value left out (line {line})", line=lines[0]),)
    return (phrase("{n} rows without a value left out (lines {lines})", n=n, lines=lines_told(lines)),)


def _without_a_value(estimates: Sequence[Estimate]) -> tuple[str, ...]:
    """What was asked for, and has no value at some of the draws."""
    symbols = [one.label.symbol for one in estimates if one.summary.median is None]  # at an edge there is no mean, and every quantile
    if not symbols:
        return ()
    said = phrase("no value at some of the draws (a division by zero, a root or logarithm of a negative number): {symbols}", symbols=listed(symbols))
    return (said,)


def _warnings(result: Told) -> str:
    """What is suspicious about the data: one warning of a file in its words, else numbers, since the part that says more stands open."""
    runs = result.runs.values()
    n, bad, far = (sum(len(found) for found in all_runs) for all_runs in zip(*((r.warnings, r.bad_frames, r.outliers) for r in runs), strict=True))
    if n == 1 and not bad and not far:
        return next(words for run in runs for words in run.warnings)
    said = (
        "" if not n else phrase("{n} warning of a file", n=n) if n == 1 else phrase("{n} warnings of files", n=n),
        "" if not bad else phrase("{n} bad frame", n=bad) if bad == 1 else phrase("{n} bad frames", n=bad),
        "" if not far else phrase("{n} likely outlier", n=far) if far == 1 else phrase("{n} likely outliers", n=far),
    )
    return phrase("{counts}, see the data and noise", counts=", ".join(filter(None, said))) if any(said) else ""


def sensitivity_words(results: Sequence[Told]) -> str:
    """'1 % of the clock κ +0.3; 1 mm of sag θ₀ +0.9': the parameter of `results` that each error moves most, in posterior standard deviations."""
    found: dict[str, tuple[float, str]] = {}
    for result in results:
        symbols = result.labels.bare if len(result.runs) == 1 else result.labels.parameters
        for one in [one for one in result.what_if if one.shifts][:_MOST_ERRORS]:
            name = max(one.shifts, key=lambda parameter: abs(one.shifts[parameter]))
            found[one.error] = max(found.get(one.error, (0.0, "")), (one.shifts[name], symbols[name].symbol), key=lambda moved: abs(moved[0]))
    felt = {error: moved for error, moved in found.items() if abs(moved[0]) >= _FELT}
    return "; ".join(f"{error}: {symbol} {signed(f'{shift:+.1f}')}" for error, (shift, symbol) in felt.items())
