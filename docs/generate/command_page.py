"""docs/reference/commands.md: every command and option, from click."""

from __future__ import annotations

import re
from collections.abc import Iterator
from inspect import cleandoc

import click

from estim.cli.commands import cli

_INTRODUCTION = """# Commands

Made by `make docs` from the commands themselves; `estim COMMAND --help` says the same.

| exit code | |
|---|---|
| 0 | the result is ok |
| 2 | the input is wrong; one line on standard error says where and how |
| 3 | a result is not to be trusted, and its report says why; it is written all the same |
| 74 | all went well, but standard output could not be written (a full disk) |
| 130 | interrupted: Ctrl-C, SIGTERM, a closed terminal |
| 141 | all went well, but nobody read standard output to its end (`\\| head`) |

"""


def commands_page() -> str:
    """The page in Markdown."""
    context = click.Context(cli, info_name="estim")
    names = cli.list_commands(context)
    commands = [
        command
        for name in names
        if (command := cli.get_command(context, name)) is not None and not command.hidden
    ]
    found = [
        f"- [`estim {command.name}`](#estim-{command.name}): {_first(command)}"
        for command in commands
    ]
    return (
        _INTRODUCTION
        + "\n".join(found)
        + "\n"
        + "".join(_section(command, context) for command in commands)
    )


def _paragraphs(command: click.Command) -> list[str]:
    text = cleandoc((command.help or "").replace("\f", "")).replace("\b\n", "")
    return [_linked(" ".join(part.split())) for part in text.split("\n\n")]


def _first(command: click.Command) -> str:
    return _paragraphs(command)[0]


def _linked(text: str) -> str:
    """Names of pages as links from docs/reference, words in capitals and angle brackets as they
    are.
    """
    return re.sub(
        r"docs/([\w/-]+\.md)", r"[docs/\1](../\1)", text.replace("<", "&lt;").replace("*", "\\*")
    )


def _section(command: click.Command, parent: click.Context) -> str:
    context = click.Context(command, info_name=command.name, parent=parent)
    arguments = " ".join(
        _metavar(parameter) for parameter in command.params if isinstance(parameter, click.Argument)
    )
    rows = [
        row
        for parameter in command.get_params(context)
        if isinstance(parameter, click.Option)
        for row in _row(parameter)
    ]
    table = "\n| option | |\n|---|---|\n" + "\n".join(rows) + "\n" if rows else ""
    usage = " ".join(
        word for word in ("estim", command.name, arguments, "[OPTIONS]" if rows else "") if word
    )
    return (
        f"\n## estim {command.name}\n\n    {usage}\n\n"
        + "\n\n".join(_paragraphs(command))
        + f"\n{table}"
    )


def _row(option: click.Option) -> Iterator[str]:
    if option.hidden or "--help" in option.opts:
        return
    names = [*option.opts, *option.secondary_opts]
    value = "" if option.is_flag or option.count else f" {_metavar(option)}"
    words = _linked(option.help or "").replace("|", "\\|")
    if (
        option.show_default
        and option.default is not None
        and not option.is_flag
        and "[default" not in words
    ):
        words += f"  [default: {option.default}]"
    if option.multiple and "several times" not in words:
        words += "  (may be given several times)"
    yield f"| `{', '.join(names)}{value}` | {' '.join(words.split())} |"


def _metavar(parameter: click.Parameter) -> str:
    """How its value is called; the same for every version of click."""
    many = "..." if parameter.nargs == -1 else ""
    if parameter.metavar:
        return (
            parameter.metavar
            if isinstance(parameter, click.Argument)
            else parameter.metavar.replace("|", " or ")
        )
    if isinstance(parameter, click.Argument):
        return (parameter.name or "").upper() + many
    kind = parameter.type
    if isinstance(kind, click.Choice):
        return " or ".join(str(choice) for choice in kind.choices)
    if isinstance(kind, click.Path):
        return "FILE" if kind.file_okay else "FOLDER"
    return {"integer": "N", "integer range": "N", "float": "NUMBER", "float range": "NUMBER"}.get(
        kind.name, "TEXT"
    )
