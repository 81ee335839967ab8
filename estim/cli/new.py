"""`estim new`: a campaign file to begin with."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from estim.cli.options import PATH
from estim.cli.tables import curve_options
from estim.cli.terminal import say, write_files
from estim.common import InputError

if TYPE_CHECKING:
    from estim.campaign import TableChoices


@click.command("new")
@click.argument("name", type=PATH)
@click.option(
    "--from",
    "files",
    multiple=True,
    type=PATH,
    metavar="FILE",
    help="The table, .trk or .trz to be fitted; give it again for each further run.  [default: "
    "asked for]",
)
@curve_options
def new_campaign(name: Path, files: tuple[Path, ...], options: Mapping[str, Any]) -> None:
    """Write NAME.toml, a commented campaign for the table FILE, for `estim fit`.

    Its curve is a guess unless --formula is given.  Without --from, the program asks in the
    terminal.  No file is overwritten.
    """
    from estim.campaign import choices_of_table, drafted_campaign

    if not name.name:
        raise InputError("must be the name of a file", field="NAME", value=str(name))
    path = name if name.suffix.lower() == ".toml" else name.with_name(f"{name.name}.toml")
    if path.exists() or path.is_symlink():
        raise InputError("is there already and is not overwritten", field="NAME", value=str(path))
    if not files:
        if not _in_a_terminal():
            raise InputError(
                "must name the table to be fit (without it, questions are asked in a terminal)",
                field="--from",
            )
        file, choices = _prompted(options)
        files = (file,)
    else:
        choices = choices_of_table(options)
    text, columns = drafted_campaign(files[0], choices, *files[1:], within=path.parent)
    write_files(path.parent, {path.name: text.encode()})
    if columns:
        say(columns)
    guessed = "" if choices.formula or choices.rolling else "; its curve is a guess: write yours"
    say(f"campaign: {path}{guessed}")
    say(f"fit it by: {shlex.join(('estim', 'fit', str(path)))}")


def _in_a_terminal() -> bool:
    return sys.stdin.isatty()


def _prompted(options: Mapping[str, Any]) -> tuple[Path, TableChoices]:
    """The file and the choices by questions and answers; what the options state is not asked."""
    from estim.campaign import choices_of_table, columns_of

    answers = dict(options)
    file = Path(click.prompt("Table (or .trk) to be fit"))
    if file.suffix.lower() not in (".trk", ".trz"):
        say(f"columns: {', '.join(columns_of(file, choices_of_table(answers)))}")
    for key, question in (
        ("x", "Column of x"),
        ("y", "Column of y"),
        ("formula", "Curve, in x and its parameters, as a*exp(-x/tau) + c"),
    ):
        answer = answers[key] or click.prompt(question)
        answers[key] = (answer,) if key == "x" and isinstance(answer, str) else answer
    if answers["u_y"] is None:
        answers["u_y"] = (
            click.prompt(
                "Standard uncertainty of one y (empty: by the residuals)",
                default="",
                show_default=False,
            )
            or None
        )
    if not answers["start"]:
        written = click.prompt(
            "Starting values, as tau=2 A=1 (only of parameters that are not linear)",
            default="",
            show_default=False,
        )
        answers["start"] = tuple(written.replace(",", " ").split())
    answers["title"] = answers["title"] or click.prompt("Title", default=file.stem)
    return file, choices_of_table(answers)
