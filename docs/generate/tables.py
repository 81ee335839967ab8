"""The tables of a campaign file as the code has them: their keys, what each may hold, and what
`key_words.toml` says of it.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_type_hints

import msgspec

from estim.campaign import campaign_file, curve_tables, part_table, plan_table, trial_table
from estim.campaign.derived import DerivedTable

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
PRIOR = campaign_file.PriorTable
CURVE, CURVE_RUN = curve_tables.CurveTable, curve_tables.CurveRunTable
# what the raw tables of the top hold: they are checked one by one, so that a message names the line
INSIDE: dict[str, Any] = {
    "shared": LEVEL,
    "bodies": dict[str, LEVEL],
    "parts": dict[str, part_table.PartTable],
    "runs": list[RUN],
    "line": campaign_file.LineTable,  # type: ignore[valid-type]
    "trials": trial_table.TrialsTable,
    "curve": CURVE,
    "derived": dict[str, str | DerivedTable],
    "plan": plan_table.PlanTable,
}
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
    for field in msgspec.structs.fields(table):
        default = (
            field.default_factory()
            if field.default_factory is not msgspec.NODEFAULT
            else field.default
        )
        holds = (
            INSIDE.get(field.name, hints[field.name]) if table is CAMPAIGN else hints[field.name]
        )
        found.append(Key(field.encode_name, owners[field.name], holds, default))
    return tuple(sorted(found, key=lambda key: key.owner != table.__name__))


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
