"""One part of a body as a TOML table, `[parts.NAME]`: what may be stated of each kind of part."""

from __future__ import annotations

from estim.campaign.key_table import KeyTable

Written = float | str


class PartTable(KeyTable, frozen=True, tag_field="kind", kw_only=True):
    """A part that was weighed and measured; `estim.model.parts` defines each kind."""

    mass_kg: Written


class TrailingTable(PartTable, frozen=True, tag="trailing"):
    pass


class OnBodyTable(PartTable, frozen=True, kw_only=True):
    distance_m: Written | None = None
    angle_deg: Written | None = None


class DiskTable(OnBodyTable, frozen=True, tag="disk", kw_only=True):
    radius_m: Written | None = None


class RingTable(DiskTable, frozen=True, tag="ring", kw_only=True):
    inner_radius_m: Written


class RodTable(OnBodyTable, frozen=True, tag="rod", kw_only=True):
    length_m: Written
    diameter_m: Written | None = None


class PointTable(PartTable, frozen=True, tag="point", kw_only=True):
    distance_m: Written
    angle_deg: Written | None = None


class BoltTable(PointTable, frozen=True, tag="bolt", kw_only=True):
    diameter_m: Written | None = None


AnyPart = DiskTable | RingTable | RodTable | BoltTable | PointTable | TrailingTable
