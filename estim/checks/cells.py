"""What a person sees of a result at a glance: what the data are, the status, and either the values or why there are none.

Reports print their cells from here, and so does a notebook: a record's `_repr_markdown_` returns `headline(...)`.  It draws
nothing and takes milliseconds.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from estim.common import KINDS, Label, Status, format_quantity, format_rounded, markdown, table
from estim.fitting import limit_cell
from estim.sampling import Summary
from estim.words import STATUS_WORDS

_LOPSIDED = 1.5
_HEAVY = 2.0  # standard deviations over half of the 68 % interval: a ratio whose denominator comes near 0


def value_cell(p: Summary, shown: Label) -> str:
    """mean ± sd, median +up −down where the posterior is lopsided, or the limit of what lies on an edge."""
    if p.limit is not None:
        return limit_cell(p.limit, shown.factor)
    if p.mean is None or p.sd is None or p.median is None or p.q16 is None or p.q84 is None:
        return "n/a"
    if lopsided(p):
        up, down = (p.q84 - p.median) * shown.factor, (p.median - p.q16) * shown.factor
        centre = format_rounded(p.median * shown.factor, min(up, down))
        return f"{centre} +{format_rounded(up, min(up, down))} −{format_rounded(down, min(up, down))}"
    return format_quantity(p.mean * shown.factor, p.sd * shown.factor)


def lopsided(p: Summary) -> bool:
    """Whether one half of the 68 or of the 95 % interval is more than 1.5 times the other, or tails make the sd say little: then ± misleads."""
    if p.median is None or p.q16 is None or p.q84 is None or p.q025 is None or p.q975 is None:
        return False
    halves = ((p.median - p.q16, p.q84 - p.median), (p.median - p.q025, p.q975 - p.median))
    return _heavy(p) or any(max(pair) > _LOPSIDED * min(pair) for pair in halves)


def _heavy(p: Summary) -> bool:
    return p.sd is not None and p.q84 is not None and p.q16 is not None and p.sd > _HEAVY * 0.5 * (p.q84 - p.q16)


def interval_cell(p: Summary, shown: Label) -> str:
    """The 95 % interval, rounded by its width; from the edge on for what lies on one."""
    if p.limit is not None:
        ends = sorted((p.limit.edge * shown.factor, p.limit.limit_95 * shown.factor))
        low, high = (format_rounded(end, 0.25 * (ends[1] - ends[0])) for end in ends)
        return f"[{low}, {high}]"
    if p.q025 is None or p.q975 is None:
        return "n/a"
    u = (p.sd if p.sd is not None and not _heavy(p) else 0.25 * (p.q975 - p.q025)) * shown.factor
    return f"[{format_rounded(p.q025 * shown.factor, u)}, {format_rounded(p.q975 * shown.factor, u)}]"


def parameter_cells(p: Summary, shown: Label) -> tuple[str, str, str, str, str]:
    """Symbol, meaning, value, 95 % interval and unit of one quantity."""
    return shown.symbol, p.meaning, value_cell(p, shown), interval_cell(p, shown), "" if shown.unit == "1" else shown.unit


def headline(
    title: str, *, kind: str, status: str, reasons: Sequence[str], advice: Sequence[str], rows: Iterable[tuple[str, str, str, str, str]]
) -> str:
    """Markdown: title, kind of data, status, and the table of `rows` (`parameter_cells`), or without it the reasons where the status is not ok.

    kind : "measured", "synthetic" or "published"; "" where nobody has said it.
    """
    words = "" if status == Status.OK else f" — {STATUS_WORDS[Status(status)]}"
    said = [f"**{markdown(title)}**" if title else "", KINDS.get(kind, ""), f"Status: **{status}**{words}"]
    if status == Status.OK:
        said.append(table(("", "", "posterior", "95 % interval", "unit"), rows))
    else:
        items = [*reasons, *(f"What to do: {words}" for words in dict.fromkeys(advice))]
        said.append("\n".join(f"- {markdown(item)}" for item in items))
    return "\n\n".join(part for part in said if part)
