"""A campaign whose curve is the user's own: the `[curve]` table and its runs, and the problems they pose.

    [curve]
    expression = "A*exp(-b*x)*cos(2*pi*x/T + p) + c"
    x = {column = "t_s", name = "time t", unit = "s"}
    y = {column = "angle_deg", name = "angle", unit = "°"}
    u_y = 0.2
    [curve.parameters]
    A = {start = 10.0, low = 0.0, unit = "°", meaning = "amplitude"}

The rule of levels holds: a parameter under [curve.parameters] is one unknown for all runs, one under [runs.parameters] belongs
to its run and is called "A[run]", as one is that all other runs of a joint fit override.  `docs/your-own-curve.md` explains the keys.
"""

from __future__ import annotations

import math
import unicodedata
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from estim.campaign_file import CampaignFile, Value, checked, read_value
from estim.curve import Curve
from estim.curve_file import (
    CurveRunTable,
    CurveTable,
    ParameterTable,
    Place,
    ReadingErrorTable,
    axis_of,
    check_parameters,
    check_words,
    prior_table,
    source_of,
)
from estim.curve_problem import MAX_OBS, SIGMA, SIGMA_SPREAD, AxisNames, reading_noise
from estim.errors import InputError
from estim.fitting import PERFECT, Fit, no_scatter, silent_parameters
from estim.formula import Formula, read_formula
from estim.levels import as_prior
from estim.noise import Scale
from estim.observing import shape_of
from estim.priors import LogNormal, Prior
from estim.problem import Observations, Parameter, Problem, shared_first
from estim.quantity import Quantity
from estim.run import Run, run_of_table
from estim.suspicion import of_any_curve
from estim.systematic import Component, DistortedCurve
from estim.table import read_table
from estim.toml_text import Places

FloatArray = NDArray[np.float64]
_MIN_ROWS = 3


@dataclass(frozen=True, eq=False)
class CurveStudy:
    """The `[curve]` table and the runs of a campaign, read and checked.  `problem` poses the inference for some of the runs."""

    source: CampaignFile
    formula: Formula
    axes: AxisNames
    table: CurveTable
    runs: tuple[CurveRunTable, ...]

    @property
    def x_column(self) -> str:
        return axis_of(self.table.x).column

    @property
    def y_column(self) -> str:
        return axis_of(self.table.y).column

    def problem(self, names: Sequence[str], tables: Mapping[str, Run]) -> Problem:
        """The joint problem of the runs `names` with their tables.  Raises InputError."""
        parameters: dict[str, Parameter] = {}
        noise: dict[str, Parameter] = {}
        components = self._components()
        shared = {c.parameter_name: c.parameter(x_unit=self.axes.x_unit, y_unit=self.axes.y_unit) for c in components}
        curve: Curve = DistortedCurve(self.formula, components) if components else self.formula
        observed = []
        indices = {name: [run.name for run in self.runs].index(name) for name in names}
        bound = {name: {argument: self._bind(argument, index) for argument in self.formula.names} for name, index in indices.items()}
        uses = Counter(b.name for found in bound.values() for b in found.values() if isinstance(b, Parameter))
        for name, index in indices.items():
            arguments: dict[str, str | float] = {}
            for argument, b in bound[name].items():
                if isinstance(b, float):
                    arguments[argument] = b
                    continue
                own = len(names) > 1 and uses[b.name] == 1 and b.name == argument  # all other runs say their own
                unknown_of_curve = replace(b, name=f"{argument}[{name}]") if own else b
                arguments[argument] = unknown_of_curve.name
                parameters.setdefault(unknown_of_curve.name, unknown_of_curve)
            arguments |= {component: component for component in shared}
            run, unknown = self._observe(curve, arguments, index, tables[name])
            noise |= {parameter.name: parameter for parameter in unknown}
            observed.append(run)
        for name in noise:
            if name in parameters or name in shared:
                rule = "is the name of a quantity of the errors of y, which is unknown here: choose another"
                raise self.source.places.error(rule, self._place(name))
        return Problem((*shared_first(parameters.values(), observed), *shared.values(), *noise.values()), tuple(observed))

    def require_determined(self, fit: Fit) -> None:
        """Raises InputError where neither the data nor a prior hold a parameter, so that no posterior exists to draw from."""
        flat = [p.name for p in fit.problem.parameters if not math.isfinite(p.prior.sd)]
        unheld = [name for name, sd in zip(fit.names, fit.sds, strict=True) if name in flat and not (math.isfinite(sd) and sd > 0.0)]
        if not unheld:
            return
        first, *others = [name for name in silent_parameters(fit) if name in flat] or unheld
        path = self._place(first)
        if not others:
            raise self.source.places.error("is not determined by the data: give it limits (low and high), or a prior", path)
        together = " and ".join(f"'{other}'" for other in others)
        rule = f"is not determined by the data, nor is {together}, only a combination of them: give one a value, limits (low and high), or a prior"
        raise self.source.places.error(rule, path)

    def require_scatter(self, fit: Fit) -> None:
        """Raises InputError where nothing is stated of the size of the errors, and the residuals are zero."""
        stated = {run.name for run in self.runs if self.table.u_y is not None or run.u_y is not None}
        for run in fit.problem.runs:
            if run.name not in stated and no_scatter(run, fit):
                rule = f"must be stated: the curve meets every point of run '{run.name}', so nothing shows their errors (were the data computed?)"
                raise self.source.places.error(rule, ("curve", "u_y"))

    def require_draws(self, problem: Problem) -> None:
        """Raises InputError where the prior of a parameter is flat without limits, so that no true value can be drawn from it."""
        for parameter in problem.parameters:
            if not math.isfinite(parameter.prior.sd):
                rule = "is flat without limits, so that nothing can be simulated: give it limits (low and high), or a prior"
                raise self.source.places.error(rule, self._place(parameter.name))

    def place_of(self, error: InputError, problem: Problem, tables: Mapping[str, Run]) -> InputError:
        """An error of the search for an optimum with its place: the first row at which alone the curve is not finite at the start."""
        named = problem.named(problem.start())
        for run in problem.runs:
            with np.errstate(all="ignore"):
                finite = np.broadcast_to(np.isfinite(run.curve.value(run.x, run.bind(named))), (1, run.n_obs))[0]
            if np.any(finite) and not np.all(finite):
                table = tables[run.name]
                row = int(np.argmax(table.columns[self.x_column] == run.x[int(np.argmin(finite))]))
                return table.error("is where the curve is not finite, at the start and around: leave the row out by a window", self.x_column, row)
        return error.at(self.source.path, self.source.places.lines.get(("curve", "parameters")))

    def _place(self, parameter: str) -> Place:
        """Where a parameter stands in the campaign file."""
        name, _, level = parameter.partition("[")
        run = [r.name for r in self.runs].index(level[:-1]) if level else 0
        return ("runs", run, "parameters", name) if level and name in self.runs[run].parameters else ("curve", "parameters", name)

    def _bind(self, name: str, index: int) -> Parameter | float:
        """A parameter of the formula for one run: an unknown, or an exact value."""
        run = self.runs[index]
        levels: tuple[tuple[Place, Mapping[str, float | str | ParameterTable], str], ...] = (
            (("runs", index, "parameters"), run.parameters, f"[{run.name}]"), (("curve", "parameters"), self.table.parameters, ""),
        )
        declared = [level[1][name] for level in levels if name in level[1]]
        for path, table, suffix in levels:
            if name in table:
                written = [entry for entry in declared if isinstance(entry, ParameterTable)]
                unit = next((entry.unit for entry in written if entry.unit is not None), "1")
                meaning = next((entry.meaning for entry in written if entry.meaning is not None), "parameter of the curve")
                source = self._read(table[name], (*path, name))
                return source if isinstance(source, float) else Parameter(name + suffix, unit, source, meaning)
        rule = f"is missing for run '{run.name}': say it under [curve.parameters] or [runs.parameters], for example {name} = {{start = 1.0}}"
        raise self.source.places.error(rule, ("curve", "parameters"), field=name)

    def _read(self, value: float | str | ParameterTable, path: Place) -> float | Prior:
        try:
            return source_of(value, str(path[-1]))
        except InputError as error:
            rule = error.rule if error.field in (None, path[-1]) else f"'{error.field}' {error.rule}"
            raise self.source.places.error(rule, path, value=error.value) from None

    def _components(self) -> tuple[Component, ...]:
        components = []
        for name, written in self.table.errors.items():
            try:
                kind, u = (name, written) if isinstance(written, float | int) else (written.kind, written.u)
                components.append(Component(kind, float(u), name))
            except InputError as error:
                raise self.source.places.error(f"'{error.field}' {error.rule}", ("curve", "errors", name), value=error.value) from None
        return tuple(components)

    def _observe(self, curve: Curve, arguments: Mapping[str, str | float], index: int, table: Run) -> tuple[Observations, tuple[Parameter, ...]]:
        x, y = table.columns[self.x_column], table.columns[self.y_column]
        order = np.argsort(x, kind="stable")
        inside, excluded = self._window(x, index)
        kept = order[inside[order]]
        if not _MIN_ROWS <= kept.size <= MAX_OBS:
            if not excluded:
                raise InputError(f"must be between {_MIN_ROWS} and {MAX_OBS} (or state a window)", field="rows", value=kept.size, file=table.file)
            rule = f"must leave between {_MIN_ROWS} and {MAX_OBS} of the {table.n_row} rows of {table.file} to fit"
            raise self.source.places.error(rule, ("runs", index, "window"), field="window", value=int(kept.size))
        scale, relative, unknown = self._errors(index, table, kept)
        tails, further = shape_of(self.runs[index].robust or self.table.robust, f"[{table.name}]")
        noise = reading_noise(
            scale, relative, None, what=self.axes.y_name, relative_x=self._errors_of_x(index, table, kept, stated=not unknown), tails=tails
        )
        run = Observations(
            name=table.name, x=x[kept], y=y[kept], t=None, curve=curve, arguments=MappingProxyType(dict(arguments)),
            noise=noise, x_name=self.axes.x_name, x_unit=self.axes.x_unit,
            y_name=self.axes.y_name, y_unit=self.axes.y_unit, excluded=excluded,
            excluded_points=np.column_stack([x[~inside], y[~inside]]), origin=None,
        )
        return run, (*unknown, *further)

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
        reach = float(np.ptp(table.columns[self.x_column][kept]))
        if float(np.min(sizes)) >= reach:
            rule = f"must be below the range of x, {reach:.4g}: points that may lie anywhere along x hold no curve"
            raise self.source.places.error(rule, path, value=float(np.min(sizes)))
        return sizes

    def _window(self, x: FloatArray, index: int) -> tuple[NDArray[np.bool_], tuple[str, ...]]:
        run = self.runs[index]
        window, path = (run.window, ("runs", index, "window")) if run.window is not None else (self.table.window, ("curve", "window"))
        low = -math.inf if window is None or window.min is None else window.min
        high = math.inf if window is None or window.max is None else window.max
        if not low < high:
            raise self.source.places.error("must have 'min' below 'max'", path, field="window", value=f"min = {low}, max = {high}")
        inside = (x >= low) & (x <= high)
        left_out = int(np.sum(~inside))
        return inside, (f"{left_out} outside the stated window",) if left_out else ()

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
            y = table.columns[self.y_column][kept]
            prior: Prior = LogNormal(_roughness(y), SIGMA_SPREAD)
            return Scale(parameter=name), ones, (Parameter(name, self.axes.y_unit, prior, "standard deviation of one reading, not stated"),)
        value: Value = written if not isinstance(written, ReadingErrorTable) else prior_table(written, str(path[-1]))
        try:
            read = read_value(value, factor=1.0, field="u_y")
        except InputError as error:
            raise self.source.places.error(error.rule, path, value=error.value) from None
        centre = read.value if isinstance(read, Quantity) else read.centre
        if centre <= 0.0 or (not isinstance(read, Quantity) and read.low < 0.0):
            raise self.source.places.error("must be > 0, and a prior of it must not reach below 0", path, value=centre)
        if isinstance(read, Quantity) and read.exact:
            if read.value < PERFECT * float(np.max(np.abs(table.columns[self.y_column][kept]))):
                raise self.source.places.error("must be above the last digit that a number of the size of y has here", path, value=read.value)
            return Scale(read.value), ones, ()
        inferred = as_prior(read, low=0.0) if isinstance(read, Quantity) else read
        return Scale(parameter=SIGMA + suffix), ones, (Parameter(SIGMA + suffix, self.axes.y_unit, inferred, "standard deviation of one reading"),)


def read_curve_study(source: CampaignFile) -> tuple[CurveStudy, Mapping[str, Run]]:
    """The curve of a campaign and the tables of its runs.

    Raises InputError with file, line, field, rule and value for whatever breaks a rule.
    """
    assert source.curve is not None
    places = source.places
    table = checked(_with_names(source.curve["curve"], places, ("curve",)), CurveTable, places, ("curve",))
    written = [_with_names(run, places, ("runs", i)) for i, run in enumerate(source.curve["runs"])]
    runs = tuple(checked(run, CurveRunTable, places, ("runs", i)) for i, run in enumerate(written))
    try:
        formula = read_formula(table.expression)
    except InputError as error:
        raise places.error(error.rule, ("curve", "expression"), value=error.value) from None
    x, y = axis_of(table.x), axis_of(table.y)
    check_words(source, table, runs, (x, y))
    check_parameters(source, formula, table, runs)
    axes = AxisNames(x.name or x.column, x.unit, y.name or y.column, y.unit)
    study = CurveStudy(source, formula, axes, table, runs)
    return study, MappingProxyType({run.name: _read_run(study, run) for run in runs})


def _with_names(raw: Mapping[str, Any], places: Places, path: Place) -> dict[str, Any]:
    """A table with the names of its parameters as Python reads them in a formula (the micro sign is the letter mu).

    The parameters are checked one by one, for their lines.  Raises InputError.
    """
    given, named = raw.get("parameters", {}), dict[str, Any]()
    for name, entry in given.items() if isinstance(given, dict) else ():
        kind: Any = ParameterTable if isinstance(entry, dict) else float | str | ParameterTable
        checked(entry, kind, places, (*path, "parameters", name))
        read = unicodedata.normalize("NFKC", name)
        if read in named:
            raise places.error("is the same name as another in a formula", (*path, "parameters", name))
        named[read] = entry
    return {**raw, "parameters": named} if named else dict(raw)


def _read_run(study: CurveStudy, run: CurveRunTable) -> Run:
    path = study.source.file_of(study.runs.index(run))
    errors = [entry for entry in (run.u_y, study.table.u_y) if entry is not None][:1]
    errors += [entry for entry in (run.u_x, study.table.u_x) if entry is not None][:1]
    columns = [entry.column for entry in errors if isinstance(entry, ReadingErrorTable) and entry.column is not None]
    needed = [study.x_column, study.y_column, *columns]
    table = read_table(path, known=needed, min_rows=_MIN_ROWS, shown_as=str(path))
    for column in needed:
        if column not in table.columns:
            raise InputError("is missing in the header", field=column, value=", ".join(table.columns), file=table.file, line=table.header_line)
    for column in columns:
        if np.any(table.columns[column] <= 0.0):
            raise table.error("must be > 0", column, int(np.argmax(table.columns[column] <= 0.0)))
    return replace(run_of_table(table, run.name), warnings=of_any_curve(table.warnings))


def _roughness(y: FloatArray) -> float:
    """A rough standard deviation of one reading, from second differences of y in order of x."""
    rough = float(np.sqrt(np.mean(np.diff(y, 2) ** 2) / 6.0)) if y.size > 2 else 0.0
    return rough or float(np.std(y)) or 1.0
