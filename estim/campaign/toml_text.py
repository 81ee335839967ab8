"""Values, text and names as TOML writes them, whatever they hold."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping


def toml_string(text: str) -> str:
    """A text in quotes: printable marks as they are, all others as escapes."""
    return "".join(
        mark if mark.isprintable() else f"\\U{ord(mark):08x}"
        for mark in json.dumps(text, ensure_ascii=False)
    )


def toml_key(name: str) -> str:
    """A name as the key of a table."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_string(name)


def toml_value(value: object) -> str:
    """A number, a text, true or false, a list, or a table in one line."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(toml_lines(value))}}}"
    if isinstance(value, tuple):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return toml_string(value) if isinstance(value, str) else repr(value)


def toml_lines(table: Mapping[str, object]) -> list[str]:
    """The keys of a table, but for those whose value is None."""
    return [
        f"{toml_key(key)} = {toml_value(value)}"
        for key, value in table.items()
        if value is not None
    ]


def toml_text(top: Mapping[str, object], tables: Iterable[tuple[str, Mapping[str, object]]]) -> str:
    """A whole text: the keys above all tables, then each table below its header."""
    lines = toml_lines(top)
    for header, table in tables:
        lines += ["", header, *toml_lines(table)]
    return "\n".join(lines) + "\n"
