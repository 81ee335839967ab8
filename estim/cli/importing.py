"""`estim import`: a run made of a file of the program Tracker, and what is suspicious about it
said.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from estim.cli.terminal import say, write_files
from estim.common import InputError

if TYPE_CHECKING:
    from estim.reading import Choices


def import_run(file: Path, choices: Choices, out: Path) -> None:
    """Writes the CSV `out`; facts go to stdout, warnings to stderr."""
    from estim.reading import import_track, run_table

    if out.resolve() == file.resolve():
        raise InputError("must not be the file that is read", field="--out", value=str(out))
    imported = import_track(file, choices)
    write_files(out.parent, {out.name: run_table(imported)})
    for fact in imported.facts:
        say(fact)
    for warning in imported.warnings:
        say(f"warning: {warning}", err=True)
    say(f"run: {out} ({imported.t.size} rows)")
