"""The section of a report on what may be missing; the text stands in
`templates/explanation.md.j2`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from estim.checks import P_FLOOR
from estim.common import (
    Label,
    Markdown,
    behind,
    code,
    format_p,
    format_quantity,
    format_rounded,
    markdown,
    number,
    phrase,
    signed,
    with_unit,
)
from estim.explanation import (
    FOUND,
    TIED,
    CauseOfRuns,
    Estimated,
    Explanation,
    RefitCandidate,
    verdict,
)
from estim.reports.records import Record
from estim.reports.rendering import render
from estim.words import describe

_MOST_SHOWN = 6


class EstimatedSummary(Record):
    name: str
    value: float  # SI units
    sd: float | None  # none at the edge of what is possible, or where a few values were tried


class OutcomeSummary(Record):
    """What a fit of the campaign gives with the lines of a candidate."""

    status: str
    numbers: list[EstimatedSummary]  # none where the status is not ok
    lacks_force: bool  # whether the curve surely lacks a force all the same


class CandidateSummary(Record):
    """One thing that the curve may lack, refit by least squares."""

    name: str
    words: str
    gain: float  # by how much AIC falls; 10 or more counts, and so do differences
    found: bool
    numbers: list[EstimatedSummary]
    p_order: float | None  # of the residuals with it, by the worst test of their order
    p_size: float | None  # the same by chi-squared
    lines: list[str]  # of the campaign file, the first a table
    remark: str
    outcome: OutcomeSummary | None  # of the first candidates that a campaign can state


class ExplanationSummary(Record):
    words: str
    p_order: float | None  # of the residuals without any of them
    p_size: float | None
    candidates: list[CandidateSummary]


def explanation_summary(explanation: Explanation | None) -> ExplanationSummary | None:
    """The record of the candidates, None where none were refit."""
    if explanation is None:
        return None
    baseline = explanation.plain
    return ExplanationSummary(
        describe(verdict(explanation)),
        number(baseline.p_order),
        number(baseline.p_size),
        msgspec.convert(explanation.candidates, list[CandidateSummary], from_attributes=True),
    )


def explanation_text(explanation: Explanation) -> Markdown:
    """Markdown fragment without a heading."""
    candidates = explanation.found[:_MOST_SHOWN]
    return render(
        "explanation.md.j2",
        verdict=describe(verdict(explanation)),
        rows=candidates,
        value=_values,
        remains=_residual_words,
        added=_added,
        add=_add_cell,
        found=f"{FOUND:g}",
        tied=f"{TIED:g}",
        more=len(explanation.found) - len(candidates),
        best=next(iter(explanation.candidates), None),
        in_campaign=any(row.outcome is not None or row.lines for row in candidates),
        offered=explanation.offered is not None,
        n_tried=len(explanation.candidates),
        left=_residual_words(explanation.plain),
    )


def slip_words(explanation: Explanation | None) -> str:
    """A slip in what was stated, and its cure, where one explains what is left; else ""."""
    slip = None if explanation is None else explanation.slip
    return (
        ""
        if slip is None
        else phrase(
            "a unit is probably wrong: {words} ({cure})", words=slip.words, cure=slip.remark
        )
    )


def explanation_lines(explanation: Explanation) -> list[str]:
    """The same for a terminal, line by line."""
    lines = [describe(verdict(explanation))]
    for candidate in explanation.found[:_MOST_SHOWN]:
        line = phrase(
            "{gain:>7}  {words}: {value}; the residuals are then {left}",
            gain=signed(f"{candidate.gain:.0f}"),
            words=candidate.words,
            value=_values(candidate),
            left=_residual_words(candidate),
        )
        lines.append(
            line
            if candidate.outcome is None
            else phrase(
                "{line}; added to the campaign: {added}", line=line, added=_added(candidate)
            )
        )
    if explanation.offered is not None:
        lines.append(
            phrase(
                "to add (priors as wide as the effect may plausibly be; your own "
                "measurement of it is better):"
            )
        )
        lines += [f"    {line}" for line in explanation.offered.lines]
    return lines


def runs_text(causes: Sequence[CauseOfRuns]) -> Markdown:
    """Markdown fragment without a heading: which runs show which cause, and whether they agree."""
    rows = [
        (
            cause.words,
            signed(f"{cause.gain:.0f}"),
            phrase("{n} of {total}", n=len(cause.found_in), total=cause.n_run),
            ", ".join(
                f"{m.label.symbol.partition('[')[0]} = {_shown(m.value, m.sd, m.label)}"
                for m in cause.means
            ),
            "n/a" if math.isnan(cause.p) else format_p(cause.p),
        )
        for cause in causes[:_MOST_SHOWN]
    ]
    return render("causes_of_runs.md.j2", rows=rows)


def _values(candidate: RefitCandidate) -> str:
    return ", ".join(map(_value, candidate.numbers))


def _value(n: Estimated) -> str:
    if n.sd > 0.0:
        return f"{n.label.symbol} = {_shown(n.value, n.sd, n.label)}"
    return phrase(
        "{symbol} about {value}{unit}",
        symbol=n.label.symbol,
        value=format_rounded(n.value * n.label.factor, 0.1 * abs(n.value * n.label.factor)),
        unit=behind(n.label.unit),
    )


def _shown(value: float, sd: float, label: Label) -> str:
    return with_unit(format_quantity(value * label.factor, sd * label.factor), label.unit)


def _residual_words(candidate: RefitCandidate) -> str:
    """How the residuals are with a candidate."""
    if math.isnan(candidate.p_order):
        return phrase("not tested")
    if not candidate.random:
        return phrase("not random ({p})", p=format_p(candidate.p_order, P_FLOOR))
    return phrase("random" if candidate.as_large_as_stated else "random, but larger than stated")


def _added(candidate: RefitCandidate) -> str:
    """What a fit of the campaign with a candidate gives."""
    if candidate.outcome is None:
        return phrase("not tested in the campaign")
    if not candidate.outcome.status.ok:
        return str(candidate.outcome.status)
    summary = ", ".join([str(candidate.outcome.status), *map(_value, candidate.outcome.numbers)])
    return (
        phrase("{found}; an unmodelled force remains", found=summary)
        if candidate.outcome.lacks_force
        else summary
    )


def _add_cell(candidate: RefitCandidate) -> Markdown:
    """Lines for a candidate that is an answer; those of one that is none would lead astray."""
    if not candidate.lines:
        return markdown(candidate.remark)
    if not candidate.explains or candidate.outcome is None:
        return markdown("")
    where, *lines = candidate.lines
    return Markdown(f"{code(where)}: {', '.join(map(code, lines))}")
