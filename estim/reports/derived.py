"""What follows from the parameters of a run, as a reader sees it: summaries of draws, and a sentence where there is no number."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from estim.arrays import FloatArray
from estim.checks import parameter_cells
from estim.common import Label, phrase
from estim.pipeline import Analysis
from estim.problem import Derived, Observations
from estim.reports.labels import Labels
from estim.sampling import Summary, summarise, trusted

_DRAWS = 20_000


class Told(Protocol):
    """What the record of a run has of it.  sought : those of `derived` that were asked for."""

    @property
    def derived(self) -> dict[str, Summary]: ...

    @property
    def sought(self) -> list[str]: ...


def derived_draws(analysis: Analysis, run: Observations) -> Mapping[str, Derived]:
    """Name -> values at draws of the posterior (n_draw, 1), or (1, 1) of what follows from exact values alone."""
    used = run.parameters.union(source for one in run.sought for source in one.others.values() if isinstance(source, str))
    places = [i for i, name in enumerate(analysis.problem.names) if name in used]
    draws = analysis.chain.thinned(_DRAWS, places)
    return run.derived(run.bind({analysis.problem.names[i]: draws[:, k, None] for k, i in enumerate(places)}))


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


def sought_columns(analysis: Analysis) -> dict[str, tuple[Derived, Label]]:
    """What a user wanted computed, as values at draws (n_draw, 1) with its label: "g" where it is the same for all runs, else "g[run]"."""
    runs, found = analysis.problem.runs, dict[str, dict[str, Derived]]()
    for run in runs:
        for name, derived in (derived_draws(analysis, run) if run.sought else {}).items():
            if name in _sought(run) and derived.values.size > 1:
                found.setdefault(name, {})[run.name] = derived
    columns: dict[str, tuple[Derived, Label]] = {}
    for name, by_run in found.items():
        first = next(iter(by_run.values()))
        if len(by_run) == len(runs) and all(np.array_equal(first.values, other.values, equal_nan=True) for other in by_run.values()):
            columns[name] = (first, first.label)
        else:
            columns |= {f"{name}[{run}]": (one, one.notation.label(one.unit, f"[{run}]")) for run, one in by_run.items()}
    return columns


def sought_labels(analysis: Analysis) -> dict[str, Label]:
    """Their labels."""
    return {name: label for name, (_, label) in sought_columns(analysis).items()}


def sought_draws(analysis: Analysis) -> list[tuple[Label, FloatArray]]:
    """Label and draws (n_draw,) of those that have a value at every draw."""
    return [(label, np.ravel(one.values)) for one, label in sought_columns(analysis).values() if not _undefined(np.ravel(one.values))]


def derived_facts(analysis: Analysis, run: Observations) -> list[str]:
    """Why a quantity that was asked for is not in the table."""
    facts, found = [], derived_draws(analysis, run)
    for one in run.sought:
        if one.lacking:
            facts.append(
                phrase(
                    "{name} = {text} is left out: this fit has no {lacking} (--joint fits runs together)",
                    name=one.name, text=one.text, lacking=", ".join(one.lacking),
                )
            )
        elif one.name in found and found[one.name].values.size == 1:
            value = found[one.name].values[0, 0]
            facts.append(phrase("{name} = {value:.10g}, exact: it follows from exact values alone", name=one.name, value=value))
        elif one.name in found and (share := _undefined(np.ravel(found[one.name].values))) > 0.0:
            facts.append(
                phrase(
                    "{name} = {text} has no value at {share:.2g} % of the draws, so no interval is given",
                    name=one.name, text=one.text, share=100.0 * share,
                )
            )
    return facts


def _undefined(values: FloatArray) -> float:
    return float(np.mean(~np.isfinite(values)))


def _sought(run: Observations) -> set[str]:
    return {one.name for one in run.sought}


def derived_rows(runs: Mapping[str, Told], labels: Labels, *, sought: bool = False) -> list[tuple[str, str, str, str, str]]:
    """Symbol, meaning, value, interval and unit of every derived quantity: once where the cells are the same for every run, else run by run.

    sought : only what was asked for.
    """
    found: dict[str, dict[str, tuple[str, str, str, str]]] = {}
    for run, summary in runs.items():
        for name, d in summary.derived.items():
            if not sought or name in summary.sought:
                found.setdefault(name, {})[run] = parameter_cells(d, labels.derived[run][name])[1:]
    rows = []
    for name, cells in found.items():
        symbol = labels.derived[next(iter(cells))][name].symbol
        if len(cells) == len(runs) and len(set(cells.values())) == 1:
            rows.append((symbol, *next(iter(cells.values()))))
        else:
            rows += [(f"{symbol}[{run}]", *shown) for run, shown in cells.items()]
    return rows
