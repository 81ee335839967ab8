"""`--format`: a report as one HTML file or as PDF, beside the Markdown that is always there.  Every command that writes a report has it."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec

import click

from estim.common import InputError

_KEY = "estim.formats"
_NEEDS = {"html": ("markdown_it", "markdown-it-py")}

WRITTEN = frozenset(f"report.{name}" for name in _NEEDS)
"""Names of all files that can stand beside `report.md` and say the same."""


def _noted(context: click.Context, _option: click.Parameter, formats: tuple[str, ...]) -> tuple[str, ...]:
    """Keeps the formats with the command, so that nobody has to pass them on.

    Raises InputError, before anything is computed, where one cannot be made.
    """
    for name in formats:
        module, package = _NEEDS[name]
        if find_spec(module) is None:
            raise InputError(f"needs a package that is not installed: pip install '{package}'", field="--format", value=name)
    context.meta[_KEY] = formats
    return formats


FORMAT = click.option(
    "--format", "formats", type=click.Choice(list(_NEEDS)), multiple=True, expose_value=False, callback=_noted,
    help="Beside report.md write report.html too: one file with all figures in it.",
)


def chosen() -> tuple[str, ...]:
    """The formats that the command under way was asked for."""
    context = click.get_current_context(silent=True)
    return () if context is None else tuple(dict.fromkeys(context.meta.get(_KEY, ())))


def in_formats(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """`files` of a report and the report in every format asked for."""
    formats = chosen()
    if not formats:
        return dict(files)
    from estim.reports import with_formats

    return with_formats(files, formats)
