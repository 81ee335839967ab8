"""What the report of a run shows beside its curve: what follows from its parameters, and where its
numbers come from.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TypeVar

import numpy as np

from estim.arrays import FloatArray
from estim.campaign import way_back
from estim.common import Label, Quantity, format_quantity, phrase
from estim.pipeline import Analysis
from estim.problem import Derived, Observations, Problem
from estim.reading import Run
from estim.reports.records import DRAWS, Labels, RunSummary
from estim.sampling import Summary, parameter_cells, summarise, trusted

T = TypeVar("T")


def derived_draws(analysis: Analysis, run: Observations) -> Mapping[str, Derived]:
    """Name -> values at draws of the posterior (n_draw, 1), or (1, 1) of what follows from exact
    values alone.
    """
    used = run.parameters.union(
        source
        for quantity in run.sought
        for source in quantity.others.values()
        if isinstance(source, str)
    )
    places = [i for i, name in enumerate(analysis.problem.names) if name in used]
    draws = analysis.chain.thinned(DRAWS)[:, places]
    return run.derived(
        run.bind({analysis.problem.names[i]: draws[:, k, None] for k, i in enumerate(places)})
    )


def derived_summaries(analysis: Analysis, run: Observations) -> dict[str, Summary]:
    """Of everything that is not exact; without numbers where a formula has no value at some of the
    draws.
    """
    summaries = {}
    for name, derived in derived_draws(analysis, run).items():
        values = np.ravel(derived.values)
        if values.size > 1:
            nothing = Summary(
                derived.unit, derived.meaning, None, None, None, None, None, None, None
            )
            undefined = name in _derived_quantities(run) and _undefined(values) > 0.0
            summary = (
                nothing
                if undefined
                else summarise(values, unit=derived.unit, meaning=derived.meaning)
            )
            summaries[name] = trusted(
                summary, analysis.diagnosis.status, sampled=analysis.diagnosis.sampled
            )
    return summaries


def derived_columns(analysis: Analysis) -> dict[str, tuple[Derived, Label]]:
    """What a user wanted computed, as values at draws (n_draw, 1) with its label: "g" where it is
    the same for all runs, else "g[run]".
    """
    entries = (
        (name, run.name, derived)
        for run in analysis.problem.runs
        if run.sought
        for name, derived in derived_draws(analysis, run).items()
        if name in _derived_quantities(run) and derived.values.size > 1
    )
    columns: dict[str, tuple[Derived, Label]] = {}
    for name, run, quantity in once(
        entries,
        len(analysis.problem.runs),
        lambda a, b: np.array_equal(a.values, b.values, equal_nan=True),
    ):
        level = run and f"[{run}]"
        columns[name + level] = (quantity, quantity.notation.label(quantity.unit, level))
    return columns


def once(
    entries: Iterable[tuple[str, str, T]], n_run: int, same: Callable[[T, T], bool] = operator.eq
) -> Iterator[tuple[str, str, T]]:
    """The values of quantities by run, `entries` of (quantity, run, value): with "" as the run,
    once, where the value is the same for all `n_run` runs.
    """
    by_name: dict[str, dict[str, T]] = {}
    for name, run, value in entries:
        by_name.setdefault(name, {})[run] = value
    for name, by_run in by_name.items():
        first, *others = by_run.values()
        shared = len(by_run) == n_run and all(same(first, other) for other in others)
        for run, value in ({"": first} if shared else by_run).items():
            yield name, run, value


def derived_quantity_draws(analysis: Analysis) -> list[tuple[Label, FloatArray]]:
    """Label and draws (n_draw,) of those that have a value at every draw."""
    return [
        (label, np.ravel(quantity.values))
        for quantity, label in derived_columns(analysis).values()
        if not _undefined(np.ravel(quantity.values))
    ]


def derived_facts(analysis: Analysis, run: Observations) -> list[str]:
    """Why a requested quantity is not in the table."""
    facts, draws = [], derived_draws(analysis, run)
    for quantity in run.sought:
        if quantity.lacking:
            facts.append(
                phrase(
                    "{name} = {text} is omitted: this fit has no {lacking} (--joint fits "
                    "runs together)",
                    name=quantity.name,
                    text=quantity.text,
                    lacking=", ".join(quantity.lacking),
                )
            )
        elif quantity.name in draws and draws[quantity.name].values.size == 1:
            facts.append(
                phrase(
                    "{name} = {value:.10g}, exact: it is computed from exact values alone",
                    name=quantity.name,
                    value=draws[quantity.name].values[0, 0],
                )
            )
        elif (
            quantity.name in draws
            and (share := _undefined(np.ravel(draws[quantity.name].values))) > 0.0
        ):
            facts.append(
                phrase(
                    "{name} = {text} has no value at {share:.2g} % of the draws, so no "
                    "interval is given",
                    name=quantity.name,
                    text=quantity.text,
                    share=100.0 * share,
                )
            )
    return facts


def _undefined(values: FloatArray) -> float:
    return float(np.mean(~np.isfinite(values)))


def _derived_quantities(run: Observations) -> set[str]:
    return {quantity.name for quantity in run.sought}


def derived_rows(runs: Mapping[str, RunSummary], labels: Labels) -> list[tuple[str, ...]]:
    """Symbol, meaning, value, interval and unit of every derived quantity: once where the cells are
    the same for every run, else run by run.
    """
    entries = (
        (name, run, parameter_cells(d, labels.derived[run][name]))
        for run, summary in runs.items()
        for name, d in summary.derived.items()
    )
    return [
        (symbol + (run and f"[{run}]"), *row) for _, run, (symbol, *row) in once(entries, len(runs))
    ]


def origin_facts(table: Run, run: Observations, problem: Problem) -> tuple[str, ...]:
    """The facts of an imported track, its tilt beside the stated one where both are known, and what
    a user's own curve takes as exact.
    """
    stated = stated_phi(run, problem)
    if not run.words.from_release:
        exact = {name: value for name, value in run.arguments.items() if not isinstance(value, str)}
        return (
            *table.facts,
            *(
                phrase("{name} is fixed at {value:.10g}", name=name, value=value)
                for name, value in exact.items()
            ),
        )
    if table.tilt is None or stated is None:
        return table.facts
    return (
        *table.facts,
        phrase(
            "tilt measured from the track {measured}, stated {stated}",
            measured=_degrees(table.tilt),
            stated=_degrees(stated),
        ),
    )


def origin_warnings(table: Run, run: Observations, problem: Problem) -> tuple[str, ...]:
    """What is suspicious about the file, and a tilt that contradicts the stated one."""
    stated = stated_phi(run, problem)
    if table.tilt is None or stated is None:
        return table.warnings
    difference, u = abs(table.tilt.value - stated.value), math.hypot(table.tilt.u, stated.u)
    if difference <= 3.0 * u:  # combined standard uncertainties
        return table.warnings
    warning = phrase(
        "the tilt of the track, {track}, and the stated tilt, {stated}, differ by "
        "{apart:.1f} combined standard uncertainties: "
        "was the x axis level, and the camera square to the plane of motion?"
        if u > 0.0
        else "the tilt of the track, {track}, and the stated tilt, {stated}, differ by "
        "{apart:.2g} deg, both taken as exact: "
        "was the x axis level, and the camera square to the plane of motion?",
        track=_degrees(table.tilt),
        stated=_degrees(stated),
        apart=difference / u if u > 0.0 else math.degrees(difference),
    )
    return (*table.warnings, warning)


def speed_facts(run: Observations) -> tuple[str, ...]:
    """What a fit of the speeds of a rolling body takes as exact by default, and the
    frames that only a fit of positions can use.
    """
    if run.motion is None or run.positions:
        return ()
    facts = []
    if "offset" not in run.arguments:
        coordinate, key = ("x", "offset_m") if run.x_unit == "m" else ("θ", "offset_rad")
        reading = run.noise.size.sigma.value if run.noise.made_of_positions else 0.0
        # m or rad, as an example
        example = format_quantity(0.0, reading or 0.001, plus_minus=False)
        facts.append(
            phrase(
                "the zero of {coordinate} (the release) is taken as exact; if it is a "
                'single reading, state {key}, e.g. {key} = "{example}"',
                coordinate=coordinate,
                key=key,
                example=example,
            )
        )
    n_back = way_back(run.excluded)
    if n_back > 5:  # frames of the way back that are not worth a word
        facts.append(
            phrase(
                'noise with model = "positions" would also use the {back} frames of the '
                "way back, and can reduce the "
                "uncertainties considerably",
                back=n_back,
            )
        )
    return tuple(facts)


def stated_phi(run: Observations, problem: Problem) -> Quantity | None:
    """Tilt of the ramp (rad) as stated before the fit, with a common zero error; None for a curve
    that has no tilt.
    """
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
