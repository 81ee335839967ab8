"""The models of a rolling body that `estim compare-models` puts side by side, by the keys of a
campaign; each a problem of the same points.

    paper                 weight and inertia alone: no resistance, exactly at rest when released
                          (arXiv 1403.7220)
    rolling-resistance    and so on: the paper's model and one thing more, with the prior that the
                          campaign states, else that of `estim fit --explain`
    as-stated             all that the campaign states, where that is more than one of these
    unmodelled-force      what the campaign states, with room for a force along the track and a
                          free start: what `estim fit` does
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from estim.campaign.campaign_file import CampaignFile
from estim.campaign.candidate_causes import Candidate, without
from estim.common import PhraseTable, phrase
from estim.discrepancy import START_SD
from estim.problem import Prior, Problem

GROUPS: Mapping[str, tuple[str, ...]] = {
    "rolling-resistance": ("rolling_resistance",),
    "load-resistance": ("load_resistance",),
    "resisting-moment": ("moment",),
    "viscous-drag": ("viscous_drag",),
    "quadratic-drag": ("quadratic_drag",),
    "moment-once": ("moment_once_cos", "moment_once_sin"),
    "moment-twice": ("moment_twice_cos", "moment_twice_sin"),
    "free-start": ("release_energy", "release_speed"),
}
"""Name of a model -> the quantities that it adds to the paper's."""

WORDS: Mapping[str, str] = PhraseTable(
    {
        "rolling-resistance": "rolling resistance",
        "load-resistance": "rolling resistance proportional to the load on the ramp",
        "resisting-moment": "a resisting moment (bearing, cord)",
        "viscous-drag": "drag that increases with the speed",
        "quadratic-drag": "drag that increases with the square of the speed (air)",
        "moment-once": "a moment once per turn",
        "moment-twice": "a moment twice per turn",
        "free-start": "a start that is not from rest",
    }
)
ADDED = frozenset(name for names in GROUPS.values() for name in names)
_ALWAYS = {
    "rolling-resistance": "rolling_resistance",
    "viscous-drag": "viscous_drag",
    "quadratic-drag": "quadratic_drag",
    "free-start": "start",
}
PAPER, STATED, FORCE = "paper", "as-stated", "unmodelled-force"


@dataclass(frozen=True, eq=False)
class CurveModel:
    """One model of some runs.

    problem : of the same points as that of every other model.
    own : names of the parameters that it adds to the paper's.
    lines : what a campaign must state for it in addition; empty where it states it already.
    forced : whether it has an unmodelled force.
    roomy : whether its noise has the room that it has beside a force
        (`estim.discrepancy.noise_without_force`).
    """

    name: str
    words: str
    problem: Problem
    own: tuple[str, ...]
    lines: tuple[str, ...]
    forced: bool
    roomy: bool


@dataclass(frozen=True, eq=False)
class Outline:
    """A model before it is posed: the campaign as it would read.  lines : of a `CurveModel`.
    of_campaign : whether it is what is stated.
    """

    name: str
    words: str
    source: CampaignFile
    lines: tuple[str, ...] = ()
    forced: bool = False
    of_campaign: bool = False


def outlines(
    source: CampaignFile,
    stated: Mapping[str, float | Prior],
    sketches: Mapping[str, Candidate],
    *,
    forced: bool,
) -> tuple[Outline, ...]:
    """The models of runs.

    stated : quantity -> number or prior of what the campaign states.
    sketches : name -> the paper's model with what the campaign does not state but may have.
    forced : whether an unmodelled force can stand beside the curve.
    """
    active = {quantity for quantity in ADDED if stated.get(quantity, 0.0) != 0.0}
    complete = without(source, ADDED - active)
    paper = phrase("the paper's model: only weight and inertia, starting from rest")
    models = [Outline(PAPER, paper, without(source, ADDED), of_campaign=not active)]
    for name, quantities in GROUPS.items():
        included = active.intersection(quantities)
        words = phrase("the paper's model with {what}", what=WORDS[name])
        if included:
            reduced = without(source, ADDED - included)
            models.append(Outline(name, words, reduced, of_campaign=included == active))
        elif (sketch := sketches.get(_ALWAYS.get(name, ""))) is not None:
            models.append(Outline(name, words, sketch.source, sketch.lines))
    if active and not any(outline.of_campaign for outline in models):
        words = phrase("everything that the campaign states")
        models.append(Outline(STATED, words, complete, of_campaign=True))
    if forced:
        what = next(outline.name for outline in models if outline.of_campaign)
        words = phrase(
            "the model stated in the campaign ({what}), with an unmodelled force and a "
            "free start (energy ± {sd:g} of the weight times "
            "R): this is the default of estim fit",
            what=what,
            sd=START_SD,
        )
        models.append(Outline(FORCE, words, complete, forced=True, of_campaign=True))
    return tuple(models)
