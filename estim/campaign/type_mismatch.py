"""What msgspec reports of a value of a wrong type, in words for people: what may stand there, and
what was likely meant.
"""

from __future__ import annotations

import difflib
import math
import re
import types
from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import msgspec

_TYPES = {
    "float": "a number",
    "int": "a whole number",
    "str": "text",
    "bool": "true or false",
    "object": "a table",
    "array": "a list",
    "list": "a list",
    "dict": "a table",
    "datetime": "a date",
    "date": "a date",
    "time": "a time",
}


def mismatch(message: str, kind: object, path: Sequence[str], value: object) -> tuple[str, object]:
    """A mismatch as a rule, any other message of msgspec as it is; and the `value`, where more
    than its type is wrong.  kind : the type that was expected.  path : where in it.
    """
    if match := re.fullmatch(r"Expected `(.+)`, got `(\w+)`", message):
        expected = [_TYPES.get(kind, kind) for kind in match[1].split(" | ") if kind != "null"]
        return f"must be {' or '.join(expected)}, not {_TYPES.get(match[2], match[2])}", None
    if isinstance(value, float) and not math.isfinite(value):
        return "must be finite", value
    if match := re.fullmatch(r"Expected `\w+` ([<>]=?) (.+)", message):
        broken, limits = f"{match[1]} {match[2].removesuffix('.0')}", _limits(kind, path)
        limit = " and ".join(limits) if broken in limits else broken
        return f"must be {limit}{hint(kind, path)}", value
    if match := re.fullmatch(r"Expected `array` of length (\d+), got (\d+)", message):
        return f"must be a list of {match[1]}, not of {match[2]}", None
    choices = list(dict.fromkeys(_choices(kind, path)))
    if message.startswith("Invalid ") and choices:
        return f"must be one of {', '.join(choices)}{suggestion(str(value), choices)}", value
    return message[0].lower() + message[1:].replace("`", ""), None


def hint(kind: object, path: Sequence[str]) -> str:
    """' (a number or a column)', what the type at `path` states as its description; "" where it has
    none.
    """
    return "".join(f" ({meta.description})" for meta in _metas(kind, path) if meta.description)


def _limits(kind: object, path: Sequence[str]) -> list[str]:
    """All that are for people, not for computers, of the number at `path`: '> 0', '<= 1'."""
    marks = {"gt": ">", "ge": ">=", "lt": "<", "le": "<="}
    return [
        f"{mark} {limit:.15g}"
        for meta in _metas(kind, path)
        for key, mark in marks.items()
        if (limit := getattr(meta, key)) is not None and abs(limit) < 1e100
    ]


def _metas(kind: object, path: Sequence[str]) -> Iterator[msgspec.Meta]:
    for variant in _at(kind, path):
        yield from getattr(variant, "__metadata__", ())


def suggestion(written: str, choices: Sequence[str]) -> str:
    """' (did you mean 'gamma'?)', or "" where nothing is like it."""
    close = difflib.get_close_matches(written, choices, n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""


def located(tree: Any, kind: object, path: Sequence[str]) -> tuple[tuple[str | int, ...], object]:
    """A path of msgspec with the keys of mappings, in whose place it says "..." (each is the first
    whose value is none of what may stand there); and what stands at it.
    """
    steps: list[str | int] = []
    for i, part in enumerate(path):
        step: str | int = int(part) if isinstance(tree, list) else part
        if part == "...":
            inside: Any = Union[tuple(_at(kind, path[: i + 1]))]  # noqa: UP007
            step = next(key for key, value in tree.items() if not _fits(value, inside))
        steps.append(step)
        tree = tree[step]
    return tuple(steps), tree


def _fits(value: object, kind: Any) -> bool:
    try:
        msgspec.convert(value, kind)
    except msgspec.ValidationError:
        return False
    return True


def of_table(kind: object, path: Sequence[str], value: Any) -> tuple[str, list[str]]:
    """What marks the table `value` at `path` in one of type `kind`, like ' (kind = "ring")', ""
    where nothing does; and the keys that may stand in it.
    """
    mark, keys = "", list[str]()
    for table in _structs(kind, path):
        config = table.__struct_config__
        if config.tag_field is not None:
            if value.get(config.tag_field) != config.tag:
                continue
            mark = f' ({config.tag_field} = "{config.tag}")'
        keys += table.__struct_fields__
    return mark, keys


def _structs(kind: object, path: Sequence[str]) -> list[type[msgspec.Struct]]:
    return [
        variant
        for variant in _at(kind, path)
        if isinstance(variant, type) and issubclass(variant, msgspec.Struct)
    ]


def _choices(kind: object, path: Sequence[str]) -> Iterator[str]:
    """The words that may stand at `path` in a value of type `kind`."""
    for variant in _at(kind, path):
        yield from (
            choice
            for choice in get_args(variant)
            if get_origin(variant) is Literal and isinstance(choice, str)
        )
    for table in _structs(kind, path[:-1]):
        config = table.__struct_config__
        yield from (str(config.tag),) if path and config.tag_field == path[-1] else ()


def _at(kind: object, path: Sequence[str]) -> Iterator[object]:
    """The types that may stand at `path` in a value of type `kind`."""
    origin, inside = get_origin(kind), get_args(kind)
    if origin is Annotated and path:
        yield from _at(inside[0], path)
    elif origin in (Union, types.UnionType):
        for variant in inside:
            yield from _at(variant, path)
    elif origin in (list, tuple):
        for variant in inside:
            yield from _at(variant, path[1:] if path and path[0].isdigit() else path)
    elif origin is dict:
        yield from _at(inside[1], path[1:]) if path else ()
    elif not path:
        yield kind
    elif isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        hints: dict[str, Any] = get_type_hints(kind, include_extras=True)
        yield from _at(hints[path[0]], path[1:]) if path[0] in hints else ()
