"""TOML text: its tree, and the line on which each key stands, for messages."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from unicodedata import normalize

from estim.errors import InputError

_MAX_LINE = 2000
_MAX_DEPTH = 20


@dataclass(frozen=True, eq=False)
class Places:
    """Where each key of a TOML text stands: path of keys -> line."""

    file: str
    lines: Mapping[tuple[str | int, ...], int]

    def error(self, rule: str, path: Sequence[str | int], *, field: str | None = None, value: object = None) -> InputError:
        """An InputError at the line of `path`, or of the closest table above it."""
        key = tuple(path)
        while key and key not in self.lines:
            key = key[:-1]
        name = field if field is not None else next((part for part in reversed(path) if isinstance(part, str)), None)
        return InputError(rule, field=name, value=value, file=self.file, line=self.lines.get(key))


def parse_toml(text: str, file: str) -> dict[str, Any]:
    """The tree of a TOML text; a syntax error becomes an InputError with its line.

    Lines and depth are limited: the standard parser takes memory as the square of the length of a dotted key.
    """
    for number, line in enumerate(text.splitlines(), start=1):
        if len(line) > _MAX_LINE:
            raise InputError(f"must have at most {_MAX_LINE} characters", field="line", value=len(line), file=file, line=number)
    try:
        tree = tomllib.loads(text)
        if _depth(tree) > _MAX_DEPTH:
            raise RecursionError
        return tree
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"\(at line (\d+), column \d+\)", str(error))
        message = re.sub(r"\s*\(at .*\)$", "", str(error))
        raise InputError(f"is not valid TOML: {message}", file=file, field="campaign", line=int(found[1]) if found else None) from None
    except ValueError as error:  # a whole number of thousands of digits
        raise InputError(f"is not valid TOML: {error}", file=file, field="campaign") from None
    except RecursionError:
        raise InputError("is nested too deeply", file=file, field="campaign") from None


def _depth(tree: object) -> int:
    """How deep tables and arrays are nested, counted level by level."""
    level, depth = [tree], 0
    while level and depth <= _MAX_DEPTH:
        inner = (value.values() if isinstance(value, dict) else value for value in level if isinstance(value, dict | list))
        level, depth = [value for values in inner for value in values], depth + 1
    return depth


def locate_keys(text: str) -> dict[tuple[str | int, ...], int]:
    """Line of each table and each `key = value` of a TOML text, by path; keys inside inline tables are not listed."""
    lines: dict[tuple[str | int, ...], int] = {}
    table: tuple[str | int, ...] = ()
    counts: dict[str, int] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        stripped = line.strip()
        if found := re.match(r"\[\[\s*([^\]]+?)\s*\]\]", stripped):
            counts[found[1]] = counts.get(found[1], -1) + 1
            table = (*_keys(found[1]), counts[found[1]])
            lines[table] = number
        elif found := re.match(r"\[\s*([^\]]+?)\s*\]", stripped):
            table = _keys(found[1])
            if table and table[0] in counts:
                table = (table[0], counts[str(table[0])], *table[1:])
            lines[table] = number
        elif found := re.match(r"([\w.\"' -]+?)\s*=", stripped):
            keys = _keys(found[1])
            for depth in range(1, len(keys) + 1):
                lines.setdefault((*table, *keys[:depth]), number)
    as_read = {tuple(normalize("NFKC", part) if isinstance(part, str) else part for part in path): number for path, number in lines.items()}
    return as_read | lines  # names in formulas are looked up as Python reads them


def _keys(dotted: str) -> tuple[str | int, ...]:
    return tuple(part.strip(" \"'") for part in re.findall(r"\"[^\"]*\"|'[^']*'|[^.]+", dotted))
