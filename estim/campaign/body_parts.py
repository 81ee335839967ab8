"""Bodies built of parts: what the weighed parts in a campaign file imply for mass, gamma, kappa,
rho and their like, with their uncertainties.

A part stands once in the file, whatever bodies hold it, and is one input: bodies that share a part
share its error.  A part listed twice in a body is two parts of the same weight, whose error is
common too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray, diagonal_scale
from estim.campaign.campaign_file import CampaignFile, LevelTable
from estim.campaign.part_table import (
    AnyPart,
    BoltTable,
    DiskTable,
    PointTable,
    RingTable,
    RodTable,
    TrailingTable,
)
from estim.campaign.quantities import QUANTITIES
from estim.common import Notation, Quantity, later, read_quantity
from estim.model import Body, Part, assemble, bolt, disk, ring, rod
from estim.propagation import Input, LinearResult, propagate_linear
from estim.reading import KeyPath

_LENGTHS = ("radius_m", "inner_radius_m", "length_m", "diameter_m", "distance_m")
_UNITS = {"mass_kg": "kg", **dict.fromkeys(_LENGTHS, "m"), "angle_deg": "°"}
_MOST_PARTS, _ROUNDING, _NEGLIGIBLE = 100, 1e-9, 0.05
_LARGEST = 10.0  # radii of the body: beyond, a length is in another unit
_HARDLY_MATTER = {"particle_gyration", "trailing_fraction"}

# quantities of a campaign that follow from the parts of a body
OF_PARTS = ("gamma", "kappa", "rho", "particle_gyration", "trailing_fraction")
OUTPUTS: Mapping[str, tuple[Notation, str, str]] = MappingProxyType(
    {  # all that does: how it is written, unit, meaning
        "mass": (Notation("M"), "kg", later("total mass")),
        **{
            name: (kind.notation, kind.unit, kind.english)
            for name in OF_PARTS
            for kind in (QUANTITIES[name],)
        },
        "inertia_ratio": (
            Notation("j"),
            "1",
            later("moment of inertia of all rotating parts / (M R²)"),
        ),
        "direction": (
            Notation("δ", "°", float(np.degrees(1.0))),
            "rad",
            later("direction of the centre of mass from the mark"),
        ),
    }
)


@dataclass(frozen=True, eq=False)
class PartedBody:
    """A body given by its parts, ready to be propagated.

    name : as shown.
    particle : numbers of its parts.
    inputs : name -> what was measured, exact numbers too; those of a shared part are the same for
        every body.
    outputs : names of what `values` gives, those of `OUTPUTS` that are not 0 for this kind of body.
    """

    name: str
    parts: tuple[tuple[str, AnyPart], ...]
    particle: tuple[int, ...]
    radius: str
    inputs: Mapping[str, Input]
    outputs: tuple[str, ...]

    def values(self, q: Mapping[str, Any]) -> tuple[ArrayLike, ...]:
        """The outputs at the values `q` of the inputs, numbers or arrays of one shape."""
        assembly = assemble(
            [_part(name, table, q, q[self.radius]) for name, table in self.parts],
            q[self.radius],
            particle=self.particle,
        )
        body = assembly.body
        extras = {"inertia_ratio": body.inertia_ratio, "direction": assembly.direction}
        every = [extras[name] if name in extras else getattr(body, name) for name in self.outputs]
        return tuple(np.asarray(value) + 0.0 * np.asarray(body.mass) for value in every)


def parted_body(
    source: CampaignFile, table: LevelTable, path: KeyPath, radius: Input, *, name: str
) -> PartedBody:
    """The body whose parts `table` (at `path`) lists, rolling on `radius`.  Raises InputError with
    its line.
    """
    listed = table.parts or []
    if not 1 <= len(listed) <= _MOST_PARTS:
        raise source.error(
            f"must list 1 to {_MOST_PARTS} parts", (*path, "parts"), value=len(listed)
        )
    for i, part in enumerate(listed):
        if part not in source.parts:
            known = ", ".join(source.parts) or "none defined"
            raise source.error(
                f"must name parts ({known})", (*path, "parts", i), field="parts", value=part
            )
    for i, part in enumerate(table.particle or []):
        if part not in listed:
            raise source.error(
                "must name some of the parts of this body",
                (*path, "particle", i),
                field="particle",
                value=part,
            )
    parts = tuple((part, source.parts[part]) for part in listed)
    if all(isinstance(entry, TrailingTable) for _, entry in parts):
        raise source.error("must hold a part that rotates", (*path, "parts"))
    inputs = {radius.name: radius}
    for part, entry in parts:
        inputs |= _inputs(source, part, entry)
    _require_metres(source, inputs, radius)
    particle = tuple(i for i, part in enumerate(listed) if _is_particle(part, table, inputs))
    angles = any(name.endswith(".angle_deg") for name in inputs)
    # a bolt is a point that has a diameter
    point = len(particle) == 1 and type(parts[particle[0]][1]) is PointTable
    trailing = tuple(i for i, (_, entry) in enumerate(parts) if isinstance(entry, TrailingTable))
    if len({*particle, *trailing}) == len(parts):
        raise source.error(
            "must leave a part for the disk: say which are the particle, particle = [...]",
            (*path, "parts"),
        )
    absent = {
        out
        for out, present in {
            "particle_gyration": particle and not point,
            "trailing_fraction": trailing,
            "direction": angles,
        }.items()
        if not present
    }
    body = PartedBody(
        name,
        parts,
        particle,
        radius.name,
        MappingProxyType(inputs),
        tuple(out for out in OUTPUTS if out not in absent),
    )
    at = dict(zip(body.outputs, (float(np.asarray(v)) for v in _values(body)), strict=True))
    if not all(np.isfinite(list(at.values()))) or at["kappa"] < 0.0 or at["rho"] <= 0.0:
        raise source.error(
            "make no body of disk and particle (is the particle on the axle, the disk far out "
            "of balance?): say which are it, particle = [...]",
            (*path, "parts"),
        )
    return body


def _require_metres(source: CampaignFile, inputs: Mapping[str, Input], radius: Input) -> None:
    """Raises InputError for a length that no part of a body of this radius has: one in
    millimetres.
    """
    for name, quantity in inputs.items():
        part, _, key = name.rpartition(".")
        if (
            name != radius.name
            and quantity.unit == "m"
            and quantity.value > _LARGEST * radius.value
        ):
            raise source.error(
                f"must be at most {_LARGEST:g} times the radius of the body, {radius.value:g} "
                "m: is it in metres?",
                ("parts", part, key),
                value=quantity.value,
            )


def _is_particle(part: str, table: LevelTable, inputs: Mapping[str, Input]) -> bool:
    """Whether a part is named as the particle, or, where none is, meant to be off the axle;
    "0.0000(5)" is a centre that is not quite on it.
    """
    distance = inputs.get(f"{part}.distance_m")
    return (
        part in table.particle if table.particle else distance is not None and distance.value != 0.0
    )


def _values(body: PartedBody) -> tuple[ArrayLike, ...]:
    with np.errstate(all="ignore"):
        return body.values(
            {name: np.float64(quantity.value) for name, quantity in body.inputs.items()}
        )


def _inputs(source: CampaignFile, name: str, table: AnyPart) -> dict[str, Input]:
    """What was measured of a part, by "name.key"."""
    path, inputs = ("parts", name), {}
    for key, unit in _UNITS.items():
        written = getattr(table, key, None)
        if written is None:
            continue
        with source.places.at((*path, key)):
            value = read_quantity(written, field=key)
        if key != "angle_deg" and (value.value < 0.0 or (value.value == 0.0 and key == "mass_kg")):
            raise source.error(
                "must be > 0" if key == "mass_kg" else "must be >= 0",
                (*path, key),
                value=value.value,
            )
        inputs[f"{name}.{key}"] = Input(f"{name}.{key}", value.value, value.u, unit=unit)
    outer, inner = (inputs.get(f"{name}.{key}") for key in ("radius_m", "inner_radius_m"))
    if outer is not None and inner is not None and inner.value > outer.value:
        raise source.error(
            "must be at most 'radius_m'", (*path, "inner_radius_m"), value=inner.value
        )
    return inputs


def _part(name: str, table: AnyPart, q: Mapping[str, Any], body_radius: Any) -> Part:
    def value_of(key: str, otherwise: Any = 0.0) -> Any:
        return q.get(f"{name}.{key}", otherwise)

    square: Any = 0.0
    match table:
        case RingTable():
            square = ring(value_of("radius_m", body_radius), value_of("inner_radius_m"))
        case DiskTable():
            square = disk(value_of("radius_m", body_radius))
        case RodTable():
            square = rod(value_of("length_m"), value_of("diameter_m"))
        case BoltTable():
            square = bolt(value_of("diameter_m"))
    return Part(
        value_of("mass_kg"),
        square,
        value_of("distance_m"),
        np.radians(value_of("angle_deg")),
        not isinstance(table, TrailingTable),
    )


def weighed(
    source: CampaignFile, path: KeyPath, radius: Input
) -> tuple[Mapping[str, Quantity], FloatArray]:
    """What the parts listed at `path` give, by linear propagation: output -> value and standard
    uncertainty, and their correlations.

    k_P and the trailing fraction are exact here where their uncertainty moves j by less than a
    twentieth of its own: no fit could resolve it.  Raises InputError where the parts are wrong, or
    linear propagation has no answer.
    """
    return _weighed(source, path, radius.name, radius.value, radius.u)


@lru_cache(maxsize=64)
def _weighed(
    source: CampaignFile, path: KeyPath, radius: str, value: float, u: float
) -> tuple[Mapping[str, Quantity], FloatArray]:
    table = source.shared
    if path[0] != "shared":
        table = source.runs[int(path[1])] if path[0] == "runs" else source.bodies[str(path[1])]
    body = parted_body(source, table, path, Input(radius, value, u, unit="m"), name=str(path[-1]))
    linear = propagate_linear(body.values, list(body.inputs.values()))
    if notes := notes_of(linear, body.values):
        raise source.error(
            f"leave no linear uncertainty ({notes[0]}): state gamma, kappa and rho in their place",
            (*path, "parts"),
        )
    quantities = {
        out: Quantity(float(v), float(s))
        for out, v, s in zip(
            body.outputs, linear.value, known_to(linear.value, linear.u), strict=True
        )
    }
    slopes = _ratios(quantities).inertia_ratio_gradient()
    for out in _HARDLY_MATTER & set(quantities):
        if abs(slopes[out]) * quantities[out].u < _NEGLIGIBLE * quantities["inertia_ratio"].u:
            quantities[out] = Quantity(quantities[out].value)
    return MappingProxyType(quantities), correlations(linear.covariance)


def notes_of(
    linear: LinearResult, values: Callable[[Mapping[str, Any]], Sequence[ArrayLike]]
) -> tuple[str, ...]:
    """What a reader must know of a linear result of `values`, except for those outputs that are
    exact but for rounding.
    """
    mask = ~(linear.u <= _ROUNDING * np.abs(linear.value))
    if not linear.notes or not np.any(mask):
        return ()
    return propagate_linear(
        lambda q: [v for v, keep in zip(values(q), mask, strict=True) if keep], linear.inputs
    ).notes


def known_to(value: FloatArray, u: FloatArray) -> FloatArray:
    """Standard uncertainties, 0 where they are what rounding leaves of an exact value."""
    return np.where(u <= _ROUNDING * np.abs(value), 0.0, u)


def correlations(covariance: FloatArray) -> FloatArray:
    """The correlation matrix of a covariance matrix; 0 where a value is exact."""
    scale = diagonal_scale(covariance)
    return np.where(np.eye(len(scale)) > 0.0, 1.0, covariance / np.outer(scale, scale))


def of_one_disk(source: CampaignFile, body: str) -> tuple[str, ...]:
    """The bodies, in the order of the file, whose kappa is one number with that of `body`: they
    have the same disk, on the axle.

    Those that state kappa or a radius of their own are none of them.
    """
    parts = _disk(source, body)
    return (
        (body,)
        if parts is None
        else tuple(other for other in source.bodies if _disk(source, other) == parts)
    )


def _disk(source: CampaignFile, body: str) -> tuple[str, ...] | None:
    table = source.bodies[body]
    if (
        table.parts is None
        or table.kappa is not None
        or table.radius_m is not None
        or not all(part in source.parts for part in table.parts)
    ):
        return None
    turning = [part for part in table.parts if not isinstance(source.parts[part], TrailingTable)]
    inputs = {
        name: quantity
        for part in turning
        for name, quantity in _inputs(source, part, source.parts[part]).items()
    }
    rest = sorted(part for part in turning if not _is_particle(part, table, inputs))
    return None if any(f"{part}.distance_m" in inputs for part in rest) else tuple(rest)


def not_independent(
    quantities: Mapping[str, Quantity], correlation: FloatArray, stated: Iterable[str]
) -> tuple[str, str, float] | None:
    """The two of the quantities `stated` (which a fit takes from the parts) that are correlated
    most, and by how much; None for fewer than two.
    """
    names: Sequence[str] = [
        name for name in quantities if name in set(stated) and quantities[name].u > 0.0
    ]
    pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
    order = list(quantities)
    if not pairs:
        return None
    a, b = max(pairs, key=lambda pair: abs(correlation[order.index(pair[0]), order.index(pair[1])]))
    return a, b, float(correlation[order.index(a), order.index(b)])


def spread_apart(quantities: Mapping[str, Quantity]) -> float:
    """Standard uncertainty that the inertia ratio j would have if the quantities it is made of were
    independent.
    """
    slopes = _ratios(quantities).inertia_ratio_gradient()
    return float(
        np.sqrt(
            sum(
                (slope * quantities[name].u) ** 2
                for name, slope in slopes.items()
                if name in quantities
            )
        )
    )


def _ratios(quantities: Mapping[str, Quantity]) -> Body:
    return Body(1.0, **{name: quantities[name].value for name in OF_PARTS if name in quantities})
