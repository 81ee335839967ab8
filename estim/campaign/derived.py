"""`[derived]` of a campaign: quantities that follow from its parameters by formulas, the same for a
rolling body and a user's own curve.

    [derived]
    g = "4*pi**2/slope"
    heavier = {formula = "gamma[heavy] - gamma[light]", meaning = "difference of the two disks"}

`docs/campaign.md` explains it to users.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from estim.campaign.campaign_file import DerivedTable
from estim.campaign.curve_tables import check_printable
from estim.common import InputError
from estim.curves import SoughtQuantity, check_derived_names, in_units, seek
from estim.problem import Derived, Observations, Problem
from estim.reading import Places

UnitOf = Callable[[str, str], str]


def read_derived(
    written: Mapping[str, str | DerivedTable], places: Places
) -> tuple[SoughtQuantity, ...]:
    """The quantities of a `[derived]` table.  Raises InputError with its place."""
    quantities = []
    for name, entry in written.items():
        path = ("derived", name)
        table = DerivedTable(entry) if isinstance(entry, str) else entry
        words = {"unit": table.unit, "symbol": table.symbol, "meaning": table.meaning}
        check_printable(places, path, words)
        with places.at(path):
            quantities.append(seek(name, table.formula, **words))
    return tuple(quantities)


def with_derived(
    problem: Problem,
    quantities: tuple[SoughtQuantity, ...],
    bodies: Mapping[str, str | None],
    unit_of: UnitOf,
) -> Problem:
    """`problem` whose runs have the derived quantities.  bodies : of all runs of the campaign, None
    where there are none.  unit_of : argument and run.

    Raises InputError with the quantity as field, where a formula names what no run has, or its unit
    contradicts theirs.
    """
    if not quantities:
        return problem
    units: dict[str, set[str]] = {}
    for run in problem.runs:
        always = _always(run, problem)
        check_derived_names(
            quantities, [name for name in run.arguments if " " not in name], list(always)
        )
        for name, unit in [
            *((name, unit_of(name, run.name)) for name in run.arguments),
            *((name, quantity.unit) for name, quantity in always.items()),
        ]:
            for written in (name, f"{name}[{run.name}]", f"{name}[{bodies[run.name]}]"):
                units.setdefault(written, set()).add(unit)
    known_units = {
        written: options.pop() for written, options in units.items() if len(options) == 1
    }
    bound = tuple(
        quantity.bound(_sources(quantity, problem, bodies))
        for quantity in in_units(quantities, known_units)
    )
    return replace(problem, runs=tuple(replace(run, sought=bound) for run in problem.runs))


def _always(run: Observations, problem: Problem) -> Mapping[str, Derived]:
    """What follows from the parameters of a run in any case."""
    return run.derived(run.bind(problem.named(problem.start())))


def _sources(
    quantity: SoughtQuantity, problem: Problem, bodies: Mapping[str, str | None]
) -> dict[str, str | float]:
    """What each name with a level means among the runs of `problem`; nothing for a level that is
    not among them.
    """
    resolved: dict[str, str | float] = {}
    for written, (name, level) in quantity.of_levels.items():
        if level not in bodies and level not in bodies.values():
            raise InputError(
                f"names '{written}', but there is no run or body '{level}'",
                field=quantity.name,
                value=quantity.text,
            )
        runs = [run for run in problem.runs if level in (run.name, bodies[run.name])]
        for run in runs:
            if name not in run.arguments:
                raise InputError(
                    f"names '{written}', but no run has '{name}' ({', '.join(run.arguments)}), "
                    "and what is derived has no level",
                    field=quantity.name,
                    value=quantity.text,
                )
        sources = {run.arguments[name] for run in runs}
        if len(sources) > 1:
            rule = f"names '{written}', which is not the same for all runs of '{level}': name a run"
            raise InputError(rule, field=quantity.name, value=quantity.text)
        if sources:
            resolved[written] = sources.pop()
    return resolved
