"""`estim mean`: the mean of several values of one quantity."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from estim.cli.options import OUT, PATH, report_options
from estim.cli.tables import dialect_options
from estim.cli.terminal import conclude, finish, reserve_output, say, write_report
from estim.common import FigureChoice, phrase


@click.command()
@click.argument("file", type=PATH)
@click.option("--y", metavar="COLUMN", help="Column of values.  [default: the only one]")
@click.option(
    "--u-y",
    metavar="U|COLUMN",
    help="Standard uncertainty of the values.  [default: the column u_NAME if there, else they are "
    "readings whose scatter tells it]",
)
@click.option(
    "--group",
    metavar="COLUMN",
    help="Column that says to which group a reading belongs, a day for instance.",
)
@dialect_options
@OUT
@report_options
def mean(
    file: Path,
    y: str | None,
    u_y: str | None,
    group: str | None,
    out: Path | None,
    seed: int,
    figures: FigureChoice,
    dialect: Mapping[str, Any],
) -> None:
    """Mean of the values in a column of the table FILE, by several methods, and which to quote.

    With uncertainties it is weighted, with a dark uncertainty where the values scatter too much;
    without, it is that of readings, which may be in groups (docs/means.md).
    """
    from estim.means import mean_of_table
    from estim.reading import dialect_of_options
    from estim.reports.mean import mean_report, mean_statement

    folder = out or Path("out") / file.stem
    reserve_output(folder, "result.json")
    result = mean_of_table(file, y=y, u_y=u_y, group=group, dialect=dialect_of_options(dialect))
    write_report(folder, mean_report(result, seed=seed, figures=figures))
    say(result.told)
    for line in str(result.mean).splitlines()[1:-1]:
        say(line)
    quoted = result.mean.shown().notes
    # values that contradict each other have a dark uncertainty, which the quoted mean includes
    status = result.mean.status
    stated = [mean_statement(result)] if status.ok else []
    conclude(phrase("mean"), status, [*stated, *quoted], result.facts)
    finish(folder, status.ok)
