"""The overview of a batch: a table for people, one for programs, and a figure in which what stands
apart is named.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import PurePath

import msgspec
import numpy as np

from estim.batch import RunRow, RunScatter, odd_runs, spreads
from estim.common import FigureChoice, Files, as_csv, as_json, phrase
from estim.drawing import BLUE, GREY, INK, ORANGE, Figure, grid, legend_below, whole_ticks
from estim.pipeline import Analysis
from estim.reports.analysis import analysis_report
from estim.reports.pages import page, with_formats
from estim.reports.result import Subject, result_of

_LISTED = 100  # rows of a table that people read
_NAMED = 6  # texts in a panel


def lean_files(campaign: Subject, analysis: Analysis) -> Files:
    """`result.json` alone, which is all that the table of a batch needs."""
    return {"result.json": as_json(result_of(campaign, analysis))}


def full_files(
    campaign: Subject,
    analysis: Analysis,
    *,
    figures: FigureChoice = "main",
    formats: Sequence[str] = (),
) -> Files:
    """The whole report of a run."""
    return with_formats(analysis_report(campaign, analysis, figures=figures), formats)


def batch_report(rows: Sequence[RunRow], *, figures: FigureChoice) -> Files:
    """`report.md`, `summary.csv`, `summary.json` and, where there is something to draw,
    `figures/overview.png`.
    """
    quantities = spreads(rows)
    # at most so many quantities, which the data constrain in at least half of the runs
    panels = [spread for spread in quantities if spread.informed >= 0.5][:4]
    bad = [row for row in rows if row.status != "ok"]
    outlying = [
        ", ".join(rows[i].name for i in spread.apart[:_NAMED])
        + (phrase(" and others") if len(spread.apart) > _NAMED else "")
        or phrase("none")
        for spread in quantities
    ]
    return page(
        {"figures/overview.png": lambda: overview_figure(rows, panels)} if panels else {},
        "batch.md.j2",
        {"summary.json": [_record(row) for row in rows]},
        figure_choice=figures,
        n=len(rows),
        counts=_counts(rows),
        synthetic=synthetic_words(rows),
        odd=odd_runs(rows)[:_LISTED],
        quantities=list(zip(quantities, outlying, strict=True)),
        bad=bad[:_LISTED],
        left=max(len(bad) - _LISTED, 0),
    ) | {"summary.csv": _csv(rows, quantities)}


def batch_times(rows: Sequence[RunRow]) -> Files:
    """`times.csv`: seconds of one processor for each run.  It is no part of the report, which
    follows from the inputs alone.
    """
    lines = [(_cell(row.campaign), _cell(row.run), f"{row.seconds:.2f}") for row in rows]
    return {"times.csv": as_csv([("campaign", "run", "cpu_s"), *lines]).encode()}


def batch_line(rows: Sequence[RunRow]) -> str:
    """How many of each status, and what they took, in one line."""
    return phrase(
        "{counts} ({seconds:.3g} s of processor time)",
        counts=", ".join(f"{number} {status}" for status, number in _counts(rows)),
        seconds=sum(row.seconds for row in rows),
    )


def _counts(rows: Sequence[RunRow]) -> list[tuple[str, int]]:
    counted = Counter(row.status or phrase("without a result") for row in rows)
    return sorted(counted.items(), key=lambda item: (item[0] != "ok", -item[1]))


def _csv(rows: Sequence[RunRow], quantities: Sequence[RunScatter]) -> bytes:
    """A line for each run; of each quantity mean, sd and the ends of the 95 % interval in SI units,
    empty where there is none.
    """
    names = sorted((spread.name, spread.unit) for spread in quantities)
    heads = [f"{name} [{unit}]" if unit != "1" else name for name, unit in names]
    columns = [f"{head}{end}" for head in heads for end in ("", " sd", " q025", " q975")]
    lines: list[list[object]] = [["campaign", "run", "status", "why", *columns]]
    for row in rows:
        why = _cell(row.error or row.reason)
        lines.append([_cell(row.campaign), _cell(row.run), row.status or "no result", why])
        for name, unit in names:
            value = row.values.get(name)
            lines[-1] += (
                [""] * 4
                if value is None or value.unit != unit
                else [value.mean, value.sd, value.q025, value.q975]
            )
    return as_csv(lines).encode()


def _record(row: RunRow) -> dict[str, object]:
    """The results in a row, without how and when it was made."""
    left_out = ("seconds", "key", "outputs", "names")
    return {key: value for key, value in msgspec.to_builtins(row).items() if key not in left_out}


def _cell(text: str) -> str:
    """Text that no spreadsheet takes for a formula."""
    return f"'{text}" if text.startswith(("=", "+", "-", "@", "\t", "\r")) else text


def synthetic_words(rows: Sequence[RunRow]) -> str:
    """Which data are synthetic; "" where none are."""
    n, of = sum(row.kind == "synthetic" for row in rows), sum(bool(row.kind) for row in rows)
    if n == 0:
        return ""
    return (
        phrase("SYNTHETIC data")
        if n == of
        else phrase("SYNTHETIC data in {n} of {total} runs", n=n, total=of)
    )


def overview_figure(rows: Sequence[RunRow], shown: Sequence[RunScatter]) -> Figure:
    """Each quantity against the number of the run; a run that is not ok is a cross at the bottom
    where it has the quantity, what stands apart is named.
    """
    figure, axes = grid(len(shown), height=1.5, columns=1, sharex=True)
    some_bad = any(row.status != "ok" for row in rows)
    for ax, spread in zip(axes, shown, strict=True):
        at = np.array(spread.rows) + 1
        outlying = np.isin(np.array(spread.rows), spread.apart)
        factor = spread.label.factor
        ax.axhline(spread.median * factor, color=GREY, label=phrase("median"))
        for chosen, colour, mark in ((~outlying, BLUE, "o"), (outlying, ORANGE, "D")):
            bars = len(rows) <= 200  # of more, error bars would be one black band
            ax.errorbar(
                at[chosen],
                spread.mean[chosen] * factor,
                spread.sd[chosen] * factor if bars else None,
                fmt=mark,
                color=colour,
                markersize=3.5 if bars else 2.0,
                markeredgewidth=None if bars else 0.0,
            )
        for i in spread.apart[:_NAMED]:
            name = rows[i].run or PurePath(rows[i].campaign).name
            value = spread.mean[spread.rows.index(i)] * factor
            ax.annotate(name, (i + 1, value), xytext=(4, 3), textcoords="offset points", color=INK)
        bad = _not_ok(rows, spread)
        ax.plot(bad, [0.04] * len(bad), "x", color=INK, transform=ax.get_xaxis_transform())
        ax.set_ylabel(spread.label.axis)
        ax.margins(y=0.15)
    if synthetic := synthetic_words(rows):
        figure.suptitle(synthetic)
    axes[-1].set_xlabel(
        phrase(
            "number of the run (cross at the bottom: not ok)" if some_bad else "number of the run"
        )
    )
    axes[-1].set_xlim(0.4, len(rows) + 0.6)
    whole_ticks(axes[-1].xaxis)
    legend_below(figure)
    return figure


def _not_ok(rows: Sequence[RunRow], spread: RunScatter) -> list[int]:
    """Numbers of the runs that are not ok and have the quantity; of one without a result that is
    known where all others of its campaign, or of the batch, agree.
    """
    known = [row for row in rows if row.names]

    def has_it(row: RunRow) -> bool:
        of_campaign = [other for other in known if other.campaign == row.campaign]
        alike = [row] if row.names else of_campaign or known
        return all(spread.name in other.names for other in alike)

    return [i for i, row in enumerate(rows, 1) if row.status != "ok" and has_it(row)]
