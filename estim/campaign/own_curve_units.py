"""Units of a `[curve]` against each other: what the axes say, the headers of the tables, and the parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from estim.campaign.campaign_file import CampaignFile
from estim.campaign.curve_tables import CurveRunTable, CurveTable, ParameterTable, Place, axis_of, y_axis
from estim.campaign.own_curve_counts import is_density
from estim.common import InputError, same_unit
from estim.curves import AxisNames, Formula, contradiction, refuse_degrees, units_of
from estim.reading import Table


def units_of_curve(
    source: CampaignFile, formula: Formula, axes: AxisNames, table: CurveTable, runs: Sequence[CurveRunTable]
) -> Mapping[str, str]:
    """Parameter -> unit, of those where the axes say it.

    Raises InputError where a parameter is said to be in another unit, or a cosine takes degrees.
    """
    try:
        refuse_degrees(formula, axes, "expression")
    except InputError as error:
        raise source.places.error(error.rule, ("curve", "expression" if table.model is None else "model"), value=error.value) from None
    levels: list[tuple[Place, CurveTable | CurveRunTable]] = [(("curve",), table), *((("runs", i), run) for i, run in enumerate(runs))]
    for path, level in levels:
        for name, entry in level.parameters.items():
            if isinstance(entry, ParameterTable) and entry.unit is not None:
                number = entry.start if entry.start is not None else entry.value
                rule = contradiction(formula, axes, name, entry.unit, density=is_density(table), number=number)
                if rule is not None:
                    raise source.places.error(rule, (*path, "parameters", name), value=entry.unit)
    return MappingProxyType(units_of(formula, axes, formula.names, density=is_density(table)))


def check_axes(source: CampaignFile, curve: CurveTable, table: Table) -> None:
    """Raises InputError where the campaign says another unit of a column than its header."""
    for key, axis in (("x", axis_of(curve.x)), ("y", y_axis(curve))):
        stated = table.units.get(axis.column, "")
        if axis.unit != "1" and stated and same_unit(axis.unit, stated) is False:
            rule = f"must be in {stated}, as the header of {table.file} says; nothing is converted"
            raise source.places.error(rule, ("curve", key), value=axis.unit)
