"""How the numbers of a result are shown.  It goes with the record, not into its JSON, which has names and SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from estim.arrays import FloatArray
from estim.common import Label, Notation, split_level
from estim.problem import Problem


@dataclass(frozen=True)
class Labels:
    """parameters : by name.  bare : the same without their levels, by name without level ("theta0").

    derived : run -> name of what follows from its parameters -> label.
    """

    parameters: Mapping[str, Label]
    bare: Mapping[str, Label]
    derived: Mapping[str, Mapping[str, Label]]

    def symbol(self, name: str) -> str:
        """Of a parameter ("θ₀[heavy-04]"), or of all that share its name without level ("θ₀")."""
        return (self.parameters[name] if name in self.parameters else self.bare[name]).symbol


def labels_of(problem: Problem, values: FloatArray) -> Labels:
    """As those who made the parameters and what follows from them say; values (n_par,)."""
    named = problem.named(values)
    return Labels(
        parameters={p.name: p.label for p in problem.parameters}, bare={split_level(p.name)[0]: p.bare_label for p in problem.parameters},
        derived={run.name: {name: d.label for name, d in run.derived(run.bind(named)).items()} for run in problem.runs},
    )


def names_as_labels(units: Mapping[str, str], derived: Mapping[str, Mapping[str, str]]) -> Labels:
    """Where only names and units are known: of the parameters, and of what is derived for each run."""
    split = {name: (*split_level(name), unit) for name, unit in units.items()}
    return Labels(
        parameters={name: Notation(base).label(unit, level) for name, (base, level, unit) in split.items()},
        bare={base: Notation(base).label(unit) for base, _, unit in split.values()},
        derived={run: {name: Notation(name).label(unit) for name, unit in found.items()} for run, found in derived.items()},
    )
