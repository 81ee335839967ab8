"""JSON Schema of a campaign file, for editors: draft 7, which the TOML extensions of editors
read.
"""

from __future__ import annotations

import json
import types
from typing import Any, Literal, Union, get_args, get_origin

from tables import CAMPAIGN, CURVE_RUN, ROLLING_ONLY, RUN, Key, all_tables, is_table, keys_of

_NAMES = {float: "number", int: "integer", str: "string", bool: "boolean"}
_TITLE = "Campaign file of estim"


def campaign_schema() -> str:
    """The schema as JSON.  What a run holds depends on whether there is a `curve`: said by `if`, so
    that an editor marks the slip alone.
    """
    top = keys_of(CAMPAIGN)
    found = _object(top)
    rolling, own = (
        {key.name: _property(key) for key in keys_of(table)} for table in (RUN, CURVE_RUN)
    )
    either = {
        name: held
        for name, held in (own | rolling).items()
        if rolling.get(name, held) == own.get(name, held)
    }
    # for completion
    found["properties"]["runs"] |= {
        "items": {"type": "object", "properties": either, "required": ["name", "file"]}
    }
    of_curve = {
        "runs": {"type": "array", "minItems": 1, "items": _schema_of(CURVE_RUN)}
    } | dict.fromkeys(ROLLING_ONLY, False)
    schema = {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": _TITLE,
        **found,
        "if": {"required": ["curve"]},
        "then": {"properties": of_curve, "required": ["runs"]},
        "else": {"properties": {"runs": {"items": _schema_of(RUN)}}},
        "definitions": {
            table.__name__: _object(keys_of(table))
            for table in sorted(all_tables()[1:], key=lambda table: table.__name__)
        },
    }
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def _object(keys: Any) -> dict[str, Any]:
    needed = [key.name for key in keys if key.needed]
    found = {
        "type": "object",
        "additionalProperties": False,
        "properties": {key.name: _property(key) for key in keys},
    }
    return found | ({"required": needed} if needed else {})


def _property(key: Key) -> dict[str, Any]:
    said = {"description": key.words.replace("`", "")} if key.words else {}
    held = _schema_of(key.holds)
    # in draft 7 nothing beside a $ref is read
    return {"allOf": [held]} | said if "$ref" in held else held | said


def _schema_of(holds: Any) -> dict[str, Any]:
    origin, inner = get_origin(holds), get_args(holds)
    if origin in (Union, types.UnionType):
        parts = [_schema_of(part) for part in inner if part is not type(None)]
        return parts[0] if len(parts) == 1 else {"anyOf": sorted(parts, key=repr)}
    if origin is Literal:
        return {"enum": list(inner)}
    if origin is list:
        return {"type": "array", "items": _schema_of(inner[0])}
    if origin is tuple:
        size = {"minItems": len(inner), "maxItems": len(inner)}
        return {"type": "array", "items": _schema_of(inner[0])} | size
    if origin is dict:
        return {"type": "object", "additionalProperties": _schema_of(inner[1])}
    if is_table(holds):
        return {"$ref": f"#/definitions/{holds.__name__}"}
    return {"type": _NAMES[holds]}
