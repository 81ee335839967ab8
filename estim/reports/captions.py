"""What stands with the figures of an analysis: a legend below the main one, and for those who cannot see them the finding of each."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping

import numpy as np

from estim.checks import P_FLOOR
from estim.common import format_p, percentage, phrase, signed
from estim.reports.budget import part_of_errors
from estim.reports.result import Result
from estim.words import name_of_test


def caption_of(result: Result) -> str:
    """What the marks of the main figure mean."""
    left_out = any(run.excluded for run in result.runs.values())
    points = phrase("Points: data ± one sd (crosses: left out).") if left_out else phrase("Points: data ± one sd.")
    forces = list((result.deviation or {}).values())
    if result.status != "ok":
        if forces:
            bare = phrase("Blue: the most probable curve, without a force beside it and from rest; no bands: the status is not ok.")
        else:
            bare = phrase("Blue: the most probable curve; no bands: the status is not ok.")
        return f"{points} {bare}"
    if any(force.drawn for force in forces):
        curve = phrase("Blue: the curve and the force it may lack, 68 and 95 %. Grey: a new reading, 95 %.")
    elif result.curve_deviation or forces:
        curve = phrase("Blue: the curve without what it may lack, 68 and 95 %. Grey: a new reading, 95 %.")
    else:
        curve = phrase("Blue: the curve, 68 and 95 %. Grey: a new reading, 95 %.")
    return f"{points} {curve}"


def alts_of(result: Result, misfit: str) -> Mapping[str, str]:
    """Name of a figure -> what it shows, as a finding; misfit : the largest, in words.  A figure without one gets no words."""
    axes = phrase(" and ").join(dict.fromkeys(phrase("{y} against {x}", y=run.y, x=run.x) for run in result.runs.values()))
    found: dict[str, str] = defaultdict(str)
    bare = [force for force in (result.deviation or {}).values() if not force.drawn] + list((result.curve_deviation or {}).values())
    if result.status != "ok":
        found["phase"] = phrase("{axes}: data and curve, {misfit}", axes=axes, misfit=misfit)
    elif bare:
        found["phase"] = phrase("{axes}: data and the curve without what it may lack, {misfit}", axes=axes, misfit=misfit)
    else:
        found["phase"] = phrase("{axes}: the curve goes through the data, {misfit}", axes=axes, misfit=misfit)
    least = min(((check.p_value, name) for run in result.runs.values() for name, check in run.checks.items()), default=None)
    found["residuals"] = phrase("Whitened residuals")
    if least is not None:
        found["residuals"] = phrase(
            "Whitened residuals: of the tests, '{test}' says most against the curve, {p}", test=name_of_test(least[1]), p=format_p(least[0], P_FLOOR)
        )
    found["corner"] = _strongest(result)
    for name, budget in (result.budget or {}).items():
        if budget.sources and name in result.parameters and result.parameters[name].measured:
            source = budget.sources[0]
            said = {"share": percentage(source.share), "symbol": result.labels.symbol(name)}
            if source.source in result.labels.parameters:
                stated = result.labels.symbol(source.source)
                found["budget"] = phrase("{share} of the variance of {symbol} comes from {stated} as stated", stated=stated, **said)
            else:
                found["budget"] = phrase("{share} of the variance of {symbol} comes from {source}", source=part_of_errors(source.source), **said)
            break
    found["traces"] = phrase("Chains of {n} ensembles: {message}", n=result.sampling.n_ensemble, message=result.sampling.message)
    found["force"] = "; ".join(force.words for force in (result.deviation or {}).values())
    return found


def _strongest(result: Result) -> str:
    matrix = np.abs(np.array(result.correlation.matrix)) - np.eye(len(result.correlation.names))
    if matrix.size < 2:
        return phrase("Joint posterior")
    i, j = np.unravel_index(int(np.argmax(matrix)), matrix.shape)
    names = [result.labels.symbol(result.correlation.names[k]) for k in (j, i)]
    r = signed(f"{result.correlation.matrix[i][j]:+.2f}")
    return phrase("Joint posterior: strongest correlation {r}, of {one} and {other}", r=r, one=names[0], other=names[1])
