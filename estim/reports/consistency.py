"""The section of a report on whether the runs of a joint fit agree; the text stands in `templates/consistency.md.j2`."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from estim.checks import P_INCONSISTENT, PRIORS, Consistency, SharedEstimate
from estim.common import Label, Markdown, format_quantity, p_digits, phrase
from estim.reports.rendering import render


@dataclass(frozen=True)
class SourceRow:
    """One source against all others, every cell as text."""

    source: str
    distance2: str
    dof: str
    p_value: str
    p_holm: str


@dataclass(frozen=True)
class EstimateRow:
    """One shared parameter as one run gives it, as all others give it, and as the joint fit gives it."""

    parameter: str
    unit: str
    run: str
    alone: str
    others: str
    joint: str


def consistency_text(
    consistency: Consistency, pictures: Collection[str] = (), *, limits_only: bool = False, on_edge: Collection[str] = ()
) -> Markdown:
    """Markdown fragment without a heading: verdict, table of sources, table of estimates, how to read them.

    pictures : paths of the figures beside it.
    limits_only : leave out what all runs give together, where that is no result.  on_edge : parameters of which it is a limit and no value.
    """
    return render(
        "consistency.md.j2", pictures=pictures,
        consistency=consistency, sources=source_rows(consistency), estimates=estimate_rows(consistency, on_edge), reject_below=P_INCONSISTENT,
        limits_only=limits_only,
    )


def source_rows(consistency: Consistency) -> list[SourceRow]:
    """Every run, and the stated values as one more source."""
    return [
        SourceRow(
            source=Markdown(f"*{phrase('stated values')}*") if row.source == PRIORS else row.source,
            distance2=f"{row.distance2:.1f}" if row.dof else "—",
            dof=str(row.dof), p_value=p_digits(row.p_value) if row.dof else "—", p_holm=p_digits(row.p_holm) if row.dof else "—",
        )
        for row in consistency.rows
    ]


def estimate_rows(consistency: Consistency, on_edge: Collection[str] = ()) -> list[EstimateRow]:
    """Every shared parameter by every run that uses it; of those `on_edge` all runs together give a limit, which stands elsewhere."""
    rows = []
    for i, (name, shown) in enumerate(zip(consistency.shared, consistency.labels, strict=True)):
        for run in consistency.used[name]:
            rows.append(
                EstimateRow(
                    parameter=shown.symbol, unit="" if shown.unit == "1" else shown.unit, run=run, alone=_cell(consistency.alone[run], i, shown),
                    others=_cell(consistency.others[run], i, shown),
                    joint=phrase("a limit") if name in on_edge else _cell(consistency.joint, i, shown),
                )
            )
    return rows


def _cell(estimate: SharedEstimate, i: int, shown: Label) -> str:
    return format_quantity(float(estimate.mean[i]) * shown.factor, float(estimate.sd[i]) * shown.factor)
