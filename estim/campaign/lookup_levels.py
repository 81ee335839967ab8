"""What a campaign file states about one run, found by the rule of levels.

A thing is looked up at the run, then at its body, then under [shared].  The level where it stands
is the level at which it is one unknown, and the suffix of its parameter's name: "phi[heavy-04]",
"gamma[heavy]", "rolling_resistance".
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from estim.campaign.campaign_file import CampaignFile, LevelTable, NoiseTable, RunTable
from estim.campaign.prior_table import Value, read_value
from estim.common import InputError, Quantity
from estim.problem import Prior
from estim.reading import KeyPath


@dataclass(frozen=True, eq=False)
class Level:
    """One table that applies to a run: where it stands, what it states, and the suffix of names
    declared there.
    """

    path: KeyPath
    table: LevelTable
    suffix: str

    def stated(self, keys: Iterable[str]) -> list[str]:
        """Those of `keys` under which it states something."""
        return [key for key in keys if getattr(self.table, key) is not None]


@dataclass(frozen=True, eq=False)
class Levels:
    """The tables of a campaign file that apply to a run or of a body, most particular first."""

    source: CampaignFile
    tables: tuple[Level, ...]

    def __iter__(self) -> Iterator[Level]:
        return iter(self.tables)

    @property
    def run(self) -> RunTable:
        """The run that they apply to."""
        return self.source.runs[int(self.tables[0].path[1])]

    def first(self, *keys: str) -> Level | None:
        """The first that states something under one of `keys`, None where none does."""
        return next((level for level in self.tables if level.stated(keys)), None)

    def read(self, level: Level, key: str, *, factor: float = 1.0) -> Quantity | Prior:
        """The value of `key` at `level` in SI units.  Raises InputError with its line."""
        value: Value = getattr(level.table, key)
        return read_at(self.source, value, (*level.path, key), factor=factor)

    def error(
        self, rule: str, path: KeyPath, *, field: str | None = None, value: object = None
    ) -> InputError:
        return self.source.error(rule, path, field=field, value=value)


def run_levels(source: CampaignFile, name: str) -> Levels:
    """The tables that apply to the run `name`."""
    index = [run.name for run in source.runs].index(name)
    run = source.runs[index]
    own = Level(("runs", index), run, f"[{name}]")
    return Levels(source, (own, *body_levels(source, run.body)))


def body_levels(source: CampaignFile, body: str) -> Levels:
    """The tables that apply to a body."""
    own = Level(("bodies", body), source.bodies[body], f"[{body}]")
    return Levels(source, (own, Level(("shared",), source.shared, "")))


def read_at(
    source: CampaignFile, value: Value, path: KeyPath, *, factor: float = 1.0
) -> Quantity | Prior:
    """`value`, which stands at `path`, in SI units.  Raises InputError with its line."""
    with source.places.at(path):
        return read_value(value, factor=factor, field=str(path[-1]))


@dataclass(frozen=True, eq=False)
class StatedNoise:
    """The noise table of a run, where it stands, and the suffix of its parameters' names."""

    levels: Levels
    table: NoiseTable
    path: KeyPath
    suffix: str

    def error(self, rule: str, *key: str, value: object = None) -> InputError:
        """An InputError at the line of the table, or of a key in it."""
        return self.levels.error(rule, (*self.path, *key), value=value)


def stated_noise(levels: Levels) -> StatedNoise:
    """The most particular noise table of a run.  Raises InputError where there is none."""
    level = levels.first("noise")
    if level is None or level.table.noise is None:
        raise levels.error(
            f"is missing for run '{levels.run.name}', for example noise = {{sigma_x_m = 0.001}}",
            levels.tables[0].path,
            field="noise",
        )
    return StatedNoise(levels, level.table.noise, (*level.path, "noise"), level.suffix)
