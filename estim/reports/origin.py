"""What the report of a run says about where its numbers come from: facts and warnings of its file, its tilt against the stated one,
and what a fit of its speeds takes as exact or leaves unused."""

from __future__ import annotations

import math

from estim.campaign import way_back
from estim.common import Quantity, format_quantity, phrase
from estim.problem import Observations, Problem
from estim.reading import Run

_APART = 3.0  # combined standard uncertainties
_HANDFUL = 5  # frames of the way back that are not worth a word
_READING = 0.001  # m or rad, as an example


def origin_facts(table: Run, run: Observations, problem: Problem) -> tuple[str, ...]:
    """The facts of an imported track, its tilt beside the stated one where both are known, and what a user's own curve takes as exact."""
    stated = stated_phi(run, problem)
    if not run.words.from_release:
        exact = {name: value for name, value in run.arguments.items() if not isinstance(value, str)}
        return (*table.facts, *(phrase("{name} is fixed at {value:.10g}", name=name, value=value) for name, value in exact.items()))
    if table.tilt is None or stated is None:
        return table.facts
    return (*table.facts, phrase("tilt measured from the track {measured}, stated {stated}", measured=_degrees(table.tilt), stated=_degrees(stated)))


def origin_warnings(table: Run, run: Observations, problem: Problem) -> tuple[str, ...]:
    """What is suspicious about the file, and a tilt that contradicts the stated one."""
    stated = stated_phi(run, problem)
    if table.tilt is None or stated is None:
        return table.warnings
    apart, u = abs(table.tilt.value - stated.value), math.hypot(table.tilt.u, stated.u)
    if apart <= _APART * u:
        return table.warnings
    said = {"track": _degrees(table.tilt), "stated": _degrees(stated)}
    if u > 0.0:
        warning = phrase(
            "the tilt of the track, {track}, and the stated tilt, {stated}, differ by {apart:.1f} combined standard uncertainties: "
            "was the x axis level, and the camera square to the plane of motion?", apart=apart / u, **said,
        )
    else:
        warning = phrase(
            "the tilt of the track, {track}, and the stated tilt, {stated}, differ by {apart:.2g} deg, both taken as exact: "
            "was the x axis level, and the camera square to the plane of motion?", apart=math.degrees(apart), **said,
        )
    return (*table.warnings, warning)


def speed_facts(run: Observations) -> tuple[str, ...]:
    """What a fit of the speeds of a rolling body takes as exact unless told otherwise, and the frames that only a fit of positions can use."""
    if run.motion is None or run.positions:
        return ()
    facts = []
    if "offset" not in run.arguments:
        coordinate, key = ("x", "offset_m") if run.x_unit == "m" else ("θ", "offset_rad")
        reading = run.noise.size.sigma.value if run.noise.made_of_positions else 0.0
        example = format_quantity(0.0, reading or _READING, plus_minus=False)
        facts.append(
            phrase(
                'the zero of {coordinate} (the release) is taken as exact; state {key}, e.g. {key} = "{example}", if it is one reading',
                coordinate=coordinate, key=key, example=example,
            )
        )
    back = way_back(run.excluded)
    if back > _HANDFUL:
        facts.append(
            phrase('noise with model = "positions" would use the {back} frames of the way back too, and can narrow the result a lot', back=back)
        )
    return tuple(facts)


def stated_phi(run: Observations, problem: Problem) -> Quantity | None:
    """Tilt of the ramp (rad) as stated before the fit, with a common zero error; None for a curve that has no tilt."""
    if run.motion is None or "phi" not in run.arguments:
        return None
    priors = {p.name: p.prior for p in problem.parameters}
    value, variance = 0.0, 0.0
    for name in ("phi", "phi_zero"):
        source = run.arguments.get(name, 0.0)
        value += priors[source].expectation if isinstance(source, str) else float(source)
        variance += priors[source].sd ** 2 if isinstance(source, str) else 0.0
    return Quantity(value, math.sqrt(variance))


def _degrees(tilt: Quantity) -> str:
    return f"{format_quantity(math.degrees(tilt.value), math.degrees(tilt.u))} deg"
