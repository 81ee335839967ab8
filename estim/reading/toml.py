"""TOML text: its tree, and the line on which each key stands, for messages."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any
from unicodedata import normalize

from estim.common import InputError, is_nested_deeper

KeyPath = tuple[str | int, ...]
"""Where something stands: keys of tables, and numbers in lists."""

_MAX_LINE = 2000
_MAX_DEPTH = 20
# no group with alternatives is repeated possessively, which is matched wrongly before Python 3.11.5
# (gh-106052), and none over several lines, where each turn takes memory
_TOKEN = re.compile(
    r"""
      \#[^\n]*+                                             # comment
    # strings of several lines, which no odd number of backslashes ends; one without end
    | "{3}.*?(?<!\\)(?:\\\\)*+"{3,5} | "{3}.*+
    | '{3}.*?'{3,5} | '{3}.*+
    | "[^"\\\n]*+(?:\\.[^"\\\n]*+)*" | '[^'\n]*+' | ["'][^\n]*+     # strings
    | [^\S\n]++ | [^\s"'\#=\[\]{},.]++ | .                # blanks, words, marks and ends of lines
    """,
    re.VERBOSE | re.DOTALL,
)


@dataclass(frozen=True, eq=False)
class Places:
    """Where each key of a TOML text stands: path of keys -> line."""

    file: str
    lines: Mapping[KeyPath, int]

    def error(
        self,
        rule: str,
        path: KeyPath,
        *,
        field: str | None = None,
        value: object = None,
        quoted: str = "",
    ) -> InputError:
        """An InputError at the line of `path`, or of the first key in it where it has no line
        itself, or of the closest table above it.
        """
        key = path
        if key and key not in self.lines:
            key = next((inside for inside in self.lines if inside[: len(key)] == key), key)
        while key and key not in self.lines:
            key = key[:-1]
        name = field or next((part for part in reversed(path) if isinstance(part, str)), None)
        line = self.lines.get(key)
        return InputError(rule, field=name, value=value, file=self.file, line=line, quoted=quoted)

    @contextmanager
    def at(self, path: KeyPath) -> Iterator[None]:
        """While what stands at `path` is read: an error has its line."""
        try:
            yield
        except InputError as error:
            raise self.error(error.rule, path, value=error.value, quoted=error.quoted) from None


def parse_toml(text: str, file: str) -> tuple[dict[str, Any], Places]:
    """The tree of a TOML text and the lines of its keys; a syntax error becomes an InputError with
    its line.

    Lines and depth are limited before anything else: the standard parser takes memory as the square
    of the length of a dotted key.
    """
    for number, line in enumerate(text.split("\n"), start=1):
        if len(line) > _MAX_LINE:
            raise InputError(
                f"must have at most {_MAX_LINE} characters",
                field="line",
                value=len(line),
                file=file,
                line=number,
            )
    try:
        tree = tomllib.loads(text)
        if is_nested_deeper(tree, _MAX_DEPTH):
            raise RecursionError
        return tree, Places(file, locate_keys(text))
    except tomllib.TOMLDecodeError as error:
        message, _, place = str(error).rpartition(" (at ")
        match = re.match(r"line (\d+), column \d+\)", place)
        at = int(match[1]) if match else None
        if file.lower().endswith((".csv", ".tsv", ".txt", ".dat")):
            rule = (
                "is a table, not a TOML file (estim new NAME --from FILE writes a campaign for it)"
            )
            raise InputError(rule, file=file, field="file", line=at) from None
        bare = message.startswith(("Invalid value", "Expected newline"))
        cure = ", in which text and values with an uncertainty stand in quotes" if bare else ""
        raise InputError(
            f"is not valid TOML{cure}",
            quoted=message,
            file=file,
            field="file",
            line=at,
            value=text.split("\n")[at - 1].strip() if at else None,
        ) from None
    except ValueError as error:  # a whole number of thousands of digits
        raise InputError("is not valid TOML", quoted=str(error), file=file, field="file") from None
    except RecursionError:
        raise InputError("is nested too deeply", file=file, field="file") from None


def locate_keys(text: str) -> dict[KeyPath, int]:
    """Line of each table and each `key = value` of a valid TOML text, by path; keys inside inline
    tables are not listed.

    The time grows in proportion to the text.
    """
    lines: dict[KeyPath, int] = {}
    table: KeyPath = ()
    # path of an array of tables -> index of its last one
    counts: dict[KeyPath, int] = {}
    for number, tokens in _statements(text):
        array, header = tokens[:2] == ["[", "["], tokens[0] == "["
        keys = [
            _key(token)
            for token in [token for token in tokens if token not in (".", "[", "]")][:_MAX_DEPTH]
        ]
        if not header:
            for depth in range(1, len(keys) + 1):
                lines.setdefault((*table, *keys[:depth]), number)
            continue
        table = ()
        for i, key in enumerate(keys):
            table = (*table, key)
            if array and i == len(keys) - 1:
                counts[table] = counts.get(table, -1) + 1
            if table in counts:
                table = (*table, counts[table])
        lines[table] = number
    as_read = {
        tuple(normalize("NFKC", part) if isinstance(part, str) else part for part in path): number
        for path, number in lines.items()
    }
    return as_read | lines  # names in formulas are looked up as Python reads them


def _statements(text: str) -> Iterator[tuple[int, list[str]]]:
    """Line and tokens of the head of every statement: a header of a table, or what stands before
    `=`.
    """
    number, first, depth, value = 1, 1, 0, False
    tokens: list[str] = []
    for match in _TOKEN.finditer(text):
        token = match[0]
        if token == "\n" and depth <= 0:
            if tokens:
                yield first, tokens
            tokens, depth, value = [], 0, False
        elif not (value or token.isspace() or token[0] in "#="):
            first = first if tokens else number
            tokens.append(token)
        value = value or token == "="
        depth += (token in ("[", "{")) - (token in ("]", "}"))
        number += token.count("\n")
    if tokens:
        yield first, tokens


def _key(token: str) -> str:
    """A bare or quoted key as TOML reads it; what is none, as it is written."""
    if token[0] == '"' and "\\" in token:
        try:
            return next(iter(tomllib.loads(f"{token} = 0")))
        except tomllib.TOMLDecodeError:
            return token
    return token[1:-1] if token[0] in "\"'" else token
