"""The points of one run that are fit, with their curve and noise, and what an unknown is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Self

import numpy as np

from estim.arrays import FloatArray, IntArray, Named
from estim.common import Finding, InputError, Label, Notation, phrase, split_level
from estim.problem.curve import POINTS, Curve, Derived, DerivedQuantity, Motion, Wording
from estim.problem.likelihood import Likelihood, Noise, Points
from estim.problem.priors import Prior


@dataclass(frozen=True, eq=False)
class Parameter:
    """One unknown: `name` as in results ("gamma[heavy]"), `unit` ("1", "rad", "m", ...), prior, and
    what it is.

    notation : how it is written; None: by its own name and in its own unit.
    between : whether it is a standard deviation between runs, of which no run by itself tells
        anything.
    """

    name: str
    unit: str
    prior: Prior
    meaning: str
    notation: Notation | None = None
    between: bool = False

    @property
    def label(self) -> Label:
        """How it is shown, with its level in brackets."""
        return self._notation.label(self.unit, split_level(self.name)[1])

    @property
    def bare_label(self) -> Label:
        """How it is shown without its level, where one run is all there is or a column holds every
        level.
        """
        return self._notation.label(self.unit)

    @property
    def _notation(self) -> Notation:
        return self.notation or Notation(split_level(self.name)[0])


# points of a curve that may lack something: every length needs a decomposition of a matrix of that
# size
MAX_LACKING = 1000


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """What a curve of the user's own may lack, before the data are used.

    deviation : scale of the prior of a smooth deviation of y along x, unit of y; 0 for none.
    along : (n_obs,) times of the readings, or their positions in order, along which their errors
        are correlated; None for independent ones.
    along_unit : of these ("s", or "readings" where they are positions in order).
    stated : whether the size of the errors of the readings was stated; else the noise has a rough
        one, and the residuals determine it.
    """

    deviation: float
    along: FloatArray | None
    along_unit: str
    stated: bool


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of the readings of a body's motion.

    t : (n_row,) s, nan where unknown.  lines : (n_row,) of the file.  kept : (n_obs,) the rows of
        the points.
    positions : (n_row,) what was read, where the points are speeds made of it; else None, and the
        points are what was read.
    """

    t: FloatArray
    lines: IntArray
    kept: IntArray
    positions: FloatArray | None = None

    @classmethod
    def of_points(cls, n_obs: int, t: FloatArray | None, lines: IntArray) -> Rows:
        """Of points that are what was read, at times t (n_obs,) on these lines (n_obs,), where
        times are known.
        """
        every = np.arange(n_obs)
        if t is None:
            return cls(np.full(n_obs, np.nan), 0 * every, every)
        return cls(t, lines, every)


@dataclass(frozen=True, eq=False)
class Observations:
    """The speeds of one run that are fit, with their curve and noise.

    x : (n_obs,) position.
    y : (n_obs,) speed.  t : (n_obs,) s, or None where it is unknown.
    arguments : argument of the curve -> parameter name, or a fixed number.
    x_name, x_unit, y_name, y_unit : for axes and tables ("position x", "m").
    excluded : why and how many rows were left out (`Finding.size`).
    excluded_points : (n, 2) the (x, y) of those rows that have a speed, for figures.
    positions : whether they are positions of a body at known times rather than speeds at known
        positions.
    force : scale of the prior of an unmodelled force along the track, in units of the weight; 0 for
        none.
    track : what runs that share such a force have in common.
    asked : whether the campaign mentions the force, so that it is not just taken as absent where
        it cannot be had.
    rows : of the readings of a body's motion, where they are known.
    complete : why the curve is taken as complete, where a force could have been asked for.
    lacks : what a plain curve may lack; None for nothing.
    sought : what a user wants to be computed from the parameters.
    motion : the body whose motion was measured; None for a plain curve.
    words : the names of the measured numbers.
    order : (n_obs,) the position of each point among those that were given; None where that is not
        known.
    places : name -> (n_obs,), the abscissas of points that have several: x are then the numbers of
        the points, between which the curve is not defined.
    notes : what a reader must know of how the run was posed, in words.
    """

    name: str
    x: FloatArray
    y: FloatArray
    t: FloatArray | None
    curve: Curve
    arguments: Mapping[str, str | float]
    noise: Noise
    x_name: str
    x_unit: str
    y_name: str
    y_unit: str
    excluded: tuple[Finding, ...]
    excluded_points: FloatArray
    motion: Motion | None = None
    words: Wording = POINTS
    positions: bool = False
    force: float = 0.0
    track: str = ""
    asked: bool = False
    rows: Rows | None = None
    complete: Finding | None = None
    lacks: Discrepancy | None = None
    sought: tuple[DerivedQuantity, ...] = ()
    order: IntArray | None = None
    places: Mapping[str, FloatArray] | None = None
    notes: tuple[str, ...] = ()

    @property
    def numbered(self) -> bool:
        """Whether x are the numbers of points that have several abscissas."""
        return self.places is not None

    @property
    def stated(self) -> bool:
        """Whether the size of its errors was stated."""
        return not self.noise.parameters and (self.lacks is None or self.lacks.stated)

    @property
    def n_obs(self) -> int:
        return int(self.x.size)

    @property
    def position(self) -> FloatArray:
        """(n_obs,) where the body was, of a motion: y where that is read over time, else x."""
        return self.y if self.positions else self.x

    @property
    def spread_in_decades(self) -> bool:
        """Whether x is positive and covers two decades or more with most points in the lower ones,
        so that figures have a logarithmic axis; never of a motion or of counts, whose bins may
        begin at 0.
        """
        low, middle, high = (float(np.quantile(self.x, p)) for p in (0.0, 0.5, 1.0))
        linear = self.words.from_release or self.noise.counted is not None or self.numbered
        return not linear and 0.0 < 100.0 * low <= high and middle < 0.25 * high

    def drawn(self, named: Named, x: FloatArray | None = None) -> FloatArray:
        """(n,) the curve for single values at the places x, or at its points."""
        at = self.x if x is None else x
        return self.curve.value(at, self.bind(named))[0]

    def against_fit(self, fitted: FloatArray) -> Self:
        """The points with the `fitted` values (n_obs,) in place of x, for figures of a curve of
        several abscissas.
        """
        return replace(self, x=fitted, x_name=phrase("fitted value"), x_unit=self.y_unit)

    def along(self, low: float, high: float, n: int) -> FloatArray:
        """(n,) places from low to high at which figures draw the curve; where there are only
        points, at most n of these.
        """
        if self.numbered:
            return self.x[:: -(-self.n_obs // n)]
        return (np.geomspace if self.spread_in_decades else np.linspace)(low, high, n)

    @cached_property
    def curve_parameters(self) -> frozenset[str]:
        """Names of the parameters of its curve."""
        return frozenset(source for source in self.arguments.values() if isinstance(source, str))

    @cached_property
    def parameters(self) -> frozenset[str]:
        """Names of all parameters that the run depends on: those of its curve and of its noise."""
        return self.curve_parameters | frozenset(self.noise.parameters)

    @property
    def x_label(self) -> str:
        return self._label(self.x_name, self.x_unit)

    @property
    def y_label(self) -> str:
        return self._label(self.y_name, self.y_unit)

    def _label(self, name: str, unit: str) -> str:
        """A body's axes have names of ours, those of a plain curve are the user's."""
        label = name if self.motion is None else phrase(name)
        return label if unit == "1" else f"{label} ({unit})"

    @property
    def points(self) -> Points:
        """The points and the curve they lie about."""
        return Points(self.curve, self.x, self.y, self.arguments)

    def likelihood(self, named: Named) -> Likelihood:
        """What the noise makes of the points, the curve taken at the values `named` where it
        matters little.
        """
        return self.noise.likelihood(self.points, named)

    def end(self, arguments: Named) -> FloatArray:
        """(n_draw, 1) or (1, 1) abscissa behind which the motion does not go; inf where there is
        none, or it never ends.
        """
        return np.full((1, 1), np.inf) if self.motion is None else self.motion.end(arguments)

    @property
    def body(self) -> Motion:
        """The body whose motion was measured.  Raises InputError for a plain curve."""
        if self.motion is None:
            raise InputError(
                "is fit by a curve that is no motion of a body", field="run", value=self.name
            )
        return self.motion

    def derived(self, arguments: Named) -> Mapping[str, Derived]:
        """Quantities that follow from the arguments of the curve (`bind`): those that mean
        something to a reader, and what was `sought`.
        """
        quantities = {} if self.motion is None else dict(self.motion.derived(arguments))
        for quantity in self.sought:
            derived = quantity.of(
                {**arguments, **{name: known.values for name, known in quantities.items()}}
            )
            if derived is not None:
                quantities[quantity.name] = derived
        return quantities

    def renamed(self, sources: Mapping[str, str | float]) -> Self:
        """The run with other sources of its arguments: parameter -> another, or its value."""
        arguments = {
            argument: sources.get(source, source) if isinstance(source, str) else source
            for argument, source in self.arguments.items()
        }
        return replace(self, arguments=MappingProxyType(arguments))

    def bind(self, values: Named) -> dict[str, float | FloatArray]:
        """Arguments of the curve for parameter values (scalars or (n_draw, 1)), and what else is
        needed for what was `sought`.
        """
        others = {
            name: source for quantity in self.sought for name, source in quantity.others.items()
        }
        known = {
            name: values.get(source) if isinstance(source, str) else source
            for name, source in others.items()
        }
        return {
            **{name: value for name, value in known.items() if value is not None},
            **self.points.bind(values),
        }


def parameters_of(runs: Iterable[Observations]) -> frozenset[str]:
    """Those on which any of `runs` depends."""
    return frozenset[str]().union(*(run.parameters for run in runs))


def uses_of(runs: Iterable[Observations]) -> Counter[str]:
    """Parameter of a curve -> number of `runs` whose curve has it."""
    return Counter(name for run in runs for name in run.curve_parameters)


def shared_first(
    parameters: Iterable[Parameter], runs: Sequence[Observations]
) -> tuple[Parameter, ...]:
    """`parameters` of a curve with those that several of `runs` share before those of one run,
    otherwise in their order.
    """
    uses = uses_of(runs)
    return tuple(sorted(parameters, key=lambda p: uses[p.name] < 2))
