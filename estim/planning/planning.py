"""What to measure next: expected standard deviations for everything that might be measured, by
linear theory, and which is best.

The information of the campaign as it stands (data and what is stated) is set beside that of the
same campaign with each change made:

    u = sqrt(diag (sum J^T C^-1 J + P)^-1)

    J    slopes of the curves at the fit
    C    covariance of the errors
    P    what is stated

Everything is taken at the fit, without the errors of the data at hand, so that all rows of the
table are the same.  C has the free start and the unmodelled force of a default analysis
(`estim.discrepancy.unmeasured_runs`).  Linear theory knows no edges and no bends: the present
posterior, drawn, shows how far it is to be trusted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import FloatArray
from estim.calibration import posterior_draws
from estim.campaign import Campaign, quantity_of_key
from estim.checks import check_goodness, check_stated_values, failed_tests, stated_values
from estim.common import Finding, InputError, Stream, later, phrase, split_level, stream, wrong
from estim.fitting import Fit, fit_problem
from estim.planning.candidates import (
    BETTER,
    OTHERWISE,
    Change,
    FurtherReadings,
    better_words,
    further,
    measured_better,
    measured_otherwise,
    which_place,
)
from estim.planning.expected_uncertainty import Option, sds_with, weigh
from estim.planning.further_reading import ReadingsAtPlaces, more_readings, weigh_places
from estim.planning.halving import Halving, ways_to_halve
from estim.planning.planned_readings import CurveBasis
from estim.planning.rolling import Outlook, posed, rolling_basis
from estim.planning.suggestions import more_runs, planned_runs
from estim.problem import Parameter, Problem, uses_of

FAR = 0.15  # how far linear theory may be from the drawn posterior before it is not to be trusted
Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Plan:
    """What further measurements would do.

    targets : the quantities of interest.
    values : (n_target,) at the fit.
    now : (n_target,) present standard deviations, by linear theory.
    drawn : (n_target,) those of the drawn posterior of the data at hand.
    how : what drew it.  shortfall : what the draws did not reach, "" for nothing.
    options : everything that was evaluated, the best first.  refused : what cannot be measured.
    halving : for each target what would halve its standard deviation.
    along : of a user's own curve, one further reading at each place.
    force : whether an unmodelled force is part of the errors.
    findings : what is wrong with the fit that all this comes from.
    """

    campaign: Campaign
    names: tuple[str, ...]
    fit: Fit
    targets: tuple[Parameter, ...]
    values: FloatArray
    now: FloatArray
    drawn: FloatArray
    how: str
    shortfall: str
    options: tuple[Option, ...]
    refused: tuple[Option, ...]
    halving: tuple[Halving, ...]
    along: tuple[ReadingsAtPlaces, ...]
    force: bool
    findings: tuple[Finding, ...]
    seed: int

    @property
    def far(self) -> tuple[Parameter, ...]:
        """Targets of which linear theory is not to be trusted."""
        deviates = np.abs(self.now / self.drawn - 1.0) > FAR
        return tuple(p for p, far in zip(self.targets, deviates, strict=True) if far)


def plan(
    campaign: Campaign,
    names: Sequence[str],
    *,
    target_names: Sequence[str] = (),
    seed: int,
    progress: Progress | None = None,
) -> Plan:
    """What to measure next of the runs `names` of a campaign, fit together; the same seed gives the
    same numbers.  Raises InputError.

    target_names : names of parameters, at any level; none for those that [plan] names, or that the
        campaign leaves unknown.
    """
    problem = posed(campaign, names)
    campaign.require_unknowns(problem)
    campaign.refuse_discrepancy("estim plan")
    if problem.counted:
        rule = "is that of counts or of single events, for which estim plan makes no plans"
        raise campaign.source.error(rule, ("curve", "noise"))
    targets = targets_of(campaign, problem, target_names)
    requested = (
        *_requested_changes(campaign, problem),
        *planned_runs(campaign),
        *_requested_readings(campaign, problem),
    )
    with campaign.placing(problem):
        fit = fit_problem(problem, rng=stream(seed, Stream.PLAN_FIT))
    tested = failed_tests(check_goodness(fit, rng=stream(seed, Stream.PLAN_TESTS)), dof=fit.dof)
    findings = wrong([*tested, stated_values(fit, check_stated_values(fit))])
    draws, how, shortfall = posterior_draws(fit, 1000.0, stream(seed, Stream.PLAN_DRAWS))
    basis = (
        rolling_basis(campaign, names, fit)
        if campaign.formula is None
        else CurveBasis(campaign, tuple(names), fit)
    )
    basis = replace(basis, fit=_with_sizes_of(draws, fit))
    nothing = Change(phrase("present experiment"), OTHERWISE)
    present = basis.outlook(nothing)
    columns = [present.problem.names.index(p.name) for p in targets]
    now = sds_with(present, {}, targets)
    along = weigh_places(basis, present, targets) if isinstance(basis, CurveBasis) else ()
    suggested = _suggested(campaign, fit, present, along) if campaign.source.plan.built_in else ()
    changes, done = (*requested, *suggested), list[Option]()
    for i, change in enumerate(changes):
        done.append(weigh(basis, change, targets, now))
        if progress is not None:
            progress(i + 1, len(changes))
    possible = sorted(
        (option for option in done if not option.reason), key=lambda option: option.score
    )
    drawn = np.std(draws[:, [fit.names.index(p.name) for p in targets]], axis=0)
    halving = ways_to_halve(basis, present, targets, now, possible)
    return Plan(
        campaign,
        tuple(names),
        fit,
        targets,
        present.values[columns],
        now,
        drawn,
        how,
        shortfall,
        tuple(possible),
        tuple(option for option in done if option.reason),
        halving,
        along,
        bool(getattr(basis, "sizes", {})),
        findings,
        seed,
    )


def _with_sizes_of(draws: FloatArray, fit: Fit) -> Fit:
    """The fit with the sizes of errors, and spreads between runs with the deviations of these, at
    their medians in the draws (n_draw, n_par): at the mode errors are too small, since the curve
    was fitted to the same residuals, and spreads too large.
    """
    spreads, _ = fit.spreads_and_effects
    drawn = [
        name in spreads or name in fit.problem.noise_names or name in fit.problem.effects
        for name in fit.names
    ]
    return replace(fit, values=np.where(drawn, np.median(draws, axis=0), fit.values))


def targets_of(
    campaign: Campaign, problem: Problem, target_names: Sequence[str]
) -> tuple[Parameter, ...]:
    """The quantities of interest: as named here or in [plan], else those that the campaign leaves
    unknown.  Raises InputError.
    """
    requested, place = (
        (list(target_names), None)
        if target_names
        else (campaign.source.plan.wanted, ("plan", "for"))
    )
    of_curve = [p for p in problem.parameters if uses_of(problem.runs)[p.name]]
    targets: list[Parameter] = []
    for name in requested:
        named = [p for p in problem.parameters if name in (p.name, split_level(p.name)[0])]
        if not named:
            rule = (
                "must name an unknown of these runs "
                f"({', '.join(dict.fromkeys(split_level(p.name)[0] for p in problem.parameters))})"
            )
            if place is None:
                raise InputError(rule, field="--for", value=name, file=campaign.source.path)
            raise campaign.source.error(rule, place, value=name)
        targets += [p for p in named if p not in targets]
    if targets:
        return tuple(targets)
    unknown = [p for p in of_curve if not p.prior.informative]
    return tuple(
        unknown or [p for p in of_curve if not p.prior.measured] or of_curve or problem.parameters
    )


def _suggested(
    campaign: Campaign, fit: Fit, present: Outlook, along: Sequence[ReadingsAtPlaces]
) -> tuple[Change, ...]:
    moving = campaign.formula is None
    more = more_runs(campaign, fit) if moving else more_readings(present, along)
    _, effects = fit.spreads_and_effects
    better = measured_better(present.problem, effects)
    return (*better, *measured_otherwise(moving=moving), *more)


def _requested_readings(campaign: Campaign, problem: Problem) -> list[Change]:
    changes = []
    for reading in campaign.source.plan.readings:
        run = reading.run or problem.runs[0].name
        if run in [one.name for one in problem.runs]:
            which = which_place(problem, run, reading.x)
            readings = (FurtherReadings(run, reading.x, reading.n),)
            changes.append(further(which, own=True, readings=readings))
    return changes


def _requested_changes(campaign: Campaign, problem: Problem) -> list[Change]:
    """The changes that [[plan.change]] requests.  Raises InputError with its line."""
    changes = []
    for i, table in enumerate(campaign.source.plan.change):
        u: dict[str, float] = {}
        words = []
        for key, size in table.u.items():
            base, level = split_level(key)
            name, factor = (
                (base, 1.0)
                if campaign.formula is not None
                else quantity_of_key(base) or (base, 1.0)
            )
            matching = [
                p
                for p in problem.parameters
                if split_level(p.name)[0] == name and (not level or split_level(p.name)[1] == level)
            ]
            path = ("plan", "change", i, "u", key)
            if not matching:
                raise campaign.source.error(
                    "is not an unknown of these runs: it is exact here, or its key does not exist",
                    path,
                )
            for p in matching:
                if p.prior.measured and size * factor >= p.prior.sd:
                    raise campaign.source.error(
                        f"is no better than what is stated of {p.name}", path, value=size
                    )
            new = {p.name: size * factor for p in matching}
            u |= new
            words.append(better_words(matching, new))
        for times, text in (
            (table.frames, later("{n:g} times as many frames")),
            (table.reading_error, later("{n:g} times the error of a reading")),
            (table.reach, later("{n:g} times the path length")),
        ):
            words += [phrase(text, n=times)] if times != 1.0 else []
        description = f"{table.name} ({'; '.join(words)})" if table.name else "; ".join(words)
        group = BETTER if len(words) == len(table.u) else OTHERWISE
        changes.append(
            Change(
                description,
                group,
                own=True,
                u=u,
                frames=table.frames,
                error=table.reading_error,
                reach=table.reach,
            )
        )
    return changes
