"""The file of a measurement model: TOML to formulas, inputs and their correlations, every mistake
with its line.

`docs/propagation.md` explains the format to its users.
"""

from __future__ import annotations

import difflib
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from estim.arrays import all_finite
from estim.campaign import KeyTable, checked
from estim.common import InputError, read_with_unit
from estim.curves import RESERVED, Formula, evaluate, read_formula, unit_that_follows
from estim.measurement_model.input_tables import InputTable, inputs_of
from estim.propagation import Input, IntervalKind
from estim.reading import TOML_BYTES, KeyPath, Places, parse_toml, read_text

_MOST_INPUTS, _MOST_OUTPUTS = 60, 12
_NO_FILE = "command line"


class _OutputTable(KeyTable, frozen=True, kw_only=True):
    formula: str
    unit: str | None = None
    meaning: str = ""
    name: str | None = None


class _CorrelationTable(KeyTable, frozen=True, kw_only=True):
    between: list[str]
    r: Annotated[float, Meta(ge=-1.0, le=1.0)]


class _TopTable(msgspec.Struct, forbid_unknown_fields=True, frozen=True, kw_only=True):
    title: str = ""
    source: str = ""
    measurand: dict[str, Any]
    inputs: dict[str, InputTable]
    correlations: list[_CorrelationTable] = []
    simultaneous: list[list[str]] = []
    simultaneous_dof: Literal["n - 1", "n - N"] = "n - 1"
    probability: Annotated[float, Meta(ge=0.5, le=0.9999)] = 0.95
    digits: Annotated[int, Meta(ge=1, le=4)] = 2
    interval: Literal["symmetric", "shortest"] = "symmetric"
    draws: Annotated[int, Meta(ge=10_000, le=10_000_000)] | None = None


@dataclass(frozen=True, eq=False)
class Output:
    """A measurand.  unit : "1" for a number, and where none was stated and none follows.  stated :
    the unit that was stated, if any.
    """

    name: str
    formula: Formula
    unit: str
    meaning: str
    stated: str | None


@dataclass(frozen=True, eq=False)
class InputQuantity:
    """An input of the formulas: the sum of `parts`, independent inputs of the propagation, the
    first of which holds the value.
    """

    name: str
    unit: str
    parts: tuple[Input, ...]
    meanings: tuple[str, ...]  # of the parts


@dataclass(frozen=True, eq=False)
class MeasurementModel:
    """A measurement model as read.

    correlation : of the parts of all quantities, in their order, None where there is none.
    digits : of u, to which the Monte Carlo settles and the GUM interval is tested.
    draws : how many, None for as many as that takes.  interval : the Monte-Carlo interval that is
        quoted.
    """

    path: Path
    sha256: str
    title: str
    source: str
    outputs: tuple[Output, ...]
    quantities: tuple[InputQuantity, ...]
    correlation: Mapping[tuple[str, str], float] | None
    probability: float
    digits: int
    draws: int | None
    interval: IntervalKind

    @property
    def inputs(self) -> tuple[Input, ...]:
        return tuple(part for quantity in self.quantities for part in quantity.parts)

    def values(self, q: Mapping[str, Any]) -> list[Any]:
        """Outputs at values of the inputs, numbers or arrays; a formula sees the outputs
        before it.
        """
        symbols = {
            quantity.name: sum(
                (q[part.name] for part in quantity.parts[1:]), start=q[quantity.name]
            )
            for quantity in self.quantities
        }
        results = []
        for output in self.outputs:
            symbols[output.name] = evaluate(output.formula.tree, symbols)
            results.append(symbols[output.name])
        return results


def read_model(path: Path) -> MeasurementModel:
    """The measurement model in the TOML file at `path`.  Raises InputError with file, line, key,
    rule and value.
    """
    text, digest = read_text(path, limit=TOML_BYTES)
    return _model_of(*parse_toml(text, str(path)), path, digest)


def model_of_formula(formula: str, given: Mapping[str, str]) -> MeasurementModel:
    """The model "g = 4*pi**2*L/T**2", or without a name, of the inputs {"L": "0.85(1) m"}.

    Raises InputError with field, rule and value.
    """
    name, mark, text = (part.strip() for part in formula.rpartition("="))
    if not mark:
        name = "result" if "y" in given else "y"
    tree = {"measurand": {"formula": text, "name": name}, "inputs": given}
    digest = hashlib.sha256(repr((formula, given)).encode()).hexdigest()
    return _model_of(tree, Places(_NO_FILE, {}), Path(_NO_FILE), digest, title=formula)


def _model_of(
    tree: dict[str, Any], places: Places, path: Path, digest: str, title: str = ""
) -> MeasurementModel:
    inputs = tree.get("inputs")
    if isinstance(inputs, Mapping):
        tables = {name: _input_table(name, stated, places) for name, stated in inputs.items()}
        tree = {**tree, "inputs": tables}
    top = checked(tree, _TopTable, places, ())
    quantities = tuple(_quantity(name, table, places) for name, table in top.inputs.items())
    if not 1 <= sum(len(quantity.parts) for quantity in quantities) <= _MOST_INPUTS:
        raise places.error(
            f"must hold 1 to {_MOST_INPUTS} inputs, their components counted", ("inputs",)
        )
    outputs = _outputs(top, places)
    _check_names(outputs, quantities, places)
    outputs = _in_units(outputs, quantities, places)
    correlation = _correlations(top, quantities, places)
    _check_sets(top, places)
    quantities = tuple(_together(quantity, top) for quantity in quantities)
    return MeasurementModel(
        path,
        digest,
        top.title or title or path.stem,
        top.source,
        outputs,
        quantities,
        correlation,
        top.probability,
        top.digits,
        top.draws,
        top.interval,
    )


def _input_table(name: str, stated: Any, places: Places) -> dict[str, Any]:
    """The table of an input, of "0.85(1) m" too."""
    if isinstance(stated, dict):
        return stated
    if isinstance(stated, bool) or not isinstance(stated, str | int | float):
        rule = 'must be a value, as "0.85(1) m", or a table, as {value = 0.85, u = 0.01}'
        raise places.error(rule, ("inputs", name), value=stated)
    with places.at(("inputs", name)):
        quantity, unit = read_with_unit(stated, field=name)
    u = {} if quantity.exact else {"u": quantity.u}
    return {"value": quantity.value, "unit": unit, **u}


def _quantity(name: str, table: InputTable, places: Places) -> InputQuantity:
    _check_name(name, ("inputs", name), places)
    try:
        parts = inputs_of(name, table)
    except InputError as error:
        keys = str(error.field).removeprefix(f"{name}.").split(".")
        raise places.error(error.rule, ("inputs", name, *keys), value=error.value) from None
    meanings = (component.meaning for component in table.components.values())
    return InputQuantity(name, table.unit, parts, (table.meaning, *meanings))


def _outputs(top: _TopTable, places: Places) -> tuple[Output, ...]:
    """One table `[measurand]`, or several `[measurand.NAME]`."""
    alone = isinstance(top.measurand.get("formula"), str)
    tables = {str(top.measurand.get("name", "y")): top.measurand} if alone else top.measurand
    if not 1 <= len(tables) <= _MOST_OUTPUTS:
        raise places.error(
            f"must hold a formula, or 1 to {_MOST_OUTPUTS} tables [measurand.NAME]", ("measurand",)
        )
    outputs = []
    for name, raw in tables.items():
        path = ("measurand",) if alone else ("measurand", name)
        if not isinstance(raw, dict):
            raise places.error(
                "must be a table [measurand.NAME] with a formula, or stand beside 'formula'",
                path,
                field=f"measurand.{name}",
            )
        table = checked(raw, _OutputTable, places, path)
        if table.name is not None and not alone:
            raise places.error(
                "does not go with several measurands: the table has the name", (*path, "name")
            )
        _check_name(name, (*path, "name") if alone else path, places)
        with places.at((*path, "formula")):
            formula = read_formula(table.formula, field="formula")
        outputs.append(Output(name, formula, table.unit or "1", table.meaning, table.unit))
    return tuple(outputs)


def _check_name(name: str, path: KeyPath, places: Places) -> None:
    if (
        not name.isidentifier()
        or name.startswith("_")
        or (name in RESERVED and name != "x")
        or name == "power"
    ):
        raise places.error(
            "must be letters, digits and _, a letter first, and no constant or function of "
            "formulas (e, pi, sin, log, ...)",
            path,
            field="name",
            value=name,
        )


def _check_names(
    outputs: Sequence[Output], quantities: Sequence[InputQuantity], places: Places
) -> None:
    """Each formula names inputs and outputs above it, and every input is used."""
    known = [quantity.name for quantity in quantities]
    used: set[str] = set()
    for output in outputs:
        path = _place_of_formula(output, places)
        if output.name in known:
            raise places.error(
                "must not be the name of an input or of another measurand",
                path,
                field="name",
                value=output.name,
            )
        names = (*output.formula.names, *(("x",) if output.formula.uses_x else ()))
        for name in names:
            if name not in known:
                close = difflib.get_close_matches(name, known, n=1)
                hint = f"did you mean '{close[0]}'?" if close else "state its value"
                raise places.error(
                    f"names no input and no measurand above it ({hint})", path, value=name
                )
        if not names:
            raise places.error("must depend on an input", path, value=output.formula.text)
        used.update(names)
        known.append(output.name)
    for quantity in quantities:
        if quantity.name not in used:
            raise places.error(
                "is in no formula", ("inputs", quantity.name), field=f"inputs.{quantity.name}"
            )


def _in_units(
    outputs: Sequence[Output], quantities: Sequence[InputQuantity], places: Places
) -> tuple[Output, ...]:
    """The outputs with the units that follow where none were stated.  Raises InputError where a
    stated one is another, or a sine takes degrees.
    """
    units, completed = {quantity.name: quantity.unit for quantity in quantities}, []
    for output in outputs:
        symbols = {name: name for name in (*output.formula.names, "x")}
        try:
            unit = unit_that_follows(output.formula.tree, symbols, units, output.stated)
        except InputError as error:
            path = _place_of_formula(output, places)
            raise places.error(
                error.rule,
                path if error.value is None else (*path[:-1], "unit"),
                value=error.value or output.formula.text,
            ) from None
        completed.append(replace(output, unit=unit))
        units[output.name] = unit
    return tuple(completed)


def _place_of_formula(output: Output, places: Places) -> tuple[str, ...]:
    return (
        ("measurand", output.name, "formula")
        if ("measurand", output.name) in places.lines
        else ("measurand", "formula")
    )


def _correlations(
    top: _TopTable, quantities: Sequence[InputQuantity], places: Places
) -> dict[tuple[str, str], float] | None:
    """Stated correlations, and those of readings that were taken together (GUM 5.2.3, eq. 17)."""
    parts = {part.name: part for quantity in quantities for part in quantity.parts}
    pairs: dict[tuple[str, str], float] = {}
    entries: list[tuple[list[str], float, KeyPath]] = []
    entries += [
        (correlation.between, correlation.r, ("correlations", i))
        for i, correlation in enumerate(top.correlations)
    ]
    for i, group in enumerate(top.simultaneous):
        entries += [
            ([a, b], r, ("simultaneous", i))
            for (a, b), r in _of_readings(top, group, places, ("simultaneous", i)).items()
        ]
    for between, r, path in entries:
        if len(between) != 2 or between[0] == between[1]:
            raise places.error("must name two inputs", (*path, "between"), value=", ".join(between))
        for name in between:
            if name not in parts or parts[name].u == 0.0:
                raise places.error(
                    'must name inputs with an uncertainty of their own (a component as "input: '
                    'component")',
                    (*path, "between"),
                    value=name,
                )
        if tuple(between) in pairs or tuple(reversed(between)) in pairs:
            raise places.error(
                "must give each pair once", (*path, "between"), value=", ".join(between)
            )
        pairs[between[0], between[1]] = r
    return pairs or None


def _check_sets(top: _TopTable, places: Places) -> None:
    """n - N degrees of freedom must be left (JCGM 102, 5.3.2)."""
    if top.simultaneous_dof == "n - 1":
        return
    if not top.simultaneous:
        raise places.error(
            "needs 'simultaneous'", ("simultaneous_dof",), value=top.simultaneous_dof
        )
    for group in top.simultaneous:
        n = len(top.inputs[group[0]].readings or [])
        if n <= len(group):
            raise places.error(
                f"needs more sets of readings than inputs, here {n} sets of {len(group)}",
                ("simultaneous_dof",),
            )


def _together(quantity: InputQuantity, top: _TopTable) -> InputQuantity:
    """The quantity, its readings marked as taken together with those of its group."""
    at = next((i for i, group in enumerate(top.simultaneous) if quantity.name in group), None)
    if at is None:
        return quantity
    base, *others = quantity.parts
    joint_dof = (
        base.dof + 1.0 - len(top.simultaneous[at]) if top.simultaneous_dof == "n - N" else 0.0
    )
    return replace(
        quantity, parts=(replace(base, group=f"readings {at}", joint_dof=joint_dof), *others)
    )


def _of_readings(
    top: _TopTable, group: Sequence[str], places: Places, path: KeyPath
) -> dict[tuple[str, str], float]:
    lists = []
    for name in group:
        if sum(name in other for other in top.simultaneous) > 1 or list(group).count(name) > 1:
            raise places.error("must name each input once", path, value=name)
        readings = top.inputs[name].readings if name in top.inputs else None
        if readings is None:
            raise places.error("must name inputs that are given by readings", path, value=name)
        lists.append(readings)
    if len(group) < 2 or len({len(readings) for readings in lists}) != 1:
        raise places.error(
            "must name two inputs or more with equally many readings", path, value=", ".join(group)
        )
    with np.errstate(all="ignore"):
        matrix = np.corrcoef(np.array(lists, dtype=float))
    if not all_finite(matrix) or any(len(set(readings)) == 1 for readings in lists):
        raise places.error("must name inputs whose readings scatter", path, value=", ".join(group))
    return {
        (group[i], group[j]): float(matrix[i, j]) for i, j in combinations(range(len(group)), 2)
    }
