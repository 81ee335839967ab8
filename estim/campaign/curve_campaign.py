"""A campaign whose curve is the user's own: the `[curve]` table and its runs, and the problems they
pose.

    [curve]
    expression = "A*exp(-b*x)*cos(2*pi*x/T + p) + c"
    x = {column = "t_s", name = "time t", unit = "s"}
    y = {column = "angle_deg", name = "angle", unit = "°"}
    u_y = 0.2
    [curve.parameters]
    A = {start = 10.0, low = 0.0, unit = "°", meaning = "amplitude"}

The rule of levels holds: a parameter under [curve.parameters] is one unknown for all runs, one
under [runs.parameters] belongs to its run and is called "A[run]", as one is that all other runs of
a joint fit override.  `docs/your-own-curve.md` explains the keys.
"""

from __future__ import annotations

import math
import unicodedata
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, TypeVar

import msgspec
import numpy as np

from estim.campaign.campaign import Campaign
from estim.campaign.campaign_file import CampaignFile, NoiseTable
from estim.campaign.curve_keys import AxisTable, CurveKeys, CurveTable, ParameterTable
from estim.campaign.curve_run import MAX_ROWS, NUMBER, RunOfCurve, rows_of
from estim.campaign.curve_tables import (
    check_counts,
    check_parameters,
    check_words,
    is_density,
    is_unstarted,
    read_curve,
    source_of,
    with_variable,
    x_axes,
    y_axis,
)
from estim.campaign.noise_models import NoiseModel
from estim.common import InputError, language, later, number, phrase, same_numbers
from estim.curves import (
    AxisNames,
    Component,
    CurveProblem,
    Formula,
    ModelSum,
    ParameterSettings,
    join,
    pose_sets,
    read_formula,
    refuse_degrees,
    units_of,
)
from estim.explanation import Cause, Suspects
from estim.problem import Parameter, Prior, Problem
from estim.reading import KeyPath, Places, bare_name, of_any_curve, run_of_table

Keys = TypeVar("Keys", bound=CurveKeys)


@dataclass(frozen=True, eq=False, kw_only=True)
class CurveCampaign(Campaign):
    """A campaign whose curve is the user's own: its `[curve]` table and runs, read and checked.

    runs : run -> its table and columns.
    abscissas : how the formula calls each of several abscissas -> what it is; empty where there is
        one.
    run_units : run -> the units of its axes, those of its header where the campaign states none.
    """

    curve: Formula
    axes: AxisNames
    table: CurveTable
    runs: Mapping[str, RunOfCurve]
    model: ModelSum
    abscissas: Mapping[str, AxisTable]
    run_units: Mapping[str, Mapping[str, str]]
    _problems: dict[tuple[str, ...], Problem] = field(default_factory=dict, init=False, repr=False)

    @property
    def formula(self) -> str:
        return self.curve.text

    @property
    def x_column(self) -> str:
        return x_axes(self.table)[0].column

    @property
    def y_column(self) -> str:
        return y_axis(self.table).column

    def columns(self, names: Sequence[str]) -> str:
        sentences = (
            self.runs[name].columns_sentence(self.run_units[name], self.tables[name])
            for name in names
        )
        parameters = self._called_like_columns
        words = later("read as a parameter, although the table has a column of that name: {names}")
        return "; ".join(
            [*dict.fromkeys(sentences), *([phrase(words, names=parameters)] if parameters else [])]
        )

    @property
    def _called_like_columns(self) -> str:
        """Parameters that are called like a column that is not read, "" for none."""
        unread = {bare_name(column) for run in self.tables.values() for column in run.unread}
        return ", ".join(name for name in self.curve.names if name in unread)

    def _posed(
        self, names: Sequence[str], *, noise: NoiseTable | None = None, usual: bool = False
    ) -> Problem:
        """Raises InputError also where other noise is requested.

        usual : changes nothing: no default errors are known for a user's own axes
            (`[curve.shared_errors]` states them).
        """
        if noise is not None:
            raise self._only_noise()
        key = (language(), *names)  # of its labels
        if key not in self._problems:  # a search for starts may take seconds
            self._problems[key] = self._pose(names)
        return self._problems[key]

    def _pose(self, names: Sequence[str]) -> Problem:
        errors = self._components()
        with self.source.places.at(("curve", "expression")):
            for curve, axes in self._along_each():
                refuse_degrees(curve, axes)
        settings = {name: self._settings(self.runs[name]) for name in names}
        own = self._own(settings)
        runs = {name: rows_of(self.runs[name], self.tables[name]) for name in names}
        points = {name: rows.points(self.model, self._axes_of(name)) for name, rows in runs.items()}

        def pose(name: str, settings: ParameterSettings, **options: Any) -> CurveProblem:
            posed = runs[name].posed(points[name], settings, errors, **options)
            if posed.lacks is not None and posed.lacks.deviation and len(names) > 1:
                raise self.runs[name].error(
                    "does not go with a joint fit, which needs a deviation that runs share: "
                    "fit the runs one by one",
                    "deviation",
                )
            by_name = {p.name: p for p in posed.parameters}
            of_curve = [by_name.pop(symbol) for symbol in self.curve.names if symbol in by_name]
            called = (self._called(p, name) for p in of_curve)
            return replace(posed, parameters=(*called, *by_name.values()))

        arguments = dict.fromkeys(names, self.curve.names)
        parts = pose_sets(points, settings, arguments, own, pose, known_starts={})
        lacking = [name for name, part in parts.items() if part.lacks is not None]
        if lacking and any(part.further for part in parts.values()):
            raise self.runs[lacking[0]].error(
                "does not go with a joint fit in which errors of another run are inferred "
                "(jitter, robust): fit the runs one by one",
                "correlated",
            )
        common = [component.parameter_name for component in errors]
        joint = join(parts, own=own, common=common, same_size=True)
        if len(parts) > 1 and joint.y.size > MAX_ROWS:
            raise self.source.error(
                f"must be at most {MAX_ROWS} in a joint fit: say every = 2 or more, or fit the "
                "runs one by one",
                ("curve", "every"),
                field="points",
                value=joint.y.size,
            )
        return joint.posed(lambda name, part: runs[name].problem(part, self.axes))

    def _axes_of(self, name: str) -> AxisNames:
        units = self.run_units[name]
        return replace(self.axes, x_unit=units.get("x", "1"), y_unit=units["y"])

    def _own(self, settings: Mapping[str, ParameterSettings]) -> dict[str, set[str]]:
        """Run -> the unknowns that it shares with no other run, since it alone states something of
        them, or all other runs do.
        """
        unknown = {
            name: {*self.curve.names} - {*run_settings.fixed}
            for name, run_settings in settings.items()
        }
        own = {name: unknown[name] & {*self.runs[name].table.parameters} for name in settings}
        uses = Counter(argument for name in settings for argument in unknown[name] - own[name])
        if any(count > 1 for count in uses.values()):
            self._refuse_other_units([*settings])
        single = {argument for argument, count in uses.items() if count == 1 < len(settings)}
        return {name: own[name] | (unknown[name] & single) for name in settings}

    def _settings(self, run: RunOfCurve) -> ParameterSettings:
        """Those of the parameters of a run."""
        settings: dict[str, dict[str, Any]] = {
            field: {} for field in ("start", "bounds", "priors", "fixed", "units")
        }
        for name in self.curve.names:
            source, unit = self._source(name, run), run.word(name, "unit")
            if unit is not None:
                settings["units"][name] = unit
            if isinstance(source, float):
                settings["fixed"][name] = source
            elif is_unstarted(run.entry(name)):
                settings["bounds"][name] = number(source.low), number(source.high)
            else:
                settings["start"][name], settings["priors"][name] = source.centre, source
        return ParameterSettings(**settings)

    def _called(self, parameter: Parameter, run: str) -> Parameter:
        """A parameter of the curve with its unit and meaning."""
        name = parameter.name
        meaning = self.runs[run].word(name, "meaning") or parameter.meaning
        return replace(parameter, unit=self._unit_of(name, run), meaning=meaning)

    def _refuse_other_units(self, names: Sequence[str]) -> None:
        """Raises InputError where the headers of runs that share a parameter have other units."""
        for key in next(iter(self.run_units.values())):
            units = {name: unit for name in names if (unit := self.run_units[name][key]) != "1"}
            for name, unit in units.items():
                first, first_unit = next(iter(units.items()))
                if same_numbers(unit, first_unit) is False:
                    raise self.source.error(
                        f"is in {first_unit} by the header of run '{first}', in {unit} by that of "
                        f"'{name}': runs that share a parameter need one unit",
                        ("curve", key[:1]),
                    )

    def suspects(self, names: Sequence[str]) -> Suspects:
        """What a user's own curve may lack is not known; what the readings may suffer is, a
        displaced zero of either axis for instance.
        """
        room = phrase(
            "another curve may explain them; if this one is known to be right, the errors "
            "of successive readings may be "
            "correlated: allow for it (correlated)"
        )
        stated, errors = self._posed(names), self.table.errors
        zeros = {
            "zero_y": phrase(
                "a constant offset of y (+ c in the formula, + constant after a model)"
            ),
            "zero_x": phrase(
                "a displaced zero of {x} ({x} - x0 in the formula)", x=self.curve.variable
            ),
        }
        causes = []
        for kind in zeros if not (stated.counted or stated.runs[0].numbered) else ():
            reach = max(np.ptp(run.x if kind == "zero_x" else run.y) for run in stated.runs)
            if reach > 0.0 and kind not in errors:
                table = msgspec.structs.replace(self.table, errors={**errors, kind: float(reach)})
                problem = replace(self, table=table)._posed(names)
                causes.append(Cause(kind, zeros[kind], problem, (kind,), ()))
        return Suspects(stated, room, tuple(causes))

    def refuse_discrepancy(self, command: str) -> None:
        """Raises InputError where the campaign allows for a discrepancy of the curve, which
        `command` does not support.
        """
        for run in self.runs.values():
            run.refuse_discrepancy(command)

    def check(self, name: str) -> None:
        self._posed([name])

    def _unit_of(self, argument: str, name: str) -> str:
        """As stated nearest to the run, or as it follows from the axes."""
        follows = {
            name: unit
            for curve, axes in self._along_each()
            for name, unit in units_of(
                curve, axes, [argument], density=is_density(self.table)
            ).items()
        }
        return self.runs[name].word(argument, "unit") or follows.get(argument, "1")

    def _along_each(self) -> list[tuple[Formula, AxisNames]]:
        """The curve and its axes; of several abscissas along each, the others taken for parameters,
        or along x alone where that is one.
        """
        formula = read_formula(self.curve.text)
        axes = {name: replace(self.axes, x_unit=axis.unit) for name, axis in self.abscissas.items()}
        if "x" in axes:
            return [(formula, axes["x"])]
        each = [(formula.in_terms_of(name), along) for name, along in axes.items()]
        return each or [(self.curve, self.axes)]

    def noise_models(self, name: str) -> tuple[NoiseModel, ...]:
        """Raises InputError: the tables of a curve state one noise."""
        raise self._only_noise()

    def _only_noise(self) -> InputError:
        return self.source.error(
            "is fit with the noise that its own tables state: no other model to compare", ("curve",)
        )

    def _path_of_unknowns(self, name: str) -> KeyPath:
        return ("curve", "parameters")

    def require_draws(self, problem: Problem, *, of_priors: bool) -> None:
        """Raises InputError where data cannot be simulated, or (`of_priors`) the prior of a
        parameter is flat without limits, so that no true value can be drawn from it.
        """
        self.refuse_discrepancy("estim calibrate")
        if self.table.noise is not None and self.table.y is None:
            raise self.source.error(
                "is not supported by estim calibrate, which simulates counts, not times: count "
                'them in bins (model = "poisson") for that',
                ("curve", "noise"),
            )
        for parameter in problem.parameters if of_priors else ():
            if not math.isfinite(parameter.prior.sd):
                raise self.source.error(
                    "is flat without limits, so that no true value can be drawn from it: give it "
                    "limits (low and high), or a prior, or repeat the fitted values alone "
                    "(--what coverage)",
                    self._path_of(parameter.name),
                )

    def _placed(self, error: InputError, problem: Problem) -> InputError:
        """The error at its key or parameter; one of the search for an optimum at the first row at
        which alone the curve is not finite at the start.
        """
        if error.field in ("u_y", "expression"):
            return self.source.error(error.rule, ("curve", error.field))
        if error.field in problem.names:
            rule, column = error.rule, self._called_like_columns
            rule += (
                f" (to use the column {column} as an abscissa, name it with --x)" if column else ""
            )
            return self.source.error(rule, self._path_of(error.field))
        named = problem.named(problem.start())
        for run in problem.runs if self.table.noise is None else ():
            with np.errstate(all="ignore"):
                finite = np.isfinite(run.drawn(named))
            if np.any(finite) and not np.all(finite):
                table = self.tables[run.name]
                row = int(np.argmax(table.columns[self.x_column] == run.x[int(np.argmin(finite))]))
                return table.error(
                    "is where the curve is not finite, at the start and around: leave the "
                    "row out by a window",
                    self.x_column,
                    row,
                )
        places = self.source.places
        return error.at(places.file, places.lines.get(("curve", "parameters")))

    def _path_of(self, parameter: str) -> KeyPath:
        """Where a parameter stands in the campaign file."""
        name, _, level = parameter.partition("[")
        return self.runs[level[:-1]].path_of(name) if level else ("curve", "parameters", name)

    def _source(self, name: str, run: RunOfCurve) -> Prior | float:
        """A parameter of the formula for one run: the prior of an unknown, or an exact value."""
        entry = run.entry(name)
        if entry is None and not self.model.terms:
            raise self.source.error(
                f"is missing for run '{run.table.name}': say it under [curve.parameters] or "
                f"[runs.parameters], as {name} = {{start = 1.0}}, or "
                f"{name} = {{}}",
                ("curve", "parameters"),
                field=name,
            )
        try:
            return source_of(
                ParameterTable() if entry is None else entry,
                name,
                self.model.limits.get(name, (None, None)),
            )
        except InputError as error:
            rule = error.rule if error.field in (None, name) else f"'{error.field}' {error.rule}"
            raise self.source.error(rule, run.path_of(name), value=error.value) from None

    def _components(self) -> tuple[Component, ...]:
        components = []
        for name, written in self.table.errors.items():
            try:
                kind, u, groups = (
                    (name, written, None)
                    if isinstance(written, float | int)
                    else (written.kind, written.u, written.groups)
                )
                components.append(Component(kind, float(u), name, groups))
            except InputError as error:
                raise self.source.error(
                    f"'{error.field}' {error.rule}", ("curve", "errors", name), value=error.value
                ) from None
        return tuple(components)


def read_curve_campaign(
    source: CampaignFile, table: CurveTable, *, only: Collection[str]
) -> CurveCampaign:
    """The campaign of a curve of the user's own, with the tables of the runs `only`.

    Raises InputError with file, line, field, rule and value for whatever breaks a rule.
    """
    table = _with_names(table, source.places, ("curve",))
    runs = tuple(
        _with_names(run, source.places, ("runs", i)) for i, run in enumerate(source.curve_runs)
    )
    formula, named = read_curve(source, table)
    check_counts(source, table)
    check_words(source, table, runs)
    formula, abscissas = with_variable(source, formula, table, runs)
    check_parameters(source, formula, table, runs)
    if abscissas:
        table = msgspec.structs.replace(table, x=NUMBER)
    every = {run.name: RunOfCurve(source, table, run, i, abscissas) for i, run in enumerate(runs)}
    read = {name: run.read() for name, run in every.items() if name in only}
    run_units = {name: every[name].units_of(data) for name, data in read.items()}
    x, y = (
        _named(axis, {units.get(key, "1") for units in run_units.values()})
        for key, axis in (("x", x_axes(table)[0]), ("y", y_axis(table)))
    )
    axes = AxisNames(*x, *y)
    tables = {
        name: replace(run_of_table(data, name), warnings=of_any_curve(data.warnings))
        for name, data in read.items()
    }
    return CurveCampaign(
        source,
        MappingProxyType(tables),
        curve=formula,
        axes=axes,
        table=table,
        runs=MappingProxyType(every),
        model=ModelSum("", formula) if named is None else named,
        abscissas=MappingProxyType(abscissas),
        run_units=MappingProxyType(run_units),
    )


def _named(axis: AxisTable, units: Collection[str]) -> tuple[str, str]:
    """Name and unit of an axis; units : those of the runs, by their headers."""
    if axis.unit != "1" or len(units) != 1 or "1" in units:
        return axis.name or axis.column, axis.unit
    return axis.name or bare_name(axis.column), next(iter(units))


def _with_names(table: Keys, places: Places, path: KeyPath) -> Keys:
    """A table with the names of its parameters as Python reads them in a formula (the micro sign is
    the letter mu).  Raises InputError.
    """
    named = dict[str, Any]()
    for name, entry in table.parameters.items():
        read = unicodedata.normalize("NFKC", name)
        if read in named:
            raise places.error(
                "is the same name as another in a formula", (*path, "parameters", name)
            )
        named[read] = entry
    return msgspec.structs.replace(table, parameters=named)
