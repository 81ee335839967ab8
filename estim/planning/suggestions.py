"""Further runs that a campaign suggests, and those that its [plan] requests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import degrees, radians

import numpy as np

from estim.campaign import Campaign, NewRun, planned_quantities
from estim.common import Quantity, phrase
from estim.fitting import Fit
from estim.planning.candidates import MORE, Change, further
from estim.problem import Observations

_RELEASES = (1.0, 179.0)  # degrees, of a body that climbs


def more_runs(campaign: Campaign, fit: Fit) -> tuple[Change, ...]:
    """Every run once more, all of them, and for each body runs on other ramps, from other angles,
    with other particles.
    """
    runs, named = fit.problem.runs, fit.named
    changes = [_once_more([run.name], campaign) for run in runs]
    if len(runs) > 1:
        changes.append(_once_more([run.name for run in runs], campaign))
    for body in dict.fromkeys(campaign.body_of(run.name) for run in runs):
        own = [run for run in runs if campaign.body_of(run.name) == body]
        changes += _other_runs(own, fit, named, body or "")
    return tuple(changes)


def planned_runs(campaign: Campaign) -> tuple[Change, ...]:
    """The runs that the campaign's [plan] requests.  Raises InputError with its line."""
    changes = []
    for i, table in enumerate(campaign.source.plan.runs):
        stated = planned_quantities(campaign.source, table, i)
        new = tuple(
            NewRun(_free_name(campaign, i, k), table.like, stated) for k in range(table.repeats)
        )
        which = (
            _which(campaign.body_of(table.like) or "", stated)
            if stated
            else phrase(" like {run}", run=table.like)
        )
        changes.append(further(which, own=True, runs=new))
    return tuple(changes)


def repeated(change: Change, times: int) -> Change:
    """The change with each of its runs and readings so many times."""
    runs = tuple(
        NewRun(f"{run.name}.{k}", run.like, run.quantities)
        for run in change.runs
        for k in range(times)
    )
    readings = tuple(replace(reading, n=reading.n * times) for reading in change.readings)
    if change.which:
        return further(change.which, own=change.own, runs=runs, readings=readings)
    words = phrase("{words}, {n} times", words=change.words, n=times)
    return Change(words, MORE, change.own, runs=runs, readings=readings)


def _once_more(names: Sequence[str], campaign: Campaign) -> Change:
    words = (
        phrase("{run} repeated", run=names[0])
        if len(names) == 1
        else phrase("every run repeated ({n} runs)", n=len(names))
    )
    return Change(
        words,
        MORE,
        runs=tuple(NewRun(_free_name(campaign, i, 0), name, {}) for i, name in enumerate(names)),
    )


def _other_runs(
    runs: Sequence[Observations], fit: Fit, named: Mapping[str, object], body: str
) -> list[Change]:
    tilts, releases = (
        [float(_value(run, argument, named)) for run in runs] for argument in ("phi", "theta0")
    )
    middle = int(np.argsort(tilts)[len(tilts) // 2])
    like, tilt, release = runs[middle], tilts[middle], releases[middle]
    u_tilt, u_release, u_gamma = (
        _stated_u(like, argument, fit) for argument in ("phi", "theta0", "gamma")
    )
    gamma, changes = _value(like, "gamma", named), list[Change]()

    def tilted(factor: float) -> dict[str, Quantity]:
        """A tilt so many times the middle one, where it is another."""
        phi = radians(_two_digits(degrees(tilt) * factor))
        return {} if factor == 1.0 else {"phi": Quantity(phi, u_tilt)}

    for factor in (0.5, 1.0, 1.5, 2.0):
        # degrees beside the middle angle at release
        for turn in (-30.0, -15.0, 0.0, 15.0, 30.0):
            angle = degrees(release) + turn
            if tilt > 0.0 and not _RELEASES[0] <= angle <= _RELEASES[1]:
                continue
            stated = {} if turn == 0.0 else {"theta0": Quantity(radians(round(angle)), u_release)}
            if stated := stated | tilted(factor):
                changes.append(_run(f"{len(changes)}", like, stated, body, tilt, radians(angle)))
    if gamma > 0.0:
        # times that of the body, and the tilt that goes with it
        for share, factor in ((0.5, 0.5), (1.5, 1.0), (1.5, 1.5)):
            stated = {"gamma": Quantity(_two_digits(gamma * share), u_gamma)} | tilted(factor)
            changes.append(_run(f"{len(changes)}", like, stated, body, tilt, release))
    return changes


def _run(
    number: str,
    like: Observations,
    stated: Mapping[str, Quantity],
    body: str,
    tilt: float,
    release: float,
) -> Change:
    shown = {"phi": Quantity(tilt), "theta0": Quantity(release)} | dict(stated)
    return further(_which(body, shown), runs=(NewRun(f"{like.name}+{number}", like.name, stated),))


def _which(body: str, stated: Mapping[str, Quantity]) -> str:
    places = []
    if "phi" in stated:
        places.append(f"φ = {degrees(stated['phi'].value):.2g}°")
    if "theta0" in stated:
        places.append(f"θ₀ = {degrees(stated['theta0'].value):.0f}°")
    at = phrase(" at {places}", places=", ".join(places)) if places else ""
    if "gamma" in stated:
        return (
            phrase(
                " of the disk of {body} with γ = {gamma:.2g}",
                body=body,
                gamma=stated["gamma"].value,
            )
            + at
        )
    return phrase(" of {body}", body=body) + at


def _value(run: Observations, argument: str, named: Mapping[str, object]) -> float:
    source = run.arguments[argument]
    return float(np.ravel(np.asarray(named[source]))[0]) if isinstance(source, str) else source


def _stated_u(run: Observations, argument: str, fit: Fit) -> float:
    """The standard uncertainty with which a quantity of a run was stated; 0 for an exact one."""
    source = run.arguments[argument]
    return (
        fit.problem.parameters[fit.names.index(source)].prior.sd if isinstance(source, str) else 0.0
    )


def _two_digits(value: float) -> float:
    return float(f"{value:.2g}")


def _free_name(campaign: Campaign, i: int, k: int) -> str:
    name = f"planned-{i + 1}.{k + 1}"
    while name in campaign.run_names:
        name += "+"
    return name
