"""Two results side by side: what went in, and by how much each estimate moved."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from estim.common import InputError, Json, Quantity, in_unit, listed, same_numbers
from estim.verification.comparing import different_values, estimate_in

_LAYERS = ("parameters", "derived", "outputs", "coefficients")  # keys that are left out of a name
_METHODS = {"GUM": "gum", "Monte Carlo": "monte_carlo"}  # quoted -> where it stands
_LISTED = ("schema", "kind", "formula", "status", "provenance")  # listed as inputs


@dataclass(frozen=True)
class Moved:
    """One estimate in both results.  shift : second minus first in sds of the first."""

    name: str
    unit: str
    first: tuple[float, float]
    second: tuple[float, float]

    @property
    def shift(self) -> float:
        return (self.second[0] - self.first[0]) / self.first[1] if self.first[1] > 0.0 else math.nan

    @property
    def ratio(self) -> float:
        """sd of the second over that of the first."""
        return self.second[1] / self.first[1] if self.first[1] > 0.0 else math.nan


@dataclass(frozen=True)
class ResultPair:
    """inputs : words on what went into one and not into the other, or differs, and on the status.
    estimates : of both, those that moved most first.

    others : where else they differ, in notes and tests, say.
    lost, gained : estimates that only the first or only the second has.
    """

    inputs: tuple[str, ...]
    estimates: tuple[Moved, ...]
    others: tuple[str, ...]
    lost: tuple[str, ...]
    gained: tuple[str, ...]

    @property
    def same(self) -> bool:
        return not (self.inputs or self.others or self.lost or self.gained) and all(
            estimate.first == estimate.second for estimate in self.estimates
        )


def compare_results(first: Json, second: Json) -> ResultPair:
    """Two `result.json` of any kind, decoded."""
    a, b = (
        {estimate.name: estimate for estimate in estimates(record)} for record in (first, second)
    )
    # how many of the unit of the first one of the second is; None where that is not known
    units = {
        name: 1.0
        if unit == estimate.unit or same_numbers(unit, estimate.unit)
        else in_unit(1.0, unit, estimate.unit)
        for name, estimate in a.items()
        if name in b
        for unit in [b[name].unit]
    }
    both = [
        Moved(name, a[name].unit, a[name].value, (size * b[name].value[0], size * b[name].value[1]))
        for name, size in units.items()
        if size is not None
    ]
    both.sort(key=lambda estimate: -abs(estimate.shift) if math.isfinite(estimate.shift) else 0.0)
    gained = tuple(name for name in b if units.get(name) is None)
    lost = tuple(name for name in a if units.get(name) is None)
    places = [estimate.place for estimate in (*a.values(), *b.values())]
    others = [
        where
        for where in different_values(first, second)
        if _root(where) not in _LISTED and not _within(where, places)
    ]
    unlike = [
        f"unit of {name}: {a[name].unit} and {b[name].unit}"
        for name, size in units.items()
        if size != 1.0
    ]
    inputs = (*_inputs(first, second), *unlike)
    return ResultPair(inputs, tuple(both), tuple(others), lost, gained)


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


def _root(where: str) -> str:
    return where.partition(".")[0].partition("[")[0]


def _within(where: str, places: Sequence[str]) -> bool:
    return any(where == place or where.startswith(f"{place}.") for place in places)


@dataclass(frozen=True)
class _Estimate:
    """name : for people.  place : where it stands in the record.  value : with its standard
    deviation or standard uncertainty.  dof : inf where none are stated.
    """

    name: str
    place: str
    unit: str
    value: tuple[float, float]
    dof: float


def estimates(node: object, name: str = "", place: str = "", unit: str = "") -> Iterator[_Estimate]:
    """Every value with its uncertainty in a decoded `result.json` of any kind, mean and sd, or
    value and u, wherever they stand together; of several methods for one value that which the
    report quotes.

    name, place, unit : of what `node` is a part; the unit may stand further out.
    """
    if not isinstance(node, dict):
        return
    unit = node["unit"] if isinstance(node.get("unit"), str) else unit
    if (value := estimate_in(node)) is not None:
        dof = node.get("dof")
        if not isinstance(dof, (int, float)) or not dof > 0.0:
            dof = math.inf
        yield _Estimate(name, place, unit, value, dof)
        return
    averages, methods = _table(node, "averages"), [_METHODS.get(str(node.get("quoted")), "")]
    if averages:
        node, methods = averages, [str(node.get("recommended"))]
        name, place = name or "mean", f"{place}.averages" if place else "averages"
    for key in methods:
        if key in node:
            yield from estimates(node[key], name, f"{place}.{key}", unit)
            return
    for key, inner in node.items():
        shown = name if key in _LAYERS else f"{name}.{key}" if name else key
        yield from estimates(inner, shown, f"{place}.{key}" if place else key, unit)


def _inputs(first: Json, second: Json) -> Iterator[str]:
    yield from _unlike("", first, second, _LISTED[:-1])
    a, b = (_table(record, "provenance") for record in (first, second))
    if a.get("campaign_sha256") != b.get("campaign_sha256"):
        yield f"the campaign file: {a.get('campaign')} and {b.get('campaign')} differ"
    data = [_data(p) for p in (a, b)]
    for name in sorted(data[0].keys() | data[1].keys()):
        if name not in data[0] or name not in data[1]:
            yield f"data: {name} is in the {'first' if name in data[0] else 'second'} alone"
        elif data[0][name] != data[1][name]:
            yield f"data: {name} differs"
    yield from _unlike("", a, b, ["seed"])
    was, now = (_table(p, "versions") for p in (a, b))
    yield from _unlike("version of ", was, now, sorted(was.keys() | now.keys()))


def _unlike(what: str, first: Json, second: Json, keys: Sequence[str]) -> Iterator[str]:
    for key in keys:
        if first.get(key) != second.get(key):
            yield f"{what}{key}: {first.get(key)} and {second.get(key)}"


def _table(record: Json, key: str) -> Json:
    """A table in a record, which somebody may have written by hand."""
    entry = record.get(key)
    return entry if isinstance(entry, dict) else {}


def _data(provenance: Json) -> Json:
    """Digests of the data by the names of the files, which may lie elsewhere now; by their paths
    where two have one name.
    """
    digests = _table(provenance, "data_sha256")
    count = Counter(PurePath(path).name for path in digests)
    return {
        path if count[PurePath(path).name] > 1 else PurePath(path).name: digest
        for path, digest in digests.items()
    }
