"""Units of a `[curve]` against each other: what the axes say, the headers of the tables, and the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from estim.campaign.campaign_file import CampaignFile
from estim.campaign.curve_tables import CurveRunTable, CurveTable, ParameterTable, Place, axis_of, y_axis
from estim.campaign.own_curve_counts import is_density
from estim.common import InputError, same_unit
from estim.curves import AxisNames, Formula, contradiction, refuse_degrees, units_of
from estim.reading import Table


def units_of_curve(formula: Formula, axes: AxisNames, table: CurveTable) -> Mapping[str, str]:
    """Parameter -> unit, of those where the axes say it."""
    return MappingProxyType(units_of(formula, axes, formula.names, density=is_density(table)))


def check_units_of_curve(
    source: CampaignFile, formula: Formula, axes: AxisNames, table: CurveTable, runs: Sequence[CurveRunTable], told: Mapping[str, AxisNames]
) -> None:
    """Raises InputError where a parameter is said to be in another unit than its axes say, or a cosine takes degrees.  told : run -> its axes."""
    common: tuple[Place, CurveTable | CurveRunTable] = (("curve",), table)
    own = [(("runs", i), run) for i, run in enumerate(runs)]
    for one, levels in [*((told[run.name], (common, (path, run))) for path, run in own if run.name in told), (axes, (common, *own))]:
        try:
            refuse_degrees(formula, one, "expression")
        except InputError as error:
            raise source.places.error(error.rule, ("curve", "expression" if table.model is None else "model"), value=error.value) from None
        for path, level in levels:
            for name, entry in level.parameters.items():
                if isinstance(entry, ParameterTable) and entry.unit is not None:
                    number = entry.start if entry.start is not None else entry.value
                    rule = contradiction(formula, one, name, entry.unit, density=is_density(table), number=number)
                    if rule is not None:
                        raise source.places.error(rule, (*path, "parameters", name), value=entry.unit)


def axes_of_run(source: CampaignFile, curve: CurveTable, axes: AxisNames, table: Table) -> AxisNames:
    """The axes of a run, with the units of its header where the campaign says none.  Raises InputError where it says another."""
    found = []
    for key, axis in (("x", axis_of(curve.x)), ("y", y_axis(curve))):
        stated = table.units.get(axis.column, "")
        if axis.unit != "1" and stated and same_unit(axis.unit, stated) is False:
            where = f"the header of {table.file}" if table.header_line else table.file
            rule = f"must be in {stated}, as {where} says; nothing is converted"
            raise source.places.error(rule, ("curve", key), value=axis.unit)
        found.append(stated if stated and axis.unit == "1" else axis.unit)
    return replace(axes, x_unit=found[0], y_unit=found[1])


def refuse_other_units(source: CampaignFile, told: Mapping[str, AxisNames]) -> None:
    """Raises InputError where the headers of runs that share a parameter have other units.  told : run -> its axes."""
    for key in ("x", "y"):
        units = {name: unit for name, axes in told.items() if (unit := axes.x_unit if key == "x" else axes.y_unit) != "1"}
        for name, unit in units.items():
            first, wanted = next(iter(units.items()))
            if same_unit(unit, wanted) is False:
                rule = f"is in {wanted} by the header of run '{first}', in {unit} by that of '{name}': runs that share a parameter need one unit"
                raise source.places.error(rule, ("curve", key))
