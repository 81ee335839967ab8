"""`estim body`: bodies from their parts."""

from __future__ import annotations

from pathlib import Path

import click

from estim.cli.options import FORMAT, LANG, OUT, PATH, SEED, out_folder
from estim.cli.terminal import report_at, reserve_output, say, write_report
from estim.common import Stream, stream


@click.command()
@click.argument("file", type=PATH)
@OUT
@SEED
@FORMAT
@LANG
def body(file: Path, out: Path | None, seed: int) -> None:
    """Mass, gamma, kappa and rho of the bodies in FILE (a campaign, or bodies alone) from their
    parts, with a budget.
    """
    from estim.campaign import read_campaign_file
    from estim.reports.bodies import body_lines, body_report
    from estim.studies.bodies import weigh

    folder = out or out_folder(file, "body")
    source = read_campaign_file(file, measured=False)
    reserve_output(folder, "result.json")
    bodies = weigh(source, rng=stream(seed, Stream.PARTS))
    write_report(folder, body_report(source, bodies, seed=seed))
    for line in body_lines(bodies):
        say(line)
    report_at(folder)
