"""The `[plan]` table of a campaign file: what might be measured next."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from estim.campaign.key_table import KeyTable
from estim.campaign.prior_table import Stated
from estim.reading import Places

_Factor = Annotated[float, Meta(ge=0.01, le=100.0)]


class PlannedRunTable(KeyTable, frozen=True, kw_only=True):
    """A further run, like one that was measured except for what is stated here."""

    like: str
    phi_deg: Stated = None
    theta0_deg: Stated = None
    gamma: Stated = None
    repeats: Annotated[int, Meta(ge=1, le=100)] = 1


class ReadingsTable(KeyTable, frozen=True, kw_only=True):
    """Further readings at one abscissa of a user's own curve."""

    x: Annotated[float, Meta(ge=-1e100, le=1e100)]
    n: Annotated[int, Meta(ge=1, le=10_000)] = 1
    run: str | None = None


class ChangeTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    """The same runs measured otherwise."""

    name: str | None = None
    u: dict[str, Annotated[float, Meta(gt=0.0, le=1e100)]] = {}
    frames: _Factor = 1.0
    reading_error: _Factor = 1.0
    reach: Annotated[float, Meta(ge=1.0, le=100.0)] = 1.0


class PlanTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True, rename={"wanted": "for"}):
    wanted: list[str] = []
    built_in: bool = True
    runs: list[PlannedRunTable] = []
    readings: list[ReadingsTable] = []
    change: list[ChangeTable] = []


def check_plan(
    plan: PlanTable, names: tuple[str, ...], places: Places, *, own_curve: bool = False
) -> None:
    """Raises InputError where a plan names what is not there, or asks for what cannot be
    counted.
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
    named = [(("plan", "runs", i, "like"), run.like) for i, run in enumerate(plan.runs)]
    named += [
        (("plan", "readings", i, "run"), readings.run)
        for i, readings in enumerate(plan.readings)
        if readings.run is not None
    ]
    for path, name in named:
        if name not in names:
            raise places.error(f"must name one of the runs ({', '.join(names)})", path, value=name)
    for i, change in enumerate(plan.change):
        if own_curve and change.reach != 1.0:
            raise places.error(
                "is for rolling bodies; for a curve of your own use [[plan.readings]]",
                ("plan", "change", i, "reach"),
            )
        if not change.u and change.frames == change.reading_error == change.reach == 1.0:
            raise places.error(
                "changes nothing: say u, frames, reading_error or reach",
                ("plan", "change", i),
                field="change",
            )
