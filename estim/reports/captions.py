"""What stands with the figures of an analysis: a legend below the main one, and for those who cannot see them the finding of each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping

import numpy as np

from estim.common import format_p, percentage, signed
from estim.reports.result import Result


def caption_of(result: Result) -> str:
    """What the marks of the main figure mean."""
    points = "Points: data ± one sd" + (" (crosses: left out)." if any(run.excluded for run in result.runs.values()) else ".")
    forces = list((result.deviation or {}).values())
    if result.status != "ok":
        bare = ", without a force beside it and from rest" if forces else ""
        return f"{points} Blue: the most probable curve{bare}; no bands: the status is not ok."
    drawn = any(force.drawn for force in forces)
    force = " and the force it may lack" if drawn else " without what it may lack" if result.curve_deviation or forces else ""
    return f"{points} Blue: the curve{force}, 68 and 95 %. Grey: a new reading, 95 %."


def alts_of(result: Result, misfit: str) -> Mapping[str, str]:
    """Name of a figure -> what it shows, as a finding; misfit : the largest, in words.  A figure without one gets no words."""
    axes = " and ".join(dict.fromkeys(f"{run.y} against {run.x}" for run in result.runs.values()))
    found: dict[str, str] = defaultdict(str)
    bare = [force for force in (result.deviation or {}).values() if not force.drawn] + list((result.curve_deviation or {}).values())
    how = "data and curve" if result.status != "ok" else "data and the curve without what it may lack" if bare else "the curve goes through the data"
    found["phase"] = f"{axes}: {how}, {misfit}"
    least = min(((check.p_value, name) for run in result.runs.values() for name, check in run.checks.items()), default=None)
    worst = "" if least is None else f": of the tests, '{least[1]}' says most against the curve, {format_p(least[0])}"
    found["residuals"] = f"Whitened residuals{worst}"
    found["corner"] = "Joint posterior" + _strongest(result)
    for name, budget in (result.budget or {}).items():
        if budget.sources and name in result.parameters and result.parameters[name].measured:
            source = budget.sources[0]
            of = f"{result.labels.symbol(source.source)} as stated" if source.source in result.labels.parameters else f"the {source.source}"
            found["budget"] = f"{percentage(source.share)} of the variance of {result.labels.symbol(name)} comes from {of}"
            break
    found["traces"] = f"Chains of {result.sampling.n_ensemble} ensembles: {result.sampling.message}"
    found["force"] = "; ".join(force.words for force in (result.deviation or {}).values())
    return found


def _strongest(result: Result) -> str:
    matrix = np.abs(np.array(result.correlation.matrix)) - np.eye(len(result.correlation.names))
    if matrix.size < 2:
        return ""
    i, j = np.unravel_index(int(np.argmax(matrix)), matrix.shape)
    names = [result.labels.symbol(result.correlation.names[k]) for k in (j, i)]
    return f": strongest correlation {signed(f'{result.correlation.matrix[i][j]:+.2f}')}, of {names[0]} and {names[1]}"
