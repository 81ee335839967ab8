"""The tables of a campaign file as the code has them: their keys, what each may hold, and what
`key_words.toml` says of it.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_type_hints

import msgspec

from estim.campaign import campaign_file, curve_keys, prior_table

WORDS = tomllib.loads((Path(__file__).parent / "key_words.toml").read_text(encoding="utf-8"))
Kind = type[msgspec.Struct]


@dataclass(frozen=True)
class Key:
    """owner : the table of the code that declares it.  holds : its type.  default : None where it
    may be left out, `NODEFAULT` where it is needed.
    """

    name: str
    owner: str
    holds: Any
    default: Any

    @property
    def needed(self) -> bool:
        return self.default is msgspec.NODEFAULT

    @property
    def words(self) -> str:
        """What it says; "" where `key_words.toml` has nothing."""
        return str(WORDS.get(self.owner, {}).get(self.name, ""))


CAMPAIGN = campaign_file._TopTable
LEVEL, RUN = campaign_file.LevelTable, campaign_file.RunTable
PRIOR = prior_table.PriorTable
CURVE_RUN = curve_keys.CurveRunTable
ROLLING_ONLY = ("published", "shared", "parts", "bodies", "line", "trials")


def keys_of(table: Kind) -> tuple[Key, ...]:
    """The keys of a table in their order; those of the table itself before inherited ones."""
    hints = get_type_hints(table)
    owners = {
        name: kind.__name__
        for kind in reversed(table.__mro__)
        for name in getattr(kind, "__annotations__", {})
    }
    found = []
    config = table.__struct_config__
    if config.tag_field is not None:  # what says of which kind a table is
        owner = next(kind for kind in reversed(table.__mro__) if _tag_field(kind))
        holds = Literal[config.tag]  # type: ignore[valid-type]
        found.append(Key(config.tag_field, owner.__name__, holds, msgspec.NODEFAULT))
    for field in msgspec.structs.fields(table):
        default = (
            field.default_factory()
            if field.default_factory is not msgspec.NODEFAULT
            else field.default
        )
        default = None if is_table(type(default)) else default
        # they are checked beside the file, as runs of bodies or of a curve
        holds = list[RUN] if (table, field.name) == (CAMPAIGN, "runs") else hints[field.name]
        found.append(Key(field.encode_name, owners[field.name], holds, default))
    tag = config.tag_field
    return tuple(sorted(found, key=lambda key: (key.name != tag, key.owner != table.__name__)))


def all_tables() -> tuple[Kind, ...]:
    """Every table that a campaign may hold, each once, the file itself first."""
    seen: list[Kind] = []

    def visit(holds: Any) -> None:
        if is_table(holds) and holds not in seen:
            seen.append(holds)
            for key in keys_of(holds):
                visit(key.holds)
        for inner in getattr(holds, "__args__", ()):
            visit(inner)

    visit(CAMPAIGN)
    visit(CURVE_RUN)
    return tuple(seen)


def _tag_field(kind: type) -> str | None:
    return kind.__struct_config__.tag_field if is_table(kind) else None


def is_table(holds: Any) -> bool:
    return isinstance(holds, type) and issubclass(holds, msgspec.Struct)


def without_words() -> list[str]:
    """Keys that `key_words.toml` does not explain, and entries there that no table has."""
    found = {(key.owner, key.name): key for table in all_tables() for key in keys_of(table)}
    missing = [f"[{owner}] {name}" for (owner, name), key in found.items() if not key.words]
    return missing + [
        f"[{owner}] {name}, which no table has"
        for owner, said in WORDS.items()
        for name in said
        if (owner, name) not in found
    ]
