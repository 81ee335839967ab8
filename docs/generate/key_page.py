"""docs/reference/campaign-keys.md: every key of a campaign file, from the tables that read it."""

from __future__ import annotations

import json
import types
from dataclasses import replace
from typing import Any, Literal, Union, get_args, get_origin

from tables import PRIOR, Key, Kind, all_tables, is_table, keys_of

_HEADS = {
    "_TopTable": "The file",
    "LevelTable": "Every level: `[shared]`, `[bodies.NAME]`, `[[runs]]`",
    "RunTable": "`[[runs]]` of rolling bodies",
    "NoiseTable": "`noise` of rolling bodies",
    "WindowTable": "`window` of rolling bodies",
    **dict.fromkeys(
        ("DiskTable", "RingTable", "RodTable", "PointTable", "BoltTable", "TrailingTable"),
        "`[parts.NAME]`",
    ),
    "LineTable": "`[line]`",
    "TrialsTable": "`[trials]`",
    "DerivedTable": "`[derived]`",
    "PlanTable": "`[plan]`",
    "PlannedRunTable": "`[[plan.runs]]`",
    "ReadingsTable": "`[[plan.readings]]`",
    "ChangeTable": "`[[plan.change]]`",
    "CurveTable": "`[curve]`",
    "AxisTable": "`x` and `y` of `[curve]`",
    "ParameterTable": "A parameter of a curve",
    "ReadingErrorTable": "`u_y` and `u_x`",
    "RangeTable": "`window` of a curve",
    "ComponentTable": "`errors` of a curve",
    **dict.fromkeys(("PoissonTable", "BinomialTable", "EventsTable"), "`noise` of a curve"),
    "CurveRunTable": "`[[runs]]` of a curve",
    "PriorTable": "A prior",
}
_SHARED_HEADS = {
    "EffectTable": "What else is known of a rolling body",
    "PriorKeys": "A prior",
    "DialectKeys": "How a table is written",
    "CurveKeys": "`[curve]` and its `[[runs]]`",
    "PartTable": "`[parts.NAME]`",
    "OnBodyTable": "`[parts.NAME]`",
    "CountTable": "`noise` of a curve",
}
_NAMES = {float: "number", int: "whole number", str: "text", bool: "`true` or `false`"}
_INTRODUCTION = """# Every key of a campaign file

Made by `make docs` from the tables that read the file. What the keys mean and when to use them: [the campaign file](../campaign.md),
[your own curve](../your-own-curve.md), [planning](../planning.md).

*Quantity*: `9.81` is exact, `"4.0(4)"` or `"4.0 +/- 0.4"` was measured, `{prior = ...}` is [a prior](#a-prior). **Bold**: must be there.

Editors with a TOML extension (Even Better TOML, Taplo) complete and check these keys where the first line of the campaign names the
[schema](estim-campaign-1.schema.json), as a path from the campaign's folder or a URL:

    #:schema ../docs/reference/estim-campaign-1.schema.json
"""


def keys_page() -> str:
    """The page in Markdown."""
    sections: dict[str, list[Key]] = {}
    further: dict[str, list[str]] = {}
    for table in all_tables():
        for key in keys_of(table):
            of_others = key.owner != table.__name__ and key.owner in _SHARED_HEADS
            title = _SHARED_HEADS[key.owner] if of_others else head_of(table)
            held = sections.setdefault(title, [])
            if key.owner != table.__name__ and title_of_owner(key) not in (
                head_of(table),
                *further.setdefault(head_of(table), []),
            ):
                further[head_of(table)].append(title_of_owner(key))
            names = [other.name for other in held]
            if key.name not in names and (
                of_others or key.owner == table.__name__ or table is PRIOR
            ):
                held.append(key)
            elif key.name in names and get_origin(key.holds) is Literal:  # of another kind
                place = names.index(key.name)
                words = (*get_args(held[place].holds), *get_args(key.holds))
                held[place] = replace(held[place], holds=Literal[words])
    return _INTRODUCTION + "".join(
        _section(title, keys, further.get(title, [])) for title, keys in sections.items() if keys
    )


def title_of_owner(key: Key) -> str:
    """The section of the table that declares a key."""
    return _SHARED_HEADS.get(key.owner, _HEADS.get(key.owner, f"`{key.owner}`"))


def head_of(table: Kind) -> str:
    return _HEADS.get(table.__name__, f"`{table.__name__}`")


def _section(title: str, keys: list[Key], further: list[str]) -> str:
    rows = [
        f"| {_name(key)} | {_holds(key.holds)}{_default(key)} | {_cell(key.words)} |"
        for key in keys
    ]
    more = (
        f"\nAnd the keys of {', '.join(f'[{head}](#{_anchor(head)})' for head in further)}.\n"
        if further
        else ""
    )
    return f"\n## {title}\n\n| key | may hold | |\n|---|---|---|\n" + "\n".join(rows) + "\n" + more


def _name(key: Key) -> str:
    return f"**`{key.name}`**" if key.needed else f"`{key.name}`"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _default(key: Key) -> str:
    if key.needed or key.default in (None, {}, [], ""):
        return ""
    return f"; if not stated `{json.dumps(key.default)}`".replace(".0`", "`")


def _holds(holds: Any) -> str:
    """What a key may hold, in words."""
    origin, inner = get_origin(holds), get_args(holds)
    if origin in (Union, types.UnionType):
        kinds = [kind for kind in inner if kind is not type(None)]
        if (
            len({head_of(kind) for kind in kinds if is_table(kind)})
            == 1
            < sum(map(is_table, kinds))
        ):
            return _holds(kinds[0])  # tables of several kinds, told apart in one section
        if {float, str, PRIOR} <= set(kinds):
            return "quantity"
        return " or ".join(_holds(kind) for kind in kinds)
    if origin is Literal:
        return ", ".join(f'`"{choice}"`' for choice in inner)
    if origin in (list, tuple):
        if get_origin(inner[0]) in (Union, types.UnionType):
            return "list of these"
        return (
            f"list of {_plural(inner[0])}"
            if not is_table(inner[0])
            else f"[tables](#{_anchor(head_of(inner[0]))})"
        )
    if origin is dict:
        tables = [kind for kind in (inner[1], *get_args(inner[1])[:1]) if is_table(kind)]
        return (
            f"[tables](#{_anchor(head_of(tables[0]))})" if tables else f"names = {_holds(inner[1])}"
        )
    if is_table(holds):
        return f"[table](#{_anchor(head_of(holds))})"
    return _NAMES[holds]


def _plural(kind: Any) -> str:
    return {str: "texts", float: "numbers"}[kind]


def _anchor(head: str) -> str:
    """The anchor that Markdown viewers make of a heading."""
    return "".join(c for c in head.lower().replace(" ", "-") if c.isalnum() or c in "-_")
