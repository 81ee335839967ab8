"""Starting values that are found from the points: of a `[curve]` that names its model, and of a formula's parameters that give none.

    [curve]
    model = "left_gaussian + right_gaussian + line"

Parameters of a model need not be declared, those of a formula must be; an entry with neither start, value nor prior
(`left_center = {unit = "nm"}`) says the level, unit and meaning.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import msgspec

from estim.campaign.campaign_file import CampaignFile
from estim.campaign.curve_tables import CurveTable, ParameterTable, refuse_keys
from estim.common import InputError
from estim.curves import Formula, ModelSum, Unstarted, provisional, read_formula, read_model, with_starts
from estim.problem import Flat, Observations, Parameter


def read_curve(source: CampaignFile, table: CurveTable) -> tuple[Formula, ModelSum | None]:
    """The formula of a `[curve]` table, and the models that it names, if it does.  Raises InputError with its line."""
    if (table.expression is None) == (table.model is None):
        rule = "must have an 'expression', or a 'model' like \"gaussian + line\"" + ("" if table.model is None else ", not both")
        raise source.places.error(rule, ("curve",))
    key = "expression" if table.model is None else "model"
    try:
        named = None if table.model is None else read_model(table.model)
        return read_formula(table.expression if named is None else named.expression), named
    except InputError as error:
        raise source.places.error(error.rule, ("curve", key), value=error.value) from None


def is_to_be_found(asked: Unstarted, entry: object) -> bool:
    """Whether an entry of `parameters` (None: there is none) leaves the start to the points."""
    if entry is None:
        return isinstance(asked, ModelSum)
    return isinstance(entry, ParameterTable) and entry.start is None and entry.value is None and entry.prior is None


def unknown_of(asked: Unstarted, name: str, entry: object) -> Flat:
    """The prior of a parameter whose start is to be found: flat within the limits of the entry, or of the model."""
    low, high = asked.limits.get(name, (None, None))
    if isinstance(entry, ParameterTable):
        refuse_keys(entry, ("mean", "sd", "scale", "median", "log_sd"), "goes with a 'prior'")
        low, high = low if entry.low is None else entry.low, high if entry.high is None else entry.high
    start, limits = provisional(asked, {}, {name: (low, high)}, (), ())
    low, high = limits[name]
    return Flat(float("-inf") if low is None else low, float("inf") if high is None else high, start[name])


def within_limits(asked: Unstarted, name: str, entry: float | str | ParameterTable) -> float | str | ParameterTable:
    """An entry with a start keeps to the limits of its model, where it states none itself."""
    if not isinstance(entry, ParameterTable) or entry.start is None:
        return entry
    low, high = asked.limits.get(name, (None, None))
    return msgspec.structs.replace(entry, low=low if entry.low is None else entry.low, high=high if entry.high is None else entry.high)


def started_runs(
    asked: Unstarted, parameters: Sequence[Parameter], runs: Sequence[Observations], sought: Collection[str]
) -> tuple[Parameter, ...]:
    """`parameters` with starts for those `sought`: from the points of the first run that has them.  Raises InputError."""
    found = {p.name: p for p in parameters}
    left = set(sought)
    for run in runs:
        names = {argument: source for argument, source in run.arguments.items() if isinstance(source, str) and source in found}
        here = {argument for argument, source in names.items() if source in left}
        if not here:
            continue
        own = tuple(replace(found[source], name=argument) for argument, source in names.items())
        known = {argument: value for argument, value in run.arguments.items() if not isinstance(value, str)}
        bins = None if run.noise.counted is None else run.noise.counted.bins
        for one in with_starts(asked, own, here, run.x, run.y, run.noise.reading_gain(), bins, known=known):
            found[names[one.name]] = replace(one, name=names[one.name])
        left -= {names[argument] for argument in here}
    return tuple(found[p.name] for p in parameters)

