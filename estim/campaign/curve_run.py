"""One run of a campaign's `[curve]`: its columns, and the problem that its rows pose as they would
in `fit_curve`.

What is stated at the run has the last word, else what is stated for the curve.  Only what rows are,
which of them are fit, and keys that Python does not have are decided here; all else by
`estim.curves.pose_points`, whose errors get the line of their cell or key.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray, max_abs
from estim.campaign.campaign_file import CampaignFile
from estim.campaign.curve_keys import (
    AxisTable,
    BinomialTable,
    ComponentTable,
    CurveRunTable,
    CurveTable,
    EventsTable,
    ParameterTable,
    PoissonTable,
    RangeTable,
    ReadingErrorTable,
)
from estim.campaign.curve_tables import x_axes, y_axis
from estim.campaign.dialect_table import DialectKeys, choices_of, dialect_of
from estim.campaign.prior_table import PriorKeys, read_source
from estim.common import Finding, InputError, Kind, bracketed, phrase, same_numbers
from estim.curves import (
    MAX_DENSE,
    SIGMA,
    SIGMA_NOTATION,
    SIGMA_SPREAD,
    AxisNames,
    Binomial,
    Component,
    Counting,
    CurveProblem,
    DataSet,
    EventTimes,
    ModelSum,
    ParameterSettings,
    Poisson,
    numbered,
    pose_points,
    roughness,
)
from estim.fitting import PERFECT
from estim.problem import Parameter, Prior, Problem, Scale, Unstated
from estim.reading import (
    Choices,
    KeyPath,
    Run,
    Table,
    columns_sentence,
    import_track,
    is_tracker_file,
    read_columns,
    track_columns,
)

_MIN_ROWS = 3
MAX_ROWS = 100_000  # of a fit with a chain, where they cost in proportion
NUMBER = "_number"  # the column of x where a curve has several abscissas
_DISCREPANCIES = ("deviation", "correlated")


@dataclass(frozen=True, eq=False)
class RunOfCurve:
    """What a campaign states of the curve in its run number `index`.

    abscissas : how the formula calls each of several abscissas -> what it is; x is then the number
        of the point.
    """

    source: CampaignFile
    curve: CurveTable
    table: CurveRunTable
    index: int
    abscissas: Mapping[str, AxisTable]

    @property
    def axes(self) -> dict[str, AxisTable]:
        """Argument of `pose_points`, "x" or "x[u]" of several abscissas, and "y" -> what it is."""
        abscissas = {f"x[{symbol}]": axis for symbol, axis in self.abscissas.items()}
        return {**(abscissas or {"x": x_axes(self.curve)[0]}), "y": y_axis(self.curve)}

    @property
    def x(self) -> str:
        """The column of x."""
        return x_axes(self.curve)[0].column

    @property
    def y(self) -> str:
        """The column of y, "" of single events."""
        return y_axis(self.curve).column

    @property
    def events(self) -> bool:
        return self.curve.y is None

    def stated(self, key: str) -> tuple[Any, KeyPath]:
        """What the run states under a key, else the curve, and where; None where neither does."""
        value = getattr(self.table, key, None)
        return (
            (value, ("runs", self.index, key))
            if value is not None
            else (getattr(self.curve, key, None), ("curve", key))
        )

    def error(self, rule: str, key: str, *, value: object = None) -> InputError:
        """An InputError at the line of a key."""
        return self.source.error(rule, self.stated(key)[1], value=value)

    def size(self, key: str, written: float | str | PriorKeys) -> float | Prior:
        """A size as it is written under a key: exact, or the prior of one.  Raises InputError."""
        with self.source.places.at(self.stated(key)[1]):
            return read_source(written, field=key, low=0.0)

    def path_of(self, parameter: str) -> KeyPath:
        """Where a parameter is stated."""
        return (
            ("runs", self.index, "parameters", parameter)
            if parameter in self.table.parameters
            else ("curve", "parameters", parameter)
        )

    def entry(self, parameter: str) -> float | str | ParameterTable | None:
        """What the nearest level states of a parameter."""
        return self.table.parameters.get(parameter, self.curve.parameters.get(parameter))

    def word(self, parameter: str, word: Literal["unit", "meaning"]) -> str | None:
        """The unit or meaning of a parameter, as the nearest level that states one has it."""
        entries = (level.parameters.get(parameter) for level in (self.table, self.curve))
        words = (getattr(entry, word, None) for entry in entries)
        return next((text for text in words if text is not None), None)

    @cached_property
    def columns(self) -> Mapping[str, str]:
        """Argument of `pose_points` -> the column that gives it."""
        noise = self.curve.noise
        stated = {key: self.stated(key)[0] for key in ("u_y", "u_x", "correlated")}
        columns: dict[str, object] = {key: axis.column for key, axis in self.axes.items()}
        columns["correlated"] = stated["correlated"]
        columns |= {
            key: written.column or written.minus
            for key, written in stated.items()
            if isinstance(written, ReadingErrorTable)
        }
        columns["u_y[plus]"] = getattr(stated["u_y"], "plus", None)
        columns |= {
            f"errors[{name}]": error.groups
            for name, error in self.curve.errors.items()
            if isinstance(error, ComponentTable)
        }
        if isinstance(noise, PoissonTable) and isinstance(noise.bins, tuple):
            columns |= {"low": noise.bins[0], "bins": noise.bins[1]}
        if isinstance(noise, BinomialTable):
            columns["trials"] = noise.trials
        return {
            key: column for key, column in columns.items() if isinstance(column, str) and column
        }

    def refuse_discrepancy(self, command: str) -> None:
        """Raises InputError where the campaign allows for a discrepancy of the curve, which
        `command` does not support.
        """
        for key in _DISCREPANCIES:
            if self.stated(key)[0]:
                raise self.error(
                    f"does not go with {command}, which takes the curve as complete: leave "
                    "it out for that",
                    key,
                )

    def read(self) -> Table:
        """The columns of its file.  Raises InputError."""
        path = self.source.file_of(self.index)
        levels = ((("runs", self.index), self.table), (("curve",), self.curve))
        dialect = dialect_of(levels, self.source.places)
        needed = list(dict.fromkeys(self.columns.values()))
        choices = choices_of(self.table) or (Choices() if is_tracker_file(path) else None)
        if choices is not None and any(
            getattr(self.table, key) is not None for key in DialectKeys.__struct_fields__
        ):
            rule = "does not go with a file of Tracker, which says itself how it is written"
            raise self.source.error(rule, ("runs", self.index), field="columns")
        with self.source.reading(path, needed):
            table = (
                track_columns(import_track(path, choices), needed)
                if choices is not None
                else read_columns(path, needed=needed, min_rows=_MIN_ROWS, dialect=dialect)
            )
        for key, of, axis in (
            ("u_y", self.y, y_axis(self.curve)),
            ("u_y[plus]", self.y, y_axis(self.curve)),
            ("u_x", self.x, x_axes(self.curve)[0]),
        ):
            if key in self.columns:
                if axis.unit == "1" or table.units.get(of):
                    table.require_unit(self.columns[key], of)
                else:
                    _require_unit_of_axis(table, self.columns[key], of, axis.unit)
        if self.abscissas:
            numbers = np.arange(1.0, table.lines.size + 1.0)
            table = table.with_columns({**table.columns, NUMBER: numbers})
        return table

    def units_of(self, table: Table) -> dict[str, str]:
        """Key of `axes` -> its unit, that of the header where the campaign states none.  Raises
        InputError where it states another.
        """
        units = {}
        for key, axis in self.axes.items():
            stated = table.units.get(axis.column, "")
            if axis.unit != "1" and stated and same_numbers(axis.unit, stated) is False:
                where = f"the header of {table.file}" if table.header_line else table.file
                raise self.source.error(
                    f"must be in {stated}, as {where} says; nothing is converted",
                    ("curve", key[:1]),
                    value=axis.unit,
                )
            units[key] = stated if stated and axis.unit == "1" else axis.unit
        return units

    def columns_sentence(self, units: Mapping[str, str], table: Run) -> str:
        """Which columns are x, y and their uncertainties, with units, and which columns of numbers
        are not read.
        """
        columns = [(key[2:-1] or key, axis.column, units[key]) for key, axis in self.axes.items()]
        columns += [
            (key, self.columns[key], units[of])
            for key, of in (("u_y", "y"), ("u_y[plus]", "y"), ("u_x", "x"))
            if key in self.columns
        ]
        return columns_sentence(columns, table.unread)


def _require_unit_of_axis(table: Table, u: str, of: str, unit: str) -> None:
    """Raises InputError where the header states another unit for uncertainties than the campaign
    for what they are of, and the header does not.
    """
    stated = table.units.get(u, "")
    if stated and same_numbers(stated, unit, differences=True) is False:
        rule = f"must be in the unit that the campaign says of '{of}', {unit}; nothing is converted"
        raise InputError(
            rule, field=u, value=stated, file=table.file, line=table.header_line or None
        )


@dataclass(frozen=True, eq=False)
class RowsOfRun:
    """A run with the table of its data and which of its rows are fit.

    row_indices : (n_obs,) rows that are fit, in order of x.
    inside : (n_row,) whether a row lies within the window.
    excluded : why others are left out.
    """

    run: RunOfCurve
    data: Run
    row_indices: IntArray
    inside: BoolArray
    excluded: tuple[Finding, ...]

    def column(self, key: str) -> FloatArray:
        """The column that gives an argument of `pose_points`, of these rows."""
        return np.asarray(self.data.columns[self.run.columns[key]][self.row_indices])

    def points(self, model: ModelSum, axes: AxisNames) -> DataSet:
        """The rows as the points of a curve.  Raises InputError."""
        run, size = self.run, self.size
        curve: Any = model
        x: Any = {symbol: self.column(f"x[{symbol}]") for symbol in run.abscissas} or self.column(
            "x"
        )
        if run.abscissas:
            with self.placing():
                curve, x = numbered(model.formula.text, x)
        return DataSet(
            x,
            None if run.events else self.column("y"),
            None if isinstance(size, Prior) else size,
            u_x=_error_of_x(self),
            noise=_counting(self),
            curve=curve,
            axes=axes,
            jitter=_jitter(run),
            robust=run.stated("robust")[0],
        )

    def posed(
        self,
        points: DataSet,
        settings: ParameterSettings,
        components: tuple[Component, ...],
        **options: Any,
    ) -> CurveProblem:
        """The problem of its points.

        settings, options : as of `pose_points`.

        Raises InputError with file and line.
        """
        run = self.run
        deviation, correlated = run.stated("deviation")[0], run.stated("correlated")[0]
        along = (
            self.column("correlated")
            if isinstance(correlated, str)
            else self.row_indices.astype(float)
            if correlated
            else False
        )
        errors = [
            component
            if component.groups is None
            else replace(component, groups=self.column(f"errors[{component.name}]"))
            for component in components
        ]
        with self.placing():
            posed = pose_points(
                points,
                settings,
                errors,
                deviation=deviation or 0.0,
                correlated=along,
                level=f"[{run.table.name}]",
                **options,
            )
        _check_keys(run, posed, self.size)
        return posed

    @contextmanager
    def placing(self) -> Iterator[None]:
        """While points are posed: an error has its place."""
        try:
            yield
        except InputError as error:
            raise _placed(error, self) from None

    @cached_property
    def size(self) -> float | str | FloatArray | Prior | None:
        """Standard deviations of y, or the prior of theirs; text where they are a share, None where
        nothing is stated.
        """
        run, written = self.run, self.run.stated("u_y")[0]
        if written is None:
            return None
        if "u_y[plus]" in run.columns:
            return np.array([self.column("u_y"), self.column("u_y[plus]")])
        if "u_y" in run.columns:
            return self.column("u_y")
        if isinstance(written, str) and "%" in written:
            return written
        read = run.size("u_y", written)
        known = isinstance(read, float)
        centre, low = (read, 0.0) if isinstance(read, float) else (read.centre, read.low)
        if centre <= 0.0 or low < 0.0:
            raise run.error(
                "must be > 0, and a prior of it must not reach below 0", "u_y", value=centre
            )
        if known and run.curve.noise is None and centre < PERFECT * max_abs(self.column("y")):
            raise run.error(
                "must be above the last digit that a number of the size of y has here",
                "u_y",
                value=centre,
            )
        return read

    def problem(self, posed: CurveProblem, axes: AxisNames) -> Problem:
        """The run as a problem, what is unknown of its errors last.  axes : as they are shown."""
        name = self.run.table.name
        sigma, unknown = Scale(1.0), tuple[Parameter, ...]()
        # its size is inferred from the residuals, together with the discrepancy of the curve
        if not posed.stated and posed.lacks is not None:
            sigma = Scale(roughness(posed.y, robust=posed.noise.robust))
        elif not posed.stated:
            inferred = isinstance(self.size, Prior)
            of_all = inferred and self.run.table.u_y is None
            prior: Prior = Unstated(roughness(posed.y, robust=posed.noise.robust), SIGMA_SPREAD)
            prior = self.size if isinstance(self.size, Prior) else prior
            meaning = (
                phrase("standard deviation of one reading")
                if inferred
                else phrase("standard deviation of one reading, not stated")
            )
            size = Parameter(
                SIGMA if of_all else f"{SIGMA}[{name}]", axes.y_unit, prior, meaning, SIGMA_NOTATION
            )
            sigma, unknown = Scale(parameter=size.name), (size,)
        discrepancy, along = posed.lacks, self.run.columns.get("correlated")
        if discrepancy is not None and discrepancy.along is not None:
            of_column = (
                x_axes(self.run.curve)[0].unit
                if along == self.run.x
                else phrase("of column '{column}'", column=along)
            )
            discrepancy = replace(
                discrepancy, along_unit=phrase("readings") if along is None else of_column
            )
        counts = posed.noise.counted
        shows_excluded = counts is None or counts.law.word == "counts"
        columns = self.data.columns
        run = replace(
            posed.observed(sigma),
            x_unit=axes.x_unit,
            y_unit=axes.y_unit,
            excluded=self.excluded,
            excluded_points=np.column_stack(
                [columns[self.run.x][~self.inside], columns[self.run.y][~self.inside]]
            )
            if shows_excluded and not self.run.events
            else np.zeros((0, 2)),
            lacks=discrepancy,
            places={
                (axis.name or axis.column) + bracketed(axis.unit): self.column(f"x[{symbol}]")
                for symbol, axis in self.run.abscissas.items()
            }
            or None,
        )
        return Problem((*posed.parameters, *unknown, *posed.further), (run,))


def _check_keys(run: RunOfCurve, posed: CurveProblem, size: object) -> None:
    """Raises InputError for keys of a campaign alone that do not go with others."""
    if posed.counted is not None and run.stated("every")[0] is not None:
        raise run.error(
            "does not go with 'noise', which says how counts scatter: leave it out", "every"
        )
    if posed.lacks is not None and isinstance(size, Prior):
        raise run.error(
            "does not go with a 'u_y' that has an uncertainty itself: state a number, "
            "or leave 'u_y' out",
            "deviation" if posed.lacks.deviation else "correlated",
        )


def _jitter(run: RunOfCurve) -> bool | Prior:
    """Whether errors in addition to the stated ones are inferred, or the prior of their size."""
    written = run.stated("jitter")[0]
    if written is None or isinstance(written, bool):
        return bool(written)
    read = run.size("jitter", written)
    if isinstance(read, float):
        rule = "must be true, or have an uncertainty or a prior (a known one belongs into u_y)"
        raise run.error(rule, "jitter", value=read)
    return read


def _placed(error: InputError, rows: RowsOfRun) -> InputError:
    """An error of an argument of `pose_points` at the cell, the parameter or the key that it comes
    from.
    """
    run, data = rows.run, rows.data
    argument, _, of = (error.field or "").partition("[")
    column = run.columns.get(error.field or "", run.columns.get(argument))
    of = of.removesuffix("]")
    if error.file is not None:
        return error
    if error.field == "start":  # of the search for them
        places = run.source.places
        return error.at(places.file, places.lines.get(("curve", "parameters")))
    if column is not None and error.index is not None:
        return data.error(error.rule, column, int(rows.row_indices[error.index]))
    if column is not None and argument in ("x", "y"):
        return InputError(error.rule, field=column, value=error.value, file=data.file)
    match argument:
        case "units" | "start":
            path = run.path_of(of)
        case "errors":
            path = ("curve", "errors", of) if of else ("curve", "errors")
        case "curve":
            path = ("curve", "expression" if run.curve.model is None else "model")
        case "bins" | "trials" | "cells":
            path = ("curve", "noise", argument)
        case _:
            path = run.stated(argument)[1]
    return run.source.places.error(error.rule, path, value=error.value, quoted=error.quoted)


def rows_of(run: RunOfCurve, data: Run) -> RowsOfRun:
    """The rows that are fit.  Raises InputError."""
    window, path = run.stated("window")
    if window is not None and run.abscissas:
        raise run.error("cannot be combined with several abscissas", "window")
    window = RangeTable() if window is None else window
    low = -math.inf if window.min is None else window.min
    high = math.inf if window.max is None else window.max
    if not low < high:
        raise run.source.error(
            "must have 'min' below 'max'", path, field="window", value=f"min = {low}, max = {high}"
        )
    if run.events and not (math.isfinite(low) and math.isfinite(high)):
        raise run.source.error(
            "must state the 'min' and 'max' between which events were recorded: their density "
            "is normalised over it (--window MIN:MAX; window = {min = ..., max = ...} in a "
            "campaign)",
            path,
            field="window",
        )
    every = run.stated("every")[0] or 1
    x = data.columns[run.x]
    inside, order = (x >= low) & (x <= high), np.argsort(x, kind="stable")
    within = order[inside[order]]
    rows = within[::every]
    excluded: tuple[Finding, ...] = (
        (Finding(Kind.OUTSIDE_WINDOW, size=x.size - within.size),) if within.size < x.size else ()
    )
    excluded += (
        (Finding(Kind.ROWS_BETWEEN, size=within.size - rows.size, numbers={"every": every}),)
        if every > 1
        else ()
    )
    most = MAX_DENSE if run.stated("u_x")[0] is not None else MAX_ROWS
    if not _MIN_ROWS <= rows.size <= most:
        cure = (
            f": say every = {-(-rows.size * every // most)}, or state a window"
            if rows.size > most and run.curve.noise is None
            else ""
        )
        if excluded:
            key = "window" if within.size < x.size else "every"
            raise run.source.error(
                f"must leave between {_MIN_ROWS} and {most} of the {data.n_row} rows of "
                f"{data.file} to fit{cure}",
                ("runs", run.index, key),
                field=key,
                value=int(rows.size),
            )
        where = " where x has errors" if run.stated("u_x")[0] is not None else ""
        raise InputError(
            f"must be between {_MIN_ROWS} and {most}{where}{cure}",
            field="rows",
            value=rows.size,
            file=data.file,
        )
    return RowsOfRun(run, data, rows, inside, excluded)


def _counting(rows: RowsOfRun) -> Counting | None:
    """What the table `noise` states; None for readings."""
    match rows.run.curve.noise:
        case EventsTable(cells=cells):
            window = rows.run.stated("window")[0]
            return EventTimes(window.min, window.max, cells)
        case BinomialTable(trials=trials):
            return Binomial(rows.column("trials") if isinstance(trials, str) else float(trials))
        case PoissonTable(bins=tuple()):
            return Poisson(np.column_stack([rows.column("low"), rows.column("bins")]))
        case PoissonTable(bins=width):
            return Poisson(width)
        case _:
            return None


def _error_of_x(rows: RowsOfRun) -> float | FloatArray | None:
    """Standard deviations of the abscissas, None where they are exact."""
    written = rows.run.stated("u_x")[0]
    if "u_x" in rows.run.columns:
        return rows.column("u_x")
    if written is not None and not isinstance(written, int | float):
        raise rows.run.error("must be a number > 0 or a column", "u_x")
    return None if written is None else float(written)
