"""Runs a page of documentation as it stands: its commands, its files and its Python, and what it
says that they print.

Fenced blocks are taken in order.  ```sh: commands, all of them `estim ...`.  ```python: run, with
the names of the page's blocks before it.  ```toml NAME (any language with a NAME): a file that is
written.  ```text after commands or Python: what they print; a line `...` stands for any lines.
Other blocks are for reading.
"""

from __future__ import annotations

import re
import shlex
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from click.testing import CliRunner

from estim.cli.commands import cli

_BLOCK = re.compile(r"^```(\w+)[ \t]*([^\n]*)\n(.*?)^```", flags=re.S | re.M)
_NUMBER = re.compile(r"[−-]?\d+(?:\.\d+)?(?:e[−+-]?\d+)?")
_PAIR = re.compile(r"([−-]?\d+\.?\d*) ± (\d+\.?\d*)")
# by how much of its ± a value may differ, for draws are fewer in tests and random numbers others
# with other versions
_PART_OF_U = 0.5
_SHARE = 0.35  # the same of any other number


def run_page(page: Path, folder: Path) -> dict[str, object]:
    """Runs the blocks of `page`; files that it writes go to `folder`, which is the working folder.
    What Python has defined comes back.

    Raises AssertionError where a command fails, or says something else than the page.
    """
    names: dict[str, object] = {}
    printed: str | None = None
    for language, argument, text in _BLOCK.findall(page.read_text(encoding="utf-8")):
        if argument:
            (folder / argument.strip()).write_text(text, encoding="utf-8")
        elif language == "sh":
            printed = "".join(_ran(line) for line in text.splitlines())
        elif language == "python":
            with redirect_stdout(StringIO()) as said:
                exec(compile(text, page.name, "exec"), names)
            printed = said.getvalue()
        elif language == "text" and printed is not None:
            trouble = difference(text, printed)
            assert trouble == "", f"{page.name}: {trouble}\n{printed}"
            printed = None
    return names


def _ran(line: str) -> str:
    """What a command prints.  It must end with 0, or with 3 and a status that is not ok."""
    program, *arguments = shlex.split(line)
    assert program == "estim", line
    done = CliRunner().invoke(cli, arguments)
    assert done.exit_code in (0, 3), f"{line}: {done.output}{done.exception!r}"
    assert (done.exit_code == 3) == (
        re.search(r"^(?!columns: ).*: (?!ok)[a-z-]+$", done.output, flags=re.M) is not None
    ), done.output
    return done.output


def difference(expected: str, printed: str) -> str:
    """The first line that is not as expected; "" where all are, numbers within what other random
    numbers do to them.
    """
    # a line about draws.nc comes where no extra is installed
    lines, skipping = (
        iter([line for line in printed.splitlines() if not line.startswith("draws.nc (the draws")]),
        False,
    )
    for wanted in expected.splitlines():
        if wanted.strip() == "...":
            skipping = True
            continue
        line = next(lines, None)
        while skipping and line is not None and not _alike(wanted, line):
            line = next(lines, None)
        if line is None or not _alike(wanted, line):
            return f"expected {wanted!r}, got {line!r}"
        skipping = False
    rest = [] if skipping else list(lines)
    return f"not expected: {rest[0]!r}" if rest else ""


def _alike(wanted: str, line: str) -> bool:
    # the last digit of what was not measured decides whether it is as stated
    wanted, line = (re.sub(r"\(stated [^)]*\)", "(as stated)", text) for text in (wanted, line))
    if [" ".join(part.split()) for part in _NUMBER.split(wanted)] != [
        " ".join(part.split()) for part in _NUMBER.split(line)
    ]:
        return False
    for (a, u), (b, v) in zip(_PAIR.findall(wanted), _PAIR.findall(line), strict=True):
        if abs(_number(a) - _number(b)) > _PART_OF_U * _number(u) or abs(
            _number(u) - _number(v)
        ) > _SHARE * _number(u):
            return False
    others = (_NUMBER.findall(_PAIR.sub("", text)) for text in (wanted, line))
    return all(_close(a, b) for a, b in zip(*others, strict=True))


def _close(a: str, b: str) -> bool:
    last = 10.0 ** -len(a.partition(".")[2]) if "." in a else 0.0
    return abs(_number(a) - _number(b)) <= max(last, _SHARE * abs(_number(a)))


def _number(text: str) -> float:
    return float(text.replace("−", "-"))


def blocks(text: str, language: str) -> list[str]:
    """The fenced blocks of one language in a Markdown text."""
    return [block for kind, _, block in _BLOCK.findall(text) if kind == language]
