"""What a campaign file says about one run, found by the rule of levels.

A thing is looked up at the run, then at its body, then under [shared].  The level where it stands
is the level at which it is one unknown, and the suffix of its parameter's name: "phi[heavy-04]",
"gamma[heavy]", "rolling_resistance".
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from estim.campaign.campaign_file import (
    CampaignFile,
    LevelTable,
    NoiseTable,
    RunTable,
    Value,
    read_value,
)
from estim.common import InputError, Quantity
from estim.problem import Prior

Path = tuple[str | int, ...]


@dataclass(frozen=True, eq=False)
class Level:
    """One table that speaks of a run: where it stands, what it says, and the suffix of names
    declared there.
    """

    path: Path
    table: LevelTable
    suffix: str


@dataclass(frozen=True, eq=False)
class Levels:
    """The tables that speak of run number `index` of a campaign file, most particular first."""

    source: CampaignFile
    index: int

    @property
    def run(self) -> RunTable:
        return self.source.runs[self.index]

    def __iter__(self) -> Iterator[Level]:
        run = self.run
        yield Level(("runs", self.index), run, f"[{run.name}]")
        yield from body_levels(self.source, run.body)

    def error(
        self, rule: str, path: Path, *, field: str | None = None, value: object = None
    ) -> InputError:
        return self.source.places.error(rule, path, field=field, value=value)


def body_levels(source: CampaignFile, body: str) -> tuple[Level, Level]:
    """The tables that speak of a body, most particular first."""
    return Level(("bodies", body), source.bodies[body], f"[{body}]"), Level(
        ("shared",), source.shared, ""
    )


def read_key(
    source: CampaignFile, level: Level, key: str, *, factor: float = 1.0
) -> Quantity | Prior:
    """The value of `key` at `level` in SI units.  Raises InputError with its line."""
    value: Value = getattr(level.table, key)
    return read_at(source, value, (*level.path, key), factor=factor)


def read_at(
    source: CampaignFile, value: Value, path: Path, *, factor: float = 1.0
) -> Quantity | Prior:
    """`value`, which stands at `path`, in SI units.  Raises InputError with its line."""
    try:
        return read_value(value, factor=factor, field=str(path[-1]))
    except InputError as error:
        raise source.places.error(error.rule, path, value=error.value) from None


def first_stating(levels: Iterable[Level], key: str) -> Level | None:
    """The first of `levels` that says something under `key`, None where none does."""
    return next((level for level in levels if getattr(level.table, key) is not None), None)


@dataclass(frozen=True, eq=False)
class StatedNoise:
    """The noise table of a run, where it stands, and the suffix of its parameters' names."""

    levels: Levels
    table: NoiseTable
    path: Path
    suffix: str

    def error(self, rule: str, *key: str, value: object = None) -> InputError:
        """An InputError at the line of the table, or of a key in it."""
        return self.levels.error(rule, (*self.path, *key), value=value)


def stated_noise(levels: Levels) -> StatedNoise:
    """The most particular noise table of a run.  Raises InputError where there is none."""
    level = first_stating(levels, "noise")
    if level is None or level.table.noise is None:
        raise levels.error(
            f"is missing for run '{levels.run.name}', for example noise = {{sigma_x_m = 0.001}}",
            ("runs", levels.index),
            field="noise",
        )
    return StatedNoise(levels, level.table.noise, (*level.path, "noise"), level.suffix)
