"""How a report was made, kept beside it: command, inputs and outputs with their digests, versions.
`estim verify` reads it.
"""

from __future__ import annotations

import shlex
import sys

import click

from estim.cli.formats import chosen
from estim.cli.origin_record import SCHEMA, Origin
from estim.common import Files, code, language, phrase, plain
from estim.versions import engine_versions, version

# options that the command does not take itself
_FROM_CONTEXT = {"formats": chosen, "lang": language}
WITHOUT_EFFECT = frozenset(
    {"out", "resume", "jobs", "scheduler", "json"}
)  # options that change no number


def inputs_so_far() -> dict[str, str]:
    """Inputs that the command under way has read, which the group of all commands keeps."""
    inputs: dict[str, str] = click.get_current_context().find_root().obj
    return inputs


def with_origin(files: Files, part: str) -> tuple[Files, Origin]:
    """`files` of a report and the requested formats; and how they were made."""
    from estim.reports.formats import with_formats

    origin = origin_of(part)
    command = code(shlex.join(["estim", *origin.command]))
    sentence = phrase(
        "Made by {command}; `estim verify` recomputes this report from the same files.",
        command=command,
    )
    line = f"\n---\n\n{sentence}\n"
    signed = {
        name: data + line.encode() if name == "report.md" else data for name, data in files.items()
    }
    return with_formats(signed, chosen()), origin


def origin_of(part: str) -> Origin:
    """The command under way, what it has read so far, and the versions; without outputs."""
    context = click.get_current_context()
    versions = (
        {"python": sys.version.split()[0]}
        | engine_versions()
        | {"matplotlib": version("matplotlib")}
    )
    inputs = {plain(path): digest for path, digest in sorted(inputs_so_far().items())}
    return Origin(SCHEMA, [plain(text) for text in _arguments(context)], part, inputs, {}, versions)


def _arguments(context: click.Context) -> list[str]:
    """The command as one would type it, options that have their defaults left out."""
    options: list[str] = []
    positional: list[str] = []
    for parameter in context.command.params:
        name = parameter.name or ""
        value = _FROM_CONTEXT[name]() if name in _FROM_CONTEXT else context.params.get(name)
        if isinstance(parameter, click.Argument):
            positional += [
                str(item)
                for item in (value if isinstance(value, tuple) else (value,))
                if item is not None
            ]
        elif (
            isinstance(parameter, click.Option)
            and name not in WITHOUT_EFFECT
            and value != parameter.get_default(context)
        ):
            options += _option(parameter, value)
    return [*(context.info_name or "",), *positional, *options]


def _option(option: click.Option, value: object) -> list[str]:
    if option.is_flag:
        chosen = option.opts if value else option.secondary_opts
        return [chosen[-1]] if chosen else []
    values = value if isinstance(value, tuple) and option.multiple else (value,)
    return [text for item in values if item is not None for text in (option.opts[-1], str(item))]
