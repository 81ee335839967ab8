"""Campaigns of rolling bodies: their quantities, and the problems that its runs pose.

A quantity is looked up at the run, then at its body, then under [shared]; where it is found decides
what is one unknown: "phi[heavy-04]" belongs to one run, "gamma[heavy]" to one body's runs, a bare
"rolling_resistance" to all.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

from estim.arrays import max_abs
from estim.campaign.between_runs import spreads_of, varied
from estim.campaign.binding import KINDS_OF_QUANTITIES, bind_quantities, grip_of, total_mass
from estim.campaign.blur import blurs
from estim.campaign.campaign import Campaign
from estim.campaign.campaign_file import NoiseTable
from estim.campaign.candidate_causes import (
    Candidate,
    Surroundings,
    sketches,
    unit_slips,
    with_lines,
    without,
)
from estim.campaign.curve_models import ADDED, CurveModel, outlines
from estim.campaign.effects import setting_of, stated_place, with_full_curves
from estim.campaign.lookup_levels import Levels, run_levels, stated_noise
from estim.campaign.noise_models import NoiseModel, noise_candidates
from estim.campaign.plausible import check_radius, check_speeds
from estim.campaign.points import Observed, observe
from estim.campaign.unmodelled_force import (
    Circumstances,
    Stance,
    force_scale,
    misfit_force,
    possible_force,
    refuse_force,
    track_of,
)
from estim.common import InputError, format_rounded, later, phrase, split_level
from estim.curves import MotionCurve, PhaseCurve, RollingMotion, Setting
from estim.explanation import Cause, Suspects
from estim.fitting import FORCE_KEY
from estim.problem import Observations, Parameter, Prior, Problem, shared_first
from estim.reading import KeyPath

_DISPLACED = 0.05  # of the length


@dataclass(frozen=True, eq=False)
class RollingCampaign(Campaign):
    """Runs of rolling bodies: the phase curve with the quantities of a campaign file."""

    def suspects(self, names: Sequence[str]) -> Suspects:
        """The runs `names` as stated, and with what known physics, or the instruments, may add to
        them that the campaign does not state.
        """
        stated, causes = self._posed(names, white=True), []
        for candidate in self._candidates(stated):
            campaign = replace(self, source=candidate.source)
            try:
                problem = campaign._posed(names, white=True)
            except InputError:
                continue  # it contradicts what is stated: no such angle in radians
            cause = Cause(
                candidate.name,
                candidate.words,
                problem,
                tuple(name for name in problem.names if split_level(name)[0] in candidate.of),
                candidate.lines,
                candidate.remark,
                candidate.scanned,
                begin=candidate.begin,
                slip=candidate.slip,
                posed=None if candidate.slip else partial(campaign._posed, names, usual=True),
            )
            causes.append(cause)
        room = phrase("the unmodelled force included in the fit allows for it")
        return Suspects(stated, room, tuple(causes))

    def _candidates(self, problem: Problem) -> Iterator[Candidate]:
        """What the runs of `problem` may have that the campaign does not state."""
        source = self.source
        yield from sketches(source, self._surroundings(problem))
        levels = [self.levels(name) for name in problem.run_names]
        tables = [self.tables[name] for name in problem.run_names]
        yield from blurs(levels, tables)
        coordinates = {table.coordinate for table in tables}
        key = "offset_rad" if "theta_rad" in coordinates else "offset_m"
        one_coordinate = len(coordinates) == 1  # angles and lengths have no zero in common
        if one_coordinate and all(of_run.first(key) is None for of_run in levels):
            reach = _DISPLACED * max(max_abs(run.position) for run in problem.runs)
            lines = ("[[runs]]", f'{key} = "0 +/- {format_rounded(reach, reach)}"')
            words = phrase("positions whose zero is not at the release")
            yield with_lines(source, "offset", words, lines)
        yield from unit_slips(source)

    def _surroundings(self, problem: Problem) -> tuple[Surroundings, ...]:
        """What is known of the runs."""
        known = []
        for run in problem.runs:
            levels = self.levels(run.name)
            bound = bind_quantities(levels)
            sources = {q: b.source for q, b in bound.items() if not b.by_default}
            reach = max_abs(run.position)
            known.append(
                Surroundings(
                    sources,
                    total_mass(levels),
                    reach,
                    self.tables[run.name].coordinate == "theta_rad",
                    run.positions,
                )
            )
        return tuple(known)

    def curve_models(self, names: Sequence[str]) -> tuple[CurveModel, ...]:
        self.problem(names)
        stated = self._posed(names, compared=True)
        forced = all(run.force for run in stated.runs)
        paper = replace(self, source=without(self.source, ADDED))
        sources = {
            q: source
            for run in self._surroundings(stated)
            for q, source in run.sources.items()
            if source != 0.0
        }
        known = sketches(paper.source, paper._surroundings(stated))
        every = {sketch.name: sketch for sketch in known}
        models, of_paper = [], frozenset[str]()
        for outline in outlines(self.source, sources, every, forced=forced):
            problem = replace(self, source=outline.source)._posed(
                names, white=not forced, compared=forced, usual=True
            )
            of_paper = of_paper or frozenset(problem.names)
            added = tuple(name for name in problem.names if name not in of_paper)
            models.append(
                CurveModel(
                    outline.name,
                    outline.words,
                    problem,
                    added,
                    outline.lines,
                    outline.forced,
                    forced,
                )
            )
        return tuple(models)

    def _posed(
        self,
        names: Sequence[str],
        *,
        noise: NoiseTable | None = None,
        white: bool = False,
        compared: bool = False,
        usual: bool = False,
    ) -> Problem:
        """white : without an allowance for what the curve may lack.
        compared : with room for a force wherever there can be one.
        """
        physics: dict[str, Parameter] = {}
        unknowns: dict[str, Parameter] = {}
        runs = []
        every = {name: observe(self.tables[name], self.levels(name), noise=noise) for name in names}
        tracks = {name: track_of(self.levels(name)) for name in names}
        sharing = Counter(tracks.values())
        points_on: Counter[str] = Counter()
        for name in names:
            points_on[tracks[name]] += every[name].y.size
        for name in names:
            levels = self.levels(name)
            bound = bind_quantities(levels)
            observed = every[name]
            mass = total_mass(levels)
            angular = self.tables[name].coordinate == "theta_rad"
            # an encoder has no length scale
            bound = {
                q: b
                for q, b in bound.items()
                if not b.by_default or (usual and not (angular and q == "scale_x"))
            }
            sources = {q: b.source for q, b in bound.items()}
            setting = setting_of(
                levels, sources, mass, positions=observed.positions, angular=angular
            )
            for quantity, b in bound.items():
                if not isinstance(b.source, float):
                    kind = KINDS_OF_QUANTITIES[quantity]
                    physics.setdefault(
                        b.name, Parameter(b.name, kind.unit, b.source, kind.meaning, kind.notation)
                    )
            unknowns.update({p.name: p for p in observed.parameters})
            arguments = {
                q: b.source if isinstance(b.source, float) else b.name for q, b in bound.items()
            }
            posed = _observations(
                name, observed, arguments, mass, setting, grip_of(levels), angular=angular
            )
            circumstances = Circumstances(
                observed,
                joint=len(names) > 1,
                tied=points_on[tracks[name]] if sharing[tracks[name]] > 1 else 0,
                replaced=noise is not None,
            )
            stance = (
                Stance(0.0)
                if white
                else (possible_force if compared else force_scale)(levels, circumstances)
            )
            runs.append(
                replace(
                    posed,
                    force=stance.scale,
                    complete=stance.complete,
                    track=tracks[name],
                    asked=stance.stated,
                )
            )
        centres = {name: p.prior.centre for name, p in (physics | unknowns).items()}
        runs = with_full_curves(
            runs, {name: stated_place(self.levels(name), "ramp") for name in names}, centres
        )
        spreads = {name: spreads_of(self.levels(name), KINDS_OF_QUANTITIES) for name in names}
        further, every_run = varied(runs, spreads)
        return Problem(
            (*shared_first([*physics.values(), *further], every_run), *unknowns.values()), every_run
        )

    def levels(self, name: str) -> Levels:
        """The tables of the campaign file that apply to a run."""
        return run_levels(self.source, name)

    def check(self, name: str) -> None:
        observed = self._posed([name]).runs[0]
        bound = bind_quantities(self.levels(name))
        sources = {quantity: b.source for quantity, b in bound.items()}
        check_radius(self.tables[name], sources, self.levels(name))
        check_speeds(
            observed,
            sources,
            angular=self.tables[name].coordinate == "theta_rad",
            file=self.tables[name].file,
        )

    def body_of(self, name: str) -> str | None:
        return next(run.body for run in self.source.runs if run.name == name)

    def _unit_of(self, argument: str, name: str) -> str:
        """The SI's."""
        return KINDS_OF_QUANTITIES[argument].unit if argument in KINDS_OF_QUANTITIES else "1"

    def noise_models(self, name: str) -> tuple[NoiseModel, ...]:
        return noise_candidates(
            self.levels(name),
            self.tables[name],
            lambda noise: self._posed([name], noise=noise).runs[0].noise,
        )

    def _placed(self, error: InputError, problem: Problem) -> InputError:
        """The error at the line of the key that asks for a force, where it is about one."""
        name, level = split_level(error.field or "")
        return misfit_force(self.levels(level[1:-1]), error) if name == FORCE_KEY else error

    def refuse_discrepancy(self, command: str) -> None:
        """A body has no such curve; its force is part of the model."""

    def _path_of_unknowns(self, name: str) -> KeyPath:
        return ("runs", [run.name for run in self.source.runs].index(name))

    def require_draws(self, problem: Problem, *, of_priors: bool) -> None:
        """Every prior of a rolling body can be drawn from; raises InputError for an unmodelled
        force, which simulated data do not contain.
        """
        self.require_complete(problem.run_names, "estim calibrate")

    def require_complete(self, names: Sequence[str], command: str) -> None:
        for name in names:
            refuse_force(self.levels(name), command)

    def require_speeds(self, names: Sequence[str], command: str) -> None:
        for name in names:
            noise = stated_noise(self.levels(name))
            if noise.table.model == "positions":
                raise noise.error(
                    f"must not be 'positions' for {command}, which needs speeds: give it a "
                    'campaign with model = "differentiated"',
                    "model",
                )
            if noise.table.robust is not None:
                raise noise.error(
                    f"does not go with {command}, which takes the errors as normal",
                    "robust",
                    value=noise.table.robust,
                )


def _observations(
    name: str,
    observed: Observed,
    arguments: Mapping[str, str | float],
    mass: float | None,
    setting: Setting,
    grip: Prior | float | None,
    *,
    angular: bool,
) -> Observations:
    """The points of a run with the curve that explains them: positions in time, or speeds along the
    way.
    """
    position, x_unit = (
        (later("angle turned θ − θ₀"), "rad") if angular else (later("position x"), "m")
    )
    speed, y_unit = (later("angular rate ω"), "rad/s") if angular else (later("speed v"), "m/s")
    axes = (
        (later("time t"), "s", position, x_unit)
        if observed.positions
        else (position, x_unit, speed, y_unit)
    )
    reach = max_abs(observed.y if observed.positions else observed.x)
    motion = RollingMotion(angular, mass, observed.positions, setting, reach, grip=grip)
    curve = (MotionCurve if observed.positions else PhaseCurve)(angular, setting)
    return Observations(
        name=name,
        x=observed.x,
        y=observed.y,
        t=observed.t,
        curve=curve,
        arguments={**arguments, **observed.arguments},
        noise=observed.noise,
        excluded=observed.excluded,
        excluded_points=observed.excluded_points,
        x_name=axes[0],
        x_unit=axes[1],
        y_name=axes[2],
        y_unit=axes[3],
        motion=motion,
        words=motion.words(),
        positions=observed.positions,
        rows=observed.rows,
    )
