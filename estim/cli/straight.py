"""`estim line FILE.csv`: a straight line through any points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from estim.cli.terminal import conclude, report_at, reserve_output, say, write_report
from estim.common import phrase, read_quantity

if TYPE_CHECKING:
    from estim.reading import Dialect


class SharedErrors(NamedTuple):
    """What the command says of errors that points share."""

    cov: Path | None
    cov_x: Path | None
    cov_y: Path | None
    common_x: tuple[str, ...]
    common_y: tuple[str, ...]


def say_straight_line(
    file: Path,
    names: Sequence[str | None],
    folder: Path,
    *,
    predict: Sequence[str],
    inverse: Sequence[str],
    figures: bool,
    dialect: Dialect,
    errors: SharedErrors,
) -> bool:
    """Writes the report of a line and says it; whether its status is ok.  names : columns x, y,
    u(x), u(y), correlation; None for the usual.
    """
    from estim.line import Columns, Correlated, commons, straight_line
    from estim.reports import straight_line_lines, straight_line_report

    x, y, u_x, u_y, r_xy = names
    columns = Columns(x or "", y or "", u_x, u_y, r_xy)
    at = [read_quantity(text, field="--predict") for text in predict]
    back = [read_quantity(text, field="--inverse") for text in inverse]
    shared = Correlated(
        errors.cov, errors.cov_x, errors.cov_y, commons(errors.common_x, errors.common_y)
    )
    reserve_output(folder, "result.json")
    line = straight_line(
        file, columns, predict=at, inverse=back, dialect=dialect, correlated=shared
    )
    write_report(folder, straight_line_report(line, figures=figures))
    say(line.told)
    conclude(
        phrase("line"),
        line.status,
        straight_line_lines(line) if line.status.ok else [line.message],
        line.facts,
    )
    report_at(folder / "report.md", ())
    return line.status.ok
