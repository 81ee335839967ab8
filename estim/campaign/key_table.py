"""What all tables are that people write in files."""

from __future__ import annotations

import msgspec


class KeyTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A table of a TOML file: its keys, and what each may hold; no other key may stand in it."""
