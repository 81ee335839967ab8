"""Several data sets, with one curve or each with its own, as one problem: which parameters they
share, and which each has for itself.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from estim.arrays import FloatArray
from estim.common import InputError, same_numbers
from estim.curves.curve_problem import CurveProblem
from estim.curves.derived import SoughtQuantity, check_derived_names, in_units, seek
from estim.problem import Parameter, Problem


@dataclass(frozen=True, eq=False)
class JointProblem:
    """Problems that share parameters, whose errors are stated, or of the same size in all.

    parts : name of the data set -> its problem.
    sources : the same -> its argument -> name in `parameters`.  y : (n_obs,) of all in turn.
    sought : what is to be computed from parameters that no data set has all of.
    """

    parts: Mapping[str, CurveProblem]
    sources: Mapping[str, Mapping[str, str]]
    parameters: tuple[Parameter, ...]
    y: FloatArray
    fixed: Mapping[str, float]
    sought: tuple[SoughtQuantity, ...] = ()

    @property
    def text(self) -> str:
        return "; ".join(dict.fromkeys(part.text for part in self.parts.values()))

    @property
    def called(self) -> str:
        return "; ".join(dict.fromkeys(part.called or part.text for part in self.parts.values()))

    @property
    def infers_errors(self) -> bool:
        """Whether anything is unknown of the errors, or they leave room for outliers."""
        return any(part.infers_errors for part in self.parts.values())

    @property
    def stated(self) -> bool:
        """Whether the size of their errors is known."""
        return all(part.stated for part in self.parts.values())

    def with_sigma(self, sigma: float) -> Problem:
        """All data sets, with what is unknown of their errors as further parameters; errors are
        `sigma` times u_y (or times 1).
        """
        return self.posed(lambda _, part: part.with_sigma(sigma))

    def with_unknown_sigma(self, typical: float) -> Problem:
        """The same with one unknown standard deviation of all y, about `typical`."""
        return self.posed(lambda _, part: part.with_unknown_sigma(typical))

    def posed(self, pose: Callable[[str, CurveProblem], Problem]) -> Problem:
        """The problems that `pose` makes of each part, as one."""
        runs, remaining, further = [], self.sought, dict[str, Parameter]()
        for name, part in self.parts.items():
            problem = pose(name, part)
            run = problem.runs[0].renamed(self.sources[name])
            runs.append(replace(run, name=name, sought=(*run.sought, *remaining)))
            remaining = ()
            for unknown in problem.parameters[len(part.parameters) :]:
                further.setdefault(unknown.name, unknown)
        return Problem((*self.parameters, *further.values()), tuple(runs))


def join(
    parts: Mapping[str, CurveProblem],
    *,
    own: Mapping[str, Collection[str]],
    common: Collection[str] = (),
    derived: Mapping[str, str] = {},
    units: Mapping[str, str] = {},
    order: Iterable[str] = (),
    same_size: bool = False,
) -> JointProblem:
    """The joint problem.  own : data set -> the parameters that belong to it alone.  All other
    parameters of one name are one unknown, which starts where the first of `parts` puts it.  Raises
    InputError.

    common : the errors in common, which come last.
    derived : what follows from parameters of several data sets, with the stated `units`.
    order : of the data sets in the result, that of `parts` if there is none.
    same_size : whether errors whose size is not stated are of the same size in all.
    """
    for name, part in parts.items():
        if not part.stated and not same_size:
            raise InputError(
                "needs u_y, cov_y or noise: otherwise the relative weights of the data "
                "sets are undefined",
                field=f"data[{name}]",
            )
    sources = {
        name: {
            p.name: f"{p.name}[{name}]" if p.name in own.get(name, ()) else p.name
            for p in part.parameters
        }
        for name, part in parts.items()
    }
    by_name: dict[str, Parameter] = {}
    for name, part in parts.items():
        for p in part.parameters:
            first = by_name.setdefault(
                sources[name][p.name], replace(p, name=sources[name][p.name])
            )
            if first.unit == "1":
                by_name[first.name] = replace(first, unit=p.unit)
            elif p.unit != "1" and same_numbers(p.unit, first.unit) is False:
                raise InputError(
                    f"is shared, but in {first.unit} for one data set and in {p.unit} for '{name}'",
                    field=p.name,
                )
    parts = {name: parts[name] for name in order or parts}
    every = [sources[name][p.name] for name, part in parts.items() for p in part.parameters]
    shared = [name for name in by_name if "[" not in name] if len(parts) > 1 else []
    names = dict.fromkeys([*shared, *every])
    ordered = tuple(by_name[name] for name in sorted(names, key=lambda name: name in common))
    fixed: dict[str, float] = {}
    for name, part in parts.items():
        is_common = {
            parameter: all(
                other.fixed.get(parameter) == value
                for other_name, other in parts.items()
                if parameter in other.fixed or parameter in sources[other_name]
            )
            for parameter, value in part.fixed.items()
        }
        fixed |= {
            parameter if is_common[parameter] else f"{parameter}[{name}]": value
            for parameter, value in part.fixed.items()
        }
    y = np.concatenate([part.y for part in parts.values()])
    return JointProblem(
        dict(parts), sources, ordered, y, fixed, _across(derived, units, parts, sources, by_name)
    )


def _across(
    derived: Mapping[str, str],
    units: Mapping[str, str],
    parts: Mapping[str, CurveProblem],
    sources: Mapping[str, Mapping[str, str]],
    by_name: Mapping[str, Parameter],
) -> tuple[SoughtQuantity, ...]:
    """What follows from parameters of several data sets, "A[second]" of one of them.  Raises
    InputError.
    """
    known: dict[str, str | float] = {}
    for name, part in parts.items():
        of_part: dict[str, str | float] = {**part.fixed, **sources[name]}
        for argument, source in of_part.items():
            known[f"{argument}[{name}]"] = source
            if source == argument or argument in part.fixed:
                known.setdefault(argument, source)
    quantities = [seek(name, text, unit=units.get(name)) for name, text in derived.items()]
    check_derived_names(quantities, [name for name in known if "[" not in name])
    for quantity in quantities:
        for written in quantity.of_levels:
            if written not in known:
                rule = f"names '{written}', which no data set has ({', '.join(known)})"
                raise InputError(rule, field=quantity.name, value=quantity.text)
    of_known = {
        written: by_name[str(source)].unit for written, source in known.items() if source in by_name
    }
    return tuple(
        quantity.bound({w: known[w] for w in quantity.symbols.values() if w in known})
        for quantity in in_units(quantities, of_known)
    )


def of_data_set(
    settings: Mapping[str, Any], name: str, everyone: Sequence[str], field: str
) -> dict[str, Any]:
    """The settings of the parameters of one data set: "A" for all, "A[second]" for one, which takes
    precedence.  Raises InputError.
    """
    if not isinstance(settings, Mapping):
        raise InputError("must be a mapping from names of parameters", field=field, value=settings)
    entries: dict[str, Any] = {}
    for written, value in settings.items():
        parameter, mark, level = str(written).partition("[")
        if mark and (not level.endswith("]") or level[:-1] not in everyone):
            raise InputError(
                f"names a data set that there is not ({', '.join(everyone)})",
                field=field,
                value=written,
            )
        if not mark:
            entries.setdefault(parameter, value)
        elif level == f"{name}]":
            entries[parameter] = value
    return entries
