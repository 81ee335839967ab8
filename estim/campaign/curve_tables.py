"""The tables of a campaign file that define a user's own curve: what goes together in them.

`estim.campaign.curve_campaign` gives them meaning.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import msgspec

from estim.campaign.campaign_file import CampaignFile
from estim.campaign.curve_keys import (
    AxisTable,
    CurveKeys,
    CurveRunTable,
    CurveTable,
    EventsTable,
    ParameterTable,
    PoissonTable,
    ReadingErrorTable,
)
from estim.campaign.prior_table import PriorKeys, read_source
from estim.common import InputError, phrase
from estim.curves import SIGMA, Formula, Limits, ModelSum, read_formula, read_model, within
from estim.problem import Flat, Prior
from estim.reading import KeyPath, Places, bare_name

_NAME = re.compile(r"[^\s$|\\`][^$|\\`\n]{0,39}")
_PATTERNS = {
    "unit": re.compile(r"[^\s$|\\`][^$|\\`\n]{0,19}"),
    "name": _NAME,
    "symbol": _NAME,
    "meaning": re.compile(r"[^|\n`]{1,120}"),
}


def _levels(table: CurveTable, runs: Sequence[CurveRunTable]) -> list[tuple[KeyPath, CurveKeys]]:
    """The tables that may apply to a run, with their places."""
    return [(("curve",), table), *((("runs", i), run) for i, run in enumerate(runs))]


def axis_of(written: AxisTable | str) -> AxisTable:
    return AxisTable(written) if isinstance(written, str) else written


def x_axes(table: CurveTable) -> tuple[AxisTable, ...]:
    """What x is, or each of several abscissas."""
    return tuple(map(axis_of, table.x if isinstance(table.x, list) else [table.x]))


def y_axis(table: CurveTable) -> AxisTable:
    """What y is; of single events, which have none, the numbers that figures show."""
    return axis_of(table.y) if table.y is not None else AxisTable("", phrase("events per cell"))


def check_printable(places: Places, path: KeyPath, words: Mapping[str, str | None]) -> None:
    """Raises InputError where one of the `words` of a quantity (what it is: the word, None where it
    was not stated) is long, or holds a mark but blanks that is invisible.
    """
    for what, text in words.items():
        if text is not None and not (
            _PATTERNS[what].fullmatch(text) and " ".join(text.split()).isprintable()
        ):
            *others, last = words
            raise places.error(
                f"must have a short {', '.join(others)} and {last} that can be printed, without "
                "$ | \\ `",
                path,
                value=text,
            )


def check_words(source: CampaignFile, table: CurveTable, runs: Sequence[CurveRunTable]) -> None:
    x, y = x_axes(table), y_axis(table)
    for key, axis in (*(("x", axis) for axis in x), ("y", y)):
        words = {"name": axis.name or axis.column, "unit": axis.unit}
        check_printable(source.places, ("curve", key), words)
    if y.column in (axis.column for axis in x):
        raise source.error("must name another column than x", ("curve", "y"), value=y.column)
    for path, level in _levels(table, runs):
        for key, error in (("u_y", level.u_y), ("u_x", level.u_x)):
            if not isinstance(error, ReadingErrorTable):
                continue
            stated = {
                name for name, value in msgspec.structs.asdict(error).items() if value is not None
            }
            columns = stated.difference(PriorKeys.__struct_fields__)
            if columns and columns < stated:
                raise source.error("must be a 'column' or have a 'prior', not both", (*path, key))
            if columns not in (set(), {"column"}) and (columns, key) != ({"minus", "plus"}, "u_y"):
                rule = "must be a 'column', or for y both 'minus' and 'plus'"
                raise source.error(rule, (*path, key))
        for name, entry in level.parameters.items():
            if isinstance(entry, ParameterTable):
                entry_words = {"unit": entry.unit, "meaning": entry.meaning}
                check_printable(source.places, (*path, "parameters", name), entry_words)


def with_variable(
    source: CampaignFile, formula: Formula, table: CurveTable, runs: Sequence[CurveRunTable]
) -> tuple[Formula, dict[str, AxisTable]]:
    """The formula with its abscissa: x, or a name that the column of x bears (t, where that is
    `t_s` or `time`) and no parameter has; and nothing, or how it calls each of several abscissas
    -> what it is.

    Raises InputError for a formula without x that has a parameter called like the abscissa, or
    several.
    """
    parameters = {*table.parameters, *(name for run in runs for name in run.parameters)}
    axis, *further = axes = x_axes(table)
    if further:
        with source.places.at(("curve", "x")):
            formula, symbols = of_several(
                formula, [(abscissa.column, abscissa.name) for abscissa in axes], parameters
            )
        return formula, dict(zip(symbols, axes, strict=True))
    variable = variable_of(formula, axis.column, axis.name, parameters)
    if variable is not None:
        return formula if variable == "x" else formula.in_terms_of(variable), {}
    abscissa_words = {"t", "time", *(word.lower() for word in _called(axis.column, axis.name))}
    misnamed = [name for name in formula.names if name.lower() in abscissa_words]
    if misnamed:
        raise source.error(
            f"must call its variable x, which is the column '{axis.column}' here: write x for "
            f"{misnamed[0]}",
            ("curve", "expression"),
            value=formula.text,
        )
    return formula, {}


def of_several(
    formula: Formula, axes: Sequence[tuple[str, str | None]], parameters: Collection[str]
) -> tuple[Formula, list[str]]:
    """A formula whose names are its parameters alone, and how it calls each of several abscissas,
    where none of the `parameters` is called so.  axes : the column and the name of each.

    Raises InputError where it calls one not, or by two names.
    """
    symbols = list[str]()
    for column, name in axes:
        free = {*formula.names, *("x" * formula.uses_x)} - {*parameters, *symbols}
        called = _called(column, name) & free
        if len(called) != 1:
            rule = "must appear in the formula under exactly one name"
            raise InputError(rule, field="x", value=column, quoted=formula.text)
        symbols += called
    return replace(formula, names=tuple(n for n in formula.names if n not in symbols)), symbols


def variable_of(
    formula: Formula, column: str, name: str | None, parameters: Collection[str]
) -> str | None:
    """How a formula calls its abscissa: x, or else as its `column` or its `name` is called, where
    none of the `parameters` is; None where it does not.
    """
    if formula.uses_x:
        return "x"
    called = [
        symbol
        for symbol in formula.names
        if symbol in _called(column, name) and symbol not in parameters
    ]
    return called[0] if len(called) == 1 else None


def _called(column: str, name: str | None) -> set[str]:
    words = {column, column.partition("_")[0], bare_name(column), *(name or "").split()}
    return words | (
        {"t"}
        if any(word.lower() == "t" or word.lower().startswith(("time", "zeit")) for word in words)
        else set()
    )


def read_curve(source: CampaignFile, table: CurveTable) -> tuple[Formula, ModelSum | None]:
    """The formula of a `[curve]` table, and the models that it names, if it does.  Raises
    InputError with its line.
    """
    if (table.expression is None) == (table.model is None):
        rule = "must have an 'expression', or a 'model' like \"gaussian + line\"" + (
            "" if table.model is None else ", not both"
        )
        raise source.error(rule, ("curve",))
    key = "expression" if table.model is None else "model"
    with source.places.at(("curve", key)):
        named = None if table.model is None else read_model(table.model)
        return read_formula(table.expression) if named is None else named.formula, named


def is_density(table: CurveTable) -> bool | None:
    """Whether the curve is y per unit of x; None where it is known up to a factor."""
    if isinstance(table.noise, EventsTable):
        return None
    return isinstance(table.noise, PoissonTable) and table.noise.bins is not None


def check_counts(source: CampaignFile, table: CurveTable) -> None:
    """Raises InputError where y is missing, or is stated beside times of single events."""
    events = isinstance(table.noise, EventsTable)
    if table.y is None and not events:
        raise source.error("is missing", ("curve", "y"))
    if events and table.y is not None:
        raise source.error("must be left out where x are times of single events", ("curve", "y"))


def check_parameters(
    source: CampaignFile, formula: Formula, table: CurveTable, runs: Sequence[CurveRunTable]
) -> None:
    for path, level in _levels(table, runs):
        for name in level.parameters:
            if name not in formula.names:
                raise source.error(
                    f"is not in the formula ({', '.join(formula.names)})",
                    (*path, "parameters", name),
                )
    for name in table.errors:
        if not name.isidentifier() or name in formula.names or name.startswith(SIGMA):
            raise source.error("must be a name that no parameter has", ("curve", "errors", name))


def is_unstarted(entry: float | str | ParameterTable | None) -> bool:
    """Whether an entry of `parameters` (None: there is none) leaves the start to the points."""
    return entry is None or (
        isinstance(entry, ParameterTable)
        and entry.start is None
        and entry.value is None
        and entry.prior is None
    )


def source_of(
    value: float | str | ParameterTable, field: str, limits: Limits = (None, None)
) -> float | Prior:
    """An exact number, or the prior of an unknown; limits : of the model that has it, which hold
    where the entry states none.
    """
    of_prior = ("mean", "sd", "scale", "median", "log_sd")
    if isinstance(value, ParameterTable) and value.prior is not None:
        refuse_keys(value, ("start", "value"), "must not stand beside 'prior'")
    elif isinstance(value, ParameterTable) and value.value is not None:
        refuse_keys(value, ("start", "low", "high", *of_prior), "must not stand beside 'value'")
        value = value.value
    elif isinstance(value, ParameterTable):
        refuse_keys(value, of_prior, "requires a 'prior'")
        low, high = (
            known if stated is None else stated
            for stated, known in zip((value.low, value.high), limits, strict=True)
        )
        start = within((low, high)) if value.start is None else value.start
        return Flat(-math.inf if low is None else low, math.inf if high is None else high, start)
    return read_source(value, field=field)


def refuse_keys(table: ParameterTable, keys: Sequence[str], rule: str) -> None:
    """Raises InputError where one of the keys is stated."""
    for key in keys:
        if getattr(table, key) is not None:
            raise InputError(rule, field=key)
