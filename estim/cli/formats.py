"""`--format`: a report as one HTML file or as PDF, beside the Markdown that is always there.  Every
command that writes a report has it.
"""

from __future__ import annotations

from importlib import import_module

import click

from estim.common import InputError

_KEY = "estim.formats"
_BROWSER = "or print report.html with a browser"
_NEEDS = {
    "html": ("markdown_it", "pip install markdown-it-py"),
    "pdf": ("weasyprint", f'pip install "estim[pdf]"; {_BROWSER}'),
}

_LIBRARIES = "Pango: docs/reports.md says where from"


def _noted(
    context: click.Context, _option: click.Parameter, formats: tuple[str, ...]
) -> tuple[str, ...]:
    """Keeps the formats with the command, so that they need not be passed on.

    Raises InputError, before anything is computed, where one cannot be made.
    """
    for name in formats:
        module, remedy = _NEEDS[name]
        try:
            import_module(module)
        except ImportError:
            raise InputError(
                f"needs the package {module}: {remedy}", field="--format", value=name
            ) from None
        except OSError:  # of a package that calls libraries of the system
            raise InputError(
                f"needs libraries that {module} does not find ({_LIBRARIES}); {_BROWSER}",
                field="--format",
                value=name,
            ) from None
    context.meta[_KEY] = formats
    return formats


FORMAT = click.option(
    "--format",
    "formats",
    type=click.Choice(list(_NEEDS)),
    multiple=True,
    expose_value=False,
    callback=_noted,
    help="Beside report.md: report.html, one file with all figures in it, or report.pdf.",
)


def chosen() -> tuple[str, ...]:
    """The formats that were requested of the command under way."""
    context = click.get_current_context(silent=True)
    return () if context is None else tuple(dict.fromkeys(context.meta.get(_KEY, ())))
