"""The rolling body as the study of a campaign: its quantities, and the problems that its runs pose.  It and `design.py` import `model`.

A quantity is looked up at the run, then at its body, then under [shared]; where it is found decides what is one unknown:
"phi[heavy-04]" belongs to one run, "gamma[heavy]" to one body's runs, a bare "rolling_resistance" to all.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from estim.campaign.between_runs import spreads_of, varied
from estim.campaign.blur import blur_cause, blurs
from estim.campaign.campaign_file import CampaignFile, NoiseTable
from estim.campaign.causes import Sketch, Surroundings, sketches
from estim.campaign.effects import setting_of
from estim.campaign.forced import KEY, Circumstances, Stance, fit_with_forces, force_scale, refuse_force
from estim.campaign.levels import Level, Levels, body_levels, noise_level, read_key
from estim.campaign.noise_models import Candidate, noise_candidates
from estim.campaign.plausible import check_speeds
from estim.campaign.points import Observed, observe
from estim.campaign.quantities import EFFECTS, QUANTITIES, Kind
from estim.campaign.shared_force import tied_points
from estim.campaign.usual import with_usual_errors
from estim.common import Quantity, format_quantity
from estim.curves import DisturbedMotion, DisturbedMotionCurve, DisturbedPhaseCurve, MotionCurve, PhaseCurve, RollingMotion, Setting
from estim.explanation import Cause, Suspects
from estim.fitting import Fit, fit_least_squares, scanned_fit
from estim.problem import Curve, Normal, Observations, Parameter, Prior, Problem, TruncatedNormal, as_prior, shared_first
from estim.reading import Run
from estim.sampling import MAX_PARAMETERS
from model import Body

_MANY_RUNS, _STARTS, _FEW_STARTS = 16, 8, 2  # of the fit
_KINDS: Mapping[str, Kind] = MappingProxyType({**QUANTITIES, **EFFECTS})


_SAME_SDS, _SAME_SHARE = 5.0, 0.05  # how far a stated gamma may be from that of the masses
_MASSES = ("mass_disk_kg", "mass_particle_kg", "mass_trailing_kg")


@dataclass(frozen=True, eq=False)
class Bound:
    """A quantity of one run: a prior (then `name` is its parameter) or an exact value in SI units."""

    name: str
    source: float | Prior


@dataclass(frozen=True, eq=False)
class RollingStudy:
    """Runs of rolling bodies: the phase curve with the quantities of a campaign file."""

    source: CampaignFile

    formula = None

    def problem(self, names: Sequence[str], tables: Mapping[str, Run], *, noise: NoiseTable | None = None) -> Problem:
        """The joint problem of the runs `names` with their tables.  Raises InputError.

        noise : in place of the noise tables of the campaign.
        """
        return self._posed(names, tables, noise=noise)

    def suspects(self, names: Sequence[str], tables: Mapping[str, Run]) -> Suspects:
        """The runs `names` as stated, and with what known physics, or the instruments, may add to them that the campaign does not say."""
        plain = self._posed(names, tables, white=True)
        known = []
        for run in plain.runs:
            levels = self.levels(run.name)
            sources = {q: b.source for q, b in bind_quantities(self.source, levels, where=f"run '{run.name}'").items()}
            reach = float(np.max(np.abs(run.y if run.positions else run.x)))
            known.append(Surroundings(sources, total_mass(self.source, levels), reach, tables[run.name].coordinate == "theta_rad", run.positions))
        found = []
        for sketch in sketches(known):
            problem = self._posed(names, tables, white=True, sketch=sketch)
            own = tuple(name for name in problem.names if name not in plain.names)
            found.append(Cause(sketch.name, sketch.words, problem, own, sketch.lines, begin=sketch.begin))
        for interval, noise in blurs([self.levels(name) for name in names], [tables[name] for name in names]):
            problem = self._posed(names, tables, white=True, noise=noise)
            found.append(blur_cause(problem, interval))
        return Suspects(plain, "an unmodelled force beside the curve has room for it", tuple(found))

    def _posed(
        self, names: Sequence[str], tables: Mapping[str, Run], *, noise: NoiseTable | None = None, white: bool = False, sketch: Sketch | None = None
    ) -> Problem:
        """white : with nothing that the curve may lack.  sketch : what is added to every run."""
        physics: dict[str, Parameter] = {}
        unknowns: dict[str, Parameter] = {}
        runs = []
        every = {name: observe(tables[name], self.levels(name), noise=noise) for name in names}
        tied = tied_points({name: observed.y.size for name, observed in every.items()}, {name: self.levels(name) for name in names}, KEY)
        for name in names:
            levels = self.levels(name)
            bound = bind_quantities(self.source, levels, where=f"run '{name}'")
            observed, mass = every[name], total_mass(self.source, levels)
            angular, sources = tables[name].coordinate == "theta_rad", {q: b.source for q, b in bound.items()}
            setting = setting_of(levels, sources, mass, positions=observed.positions, angular=angular)
            if sketch is not None:
                bound |= {q: Bound(f"{q}[{name}]" if sketch.of_run else q, prior) for q, prior in sketch.priors.items()}
                setting = sketch.setting(setting, mass) if sketch.disturbs else setting
            for quantity, b in bound.items():
                if not isinstance(b.source, float):
                    kind = _KINDS[quantity]
                    physics.setdefault(b.name, Parameter(b.name, kind.unit, b.source, kind.meaning, kind.notation))
            unknowns.update({p.name: p for p in observed.parameters})
            arguments = {q: b.source if isinstance(b.source, float) else b.name for q, b in bound.items()}
            posed = _observations(name, observed, arguments, mass, setting, angular=angular)
            circumstances = Circumstances(observed, joint=len(names) > 1, tied=tied[name], replaced=noise is not None)
            stance = Stance(0.0) if white else force_scale(levels, circumstances)
            runs.append(replace(posed, force=stance.scale, complete=stance.complete))
        further, every_run = varied(runs, {name: spreads_of(self.levels(name), _KINDS) for name in names})
        return Problem((*shared_first([*physics.values(), *further], every_run), *unknowns.values()), every_run)

    def with_usual_errors(self, problem: Problem, tables: Mapping[str, Run]) -> Problem:
        """Of a single run: with room for usual errors of clock and scale.  Runs fit together share these, and share no covariance: as they are."""
        if len(problem.runs) > 1:
            return problem
        runs = (with_usual_errors(run, self.levels(run.name), angular=tables[run.name].coordinate == "theta_rad") for run in problem.runs)
        return replace(problem, runs=tuple(runs))

    def levels(self, name: str) -> Levels:
        """The tables of the campaign file that speak of a run."""
        return Levels(self.source, [run.name for run in self.source.runs].index(name))

    def fit(self, problem: Problem, tables: Mapping[str, Run], *, rng: np.random.Generator) -> Fit:
        """The posterior mode; where there are few parameters, scans through the range of each look for further ones."""
        fit = fit_least_squares(problem, rng=rng, n_start=_STARTS if len(problem.runs) <= _MANY_RUNS else _FEW_STARTS)
        fit = scanned_fit(fit, rng=rng) if problem.n_par <= MAX_PARAMETERS else fit
        if not any(run.force for run in problem.runs):
            return fit
        return fit_with_forces(fit, tables, {run.name: self.levels(run.name) for run in problem.runs}, rng=rng)

    def check(self, name: str, tables: Mapping[str, Run]) -> None:
        """Raises InputError where the data of a run cannot be what the campaign says of them."""
        observed = self.problem([name], tables).runs[0]
        bound = bind_quantities(self.source, self.levels(name), where=f"run '{name}'")
        sources = {quantity: b.source for quantity, b in bound.items()}
        check_speeds(observed, sources, angular=tables[name].coordinate == "theta_rad", file=tables[name].file)

    def body_of(self, name: str) -> str | None:
        """The name of the body of a run."""
        return next(run.body for run in self.source.runs if run.name == name)

    def noise_models(self, name: str, table: Run) -> tuple[Candidate, ...]:
        """The models of the noise that the data of a run and its noise table allow.  Raises InputError where there is only one."""
        return noise_candidates(self.levels(name), table, lambda noise: self.problem([name], {name: table}, noise=noise).runs[0].noise)

    def place_of_unknowns(self, name: str) -> tuple[str | int, ...]:
        """Where in the file the unknowns of a run are declared."""
        return ("runs", [run.name for run in self.source.runs].index(name))

    def require_body(self) -> None:
        """A rolling body is what this is about."""

    def require_draws(self, problem: Problem) -> None:
        """Every prior of a rolling body can be drawn from; raises InputError for an unmodelled force, which simulated data lack."""
        self.require_complete([run.name for run in problem.runs], "estim calibrate")

    def require_complete(self, names: Sequence[str], command: str) -> None:
        """Raises InputError where an unmodelled force was asked for, which `command` does not know."""
        for name in names:
            refuse_force(self.levels(name), command)

    def require_speeds(self, names: Sequence[str], command: str) -> None:
        """Raises InputError where a run is not fit as speeds with normal errors, which is what `command` knows."""
        for name in names:
            table, path, _ = noise_level(self.levels(name))
            if table.model == "positions":
                raise self.source.places.error(
                    f"must not be 'positions' for {command}, which needs speeds: give it a campaign with model = \"differentiated\"", (*path, "model")
                )
            if table.robust is not None:
                raise self.source.places.error(f"does not go with {command}, which takes the errors as normal", (*path, "robust"), value=table.robust)


def _observations(
    name: str, observed: Observed, arguments: Mapping[str, str | float], mass: float | None, setting: Setting | None, *, angular: bool
) -> Observations:
    """The points of a run with the curve that explains them: positions in time, or speeds along the way.

    setting : None for the plain motion.
    """
    position, x_unit = ("angle turned θ − θ₀", "rad") if angular else ("position x", "m")
    speed, y_unit = ("angular rate ω", "rad/s") if angular else ("speed v", "m/s")
    axes = ("time t", "s", position, x_unit) if observed.positions else (position, x_unit, speed, y_unit)
    curve: Curve
    if setting is None:
        motion = RollingMotion(angular, mass, observed.positions)
        curve = (MotionCurve if observed.positions else PhaseCurve)(angular)
    else:
        reach = float(np.max(np.abs(observed.y if observed.positions else observed.x)))
        motion = DisturbedMotion(angular, mass, observed.positions, setting, reach)
        curve = (DisturbedMotionCurve if observed.positions else DisturbedPhaseCurve)(angular, setting)
    return Observations(
        name=name, x=observed.x, y=observed.y, t=observed.t, curve=curve,
        arguments=MappingProxyType({**arguments, **observed.arguments}), noise=observed.noise,
        excluded=observed.excluded, excluded_points=observed.excluded_points,
        x_name=axes[0], x_unit=axes[1], y_name=axes[2], y_unit=axes[3], motion=motion, words=motion.words(),
        positions=observed.positions,
    )


def gamma_of_body(source: CampaignFile, body: str) -> Quantity | None:
    """gamma as stated for a body, from its masses or directly; None where it is not, or only guessed (no normal prior)."""
    tables = body_levels(source, body)
    if not any(getattr(level.table, key) is not None for level in tables for key in ("gamma", "mass_particle_kg")):
        return None
    stated = _bind(source, tables, "gamma", f"body '{body}'").source
    if isinstance(stated, float):
        return Quantity(stated)
    return Quantity(stated.mean, stated.sd) if isinstance(stated, Normal | TruncatedNormal) else None


def gamma_origin(source: CampaignFile, body: str) -> str:
    """Where gamma of a body comes from, in words."""
    weighed = any(level.table.mass_particle_kg is not None and level.table.gamma is None for level in body_levels(source, body))
    return "from the masses" if weighed else "as stated"


def bind_quantities(source: CampaignFile, levels: Iterable[Level], *, where: str) -> dict[str, Bound]:
    """Every quantity of the phase curve as the tables of `levels` give it, effects where they are said and not 0; `where` names them in messages.

    Raises InputError where one is missing, said twice at one level, or out of its physical range.
    """
    tables = tuple(levels)
    bound = {name: _bind(source, tables, name, where) for name in QUANTITIES}
    effects = {name: _bind(source, tables, name, where) for name in EFFECTS}
    bound |= {name: b for name, b in effects.items() if b.source != 0.0}
    centre = {name: b.source if isinstance(b.source, float) else b.source.centre for name, b in bound.items()}
    others = centre["gamma"] / centre["rho"] + centre["trailing_fraction"]
    if others > 1.0:
        home = next((level for level in tables if level.table.gamma is not None), tables[0])
        rule = "leaves no mass for the disk: gamma/rho + trailing_fraction must be at most 1"
        raise source.places.error(rule, (*home.path, "gamma"), value=others)
    return bound


def _bind(source: CampaignFile, levels: tuple[Level, ...], name: str, where: str) -> Bound:
    kind = _KINDS[name]
    for level in levels:
        said = [key for key in kind.keys if getattr(level.table, key) is not None]
        weighed = [key for key in _MASSES if getattr(level.table, key) is not None]
        if len(said) > 1:
            raise source.places.error(f"must not stand beside '{said[0]}'", (*level.path, said[1]))
        if said:
            value = read_key(source, level, said[0], factor=kind.keys[said[0]])
            if name == "gamma" and weighed:
                _check_masses(source, levels, value, (*level.path, "gamma"), _bind(source, levels, "rho", where).source)
            return Bound(name + level.suffix, _checked(source, value, kind, (*level.path, said[0])))
        if weighed and name in ("gamma", "trailing_fraction"):
            value = _from_masses(source, levels, name, _bind(source, levels, "rho", where).source)
            return Bound(name + level.suffix, _checked(source, value, kind, (*level.path, weighed[0])))
    if kind.default is not None:
        return Bound(name, kind.default)
    rule = f"is missing for {where}: say it there, for its body or under [shared]"
    raise source.places.error(rule + (" (or give the masses)" if name == "gamma" else ""), levels[0].path, field=next(iter(kind.keys)))


def _checked(source: CampaignFile, value: Quantity | Prior, kind: Kind, path: tuple[str | int, ...]) -> float | Prior:
    """A number or a prior that respects the quantity's physical limit."""
    centre = value.value if isinstance(value, Quantity) else value.centre
    if centre < kind.low or (centre == 0.0 and not kind.zero):
        raise source.places.error(f"must be {'>=' if kind.zero else '>'} {kind.low:g}", path, value=centre)
    if abs(centre) > kind.high and kind.too_large:
        raise source.places.error(kind.too_large, path, value=centre)
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

    tables = tuple(levels)
    read = [_mass(source, tables, key) for key in _MASSES]
    disk, particle, trailing = (m.value if m.exact else ufloat(m.value, m.u) for m in read)
    distance = rho if isinstance(rho, float) else ufloat(rho.expectation, rho.sd)
    try:
        ratio = getattr(Body.from_masses(1.0, disk, particle, kappa=0.5, rho=distance, mass_trailing=trailing), name)
        return Quantity(ratio) if isinstance(ratio, float) else Quantity(ratio.nominal_value, ratio.std_dev)
    except (OverflowError, ZeroDivisionError):
        home = next(t for t in tables if any(getattr(t.table, k) is not None for k in _MASSES))
        raise source.places.error("is too far from the other masses to take a ratio", (*home.path, _MASSES[0])) from None


def _check_masses(source: CampaignFile, levels: tuple[Level, ...], gamma: Quantity | Prior, path: tuple[str | int, ...], rho: float | Prior) -> None:
    """Masses beside a stated gamma give the total mass only; raises InputError where they give another gamma."""
    weighed = _from_masses(source, levels, "gamma", rho)
    centre, sd = (gamma.value, gamma.u) if isinstance(gamma, Quantity) else (gamma.centre, gamma.sd)
    if abs(weighed.value - centre) > _SAME_SDS * np.hypot(sd, weighed.u) + _SAME_SHARE * centre:
        rule = f"contradicts the masses beside it, which give {format_quantity(weighed.value, weighed.u)}: say one of the two"
        raise source.places.error(rule, path, value=centre)


def total_mass(source: CampaignFile, levels: Iterable[Level]) -> float | None:
    """Sum of the masses (kg) where they are given, else None."""
    tables = tuple(levels)
    if not any(getattr(level.table, key) is not None for level in tables for key in _MASSES):
        return None
    return sum(_mass(source, tables, key).value for key in _MASSES)
