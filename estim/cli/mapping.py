"""`estim map`: what bodies do from rest, over tilt and angle of release."""

from __future__ import annotations

from pathlib import Path

import click

from estim.cli.options import CAMPAIGN, OUT_MAP, Real, out_folder, report_options
from estim.cli.terminal import conclude, finish, reserve_output, say, write_report
from estim.common import FigureChoice, decide


@click.command("map")
@CAMPAIGN
@click.option(
    "--body",
    "bodies",
    multiple=True,
    metavar="NAME",
    help="This body only; may be given several times.  [default: every body with runs]",
)
@click.option(
    "--ramp-length",
    type=Real(),
    metavar="M",
    help="From the release to the end of the ramp, m.  [default: stated, else the longest run]",
)
@OUT_MAP
@report_options
def map_motions(
    campaign: Path,
    bodies: tuple[str, ...],
    ramp_length: float | None,
    out: Path | None,
    seed: int,
    figures: FigureChoice,
) -> None:
    """Map the motion of the bodies of CAMPAIGN released at rest, over tilt and angle of release.

    Does it climb, how far, does it turn on the ramp, roll on for ever; each border with its
    uncertainty, the runs marked.  Exit code 3: a recording shows what the stated values do not
    allow.
    """
    from estim.campaign import load_campaign
    from estim.line import read_theta_min
    from estim.reports.regimes import map_report, place_words
    from estim.studies.regimes import map_bodies
    from estim.words import describe

    loaded = load_campaign(campaign)
    loaded.require_body()
    line = None if loaded.source.line is None else read_theta_min(loaded.source)
    folder = out or out_folder(campaign, "map")
    reserve_output(folder, "result.json")
    maps = map_bodies(loaded, bodies, ramp_length=ramp_length, seed=seed)
    write_report(folder, map_report(loaded, maps, line, seed=seed, figures=figures))
    for body_map in maps:
        conclude(body_map.body, decide(body_map.findings), map(describe, body_map.findings))
        for place in body_map.runs:
            say(f"  {place_words(place)}")
    ok = decide(finding for body_map in maps for finding in body_map.findings).ok
    finish(folder, ok, loaded.source.files_outside(line=line is not None))
