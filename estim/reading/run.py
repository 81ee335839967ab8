"""A run: the measurements of one motion, read from a CSV file without changing a number, or from a
file of Tracker.

Columns: `t_s` time, `x_m` position along the ramp since release, `v_m_s` speed, `theta_rad` angle
turned since release, `omega_rad_s` angular rate, `sigma_x_m`, `sigma_v_m_s` standard deviations row
by row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, Quantity
from estim.reading.dialect import PLAIN, Dialect
from estim.reading.named_columns import read_known_columns
from estim.reading.source import reader_of
from estim.reading.table import UNITS, Table
from estim.reading.tracker.importing import (
    Choices,
    head_of_export_file,
    import_track,
    is_tracker_file,
    stated_tilt,
    track_columns,
)
from estim.reading.tracker.plausibility import odd_intervals
from estim.reading.tracker.track import LEAST_STEP, MOST

COLUMNS = tuple(UNITS)


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(Table):
    """The table of one run.

    columns : standard column name -> (n_row,) read-only array, SI units.
    facts : where an imported track comes from and how x was made of it, in words; also for a CSV
        made by `estim import`; what is missing in a table.
    tilt : rad, of an imported track against the x axis of its video, positive uphill; None where it
        is not known.
    left_out : how many rows of the file were left out by `without`.
    interval : s between frames, of an imported run of a campaign; None of others.
    """

    name: str
    tilt: Quantity | None = None
    left_out: int = 0
    interval: float | None = None

    @property
    def n_row(self) -> int:
        return int(self.lines.size)

    @property
    def coordinate(self) -> str:
        """The column of the position of the body: `x_m` or `theta_rad`."""
        return "x_m" if "x_m" in self.columns else "theta_rad"

    @property
    def position(self) -> FloatArray:
        """(n_row,) its column of positions."""
        return self.columns[self.coordinate]

    def without(self, times: Sequence[float]) -> Run:
        """The run without the rows at `times` (s), each to a hundredth of the interval.

        Raises InputError naming `leave_out_s` for a time that has no row.
        """
        if "t_s" not in self.columns:
            raise InputError(
                "needs times: the run's file has no t_s column", field="leave_out_s", value=times[0]
            )
        t = self.columns["t_s"]
        within = 0.01 * float(np.median(np.diff(t)))
        rows = [int(np.argmin(np.abs(t - time))) for time in times]
        for row, time in zip(rows, times, strict=True):
            if not abs(t[row] - time) <= within:
                raise InputError(
                    f"must name times of rows of {self.file}: the nearest is {t[row]:.6g} s, on "
                    f"line {self.lines[row]}",
                    field="leave_out_s",
                    value=time,
                )
        remaining = np.setdiff1d(np.arange(t.size), rows)
        columns = {name: column[remaining] for name, column in self.columns.items()}
        left_out = t.size - remaining.size
        return self.with_columns(columns, lines=self.lines[remaining], left_out=left_out)

    @property
    def rate(self) -> str:
        """The column of its speed there: `v_m_s` or `omega_rad_s`."""
        return "v_m_s" if self.coordinate == "x_m" else "omega_rad_s"


def read_run(
    path: Path, *, name: str, choices: Choices | None = None, dialect: Dialect = PLAIN
) -> Run:
    """The run in the file at `path`.

    dialect : how the table is written, where that is stated; its columns may then be among others,
        and are called as below, or "time (s)".

    A .trk, a .trz, a text export of Tracker, and any file for which there are `choices`, is
    imported (`importing`).  Without `choices` a table of `t` and `x` alone is refused, since
    nothing shows whether its x is counted from the release.

    Raises InputError with file, line, field, rule and value for anything that is not a table of
    finite numbers with known columns, one of `x_m` and `theta_rad` among them, and times that
    increase.
    """
    of_tracker = choices is not None or is_tracker_file(path)
    if of_tracker and dialect != PLAIN:
        rule = "applies to tables, not to a file of Tracker, whose format is fixed"
        raise InputError(rule, field="columns", file=path)
    stated = of_tracker or dialect != PLAIN or reader_of(path) is not None
    head = None if stated else head_of_export_file(path)
    if of_tracker or head is not None:
        imported = import_track(path, choices or Choices())
        if head is not None and head[2]:
            rule = (
                "may be a table or an export of Tracker, which is counted from its first point: "
                "for a table write t_s,x_m (s, m from the release), for an export say "
                'release = "first" in the run'
            )
            raise InputError(rule, field="header", value=head[1], file=path, line=head[0])
        return run_of_table(track_columns(imported, ("t_s", "x_m")), name, imported.ramp.tilt)
    table = read_known_columns(path, known=COLUMNS, min_rows=5, dialect=dialect)
    names = set(table.columns)
    header = ", ".join(table.columns)
    if ("x_m" in names) == ("theta_rad" in names):
        raise InputError(
            "must hold exactly one of x_m and theta_rad",
            field="header",
            value=header,
            file=table.file,
            line=table.header_line,
        )
    if not {"t_s", "v_m_s", "omega_rad_s"} & names:
        rule = "must hold a time (t_s) or a speed (v_m_s, omega_rad_s)"
        raise InputError(
            rule, field="header", value=header, file=table.file, line=table.header_line
        )
    _check_numbers(table)
    return run_of_table(table, name)


def run_of_table(table: Table, name: str, tilt: Quantity | None = None) -> Run:
    """The run `name` in a table that has been checked, with the tilt that is known or that the head
    of an imported one states.
    """
    return Run(**vars(table), name=name, tilt=tilt or stated_tilt(table.facts))


def is_timed_track(run: Run) -> bool:
    """Whether a run was imported with the times of its frames."""
    return run.imported and "t_s" in run.columns


def compare_intervals(runs: Mapping[str, Run]) -> dict[str, Run]:
    """The same runs, by name, each imported one with its frame interval, and a warning where that
    is not the interval of most of them.
    """
    intervals = {
        name: float(np.median(np.diff(run.columns["t_s"])))
        for name, run in runs.items()
        if is_timed_track(run)
    }
    odd = odd_intervals(intervals)
    warnings = {
        name: (*run.warnings, odd[name]) if name in odd else run.warnings
        for name, run in runs.items()
    }
    return {
        name: replace(run, warnings=warnings[name], interval=intervals.get(name))
        for name, run in runs.items()
    }


def _check_numbers(table: Table) -> None:
    """Numbers are of a size that can be measured, times increase, standard deviations are
    positive.
    """
    for name, column in table.columns.items():
        table.require(name, np.abs(column) <= MOST, f"must lie within ±{MOST:g}")
    if "t_s" in table.columns:
        steps = np.diff(table.columns["t_s"], prepend=-np.inf)
        table.require("t_s", steps > 0.0, "must increase from row to row")
        table.require("t_s", steps >= LEAST_STEP, f"must advance by at least {LEAST_STEP:g} s")
    for name in [name for name in ("sigma_x_m", "sigma_v_m_s") if name in table.columns]:
        table.require(name, table.columns[name] > 0.0, "must be > 0")
