"""How a report was made, kept beside it: command, inputs and outputs with their digests, versions.  `estim verify` reads it."""

from __future__ import annotations

import hashlib
import shlex
import sys
from collections.abc import Mapping
from dataclasses import replace

import click

from estim.cli.crate import CRATE, crate_of
from estim.cli.formats import chosen, in_formats
from estim.cli.origin_record import ORIGIN, SCHEMA, Origin
from estim.common import as_json, code, inputs_read, language, phrase
from estim.versions import engine_versions

_KEPT = {"formats": chosen, "lang": language}  # options that the command does not take itself
_OF_THE_MOMENT = frozenset({"out", "resume", "jobs", "scheduler"})  # options that change no number


class Ledger:
    """What the command under way has read so far; kept in click's context, so that nobody has to pass it on."""

    def __init__(self) -> None:
        self._noting = inputs_read()
        self.inputs: dict[str, str] = {}

    def __enter__(self) -> Ledger:
        self.inputs = self._noting.__enter__()
        return self

    def __exit__(self, *trouble: object) -> None:
        self._noting.__exit__(None, None, None)


def note_of_others(inputs: Mapping[str, str]) -> None:
    """Adds what other processes have read for the command under way."""
    ledger = click.get_current_context().find_object(Ledger)
    if ledger is not None:
        ledger.inputs.update(inputs)


def with_origin(files: Mapping[str, bytes], part: str) -> dict[str, bytes]:
    """`files` of a report, the formats asked for, `origin.json` and the description for archives, where a command is under way."""
    context = click.get_current_context(silent=True)
    ledger = None if context is None else context.find_object(Ledger)
    if context is None or ledger is None:
        return dict(files)
    versions = {"python": sys.version.split()[0]} | engine_versions()
    command, inputs = [_plain(text) for text in _arguments(context)], {_plain(path): digest for path, digest in sorted(ledger.inputs.items())}
    said = phrase("Made by {command}; `estim verify` recomputes this report from the same files.", command=code(shlex.join(["estim", *command])))
    line = f"\n---\n\n{said}\n"
    signed = in_formats({name: data + line.encode() if name == "report.md" else data for name, data in files.items()})
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in sorted(signed.items())}
    origin = Origin(SCHEMA, command, part, inputs, digests, versions)
    crate = crate_of(signed, origin)
    outputs = digests | {CRATE: hashlib.sha256(crate).hexdigest()}
    return {**signed, CRATE: crate, ORIGIN: as_json(replace(origin, outputs=dict(sorted(outputs.items()))))}


def _plain(text: str) -> str:
    """The text without bytes that are none of UTF-8's, which a path may hold."""
    return text.encode("utf-8", "backslashreplace").decode()


def _arguments(context: click.Context) -> list[str]:
    """The command as one would type it, options that have their defaults left out."""
    said: list[str] = []
    plain: list[str] = []
    for parameter in context.command.params:
        name = parameter.name or ""
        value = _KEPT[name]() if name in _KEPT else context.params.get(name)
        if isinstance(parameter, click.Argument):
            plain += [str(item) for item in (value if isinstance(value, tuple) else (value,)) if item is not None]
        elif isinstance(parameter, click.Option) and name not in _OF_THE_MOMENT and value != parameter.get_default(context):
            said += _option(parameter, value)
    return [*(context.info_name or "",), *plain, *said]


def _option(option: click.Option, value: object) -> list[str]:
    if option.is_flag:
        chosen = option.opts if value else option.secondary_opts
        return [chosen[-1]] if chosen else []
    values = value if isinstance(value, tuple) and option.multiple else (value,)
    return [text for item in values if item is not None for text in (option.opts[-1], str(item))]
