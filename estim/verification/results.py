"""Two results side by side: what went in, and by how much each estimate moved."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

_LAYERS = ("parameters", "derived")  # keys that say nothing in a name


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
    """inputs : words on what went into one and not into the other, or differs.  estimates : of both, those that moved most first.

    lost, gained : names that only the first or only the second has.
    """

    inputs: tuple[str, ...]
    estimates: tuple[Moved, ...]
    lost: tuple[str, ...]
    gained: tuple[str, ...]

    @property
    def same(self) -> bool:
        return not (self.inputs or self.lost or self.gained) and all(one.first == one.second for one in self.estimates)


def compare_results(first: Mapping[str, Any], second: Mapping[str, Any]) -> ResultPair:
    """Two `result.json` of any kind, decoded."""
    a, b = dict(_estimates("", first)), dict(_estimates("", second))
    both = [Moved(name, a[name][2], a[name][:2], b[name][:2]) for name in a if name in b]
    both.sort(key=lambda one: -abs(one.shift) if math.isfinite(one.shift) else 0.0)
    gained, lost = tuple(name for name in b if name not in a), tuple(name for name in a if name not in b)
    return ResultPair(tuple(_inputs(first, second)), tuple(both), lost, gained)


def _estimates(path: str, node: object) -> Iterator[tuple[str, tuple[float, float, str]]]:
    if not isinstance(node, dict):
        return
    mean, sd = node.get("mean"), node.get("sd")
    if isinstance(mean, int | float) and isinstance(sd, int | float) and "unit" in node:
        yield path, (float(mean), float(sd), str(node["unit"]))
        return
    for key, inner in node.items():
        place = path if key in _LAYERS else f"{path}.{key}" if path else key
        yield from _estimates(place, inner)


def _inputs(first: Mapping[str, Any], second: Mapping[str, Any]) -> Iterator[str]:
    for key in ("schema", "kind", "formula"):
        if first.get(key) != second.get(key):
            yield f"{key}: {first.get(key)} and {second.get(key)}"
    a, b = first.get("provenance", {}), second.get("provenance", {})
    if a.get("campaign_sha256") != b.get("campaign_sha256"):
        yield f"the campaign file: {a.get('campaign')} and {b.get('campaign')} differ"
    data = [{PurePath(path).name: digest for path, digest in p.get("data_sha256", {}).items()} for p in (a, b)]
    for name in sorted(data[0].keys() | data[1].keys()):
        if name not in data[0] or name not in data[1]:
            yield f"data: {name} is in the {'first' if name in data[0] else 'second'} alone"
        elif data[0][name] != data[1][name]:
            yield f"data: {name} differs"
    if a.get("seed") != b.get("seed"):
        yield f"seed: {a.get('seed')} and {b.get('seed')}"
    versions = [p.get("versions", {}) for p in (a, b)]
    for name in sorted(versions[0].keys() | versions[1].keys()):
        if versions[0].get(name) != versions[1].get(name):
            yield f"version of {name}: {versions[0].get(name)} and {versions[1].get(name)}"
