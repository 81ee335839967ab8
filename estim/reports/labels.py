"""How the numbers of a result are shown.  It goes with the record, not into its JSON, which has names and SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from estim.arrays import FloatArray
from estim.common import Label, Notation, split_level
from estim.problem import Problem


@dataclass(frozen=True)
class Labels:
    """parameters : by name.  bare : the same without their levels, by name too.

    derived : run -> name of what follows from its parameters -> label.
    """

    parameters: Mapping[str, Label]
    bare: Mapping[str, Label]
    derived: Mapping[str, Mapping[str, Label]]

    def symbol(self, name: str) -> str:
        """Of a parameter ("θ₀[heavy-04]"), or of all that have `name` without their levels ("θ₀")."""
        if name in self.parameters:
            return self.parameters[name].symbol
        return next(shown.symbol for full, shown in self.bare.items() if split_level(full)[0] == name)


def labels_of(problem: Problem, values: FloatArray) -> Labels:
    """As those who made the parameters and what follows from them say; values (n_par,)."""
    named = problem.named(values)
    return Labels(
        parameters={p.name: p.label for p in problem.parameters}, bare={p.name: p.bare_label for p in problem.parameters},
        derived={run.name: {name: d.label for name, d in run.derived(run.bind(named)).items()} for run in problem.runs},
    )


def names_as_labels(units: Mapping[str, str], derived: Mapping[str, Mapping[str, str]]) -> Labels:
    """Where only names and units are known: of the parameters, and of what is derived for each run."""
    split = {name: (*split_level(name), unit) for name, unit in units.items()}
    return Labels(
        parameters={name: Notation(base).label(unit, level) for name, (base, level, unit) in split.items()},
        bare={name: Notation(base).label(unit) for name, (base, _, unit) in split.items()},
        derived={run: {name: Notation(name).label(unit) for name, unit in found.items()} for run, found in derived.items()},
    )
