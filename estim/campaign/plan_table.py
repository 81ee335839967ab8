"""The `[plan]` table of a campaign file: what might be measured next."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from estim.campaign.prior_table import Value
from estim.reading import KeyPath, Places

_MOST_REPEATS, _MOST_READINGS = 100, 10_000


class PlannedRunTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """A further run, like one that was measured but for what is said here."""

    like: str
    phi_deg: Value | None = None
    theta0_deg: Value | None = None
    gamma: Value | None = None
    repeats: int = 1


class ReadingsTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """Further readings at one abscissa of a user's own curve."""

    x: float
    n: int = 1
    run: str | None = None


class ChangeTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The same runs measured otherwise."""

    name: str | None = None
    u: dict[str, float] = {}
    frames: float = 1.0
    reading_error: float = 1.0
    reach: float = 1.0


class PlanTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True, rename={"wanted": "for"}):
    wanted: list[str] = []
    built_in: bool = True
    runs: list[PlannedRunTable] = []
    readings: list[ReadingsTable] = []
    change: list[ChangeTable] = []


NO_PLAN = PlanTable()


def check_plan(
    plan: PlanTable, names: tuple[str, ...], places: Places, *, own_curve: bool = False
) -> PlanTable:
    """The plan itself.  Raises InputError where a plan names what is not there, or asks for what
    cannot be counted.
    """
    if own_curve and plan.runs:
        raise places.error(
            "is for a rolling body (use [[plan.readings]])",
            ("plan", "runs", 0, "like"),
            field="plan.runs",
        )
    if plan.readings and not own_curve:
        raise places.error(
            "is for a curve of your own (use [[plan.runs]])",
            ("plan", "readings", 0, "x"),
            field="plan.readings",
        )
    for i, run in enumerate(plan.runs):
        if run.like not in names:
            raise places.error(
                f"must name one of the runs ({', '.join(names)})",
                ("plan", "runs", i, "like"),
                value=run.like,
            )
        _whole(run.repeats, _MOST_REPEATS, places, ("plan", "runs", i, "repeats"))
    for i, readings in enumerate(plan.readings):
        if readings.run is not None and readings.run not in names:
            raise places.error(
                f"must name one of the runs ({', '.join(names)})",
                ("plan", "readings", i, "run"),
                value=readings.run,
            )
        if not math.isfinite(readings.x):
            raise places.error("must be finite", ("plan", "readings", i, "x"), value=readings.x)
        _whole(readings.n, _MOST_READINGS, places, ("plan", "readings", i, "n"))
    for i, change in enumerate(plan.change):
        _check_change(change, i, places, own_curve=own_curve)
    return plan


def _check_change(change: ChangeTable, i: int, places: Places, *, own_curve: bool) -> None:
    factors: Mapping[str, float] = {
        key: getattr(change, key) for key in ("frames", "reading_error", "reach")
    }
    low, high = 0.01, 100.0
    for key, factor in factors.items():
        if not low <= factor <= high:
            raise places.error(
                f"is a factor: it must lie between {low:g} and {high:g}",
                ("plan", "change", i, key),
                value=factor,
            )
    if own_curve and change.reach != 1.0:
        raise places.error(
            "is for rolling bodies; for a curve of your own use [[plan.readings]]",
            ("plan", "change", i, "reach"),
        )
    if change.reach < 1.0:
        raise places.error(
            "is how many times farther a run goes: it must be at least 1",
            ("plan", "change", i, "reach"),
            value=change.reach,
        )
    for key, u in change.u.items():
        if not (u > 0.0 and math.isfinite(u)):
            raise places.error(
                "must be an uncertainty > 0", ("plan", "change", i, "u", key), value=u
            )
    if not change.u and all(factor == 1.0 for factor in factors.values()):
        raise places.error(
            "changes nothing: say u, frames, reading_error or reach",
            ("plan", "change", i),
            field="change",
        )


def _whole(count: int, most: int, places: Places, path: KeyPath) -> None:
    if not 1 <= count <= most:
        raise places.error(f"must be a whole number from 1 to {most}", path, value=count)
