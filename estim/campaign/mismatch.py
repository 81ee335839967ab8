"""What msgspec says of a value of a wrong type, in words for people: what may stand there, and what
was likely meant.
"""

from __future__ import annotations

import ast
import difflib
import re
import types
from collections.abc import Iterator, Sequence
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

_TYPES = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "object": "a table",
    "array": "a list",
    "datetime": "a date",
    "date": "a date",
    "time": "a time",
}


def mismatch_words(message: str, kind: object, path: Sequence[str]) -> str:
    """A mismatch as a rule; any other message of msgspec as it is.  kind : the type that was asked
    for.  path : where in it, keys and numbers.
    """
    if match := re.fullmatch(r"Expected `(.+)`, got `(\w+)`", message):
        wanted = [_TYPES.get(kind, kind) for kind in match[1].split(" | ") if kind != "null"]
        return f"must be {' or '.join(wanted)}, not {_TYPES.get(match[2], match[2])}"
    if (word := wrong_word(message)) is not None:
        choices = list(dict.fromkeys(_choices(kind, path)))
        if choices:
            return f"must be one of {', '.join(choices)}{meant(word, choices)}"
    return message[0].lower() + message[1:].replace("`", "")


def wrong_word(message: str) -> str | None:
    """The word of which msgspec says that it is none of those that may stand there; it quotes it as
    Python does.
    """
    match = re.fullmatch(r"Invalid enum value ('.*'|\".*\")", message)
    return None if match is None else str(ast.literal_eval(match[1]))


def meant(written: str, choices: Sequence[str]) -> str:
    """' (did you mean 'gamma'?)', or "" where nothing is like it."""
    close = difflib.get_close_matches(written, choices, n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""


def known_keys(kind: object, path: Sequence[str]) -> list[str]:
    """The keys that may stand in the table at `path` in a value of type `kind`."""
    tables = (
        variant
        for variant in _at(kind, path)
        if isinstance(variant, type) and issubclass(variant, msgspec.Struct)
    )
    return [key for table in tables for key in table.__struct_fields__]


def _choices(kind: object, path: Sequence[str]) -> Iterator[str]:
    """The words that may stand at `path` in a value of type `kind`."""
    for variant in _at(kind, path):
        yield from (
            choice
            for choice in get_args(variant)
            if get_origin(variant) is Literal and isinstance(choice, str)
        )


def _at(kind: object, path: Sequence[str]) -> Iterator[object]:
    """The types that may stand at `path` in a value of type `kind`; the keys of a mapping are not
    in the path.
    """
    origin, inside = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        for variant in inside:
            yield from _at(variant, path)
    elif origin in (list, tuple):
        for variant in inside:
            yield from _at(variant, path[1:] if path and path[0].isdigit() else path)
    elif origin is dict:
        yield from _at(inside[1], path)
    elif not path:
        yield kind
    elif isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        hints: dict[str, Any] = get_type_hints(kind)
        yield from _at(hints[path[0]], path[1:]) if path[0] in hints else ()
