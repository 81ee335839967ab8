"""A campaign bound to physics: bodies, runs and the problems they pose.  The only file, with `design.py`, that imports `model`.

A quantity is looked up at the run, then at its body, then under [shared]; where it is found decides what is one unknown:
"phi[heavy-04]" belongs to one run, "gamma[heavy]" to one body's runs, a bare "rolling_resistance" to all.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.campaign_file import CampaignFile, read_campaign_file
from estim.curve import Derived, LocalCurve
from estim.curve_campaign import CurveStudy, read_curve_study
from estim.errors import InputError
from estim.levels import Level, Levels, as_prior, body_levels, read_key
from estim.observing import observe
from estim.priors import Normal, Prior, TruncatedNormal
from estim.problem import Observations, Parameter, Problem
from estim.quantity import Quantity
from estim.run import Run, read_run
from model import Body, energy, phase

FloatArray = NDArray[np.float64]

_DEGREE = float(np.pi / 180.0)


@dataclass(frozen=True)
class _Kind:
    """A physical quantity of a campaign: its keys with their factors to SI, unit, value where it is missing, meaning."""

    keys: Mapping[str, float]
    unit: str
    default: float | None
    meaning: str
    low: float = -np.inf
    zero: bool = True  # whether 0 is possible
    high: float = np.inf  # of the size


_QUANTITIES: Mapping[str, _Kind] = MappingProxyType(
    {
        "gamma": _Kind({"gamma": 1.0}, "1", None, "distance of the centre of mass from the axle / R", 0.0),
        "kappa": _Kind({"kappa": 1.0}, "1", None, "inertia of the disk / (M_D R²)", 0.0),
        "theta0": _Kind({"theta0_deg": _DEGREE, "theta0_rad": 1.0}, "rad", None, "angle of the particle at release", high=2.0 * np.pi),
        "phi": _Kind({"phi_deg": _DEGREE, "phi_rad": 1.0}, "rad", None, "tilt of the ramp", high=0.5 * np.pi),
        "rolling_resistance": _Kind({"rolling_resistance": 1.0}, "1", 0.0, "coefficient of rolling resistance", 0.0),
        "radius": _Kind({"radius_m": 1.0}, "m", None, "radius of the disk", 0.0, False),
        "rho": _Kind({"rho": 1.0}, "1", 1.0, "distance of the particle from the axle / R", 0.0, False),
        "trailing_fraction": _Kind({"trailing_fraction": 1.0}, "1", 0.0, "share of the mass that does not rotate", 0.0),
        "particle_gyration": _Kind({"particle_gyration": 1.0}, "1", 0.0, "radius of gyration of the particle / R", 0.0),
        "g": _Kind({"g": 1.0}, "m/s²", phase.STANDARD_GRAVITY, "acceleration of free fall", 0.0, False),
    }
)
_MASSES = ("mass_disk_kg", "mass_particle_kg", "mass_trailing_kg")


@dataclass(frozen=True, eq=False)
class PhaseCurve:
    """The phase curve of a rolling body as a curve to fit: v(x) in m/s, or omega(theta - theta0) in rad/s.

    angular : positions are angles turned since release.  mass : kg, or None where the campaign does not say.
    """

    angular: bool
    mass: float | None = None

    def _body(self, a: Mapping[str, ArrayLike]) -> tuple[Body, dict[str, ArrayLike]]:
        names = ("radius", "gamma", "kappa", "rho", "trailing_fraction", "particle_gyration")
        motion = {name: a[name] for name in ("phi", "theta0", "rolling_resistance", "g")}
        return Body(**{name: a[name] for name in names}), motion

    def value(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        body, motion = self._body(arguments)
        return (phase.angular_rate if self.angular else phase.speed)(x, body, **motion)

    def local(self, x: FloatArray, arguments: Mapping[str, ArrayLike]) -> LocalCurve:
        body, motion = self._body(arguments)
        value, slope, gradient = (phase.angular_rate_derivatives if self.angular else phase.speed_derivatives)(x, body, **motion)
        return LocalCurve(np.atleast_2d(value), np.atleast_2d(slope), gradient)

    def time_derivative(self, x: FloatArray, arguments: Mapping[str, ArrayLike], order: int) -> FloatArray:
        body, motion = self._body(arguments)
        g, radius = np.asarray(motion.pop("g")), np.asarray(body.radius)
        ratios = phase.energy_ratio_derivatives(x if self.angular else x / radius, body, **motion, order=order)
        scale = 2.0 * g / radius if self.angular else 2.0 * g * radius
        step = 1.0 if self.angular else radius
        return np.atleast_2d(phase.time_derivative([scale * h / step**n for n, h in enumerate(ratios)], order))

    def end(self, arguments: Mapping[str, ArrayLike]) -> FloatArray:
        body, motion = self._body(arguments)
        motion.pop("g")
        return np.atleast_2d((phase.turning_angle if self.angular else phase.turning_point)(body, **motion))

    def metres(self, arguments: Mapping[str, ArrayLike]) -> ArrayLike:
        return arguments["radius"] if self.angular else 1.0

    def energies(self, x: FloatArray, v: FloatArray, arguments: Mapping[str, ArrayLike]) -> tuple[FloatArray, FloatArray]:
        body, motion = self._body(arguments)
        length = body.radius if self.angular else 1.0
        place = {"phi": motion["phi"], "theta0": motion["theta0"]}
        kinetic = energy.kinetic_energy(length * x, length * v, body, **place)
        return kinetic, energy.potential_energy(length * x, body, **place, g=motion["g"])

    def derived(self, arguments: Mapping[str, ArrayLike]) -> Mapping[str, Derived]:
        body, motion = self._body(arguments)
        phi, resistance = np.asarray(motion["phi"]), np.asarray(motion["rolling_resistance"])
        derived = {
            "inertia_ratio": Derived("1", np.atleast_2d(body.inertia_ratio), "inertia of all that rotates / (M R²)"),
            "slope": Derived("1", np.atleast_2d(phase.effective_slope(phi, resistance)), "effective slope sin φ + c_rr cos φ"),
        }
        if self.mass is not None:
            moment = resistance * self.mass * np.asarray(motion["g"]) * body.radius * np.cos(phi)
            derived["resisting_moment"] = Derived("N m", np.atleast_2d(moment), "moment of the rolling resistance, c_rr M g R cos φ")
        return derived


@dataclass(frozen=True, eq=False)
class Bound:
    """A quantity of one run: a prior (then `name` is its parameter) or an exact value in SI units."""

    name: str
    source: float | Prior


@dataclass(frozen=True, eq=False)
class Campaign:
    """A campaign and the tables of its runs, read and checked.  `problem` poses the inference for some of its runs."""

    source: CampaignFile
    tables: Mapping[str, Run]
    curve: CurveStudy | None = None

    @property
    def title(self) -> str:
        return self.source.title

    @property
    def kind(self) -> str:
        return self.source.kind

    @property
    def formula(self) -> str | None:
        """The user's own curve as written, None for a rolling body."""
        return None if self.source.curve is None else str(self.source.curve["curve"]["expression"])

    @property
    def published(self) -> Path | None:
        """The file of published numbers that the campaign names, if any."""
        return None if self.source.published is None else self.source.path.parent / self.source.published

    @property
    def run_names(self) -> tuple[str, ...]:
        return tuple(run.name for run in self.source.runs)

    def problem(self, names: Sequence[str]) -> Problem:
        """The joint problem of the runs `names`: what they share is one parameter.  Raises InputError."""
        physics: dict[str, Parameter] = {}
        noise: dict[str, Parameter] = {}
        runs = []
        if not names or len(set(names)) < len(names):
            raise InputError("must name one run or several, each once", field="run", value=", ".join(names), file=self.source.path)
        for name in names:
            if name not in self.run_names:
                raise InputError(f"must name one of the runs ({', '.join(self.run_names)})", field="run", value=name, file=self.source.path)
        if self.curve is not None:
            return self.curve.problem(names, self.tables)
        for name in names:
            levels = Levels(self.source, self.run_names.index(name))
            bound = bind_quantities(levels.source, levels, where=f"run '{name}'")
            for quantity, b in bound.items():
                if not isinstance(b.source, float):
                    physics.setdefault(b.name, Parameter(b.name, _QUANTITIES[quantity].unit, b.source, _QUANTITIES[quantity].meaning))
            speeds = observe(self.tables[name], levels)
            noise.update({p.name: p for p in speeds.parameters})
            angular = self.tables[name].coordinate == "theta_rad"
            runs.append(
                Observations(
                    name=name, x=speeds.x, y=speeds.y, t=speeds.t, curve=PhaseCurve(angular, total_mass(levels.source, levels)),
                    arguments=MappingProxyType({q: b.source if isinstance(b.source, float) else b.name for q, b in bound.items()}),
                    noise=speeds.noise, excluded=speeds.excluded, excluded_points=speeds.excluded_points,
                    x_name="angle turned θ − θ₀" if angular else "position x", x_unit="rad" if angular else "m",
                    y_name="angular rate ω" if angular else "speed v", y_unit="rad/s" if angular else "m/s",
                )
            )
        return Problem((*physics.values(), *noise.values()), tuple(runs))


    def require_body(self) -> None:
        """Raises InputError where the curve is the user's own, so that there is no rolling body to speak of."""
        if self.curve is not None:
            raise self.source.places.error("has no rolling body, so only estim fit knows what to do with it", ("curve",))


def gamma_of_body(campaign: Campaign, body: str) -> Quantity | None:
    """gamma as stated for a body, from its masses or directly; None where it is not, or only guessed (no normal prior)."""
    tables = body_levels(campaign.source, body)
    if not any(getattr(level.table, key) is not None for level in tables for key in ("gamma", "mass_particle_kg")):
        return None
    stated = _bind(campaign.source, tables, "gamma", f"body '{body}'").source
    if isinstance(stated, float):
        return Quantity(stated)
    return Quantity(stated.mean, stated.sd) if isinstance(stated, Normal | TruncatedNormal) else None


def gamma_origin(campaign: Campaign, body: str) -> str:
    """Where gamma of a body comes from, in words."""
    weighed = any(level.table.mass_particle_kg is not None and level.table.gamma is None for level in body_levels(campaign.source, body))
    return "from the masses" if weighed else "as stated"


def load_campaign(path: str | Path) -> Campaign:
    """The campaign in the TOML file at `path`, with the tables of its runs.

    Raises InputError with file, line, field, rule and value for whatever breaks a rule; every run is posed as a problem
    once, so that a mistake in any of them shows at once.
    """
    source = read_campaign_file(Path(path))
    folder = Path(path).parent
    curve = None
    tables: Mapping[str, Run]
    if source.curve is not None:
        curve, tables = read_curve_study(source)
    else:
        tables = {run.name: read_run(folder / run.file, name=run.name, shown_as=str(folder / run.file)) for run in source.runs}
    campaign = Campaign(source, MappingProxyType(dict(tables)), curve)
    for name in campaign.run_names:
        campaign.problem([name])
    return campaign


def bind_quantities(source: CampaignFile, levels: Iterable[Level], *, where: str) -> dict[str, Bound]:
    """Every quantity of the phase curve as the tables of `levels` give it; `where` names them in messages.

    Raises InputError where one is missing, said twice at one level, or out of its physical range.
    """
    tables = tuple(levels)
    bound = {name: _bind(source, tables, name, where) for name in _QUANTITIES}
    centre = {name: b.source if isinstance(b.source, float) else b.source.centre for name, b in bound.items()}
    others = centre["gamma"] / centre["rho"] + centre["trailing_fraction"]
    if others > 1.0:
        home = next((level for level in tables if level.table.gamma is not None), tables[0])
        rule = "leaves no mass for the disk: gamma/rho + trailing_fraction must be at most 1"
        raise source.places.error(rule, (*home.path, "gamma"), value=others)
    return bound


def _bind(source: CampaignFile, levels: tuple[Level, ...], name: str, where: str) -> Bound:
    kind = _QUANTITIES[name]
    for level in levels:
        said = [key for key in kind.keys if getattr(level.table, key) is not None]
        weighed = [key for key in _MASSES if getattr(level.table, key) is not None]
        if len(said) > 1:
            raise source.places.error(f"must not stand beside '{said[0]}'", (*level.path, said[1]))
        if said:
            value = read_key(source, level, said[0], factor=kind.keys[said[0]])
            return Bound(name + level.suffix, _checked(source, value, kind, (*level.path, said[0])))
        if weighed and name in ("gamma", "trailing_fraction"):
            value = _from_masses(source, levels, name, _bind(source, levels, "rho", where).source)
            return Bound(name + level.suffix, _checked(source, value, kind, (*level.path, weighed[0])))
    if kind.default is not None:
        return Bound(name, kind.default)
    rule = f"is missing for {where}: say it there, for its body or under [shared]"
    raise source.places.error(rule + (" (or give the masses)" if name == "gamma" else ""), levels[0].path, field=next(iter(kind.keys)))


def _checked(source: CampaignFile, value: Quantity | Prior, kind: _Kind, path: tuple[str | int, ...]) -> float | Prior:
    """A number or a prior that respects the quantity's physical limit."""
    centre = value.value if isinstance(value, Quantity) else value.centre
    if centre < kind.low or (centre == 0.0 and not kind.zero):
        raise source.places.error(f"must be {'>=' if kind.zero else '>'} {kind.low:g}", path, value=centre)
    if abs(centre) > kind.high:
        rule = f"must lie within {np.degrees(kind.high):.0f} degrees = {kind.high:.2f} rad (degrees go with the key {next(iter(kind.keys))})"
        raise source.places.error(rule, path, value=f"{centre:.4g} rad")
    if isinstance(value, Quantity):
        return value.value if value.exact else as_prior(value, low=kind.low)
    if isinstance(value, Normal):
        return as_prior(Quantity(value.mean, value.sd), low=kind.low)
    if value.low < kind.low:
        raise source.places.error(f"must have a prior that does not reach below {kind.low:g}", path, value=value.describe())
    return value


def _mass(source: CampaignFile, levels: Iterable[Level], key: str) -> Quantity:
    """One of the masses, from the most particular level that gives it."""
    tables = tuple(levels)
    level = next((level for level in tables if getattr(level.table, key) is not None), None)
    if level is None:
        if key == "mass_trailing_kg":
            return Quantity(0.0)
        home = next(t for t in tables if any(getattr(t.table, k) is not None for k in _MASSES))
        raise source.places.error("is missing beside the other masses", (*home.path, key))
    mass = read_key(source, level, key)
    if not isinstance(mass, Quantity):
        raise source.places.error("must be a number or a measured value, not a prior", (*level.path, key))
    if mass.value < 0.0 or (mass.value == 0.0 and key == "mass_disk_kg"):
        raise source.places.error("must be > 0" if key == "mass_disk_kg" else "must be >= 0", (*level.path, key), value=mass.value)
    return mass


def _from_masses(source: CampaignFile, levels: Iterable[Level], name: str, rho: float | Prior) -> Quantity:
    """gamma or the trailing fraction with the uncertainty that follows from the masses (linear propagation)."""
    from uncertainties import ufloat

    read = [_mass(source, levels, key) for key in _MASSES]
    disk, particle, trailing = (m.value if m.exact else ufloat(m.value, m.u) for m in read)
    distance = rho if isinstance(rho, float) else ufloat(rho.centre, rho.sd)
    ratio = getattr(Body.from_masses(1.0, disk, particle, kappa=0.5, rho=distance, mass_trailing=trailing), name)
    return Quantity(ratio) if isinstance(ratio, float) else Quantity(ratio.nominal_value, ratio.std_dev)


def total_mass(source: CampaignFile, levels: Iterable[Level]) -> float | None:
    """Sum of the masses (kg) where they are given, else None."""
    tables = tuple(levels)
    if not any(getattr(level.table, key) is not None for level in tables for key in _MASSES):
        return None
    return sum(_mass(source, tables, key).value for key in _MASSES)
