"""Two results side by side: what went in, and by how much each estimate moved."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from estim.common import InputError, Json, Quantity, listed
from estim.verification.comparing import entries_of, estimate_in, short

_LAYERS = ("parameters", "derived", "outputs", "coefficients")  # keys that are left out of a name
_METHODS = {"GUM": "gum", "Monte Carlo": "monte_carlo"}  # quoted -> where it stands
_INPUTS = ("schema", "kind", "formula", "status", "statuses", "provenance")


@dataclass(frozen=True)
class Moved:
    """One estimate in both results."""

    name: str
    unit: str
    first: tuple[float, float]
    second: tuple[float, float]

    @property
    def shift(self) -> float:
        """Second minus first in sds of the first."""
        change, sd = self.second[0] - self.first[0], self.first[1]
        return change / sd if sd > 0.0 else math.copysign(math.inf, change) if change else 0.0


@dataclass(frozen=True)
class ResultPair:
    """inputs : words on what differs of what went in, and on the status.  estimates : of both,
    those that moved most first.  lost, gained : estimates that only the first or only the second
    has, or that have another unit there.
    """

    inputs: tuple[str, ...]
    estimates: tuple[Moved, ...]
    lost: tuple[str, ...]
    gained: tuple[str, ...]


def compare_results(first: Json, second: Json) -> ResultPair:
    """Two `result.json` of any kind, decoded."""
    a, b = (
        {(estimate.name, estimate.unit or "1"): estimate.value for estimate in estimates(record)}
        for record in (first, second)
    )
    both = [Moved(*key, a[key], b[key]) for key in a if key in b]
    lost, gained = (
        tuple(
            name if unit == "1" else f"{name} ({unit})"
            for name, unit in one
            if (name, unit) not in other
        )
        for one, other in ((a, b), (b, a))
    )
    inputs = tuple(
        f"{entry.where} differs"
        if "sha256" in entry.where
        else f"{entry.where}: {short(entry.before)} and {short(entry.now)}"
        for key in _INPUTS
        for entry in entries_of(key, first.get(key), second.get(key))
        if entry.change > 0.0
    )
    both.sort(key=lambda estimate: -abs(estimate.shift))
    return ResultPair(inputs, tuple(both), lost, gained)


def only_estimate(record: Json) -> tuple[Quantity, str, float]:
    """The one estimate of a decoded `result.json`, its unit, and the degrees of freedom of its
    uncertainty.

    Raises InputError where it has several, or none.
    """
    entries = list(estimates(_table(record, "outputs") or record))
    if len(entries) != 1:
        raise InputError(
            "must have one estimate, to be compared with a value",
            field="result",
            quoted=listed(sorted(estimate.name for estimate in entries)),
        )
    return Quantity(*entries[0].value), entries[0].unit or "1", entries[0].dof


@dataclass(frozen=True)
class _Estimate:
    """name : for people.  value : with its standard deviation or standard uncertainty.  dof : inf
    where none are stated.
    """

    name: str
    unit: str
    value: tuple[float, float]
    dof: float


def estimates(node: object, name: str = "", unit: str = "") -> Iterator[_Estimate]:
    """Every value with its uncertainty in a decoded `result.json` of any kind, mean and sd, or
    value and u, wherever they stand together; of several methods for one value that which the
    report quotes.

    name, unit : of what `node` is a part; the unit may stand further out.
    """
    if not isinstance(node, dict):
        return
    unit = node["unit"] if isinstance(node.get("unit"), str) else unit
    if (value := estimate_in(node)) is not None:
        dof = node.get("dof")
        if not isinstance(dof, (int, float)) or not dof > 0.0:
            dof = math.inf
        yield _Estimate(name, unit, value, dof)
        return
    averages, methods = _table(node, "averages"), [_METHODS.get(str(node.get("quoted")), "")]
    if averages:
        node, methods, name = averages, [str(node.get("recommended"))], name or "mean"
    for key in methods:
        if key in node:
            yield from estimates(node[key], name, unit)
            return
    for key, inner in node.items():
        shown = name if key in _LAYERS else f"{name}.{key}" if name else key
        yield from estimates(inner, shown, unit)


def _table(record: Json, key: str) -> Json:
    """A table in a record, which somebody may have written by hand."""
    entry = record.get(key)
    return entry if isinstance(entry, dict) else {}
