"""How a report was made, kept beside it: command, inputs and outputs with their digests, versions.
`estim verify` reads it.
"""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path, PurePosixPath

import click

from estim.cli.options import chosen
from estim.common import Files, InputError, code, json_of, language, phrase, plain, read_file
from estim.versions import engine_versions, version

# options that the command does not take itself
_FROM_CONTEXT = {"formats": chosen, "lang": language}
WITHOUT_EFFECT = {"out", "resume", "jobs", "scheduler", "json"}  # options that change no number


def inputs_so_far() -> dict[str, str]:
    """Inputs that the command under way has read, which the group of all commands keeps."""
    inputs: dict[str, str] = click.get_current_context().find_root().obj
    return inputs


def with_origin(files: Files, part: str) -> tuple[Files, Origin]:
    """`files` of a report and the requested formats; and how they were made."""
    from estim.reports.pages import with_formats

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


ORIGIN = "origin.json"
# of a synthetic campaign, in whose folder a report may stand: it must not pass for the report
# before
SIMULATION = "simulation.json"
SCHEMA = "estim-origin/1"


@dataclass(frozen=True)
class Origin:
    """command : arguments of `estim`, without those that change no number.  part : folder of this
    report within what the command writes.

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

    @property
    def subject(self) -> list[str]:
        """The command without options, and the files that it names."""
        words = takewhile(lambda word: not word.startswith("-"), self.command)
        return [
            str(Path(word).resolve()) if word in self.inputs else word
            for i, word in enumerate(words)
            if i == 0 or word in self.inputs
        ]


def read_origin(folder: Path, *, within: Path | None = None, name: str = ORIGIN) -> Origin:
    """The origin of the report in `folder`.  Raises InputError where there is none, or it is none
    of estim's: it may be another program's.
    """
    path = folder / name
    data = read_file(path, within=within or folder)
    if data is None:
        raise InputError(
            f"holds no {ORIGIN}: it is not a report of this version of estim",
            field="report",
            value=str(folder),
        )
    import msgspec

    try:
        origin = msgspec.convert(json_of(data), Origin)
    except (ValueError, msgspec.ValidationError) as error:
        raise InputError(
            f"is no origin of a report ({str(error).splitlines()[0]})", file=str(path)
        ) from None
    if origin.schema != SCHEMA:
        raise InputError(f"must be {SCHEMA}", field="schema", value=origin.schema, file=str(path))
    for field, places in (("part", [origin.part]), ("outputs", origin.outputs)):
        for place in places:
            if not stays_inside(place) or (field == "outputs" and not PurePosixPath(place).parts):
                raise InputError(
                    "must lie within what the command writes",
                    field=field,
                    value=place,
                    file=str(path),
                )
    return origin


def written_before(folder: Path, *, within: Path, name: str = ORIGIN) -> Origin | None:
    """The origin of the report that stands in `folder`; None where there is none.

    Raises InputError for an origin that is none of ours.
    """
    exists = read_file(folder / name, within=within) is not None
    return read_origin(folder, within=within, name=name) if exists else None


def stays_inside(name: str) -> bool:
    """Whether a path that somebody may have written can be one of a file and leads no way out of
    its folder.
    """
    return name.isprintable() and not (
        PurePosixPath(name).is_absolute()
        or Path(name).is_absolute()
        or ".." in PurePosixPath(name).parts
    )
