"""`estim body`: bodies from their parts."""

from __future__ import annotations

from pathlib import Path

from estim.cli.terminal import report_at, reserve_output, say, write_report
from estim.common import Stream, stream


def report_bodies(campaign: Path, folder: Path, *, seed: int) -> None:
    """Writes the report of the bodies in a file that give `parts`, and says their values."""
    from estim.campaign import read_campaign_file
    from estim.reports import body_lines, body_report
    from estim.studies import weigh

    source = read_campaign_file(campaign, measured=False)
    reserve_output(folder, "result.json")
    weighing = weigh(source, rng=stream(seed, Stream.PARTS))
    write_report(folder, body_report(source, weighing, seed=seed))
    for line in body_lines(weighing):
        say(line)
    report_at(folder / "report.md", ())
