"""`--lang`: the language of a report.  Every command that writes one has it."""

from __future__ import annotations

import click

from estim.common import LANGUAGES, spoken


def _speak(context: click.Context, _option: click.Parameter, name: str) -> str:
    """Sets the language of everything that the command prints from here on."""
    context.with_resource(spoken(name))
    return name


LANG = click.option(
    "--lang",
    type=click.Choice(list(LANGUAGES)),
    default="en",
    show_default=True,
    is_eager=True,
    expose_value=False,
    callback=_speak,
    help="Language of the report, its figures and the final messages.  Error messages stay "
    "English.",
)
