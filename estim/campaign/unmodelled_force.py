"""The unmodelled force of a campaign: what the key `unmodelled_force` states of a run, and where it
may stand.

Where nothing is stated it stands beside the curve of every run that it goes with; elsewhere the
curve is taken as complete, and the reason is kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estim.campaign.lookup_levels import Level, Levels
from estim.campaign.points import Observed
from estim.common import OF_BODY, Finding, InputError, later, phrase
from estim.discrepancy import FORCE_SCALE
from estim.fitting import FORCE_KEY, complete_as, taken_as_complete
from estim.problem import Problem

# of runs that share a force: the covariance of all of them is diagonalised some two dozen times
MOST_POINTS = 1500


@dataclass(frozen=True, eq=False)
class Circumstances:
    """What decides whether a force can stand beside the curve of a run.

    joint : whether the run is fit together with others.
    tied : number of points of those that would share its force, 0 where it shares none.
    replaced : whether its noise is not the one that the campaign states.
    """

    observed: Observed
    joint: bool
    tied: int
    replaced: bool

    @property
    def inferred(self) -> str:
        """The first size of the noise that is inferred, "" where all are stated."""
        return next((name.partition("[")[0] for name in self.observed.noise.parameters), "")

    @property
    def named(self) -> dict[str, object]:
        """What the words of an obstacle may name."""
        return {"inferred": self.inferred, "tied": self.tied, "most": MOST_POINTS}


@dataclass(frozen=True, eq=False)
class Obstacle:
    """Where a force does not go.  what : it does not go with.  instead : what to do where one was
    requested.
    """

    stands: Callable[[Circumstances], bool]
    what: str
    instead: str


OBSTACLES = (
    Obstacle(
        lambda c: c.observed.noise.robust,
        later("'robust' noise"),
        "omit it: in a fit with a force single bad frames are detected and named",
    ),
    Obstacle(
        lambda c: bool(np.any(c.observed.noise.x_gain() > 0.0)),
        later("errors of the positions of independent speeds"),
        "take their standard deviation out",
    ),
    Obstacle(
        lambda c: bool(c.inferred),
        later("a '{inferred}' that is inferred, which would absorb the force"),
        "state the error of the instrument, or omit it",
    ),
    Obstacle(lambda c: c.replaced, later("a comparison of noise models"), "set it to 0 for that"),
    Obstacle(
        lambda c: c.joint and c.observed.positions,
        later("noise model 'positions' in a joint fit yet"),
        "fit the runs one by one",
    ),
    Obstacle(
        lambda c: c.tied > MOST_POINTS,
        later("runs that share it and have {tied} points, more than {most}"),
        "fit fewer runs, or state it for each run, which gives each a force of its own",
    ),
)


@dataclass(frozen=True, eq=False)
class Stance:
    """scale : of the prior of a force, in units of the weight, 0 for none.  complete : why there is
    none; None where there is one.  stated : whether the campaign states it.
    """

    scale: float
    complete: Finding | None = None
    stated: bool = False


def force_scale(levels: Levels, circumstances: Circumstances) -> Stance:
    """Whether a force stands beside the curve of a run, and how large it may be: as stated, else
    the default wherever nothing is in its way.

    Raises InputError at the key's line where one is requested that has an obstacle, or is no share
    of the weight.
    """
    level = levels.first(FORCE_KEY)
    stated = None if level is None else level.table.unmodelled_force
    if stated == 0.0:
        return Stance(0.0, complete_as(phrase("as stated"), levels.run.name))
    obstacle = next((obstacle for obstacle in OBSTACLES if obstacle.stands(circumstances)), None)
    if level is None or stated is None:
        if obstacle is None:
            return Stance(FORCE_SCALE)
        reason = phrase(
            "an unmodelled force cannot be combined with {what}",
            what=phrase(obstacle.what, **circumstances.named),
        )
        return Stance(0.0, complete_as(reason, levels.run.name))
    scale = float(stated)
    # a force as large as the weight is no small thing that was left out
    if not (math.isfinite(scale) and 0.0 < scale <= 1.0):
        raise _error(
            levels,
            level,
            "is a share of the weight: it must lie between 0 (none) and 1; where nothing "
            "is said it is 0.02",
            value=scale,
        )
    if obstacle is not None:
        raise _error(
            levels,
            level,
            f"does not go with {obstacle.what.format(**circumstances.named)}: {obstacle.instead}",
        )
    return Stance(scale, stated=True)


def possible_force(levels: Levels, circumstances: Circumstances) -> Stance:
    """The same for a comparison of models: as stated, the default also where 0 is stated; none
    where there is an obstacle.
    """
    level = levels.first(FORCE_KEY)
    if (
        level is not None
        and not level.table.unmodelled_force
        and not any(obstacle.stands(circumstances) for obstacle in OBSTACLES)
    ):
        return Stance(FORCE_SCALE, stated=True)
    return force_scale(levels, circumstances)


def refuse_force(levels: Levels, command: str) -> None:
    """Raises InputError where a run has an unmodelled force, which `command` does not support."""
    level = levels.first(FORCE_KEY)
    if level is not None and level.table.unmodelled_force:
        raise _error(
            levels,
            level,
            f"is not supported by {command}, which assumes that the curve is complete: set "
            "it to 0 for that",
        )


def as_complete(problem: Problem, command: str) -> Problem:
    """`problem` without the forces that were not requested, as `command` takes its curves."""
    return taken_as_complete(
        problem, phrase("{command} does not support an unmodelled force", command=command)
    )


def track_of(levels: Levels) -> str:
    """What runs that share a force have in common: the body, whose profile and ramp it belongs to;
    where the key stands at a run the force is that run's alone.

    One force for two bodies is much worse than one for each, so a key under [shared] or at a body,
    or none at all, gives each body one that its runs share.
    """
    run = levels.run
    return run.name if run.unmodelled_force is not None else f"{OF_BODY}{run.body}"


def misfit_force(levels: Levels, error: InputError) -> InputError:
    """An error of a fit about the force of a run, at the key's line."""
    level = levels.first(FORCE_KEY)
    assert level is not None, "raised where it was asked for"
    return _error(levels, level, error.rule, value=error.value)


def _error(levels: Levels, level: Level, rule: str, *, value: object = None) -> InputError:
    return levels.error(rule, (*level.path, FORCE_KEY), value=value)
