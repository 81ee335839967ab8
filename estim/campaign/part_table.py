"""One piece of a body as a TOML table, `[parts.NAME]`, and which keys go with which kind of
piece.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Literal

import msgspec

PartKind = Literal["disk", "ring", "rod", "bolt", "point", "trailing"]
Written = float | str


class PartTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """A piece that was weighed and measured; `estim.model.parts` says what each kind is."""

    kind: PartKind
    mass_kg: Written
    radius_m: Written | None = None
    inner_radius_m: Written | None = None
    length_m: Written | None = None
    diameter_m: Written | None = None
    distance_m: Written | None = None
    angle_deg: Written | None = None

    @property
    def stated(self) -> tuple[str, ...]:
        """The keys that hold a number."""
        return tuple(key for key in PART_UNITS if getattr(self, key) is not None)


PART_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "mass_kg": "kg",
        "radius_m": "m",
        "inner_radius_m": "m",
        "length_m": "m",
        "diameter_m": "m",
        "distance_m": "m",
        "angle_deg": "°",
    }
)
NEEDED: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        kind: frozenset(keys)
        for kind, keys in {
            "disk": (),
            "ring": ("inner_radius_m",),
            "rod": ("length_m",),
            "bolt": ("distance_m",),
            "point": ("distance_m",),
            "trailing": (),
        }.items()
    }
)
POSSIBLE: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        kind: frozenset({"mass_kg", *keys})
        for kind, keys in {
            "disk": ("radius_m", "distance_m", "angle_deg"),
            "ring": ("radius_m", "inner_radius_m", "distance_m", "angle_deg"),
            "rod": ("length_m", "diameter_m", "distance_m", "angle_deg"),
            "bolt": ("diameter_m", "distance_m", "angle_deg"),
            "point": ("distance_m", "angle_deg"),
            "trailing": (),
        }.items()
    }
)
