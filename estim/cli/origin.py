"""How a report was made, kept beside it as `origin.json`: command, inputs and outputs with their digests, versions.  `estim verify` reads it."""

from __future__ import annotations

import hashlib
import shlex
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path, PurePosixPath

import click

from estim.common import EstimError, InputError, as_json, code, inputs_read, read_file

ORIGIN = "origin.json"
_SCHEMA = "estim-origin/1"
_LARGEST = 2**24
_PACKAGES = ("estim", "numpy", "scipy", "lmfit", "emcee")
_OF_THE_MOMENT = frozenset({"out", "resume", "jobs", "scheduler"})  # options that change no number


@dataclass(frozen=True)
class Origin:
    """command : arguments of `estim`, without those that change no number.  part : folder of this report within what the command writes.

    inputs, outputs : path (of outputs: within the folder) -> SHA-256 of its bytes.
    """

    schema: str
    command: list[str]
    part: str
    inputs: dict[str, str]
    outputs: dict[str, str]
    versions: dict[str, str]

    @property
    def line(self) -> str:
        return shlex.join(["estim", *self.command])


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
    """`files` of a report and `origin.json`, where a command is under way."""
    context = click.get_current_context(silent=True)
    ledger = None if context is None else context.find_object(Ledger)
    if context is None or ledger is None:
        return dict(files)
    versions = {"python": sys.version.split()[0]} | {package: version(package) for package in _PACKAGES}
    command, inputs = [_plain(text) for text in _arguments(context)], {_plain(path): digest for path, digest in sorted(ledger.inputs.items())}
    line = f"\n---\n\nMade by {code(shlex.join(['estim', *command]))}; `estim verify` recomputes this report from the same files.\n"
    signed = {name: data + line.encode() if name == "report.md" else data for name, data in files.items()}
    digests = {name: hashlib.sha256(data).hexdigest() for name, data in sorted(signed.items())}
    return {**signed, ORIGIN: as_json(Origin(_SCHEMA, command, part, inputs, digests, versions))}


def _plain(text: str) -> str:
    """The text without bytes that are none of UTF-8's, which a path may hold."""
    return text.encode("utf-8", "backslashreplace").decode()


def _arguments(context: click.Context) -> list[str]:
    """The command as one would type it, options that have their defaults left out."""
    said: list[str] = []
    plain: list[str] = []
    for parameter in context.command.params:
        value, name = context.params.get(parameter.name or ""), parameter.name or ""
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


def written_before(folder: Path) -> dict[str, str]:
    """Files of the report that stands in `folder`, with their digests; none where none of ours does."""
    try:
        outputs = read_origin(folder).outputs
    except EstimError:
        return {}
    return {name: digest for name, digest in outputs.items() if inside(name)}


def inside(name: str) -> bool:
    """Whether a path that somebody may have written leads no way out of its folder."""
    return not (PurePosixPath(name).is_absolute() or Path(name).is_absolute() or ".." in PurePosixPath(name).parts)


def read_origin(folder: Path) -> Origin:
    """The origin of the report in `folder`.  Raises InputError where there is none, or it is none of estim's."""
    path = folder / ORIGIN
    data = read_file(path, at_most=_LARGEST, within=folder)
    if data is None:
        raise InputError(f"holds no {ORIGIN}: it is no report of this version of estim", field="report", value=str(folder))
    import msgspec

    try:
        origin = msgspec.json.decode(data, type=Origin)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise InputError(f"is no origin of a report ({str(error).splitlines()[0]})", file=str(path)) from None
    if origin.schema != _SCHEMA:
        raise InputError(f"must be {_SCHEMA}", field="schema", value=origin.schema, file=str(path))
    return origin
