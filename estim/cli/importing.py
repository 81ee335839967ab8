"""`estim import`: a run made of a file of the program Tracker, with warnings about what is
suspicious in it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from estim.cli.options import PATH, Place, Real
from estim.cli.terminal import say, write_files

if TYPE_CHECKING:
    from estim.reading import Unit


@click.command("import")
@click.argument("file", type=PATH)
@click.option("--track", metavar="NAME", help="Name of the track.  [default: the only one]")
@click.option(
    "--along",
    default="fit",
    show_default=True,
    metavar="fit|x|y|-x|-y|DEG",
    help="Direction of motion: fitted, an axis, an angle from x.",
)
@click.option(
    "--unit",
    type=click.Choice(["m", "cm", "mm"]),
    help="Unit of the lengths.  [default: as stated in the file, else m]",
)
@click.option(
    "--release",
    default="first",
    show_default=True,
    metavar="first|keep|T",
    help="x = 0 at the first point, the origin, or time T (s).",
)
@click.option(
    "--frame-ms",
    type=Real(),
    metavar="MS",
    help="Duration of a frame of a .trk, instead of that stated in the file (high-speed film).",
)
@click.option(
    "--drop-duplicates", is_flag=True, help="Exclude rows of an export that copy the previous row."
)
@click.option(
    "-o",
    "--out",
    required=True,
    type=Place(path_type=Path, dir_okay=False),
    help="The CSV file to write.",
)
def import_file(
    file: Path,
    track: str | None,
    along: str,
    unit: Unit | None,
    release: str,
    frame_ms: float | None,
    drop_duplicates: bool,
    out: Path,
) -> None:
    """Make a run of FILE, a .trk, .trz or text export of the program Tracker: a CSV with t_s and
    x_m.

    Warnings about suspicious data go to stderr and into the head of the CSV (docs/tracker.md).
    """
    from estim.reading import Choices, import_track, read_release, run_table

    choices = Choices(track, along, unit, read_release(release), frame_ms, drop_duplicates)
    imported = import_track(file, choices)
    write_files(out.parent, {out.name: run_table(imported)})
    for fact in imported.facts:
        say(fact)
    for warning in imported.warnings:
        say(f"warning: {warning}", err=True)
    say(f"run: {out} ({imported.t.size} rows)")
