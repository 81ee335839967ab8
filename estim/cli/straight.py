"""`estim line FILE.csv`: a straight line through any points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from estim.cli.terminal import conclude, report_at, write_report
from estim.common import read_quantity

if TYPE_CHECKING:
    from estim.reading import Dialect


def say_straight_line(
    file: Path, names: Sequence[str | None], folder: Path, *, predict: Sequence[str], inverse: Sequence[str], figures: bool,
    dialect: Dialect,
) -> bool:
    """Writes the report of a line and says it; whether its status is ok.  names : columns x, y, u(x), u(y), correlation; None for the usual."""
    from estim.line import Columns, straight_line
    from estim.reports import straight_line_lines, straight_line_report

    x, y, u_x, u_y, r_xy = names
    columns = Columns(x or "x", y or "y", u_x, u_y, r_xy)
    at = [read_quantity(text, field="--predict") for text in predict]
    line = straight_line(file, columns, predict=at, inverse=[read_quantity(text, field="--inverse") for text in inverse], dialect=dialect)
    write_report(folder, straight_line_report(line, figures=figures))
    conclude("line", line.status, straight_line_lines(line) if line.status.ok else [line.fit.message], line.facts)
    report_at(folder / "report.md", ())
    return line.status.ok
