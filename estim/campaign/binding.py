"""What a campaign file states about the quantities of a run or a body: where each is found, its
prior or exact value, whether it can be.

A quantity that stands nowhere may follow from the masses of the body, or from its parts
(`body_parts`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from estim.arrays import FloatArray
from estim.campaign.body_parts import (
    OF_PARTS,
    OUTPUTS,
    PartedBody,
    not_independent,
    of_one_disk,
    parted_body,
    spread_apart,
    weighed,
)
from estim.campaign.campaign_file import CampaignFile
from estim.campaign.lookup_levels import Level, Levels, body_levels
from estim.campaign.quantities import EFFECTS, GRIP, QUANTITIES, QuantityKind
from estim.common import Quantity, format_quantity, phrase, signed
from estim.model import Body
from estim.problem import DefaultError, Prior, as_prior, centre_of
from estim.propagation import Input
from estim.reading import KeyPath

KINDS_OF_QUANTITIES: Mapping[str, QuantityKind] = {**QUANTITIES, **EFFECTS}

_SAME_SDS, _SAME_SHARE = 5.0, 0.05  # how far a stated gamma may be from that of the masses
_MASSES = ("mass_disk_kg", "mass_particle_kg", "mass_trailing_kg")


@dataclass(frozen=True, eq=False)
class Bound:
    """A quantity of one run: a prior (then `name` is its parameter) or an exact value in SI
    units.
    """

    name: str
    source: float | Prior
    by_default: bool = False  # whether nothing is stated, and it has its default uncertainty


def gamma_of_body(source: CampaignFile, body: str) -> Quantity | None:
    """gamma as stated for a body, from its masses or directly; None where it is not, or only
    guessed (no normal prior).
    """
    levels = body_levels(source, body)
    if levels.first("gamma", "mass_particle_kg", "parts") is None:
        return None
    stated = _bind(levels, "gamma", f"body '{body}'").source
    if isinstance(stated, float):
        return Quantity(stated)
    return Quantity(stated.centre, stated.sd) if stated.measured else None


def gamma_origin(source: CampaignFile, body: str) -> str:
    """Where gamma of a body comes from, in words."""
    tables = [level.table for level in body_levels(source, body) if level.table.gamma is None]
    if any(table.mass_particle_kg is not None for table in tables):
        return phrase("from the masses")
    return (
        phrase("from the parts")
        if any(table.parts is not None for table in tables)
        else phrase("as stated")
    )


def resistance_of_body(source: CampaignFile, body: str) -> Prior | float:
    """c_rr as stated for a body: its prior, or an exact value; 0 where nothing is stated."""
    return _bind(body_levels(source, body), "rolling_resistance", f"body '{body}'").source


def grip_of(levels: Levels) -> Prior | float | None:
    """The coefficient of static friction, None where it is not stated: no parameter, for no curve
    depends on it while the body rolls.
    """
    level = levels.first("friction")
    if level is None:
        return None
    return _checked(levels, levels.read(level, "friction"), GRIP, (*level.path, "friction"))


def bind_quantities(levels: Levels) -> dict[str, Bound]:
    """Every quantity of the phase curve of a run as its tables give it, effects where they are
    stated and not 0, or by default.

    Raises InputError where one is missing, stated twice at one level, or out of its physical range.
    """
    where = f"run '{levels.run.name}'"
    bound = {name: _bind(levels, name, where) for name in QUANTITIES}
    effects = {name: _bind(levels, name, where) for name in EFFECTS}
    bound |= {name: b for name, b in effects.items() if b.source != 0.0}
    centre = {name: centre_of(b.source) for name, b in bound.items()}
    others = centre["gamma"] / centre["rho"] + centre["trailing_fraction"]
    if others > 1.0:
        home = levels.first("gamma") or levels.tables[0]
        rule = "leaves no mass for the disk: gamma/rho + trailing_fraction must be at most 1"
        raise levels.error(rule, (*home.path, "gamma"), value=others)
    return bound


def _bind(levels: Levels, name: str, where: str) -> Bound:
    """where : what the quantity is of, in messages."""
    kind = KINDS_OF_QUANTITIES[name]
    for level in levels:
        keys, masses = level.stated(kind.keys), level.stated(_MASSES)
        if len(keys) > 1:
            raise levels.error(f"must not stand beside '{keys[0]}'", (*level.path, keys[1]))
        parted = level.table.parts is not None
        suffix = level.suffix
        if keys:
            key = keys[0]
            value = levels.read(level, key, factor=kind.keys[key])
            if name == "gamma" and masses:
                _check_masses(levels, value, (*level.path, "gamma"), where)
        elif parted and masses:
            raise levels.error("must not stand beside 'parts'", (*level.path, masses[0]))
        elif parted and name in OF_PARTS:
            key, suffix = "parts", _suffix(levels.source, level, name)
            value = _from_parts(levels, level)[0].get(name, Quantity(0.0))
        elif masses and name in ("gamma", "trailing_fraction"):
            key, value = masses[0], _from_masses(levels, name, where)
        else:
            continue
        return Bound(name + suffix, _checked(levels, value, kind, (*level.path, key)))
    if kind.default_u > 0.0:
        return Bound(
            name, DefaultError(0.0, kind.default_u, -kind.high, kind.high), by_default=True
        )
    if kind.default is not None:
        return Bound(name, kind.default)
    rule = f"is missing for {where}: say it there, for its body or under [shared]"
    raise levels.error(
        rule + (" (or give the masses)" if name == "gamma" else ""),
        levels.tables[0].path,
        field=next(iter(kind.keys)),
    )


def parted_bodies(source: CampaignFile) -> tuple[PartedBody, ...]:
    """The bodies of a file that list their parts, in its order.  Raises InputError with its
    line.
    """
    bodies = []
    for name in source.bodies:
        levels = body_levels(source, name)
        home = levels.first("parts")
        if home is not None:
            bodies.append(parted_body(source, home.table, home.path, _radius(levels), name=name))
    return tuple(bodies)


def _from_parts(levels: Levels, level: Level) -> tuple[Mapping[str, Quantity], FloatArray]:
    """What the parts at `level` give, and its correlations."""
    return weighed(levels.source, level.path, _radius(levels))


def _radius(levels: Levels) -> Input:
    """The rolling radius, which is also that of parts that state none."""
    radius = _bind(levels, "radius", "the body of these parts")
    value, u = (
        (radius.source, 0.0)
        if isinstance(radius.source, float)
        else (radius.source.expectation, radius.source.sd)
    )
    return Input("radius_m" + radius.name.removeprefix("radius"), value, u, unit="m")


def parts_fact(levels: Levels) -> str | None:
    """What a fit leaves out of what the parts state: the correlation of the quantities that it
    takes from them; None where it takes none or one.
    """
    home, names = None, list[str]()
    for name in OF_PARTS:
        stating = levels.first("parts", name)
        if stating is not None and getattr(stating.table, name) is None:
            names, home = [*names, name], stating
    quantities, correlation = ({}, None) if home is None else _from_parts(levels, home)
    pair = None if correlation is None else not_independent(quantities, correlation, names)
    if pair is None:
        return None
    first, second = (OUTPUTS[name][0].symbol for name in pair[:2])
    inertia = quantities["inertia_ratio"]
    return phrase(
        "{first} and {second} are computed from the parts of the body; their correlation, "
        "r = {r}, is neglected here, and so is what "
        "they share with other bodies (estim body shows it): j is {by_parts} from the "
        "parts, {apart} from these values taken as "
        "independent",
        first=first,
        second=second,
        r=signed(f"{pair[2]:.2f}"),
        by_parts=format_quantity(inertia.value, inertia.u),
        apart=format_quantity(inertia.value, spread_apart(quantities)),
    )


def _suffix(source: CampaignFile, level: Level, name: str) -> str:
    """Bodies on one disk have one kappa."""
    bodies = (
        of_one_disk(source, str(level.path[1]))
        if name == "kappa" and level.path[0] == "bodies"
        else ()
    )
    return f"[{'+'.join(bodies)}]" if len(bodies) > 1 else level.suffix


def _checked(
    levels: Levels, value: Quantity | Prior, kind: QuantityKind, path: KeyPath
) -> float | Prior:
    """A number or a prior that respects the quantity's physical limit."""
    centre = value.value if isinstance(value, Quantity) else value.centre
    if centre < kind.low or (centre == 0.0 and not kind.zero):
        raise levels.error(f"must be {'>=' if kind.zero else '>'} {kind.low:g}", path, value=centre)
    if abs(centre) > kind.high and kind.too_large:
        raise levels.error(kind.too_large, path, value=centre)
    if abs(centre) > kind.high:
        raise levels.error(
            f"must lie within {np.degrees(kind.high):.0f} degrees = {kind.high:.2f} rad "
            f"(degrees go with the key {next(iter(kind.keys))})",
            path,
            value=f"{centre:.4g} rad",
        )
    if isinstance(value, Quantity):
        return value.value if value.exact else as_prior(value, low=kind.low)
    value = value.cut_below(kind.low)
    if value.low < kind.low:
        raise levels.error(
            f"must have a prior that does not reach below {kind.low:g}",
            path,
            value=value.describe(),
        )
    return value


def _mass(levels: Levels, key: str) -> Quantity:
    """One of the masses, from the most particular level that gives it."""
    level = levels.first(key)
    if level is None:
        if key == "mass_trailing_kg":
            return Quantity(0.0)
        raise levels.error("is missing: the other masses are given", (*_home(levels), key))
    mass = levels.read(level, key)
    if not isinstance(mass, Quantity):
        raise levels.error("must be a number or a measured value, not a prior", (*level.path, key))
    if mass.value < 0.0 or (mass.value == 0.0 and key == "mass_disk_kg"):
        raise levels.error(
            "must be > 0" if key == "mass_disk_kg" else "must be >= 0",
            (*level.path, key),
            value=mass.value,
        )
    return mass


def _home(levels: Levels) -> KeyPath:
    """Where the first of the masses stands."""
    level = levels.first(*_MASSES)
    assert level is not None, "asked where a mass is given"
    return level.path


def _from_masses(levels: Levels, name: str, where: str) -> Quantity:
    """gamma or the trailing fraction with the uncertainty that follows from the masses (linear
    propagation).
    """
    from uncertainties import ufloat

    rho = _bind(levels, "rho", where).source
    read = [_mass(levels, key) for key in _MASSES]
    disk, particle, trailing = (m.value if m.exact else ufloat(m.value, m.u) for m in read)
    distance = rho if isinstance(rho, float) else ufloat(rho.expectation, rho.sd)
    try:
        ratio = getattr(
            Body.from_masses(1.0, disk, particle, kappa=0.5, rho=distance, mass_trailing=trailing),
            name,
        )
        return (
            Quantity(ratio)
            if isinstance(ratio, float)
            else Quantity(ratio.nominal_value, ratio.std_dev)
        )
    except (OverflowError, ZeroDivisionError):
        raise levels.error(
            "is too far from the other masses to take a ratio", (*_home(levels), _MASSES[0])
        ) from None


def _check_masses(levels: Levels, gamma: Quantity | Prior, path: KeyPath, where: str) -> None:
    """Masses beside a stated gamma give the total mass only; raises InputError where they give
    another gamma.
    """
    computed = _from_masses(levels, "gamma", where)
    centre, sd = (gamma.value, gamma.u) if isinstance(gamma, Quantity) else (gamma.centre, gamma.sd)
    if abs(computed.value - centre) > _SAME_SDS * np.hypot(sd, computed.u) + _SAME_SHARE * centre:
        raise levels.error(
            "contradicts the stated masses, which give "
            f"{format_quantity(computed.value, computed.u)}: state only one of the two",
            path,
            value=centre,
        )


def total_mass(levels: Levels) -> float | None:
    """Sum of the masses (kg) where they are given, else None."""
    level = levels.first("parts", *_MASSES)
    if level is None:
        return None
    if level.table.parts is not None:
        return _from_parts(levels, level)[0]["mass"].value
    return sum(_mass(levels, key).value for key in _MASSES)
