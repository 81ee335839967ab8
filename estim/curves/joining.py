"""Several data sets with one curve as one problem: which parameters they share, and which each has
for itself.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import InputError
from estim.curves.counting import Counting
from estim.curves.posing import CurveProblem
from estim.problem import Parameter, Problem


@dataclass(frozen=True, eq=False)
class DataSet:
    """Points x, y (n_obs,) of one of several data sets, with what `fit_curve` takes of their
    errors: u_y, cov_y, u_x, or `noise` for counts.
    """

    x: ArrayLike
    y: ArrayLike | None
    u_y: ArrayLike | None = None
    cov_y: ArrayLike | None = None
    u_x: ArrayLike | None = None
    noise: Counting | str | None = None


@dataclass(frozen=True, eq=False)
class JointProblem:
    """Problems that share parameters; it answers what a `CurveProblem` answers.

    parts : name of the data set -> its problem.
    sources : the same -> its argument -> name in `parameters`.  y : (n_obs,) of all in turn.
    """

    parts: Mapping[str, CurveProblem]
    sources: Mapping[str, Mapping[str, str]]
    parameters: tuple[Parameter, ...]
    y: FloatArray
    fixed: Mapping[str, float]

    @property
    def text(self) -> str:
        return self._first.text

    @property
    def called(self) -> str:
        return self._first.called

    @property
    def _first(self) -> CurveProblem:
        return next(iter(self.parts.values()))

    def with_sigma(self, sigma: float) -> Problem:
        """The problem whose errors are `sigma` times the stated ones."""
        runs = []
        for name, part in self.parts.items():
            run, sources = part.with_sigma(sigma).runs[0], self.sources[name]
            arguments = {
                argument: sources.get(source, source) if isinstance(source, str) else source
                for argument, source in run.arguments.items()
            }
            runs.append(replace(run, name=name, arguments=MappingProxyType(arguments)))
        return Problem(self.parameters, tuple(runs))

    def with_unknown_sigma(self, typical: float) -> Problem:
        """None of its errors is unknown."""
        raise InputError("must be stated for every data set", field="u_y", value=typical)

    def residuals(self, values: FloatArray) -> FloatArray:
        """(n_obs,) y - f, unit of y."""
        known = {p.name: float(v) for p, v in zip(self.parameters, values, strict=True)}
        return np.concatenate(
            [
                part.residuals(
                    np.array([known[self.sources[name][p.name]] for p in part.parameters])
                )
                for name, part in self.parts.items()
            ]
        )


def join(
    parts: Mapping[str, CurveProblem], *, shared: Collection[str], common: Collection[str]
) -> JointProblem:
    """The joint problem.  shared : parameters of the curve that are one unknown for all; `common`
    are so in any case.  Raises InputError.
    """
    for name, part in parts.items():
        if not part.stated:
            raise InputError(
                "needs u_y, cov_y or noise: otherwise the relative weights of the data "
                "sets are undefined",
                field=f"data[{name}]",
            )
    unknown = {p.name for part in parts.values() for p in part.parameters}
    for name in shared:
        if name not in unknown:
            raise InputError(
                f"names '{name}', which is not a fitted parameter ({', '.join(sorted(unknown))})",
                field="shared",
            )
    together = {*shared, *common}
    sources = {
        name: {
            p.name: p.name if p.name in together else f"{p.name}[{name}]" for p in part.parameters
        }
        for name, part in parts.items()
    }
    by_name = {
        sources[name][p.name]: replace(p, name=sources[name][p.name])
        for name, part in reversed(list(parts.items()))
        for p in part.parameters
    }
    ordered = [name for name in by_name if "[" not in name] + [
        sources[name][p.name] for name, part in parts.items() for p in part.parameters
    ]
    fixed: dict[str, float] = {}
    for name, part in parts.items():
        alike = {
            parameter: all(other.fixed.get(parameter) == value for other in parts.values())
            for parameter, value in part.fixed.items()
        }
        fixed |= {
            parameter if alike[parameter] else f"{parameter}[{name}]": value
            for parameter, value in part.fixed.items()
        }
    y = np.concatenate([part.y for part in parts.values()])
    return JointProblem(
        MappingProxyType(dict(parts)),
        MappingProxyType(sources),
        tuple(by_name[name] for name in dict.fromkeys(ordered)),
        y,
        MappingProxyType(fixed),
    )


def of_data_set(
    given: Mapping[str, Any], name: str, everyone: Sequence[str], field: str
) -> dict[str, Any]:
    """What is said of the parameters of one data set: "A" for all, "A[second]" for one, which has
    the last word.  Raises InputError.
    """
    if not isinstance(given, Mapping):
        raise InputError("must be a mapping from names of parameters", field=field, value=given)
    entries: dict[str, Any] = {}
    for written, value in given.items():
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
