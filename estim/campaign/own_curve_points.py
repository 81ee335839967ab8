"""The points of a run of a user's own curve, with the errors that its tables state."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from estim.arrays import FloatArray
from estim.campaign.campaign_file import CampaignFile, Value, read_value
from estim.campaign.curve_tables import CurveRunTable, CurveTable, Place, ReadingErrorTable, axis_of, prior_table, y_axis
from estim.campaign.own_curve_counts import read_counts, window_of_events
from estim.campaign.own_curve_lacks import check_lacks, read_lacks
from estim.campaign.robust import shape_of
from estim.common import Finding, InputError, Kind, Quantity, phrase
from estim.curves import MAX_DENSE, MAX_EVENTS, MAX_OBS, SIGMA, SIGMA_NOTATION, SIGMA_SPREAD, AxisNames, reading_noise
from estim.fitting import PERFECT
from estim.problem import Curve, Observations, Parameter, Prior, Scale, Unstated, as_prior, hide_the_range, plain_words
from estim.reading import Run

MIN_ROWS = 3


@dataclass(frozen=True, eq=False)
class CurvePoints:
    """What the `[curve]` table and the runs say of points and their errors.  `observe` reads one run."""

    source: CampaignFile
    axes: AxisNames
    table: CurveTable
    runs: tuple[CurveRunTable, ...]

    def observe(
        self, curve: Curve, arguments: Mapping[str, str | float], index: int, table: Run, *, joint: bool
    ) -> tuple[Observations, tuple[Parameter, ...]]:
        """The points of run number `index`, and what is unknown of their errors.  joint : whether other runs are fit with it.  Raises InputError."""
        if self.table.noise is not None:
            return self._counted(curve, arguments, index, table), ()
        x, y = table.columns[axis_of(self.table.x).column], table.columns[y_axis(self.table).column]
        order = np.argsort(x, kind="stable")
        inside, excluded = self._window(x, index)
        kept, between = self._every(order[inside[order]], index)
        excluded += between
        dense = self.table.u_x is not None or self.runs[index].u_x is not None
        most = MAX_DENSE if dense else MAX_OBS
        if not MIN_ROWS <= kept.size <= most:
            cure = f"say every = {-(-kept.size * max(1, self._step(index)) // most)}, or state a window"
            cure = f": {cure}" if kept.size > most else ""
            if not excluded:
                rule = f"must be between {MIN_ROWS} and {most}{' where x has errors' if dense else ''}{cure}"
                raise InputError(rule, field="rows", value=kept.size, file=table.file)
            rule = f"must leave between {MIN_ROWS} and {most} of the {table.n_row} rows of {table.file} to fit{cure}"
            raise self.source.places.error(rule, ("runs", index, "window"), field="window", value=int(kept.size))
        stated = self.table.u_y is not None or self.runs[index].u_y is not None
        lacks = read_lacks(self.source, self.table, self.runs, index, table, kept=kept, stated=stated)
        scale, relative, unknown = self._errors(index, table, kept)
        if lacks is not None and not stated:
            scale, unknown = Scale(_roughness(y[kept])), ()  # the residuals say its size, together with what the curve lacks
        tails, further = shape_of(self.runs[index].robust or self.table.robust, f"[{table.name}]")
        noise = reading_noise(
            scale, relative, None, what=self.axes.y_name, relative_x=self._errors_of_x(index, table, kept, stated=not unknown), tails=tails
        )
        if lacks is not None:
            check_lacks(self.source, self.runs[index], index, lacks, noise, joint=joint)
        run = Observations(
            name=table.name, x=x[kept], y=y[kept], t=None, curve=curve, arguments=MappingProxyType(dict(arguments)),
            noise=noise, x_name=self.axes.x_name, x_unit=self.axes.x_unit,
            y_name=self.axes.y_name, y_unit=self.axes.y_unit, excluded=excluded,
            excluded_points=np.column_stack([x[~inside], y[~inside]]), motion=None, words=plain_words(), lacks=lacks,
        )
        return run, (*unknown, *further)

    def _counted(self, curve: Curve, arguments: Mapping[str, str | float], index: int, table: Run) -> Observations:
        """The points of run number `index` where y was counted.  Raises InputError."""
        x = table.columns[axis_of(self.table.x).column]
        inside, excluded = self._window(x, index)
        run, kept, events = self.runs[index], np.flatnonzero(inside), self.table.y is None
        path: Place = ("runs", index, "window") if run.window is not None else ("curve", "window")
        window = window_of_events(self.source, run.window or self.table.window, path) if events else (0.0, 0.0)
        if not MIN_ROWS <= kept.size <= (MAX_EVENTS if events else MAX_DENSE):
            rule = f"must be between {MIN_ROWS} and {MAX_EVENTS if events else MAX_DENSE} (within the window, where one is stated)"
            raise InputError(rule, field="rows", value=int(kept.size), file=table.file)
        points = read_counts(self.source, self.table, table, kept, what=self.axes.y_name, window=window)
        left_out = np.zeros((0, 2))
        if not events and points.noise.law.word == "counts":
            left_out = np.column_stack([x[~inside], table.columns[y_axis(self.table).column][~inside]])
        return Observations(
            name=table.name, x=points.x, y=points.y, t=None, curve=points.expected(curve), arguments=MappingProxyType(dict(arguments)),
            noise=points.noise, x_name=self.axes.x_name, x_unit=self.axes.x_unit, y_name=self.axes.y_name, y_unit=self.axes.y_unit,
            excluded=excluded, excluded_points=left_out, motion=None, words=points.words,
        )

    def _errors_of_x(self, index: int, table: Run, kept: NDArray[np.int64], *, stated: bool) -> FloatArray | None:
        """(n_obs,) standard deviations of the abscissas, None where they are exact; `stated`: whether those of y are known."""
        run = self.runs[index]
        written, path = (run.u_x, ("runs", index, "u_x")) if run.u_x is not None else (self.table.u_x, ("curve", "u_x"))
        if written is None:
            return None
        if not stated:
            raise self.source.places.error("needs a known 'u_y' beside it: the sizes of both errors cannot be told from the residuals", path)
        if isinstance(written, ReadingErrorTable) and written.column is not None:
            sizes = table.columns[written.column][kept]
        elif not isinstance(written, int | float) or not (math.isfinite(written) and written > 0.0):
            shown = None if isinstance(written, ReadingErrorTable) else written
            raise self.source.places.error("must be a number > 0 or a column", path, value=shown)
        else:
            sizes = np.full(kept.size, float(written))
        if hide_the_range(table.columns[axis_of(self.table.x).column][kept], sizes):
            spread = float(np.std(table.columns[axis_of(self.table.x).column][kept], ddof=1))
            rule = f"must be below the standard deviation of x, {spread:.4g}: points that may lie anywhere along x hold no curve"
            raise self.source.places.error(rule, path, value=float(np.sqrt(np.mean(sizes**2))))
        return sizes

    def _window(self, x: FloatArray, index: int) -> tuple[NDArray[np.bool_], tuple[Finding, ...]]:
        run = self.runs[index]
        window, path = (run.window, ("runs", index, "window")) if run.window is not None else (self.table.window, ("curve", "window"))
        low = -math.inf if window is None or window.min is None else window.min
        high = math.inf if window is None or window.max is None else window.max
        if not low < high:
            raise self.source.places.error("must have 'min' below 'max'", path, field="window", value=f"min = {low}, max = {high}")
        inside = (x >= low) & (x <= high)
        left_out = int(np.sum(~inside))
        return inside, (Finding(Kind.OUTSIDE_WINDOW, size=left_out),) if left_out else ()

    def _step(self, index: int) -> int:
        """One of how many points is fit."""
        return self.runs[index].every or self.table.every or 1

    def _every(self, kept: NDArray[np.int64], index: int) -> tuple[NDArray[np.int64], tuple[Finding, ...]]:
        """Every so many of the points in order of x."""
        run = self.runs[index]
        every, path = (run.every, ("runs", index, "every")) if run.every is not None else (self.table.every, ("curve", "every"))
        if every is None or every == 1:
            return kept, ()
        if every < 1:
            raise self.source.places.error("takes one point of so many: it must be at least 1", path, value=every)
        some = kept[::every]
        return some, (Finding(Kind.ROWS_BETWEEN, size=kept.size - some.size, numbers={"every": every}),)

    def _errors(self, index: int, table: Run, kept: NDArray[np.int64]) -> tuple[Scale, FloatArray, tuple[Parameter, ...]]:
        """Scale and relative size (n_obs,) of the errors of y, and their unknown size if it is to be inferred."""
        run, ones = self.runs[index], np.ones(kept.size)
        path: Place = ("curve", "u_y")
        written, suffix = self.table.u_y, ""
        if run.u_y is not None:
            written, path, suffix = run.u_y, ("runs", index, "u_y"), f"[{run.name}]"
        if isinstance(written, ReadingErrorTable) and written.column is not None:
            return Scale(1.0), table.columns[written.column][kept], ()
        if written is None:
            name = f"{SIGMA}[{run.name}]"
            y = table.columns[y_axis(self.table).column][kept]
            prior: Prior = Unstated(_roughness(y), SIGMA_SPREAD)
            meaning = phrase("standard deviation of one reading, not stated")
            return Scale(parameter=name), ones, (Parameter(name, self.axes.y_unit, prior, meaning, SIGMA_NOTATION),)
        try:
            value: Value = written if not isinstance(written, ReadingErrorTable) else prior_table(written, str(path[-1]))
            read = read_value(value, factor=1.0, field="u_y")
        except InputError as error:
            raise self.source.places.error(error.rule, path, value=error.value) from None
        centre = read.value if isinstance(read, Quantity) else read.centre
        if centre <= 0.0 or (not isinstance(read, Quantity) and read.low < 0.0):
            raise self.source.places.error("must be > 0, and a prior of it must not reach below 0", path, value=centre)
        if isinstance(read, Quantity) and read.exact:
            if read.value < PERFECT * float(np.max(np.abs(table.columns[y_axis(self.table).column][kept]))):
                raise self.source.places.error("must be above the last digit that a number of the size of y has here", path, value=read.value)
            return Scale(read.value), ones, ()
        inferred = as_prior(read, low=0.0) if isinstance(read, Quantity) else read
        unknown = Parameter(SIGMA + suffix, self.axes.y_unit, inferred, phrase("standard deviation of one reading"), SIGMA_NOTATION)
        return Scale(parameter=unknown.name), ones, (unknown,)


def _roughness(y: FloatArray) -> float:
    """A rough standard deviation of one reading, from second differences of y in order of x."""
    rough = float(np.sqrt(np.mean(np.diff(y, 2) ** 2) / 6.0)) if y.size > 2 else 0.0
    return rough or float(np.std(y)) or 1.0
