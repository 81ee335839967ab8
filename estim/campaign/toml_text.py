"""Text and names as TOML writes them, whatever they hold."""

from __future__ import annotations

import json
import re


def toml_string(text: str) -> str:
    """A text in quotes: printable marks as they are, all others as escapes."""
    return "".join(
        mark if mark.isprintable() else f"\\U{ord(mark):08x}"
        for mark in json.dumps(text, ensure_ascii=False)
    )


def toml_key(name: str) -> str:
    """A name as the key of a table."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_string(name)
