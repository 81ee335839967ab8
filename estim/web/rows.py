"""The table of a batch: a row for each file, made of the results by the code of `estim batch`.  A
server loads it when the first table is requested.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec.structs import replace

from estim.web.labels import on_page
from estim.web.store import Answer, Store

if TYPE_CHECKING:
    from estim.batch import RunRow, RunScatter


def answers_of(store: Store, batch: str) -> list[Answer]:
    """The answers of a batch, the oldest first, without those in whose place another stands."""
    rows, first = dict[str, Answer](), dict[str, str]()  # a row may be replaced twice
    for answer in store.answers.records.values():
        if answer.batch == batch:
            at = first[answer.id] = first.get(answer.instead, answer.id)
            rows.pop(at, None)
            rows[at] = answer
    return [*rows.values()]


def rows_of(store: Store, answers: Sequence[Answer]) -> tuple[list[RunRow], list[RunScatter]]:
    """A row for each of `answers`, and the quantities in them."""
    from estim.batch import spreads

    rows = [_row(store, answer) for answer in answers]
    return rows, spreads(rows)


def summary_of(store: Store, answers: Sequence[Answer]) -> bytes:
    """`summary.csv` of the answers that have ended, as `estim batch` writes it."""
    from estim.reports.batch import batch_report

    ended = [answer for answer in answers if answer.state != "running"]
    return batch_report(rows_of(store, ended)[0], figures="none")["summary.csv"]


def _row(store: Store, answer: Answer) -> RunRow:
    from estim.batch import Unit, failed, row_of

    unit = Unit(Path(), "", answer.id)
    has_result = answer.standing in ("ok", "doubtful")
    result = store.answers.read(answer.id, "report/result.json") if has_result else None
    row = (
        failed(unit, on_page(answer.error))
        if result is None
        else row_of(unit, result, {}, key="", seconds=0.0, interval=None)
    )
    return replace(row, campaign=answer.given)  # a name that a person gave is no path
