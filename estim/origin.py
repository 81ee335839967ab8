"""What the report of a run says about where its numbers come from: facts and warnings of its file, and its tilt against the stated one."""

from __future__ import annotations

import math

from estim.problem import Observations, Problem
from estim.quantity import Quantity, format_quantity
from estim.run import Run

_APART = 3.0  # combined standard uncertainties


def origin_facts(table: Run, run: Observations, problem: Problem) -> tuple[str, ...]:
    """The facts of an imported track, and its tilt beside the stated one where both are known."""
    stated = stated_phi(run, problem)
    if table.tilt is None or stated is None:
        return table.facts
    return (*table.facts, f"tilt measured from the track {_degrees(table.tilt)}, stated {_degrees(stated)}")


def origin_warnings(table: Run, run: Observations, problem: Problem) -> tuple[str, ...]:
    """What is suspicious about the file, and a tilt that contradicts the stated one."""
    stated = stated_phi(run, problem)
    if table.tilt is None or stated is None:
        return table.warnings
    apart, u = abs(table.tilt.value - stated.value), math.hypot(table.tilt.u, stated.u)
    if apart <= _APART * u:
        return table.warnings
    how = f"{apart / u:.1f} combined standard uncertainties" if u > 0.0 else f"{math.degrees(apart):.2g} deg, both taken as exact"
    warning = (
        f"the tilt of the track, {_degrees(table.tilt)}, and the stated tilt, {_degrees(stated)}, differ by {how}:"
        " was the x axis level, and the camera square to the plane of motion?"
    )
    return (*table.warnings, warning)


def stated_phi(run: Observations, problem: Problem) -> Quantity | None:
    """Tilt of the ramp (rad) as stated before the fit, with a common zero error; None for a curve that has no tilt."""
    if "phi" not in run.arguments:
        return None
    priors = {p.name: p.prior for p in problem.parameters}
    value, variance = 0.0, 0.0
    for name in ("phi", "phi_zero"):
        source = run.arguments.get(name, 0.0)
        value += priors[source].centre if isinstance(source, str) else float(source)
        variance += priors[source].sd ** 2 if isinstance(source, str) else 0.0
    return Quantity(value, math.sqrt(variance))


def _degrees(tilt: Quantity) -> str:
    return f"{format_quantity(math.degrees(tilt.value), math.degrees(tilt.u))} deg"
