"""What follows from the parameters of a run, as a reader sees it: summaries of draws, and a sentence where there is no number."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from estim.arrays import FloatArray
from estim.pipeline import Analysis
from estim.problem import Derived, Observations
from estim.sampling import Summary, summarise, trusted

_DRAWS = 20_000


def derived_draws(analysis: Analysis, run: Observations) -> Mapping[str, Derived]:
    """Name -> values at draws of the posterior (n_draw, 1), or (1, 1) of what follows from exact values alone."""
    draws = analysis.chain.thinned(_DRAWS)
    return run.derived(run.bind(analysis.problem.named(draws)))


def derived_summaries(analysis: Analysis, run: Observations) -> dict[str, Summary]:
    """Of everything that is not exact; without numbers where a formula has no value at some of the draws."""
    found = {}
    for name, derived in derived_draws(analysis, run).items():
        values = np.ravel(derived.values)
        if values.size > 1:
            nothing = Summary(derived.unit, derived.meaning, None, None, None, None, None, None, None)
            undefined = name in _sought(run) and _undefined(values) > 0.0
            summary = nothing if undefined else summarise(values, unit=derived.unit, meaning=derived.meaning)
            found[name] = trusted(summary, analysis.diagnosis.status)
    return found


def derived_facts(analysis: Analysis, run: Observations) -> list[str]:
    """Why a quantity that was asked for is not in the table."""
    facts, found = [], derived_draws(analysis, run)
    for one in run.sought:
        if one.lacking:
            facts.append(f"{one.name} = {one.text} is left out: this fit has no {', '.join(one.lacking)} (--joint fits runs together)")
        elif one.name in found and found[one.name].values.size == 1:
            facts.append(f"{one.name} = {found[one.name].values[0, 0]:.10g}, exact: it follows from exact values alone")
        elif one.name in found and (share := _undefined(np.ravel(found[one.name].values))) > 0.0:
            facts.append(f"{one.name} = {one.text} has no value at {100.0 * share:.2g} % of the draws, so no interval is given")
    return facts


def _undefined(values: FloatArray) -> float:
    return float(np.mean(~np.isfinite(values)))


def _sought(run: Observations) -> set[str]:
    return {one.name for one in run.sought}
