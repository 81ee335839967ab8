"""The keys of a user's own curve in a campaign file, and what each may hold.

`docs/your-own-curve.md` explains them to users; `estim.campaign.curve_tables` checks what goes
together.
"""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from estim.campaign.dialect_table import DialectKeys
from estim.campaign.key_table import KeyTable
from estim.campaign.prior_table import PriorKeys, PriorTable
from estim.reading import Unit


class AxisTable(KeyTable, frozen=True):
    column: str
    name: str | None = None
    unit: str = "1"


class ParameterTable(PriorKeys, frozen=True, kw_only=True):
    """`start` with limits, a `value`, or a `prior` with its keys."""

    start: float | None = None
    value: float | str | None = None
    unit: str | None = None
    meaning: str | None = None


class ReadingErrorTable(PriorKeys, frozen=True, kw_only=True):
    """A standard deviation of y: a column of the runs' files, two where it is another above than
    below, or a prior (then it is inferred).
    """

    column: str | None = None
    minus: str | None = None
    plus: str | None = None


class RangeTable(KeyTable, frozen=True):
    min: float | None = None
    max: float | None = None


class ComponentTable(KeyTable, frozen=True):
    kind: Literal["zero_y", "scale_y", "zero_x", "scale_x"]
    u: float
    groups: str | None = None


class CountTable(KeyTable, frozen=True, tag_field="model", kw_only=True):
    """How y was counted, or that x are times of single events.

    noise = {model = "poisson", bins = ["low_us", "high_us"]}      # or a width; without it
    counts belong to single x
    noise = {model = "binomial", trials = "shots"}                 # or a number
    noise = {model = "event-times"}                                # x are times of single
    events within `window`; no y
    """


class PoissonTable(CountTable, frozen=True, tag="poisson"):
    bins: float | tuple[str, str] | None = None


class BinomialTable(CountTable, frozen=True, tag="binomial"):
    trials: Annotated[float | str, Meta(description="how many at each x: a number or a column")]


class EventsTable(CountTable, frozen=True, tag="event-times"):
    cells: int | None = None


class CurveKeys(DialectKeys, frozen=True, kw_only=True):
    """What may stand under [curve] and at a run, which has the last word."""

    u_y: float | str | ReadingErrorTable | None = None
    u_x: float | str | ReadingErrorTable | None = None
    robust: str | None = None
    jitter: bool | str | PriorTable | None = None
    deviation: float | None = None
    correlated: bool | str | None = None
    window: RangeTable | None = None
    every: Annotated[int, Meta(ge=1, description="3: every third point")] | None = None
    parameters: dict[str, float | str | ParameterTable] = msgspec.field(default_factory=dict)


class CurveTable(CurveKeys, frozen=True, kw_only=True):
    x: AxisTable | str | Annotated[list[AxisTable | str], Meta(min_length=2)]
    expression: str | None = None
    model: str | None = None
    y: AxisTable | str | None = None
    noise: PoissonTable | BinomialTable | EventsTable | None = None
    errors: dict[str, float | ComponentTable] = msgspec.field(default_factory=dict)


class CurveRunTable(CurveKeys, frozen=True, kw_only=True):
    name: str
    file: str
    track: str | None = None
    along: str | float | None = None
    unit: Unit | None = None
    release: Literal["first", "keep"] | float | None = None
    frame_ms: float | None = None
    drop_duplicates: bool | None = None
