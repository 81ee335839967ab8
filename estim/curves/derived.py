"""A quantity that follows from the parameters of a curve by a formula of the user's: `g =
"4*pi**2/slope"`.

A name in the formula is an argument of the curve as this run has it, or another quantity that
follows from them, stated before this one.  `name[level]` is the same of another run or body of the
fit.  Several runs may make one name mean several things: then it is one quantity a run.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import count

import numpy as np

from estim.arrays import Named
from estim.common import InputError, Notation
from estim.curves.derived_units import unit_that_follows
from estim.curves.formula import Formula, check_names, evaluate, read_formula
from estim.problem import Derived

_OF_LEVEL = re.compile(r"([^\W\d]\w*)\[([^\[\]]*)\]")
_SHOWN = 60  # marks of a formula that stand for a meaning


@dataclass(frozen=True, eq=False)
class SoughtQuantity:
    """What a user wants to be computed.

    text : the formula as written.
    formula : the same, with `symbols` in the place of names with a level.
    symbols : name in the formula -> "gamma[heavy]" or, of this run, the name itself.
    others : "gamma[heavy]" -> name of the parameter, or an exact number; empty until it is known
        which runs are fit together.
    stated : the unit that was stated, if any; `unit` is what follows in its place (`in_units`).
    """

    name: str
    unit: str
    notation: Notation
    meaning: str
    text: str
    formula: Formula
    symbols: Mapping[str, str]
    others: Mapping[str, str | float] = field(default_factory=dict)
    stated: str | None = None

    @property
    def of_levels(self) -> dict[str, tuple[str, str]]:
        """Names with a level -> name and level: "gamma[heavy]" -> ("gamma", "heavy")."""
        matches = {written: _OF_LEVEL.fullmatch(written) for written in self.symbols.values()}
        return {
            written: (match[1], match[2].strip()) for written, match in matches.items() if match
        }

    @property
    def lacking(self) -> tuple[str, ...]:
        """Names that no run of this fit knows."""
        return tuple(written for written in self.of_levels if written not in self.others)

    @property
    def own(self) -> tuple[str, ...]:
        """Names without a level."""
        return tuple(written for written in self.symbols.values() if "[" not in written)

    def of(self, known: Named) -> Derived | None:
        """Its values where `known` has scalars or (n_draw, 1) of every name; None where it lacks
        one.  nan where the formula has no value.
        """
        if any(written not in known for written in self.symbols.values()):
            return None
        result = evaluate(
            self.formula.tree,
            {
                symbol: np.asarray(known[written], dtype=float)
                for symbol, written in self.symbols.items()
            },
        )
        return Derived(
            self.unit, np.atleast_2d(np.asarray(result, dtype=float)), self.meaning, self.notation
        )

    def bound(self, others: Mapping[str, str | float]) -> SoughtQuantity:
        """The same, with the sources of the names that have a level."""
        return replace(self, others=others)


def seek(
    name: str,
    text: object,
    *,
    unit: str | None = None,
    symbol: str | None = None,
    meaning: str | None = None,
) -> SoughtQuantity:
    """The quantity `name` that follows by the formula `text`.  Raises InputError."""
    check_names([name], field="derived")
    if not isinstance(text, str) or not text.strip():
        raise InputError(
            'must be a formula like "4*pi**2/slope"', field=name, value=text if text != "" else "''"
        )
    stand_ins: dict[str, str] = {}  # "gamma[heavy]" -> what stands for it

    def stand_in(match: re.Match[str]) -> str:
        written = f"{match[1]}[{match[2].strip()}]"
        free = (f"{match[1]}_{i}" for i in count() if f"{match[1]}_{i}" not in text)
        return stand_ins.setdefault(
            written, next(identifier for identifier in free if identifier not in stand_ins.values())
        )

    substituted = _OF_LEVEL.sub(stand_in, text)
    try:
        formula = read_formula(substituted, field=name)
    except InputError as error:
        raise InputError(
            error.rule,
            field=name,
            value=text if error.value == " ".join(substituted.split()) else error.value,
        ) from None
    if formula.uses_x:
        raise InputError(
            "must not hold x: a derived quantity is one number, not a curve", field=name, value=text
        )
    written = {stands: full for full, stands in stand_ins.items()}
    normalised = " ".join(text.split())
    description = meaning or (
        normalised if len(normalised) <= _SHOWN else f"{normalised[: _SHOWN - 3]}..."
    )
    symbols = {identifier: written.get(identifier, identifier) for identifier in formula.names}
    return SoughtQuantity(
        name,
        unit or "1",
        Notation(symbol or name),
        description,
        normalised,
        formula,
        symbols,
        stated=unit,
    )


def check_derived_names(
    quantities: Iterable[SoughtQuantity], known: Collection[str], derived: Collection[str] = ()
) -> None:
    """Every name without a level is one of `known` (arguments of the curve), `derived` (what
    follows in any case) or of a quantity before it, and no quantity has a name that is taken.
    Raises InputError with the quantity as field.
    """
    everything = [*known, *derived]
    for quantity in quantities:
        if quantity.name in everything:
            raise InputError(
                "is the name of something else here: choose another", field=quantity.name
            )
        for name in quantity.own:
            if name not in everything:
                raise InputError(
                    f"names '{name}', which is neither a parameter nor a derived quantity "
                    f"before it ({', '.join(everything)})",
                    field=quantity.name,
                    value=quantity.text,
                )
        everything.append(quantity.name)


def in_units(
    quantities: Iterable[SoughtQuantity], units: Mapping[str, str]
) -> tuple[SoughtQuantity, ...]:
    """The same, each in the unit that was stated of it, or that follows from those before it and
    `units`, of names as they are written; of a tied parameter that of the curve.

    Raises InputError with the quantity as field, where the stated unit is another, or the formula
    cannot be in that unit.
    """
    resolved: list[SoughtQuantity] = []
    for quantity in quantities:
        try:
            follows = unit_that_follows(
                quantity.formula.tree,
                quantity.symbols,
                {**units, **{before.name: before.unit for before in resolved}},
                quantity.stated,
                units.get(quantity.name),
            )
        except InputError as error:
            raise InputError(
                error.rule, field=quantity.name, value=error.value or quantity.text
            ) from None
        resolved.append(replace(quantity, unit=follows))
    return tuple(resolved)


def seek_of_fit(
    derived: Mapping[str, str],
    units: Mapping[str, str],
    known: Collection[str],
    of_parameters: Mapping[str, str] = {},
) -> tuple[SoughtQuantity, ...]:
    """The quantities of a fit from Python: name -> formula; there is one run, and so no level.
    Raises InputError.

    units : those stated, also of quantities.
    of_parameters : those of the parameters, stated or as they follow, also of tied ones.
    """
    quantities = tuple(seek(name, text, unit=units.get(name)) for name, text in derived.items())
    for quantity in quantities:
        if quantity.of_levels:
            raise InputError(
                "must use ( ), not [ ]: there are no runs to choose from",
                field=quantity.name,
                value=quantity.text,
            )
    check_derived_names(quantities, known)
    return in_units(quantities, of_parameters)
