"""What estim needs of noise.  Two questions, two contracts:

- `Noise`: what was assumed of the errors of a run, before any curve: which unknowns, in which
  words.
- `Likelihood`: what it makes of the points of a run and of their curve, with all that depends only
  weakly on the parameters (the slope of the curve inside a covariance, the truncation of a stencil)
  taken at one set of values.  The posterior is a sum of these over the groups of runs
  (`estim.problem.correlated_runs`), most of which hold one run.

`estim.problem.correlated_normal`, `robust_likelihood`, `errors_in_x`, `count_noise`, `own_density`
and `estim.discrepancy.likelihood` have the likelihoods; nobody else knows which of them a run has.
What only some have may be None: `Likelihood.normal`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol, cast

import numpy as np
from scipy.sparse import csr_array

from estim.arrays import FloatArray, IntArray, Named
from estim.problem.count_distributions import Counted
from estim.problem.curve import Curve, LocalCurve, SquaredCurve, Wording
from estim.problem.noise_variance import NoiseVariance, Scale
from estim.problem.roots import Root
from estim.problem.whitened_residuals import Linear, Whitened

Ends = Mapping[str, tuple[Named, Named, float]]
"""Noise parameter -> values below, values above, their distance: for differences."""


@dataclass(frozen=True, eq=False)
class Points:
    """Points (x, y), (n_obs,) each, and the curve they lie about.

    arguments : argument of the curve -> parameter name, or a fixed number.  Of an argument that
        varies between runs it names the mean, and `spread_of` and `shift_of` it what this run
        deviates by:  mean + spread * shift.
    """

    curve: Curve
    x: FloatArray
    y: FloatArray
    arguments: Mapping[str, str | float]

    @property
    def runs(self) -> tuple[Points, ...]:
        """Those of each run: of this one alone."""
        return (self,)

    def bind(self, named: Named) -> dict[str, float | FloatArray]:
        """Arguments of the curve for parameter values; of what varies between runs, this run's
        own.
        """
        values = {
            a: named[source] if isinstance(source, str) else source
            for a, source in self.arguments.items()
        }
        return own_values(values)

    def value(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) the curve at the points."""
        return self.curve.value(self.x, self.bind(named))

    def square(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) the square of a curve of speeds, negative where the energy does not
        suffice.
        """
        return cast(SquaredCurve, self.curve).square(self.x, self.bind(named))

    def square_gradient(self, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_obs, n) its derivatives, for single values."""
        return self.gradients_of(
            cast(SquaredCurve, self.curve).local_square(self.x, self.bind(named)), named, names, 1
        )[0]

    def slope(self, named: Named) -> FloatArray:
        """(n_obs,) its slope in x."""
        return self.curve.local(self.x, self.bind(named)).slope[0]

    def gradients(self, named: Named, names: Sequence[str], n_draw: int) -> FloatArray:
        """(n_draw, n_obs, n) derivatives of the curve in the parameters `names`; 0 in those that it
        does not have.
        """
        return self.gradients_of(self.curve.local(self.x, self.bind(named)), named, names, n_draw)

    def gradients_of(
        self, local: LocalCurve, named: Named, names: Sequence[str], n_draw: int
    ) -> FloatArray:
        """The same from the curve with its derivatives."""
        gradients = np.zeros((n_draw, self.x.size, len(names)))
        for part, source in self.arguments.items():
            if source in names:
                argument, by = part, np.asarray(1.0)
                for suffix, factor in ((_SPREAD, _SHIFT), (_SHIFT, _SPREAD)):
                    if part.endswith(suffix):
                        argument = part.removesuffix(suffix)
                        other = self.arguments[argument + factor]
                        by = np.asarray(named[other] if isinstance(other, str) else other)
                gradients[:, :, names.index(str(source))] += local.gradient[argument] * by
        return gradients

    def gradient(self, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_obs, n) the same for single values."""
        return self.gradients(named, names, 1)[0]


_SPREAD, _SHIFT = " spread", " shift"


def spread_of(argument: str) -> str:
    return argument + _SPREAD


def shift_of(argument: str) -> str:
    return argument + _SHIFT


def own_values(values: dict[str, Any]) -> dict[str, Any]:
    """Arguments of a curve with this run's own value, mean + spread * shift, of those that vary
    between runs.
    """
    for name in [name.removesuffix(_SHIFT) for name in values if name.endswith(_SHIFT)]:
        spread, shift = (values.pop(part(name)) for part in (spread_of, shift_of))
        values[name] = values[name] + spread * shift
    return values


def n_draws(named: Named) -> int:
    """Number of draws that the columns of `named` hold."""
    return max(
        (np.shape(column)[0] for column in named.values() if np.ndim(column) == 2), default=1
    )


def some_draws(named: Named, rows: slice | IntArray) -> Named:
    """The columns of `named` at some of their draws; what is the same for all stays."""
    return {
        name: np.asarray(a)[rows] if np.ndim(a) == 2 and np.shape(a)[0] > 1 else a
        for name, a in named.items()
    }


@dataclass(frozen=True, eq=False)
class StackedPoints:
    """The points of several runs below each other, in the order of the runs; each has its own
    curve.
    """

    runs: tuple[Points, ...]

    @property
    def y(self) -> FloatArray:
        """(n_obs,)."""
        return np.concatenate([run.y for run in self.runs])

    def value(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) the curves at the points."""
        n_draw = n_draws(named)
        return np.hstack(
            [np.broadcast_to(run.value(named), (n_draw, run.x.size)) for run in self.runs]
        )

    def gradients(self, named: Named, names: Sequence[str], n_draw: int) -> FloatArray:
        """(n_draw, n_obs, n) derivatives of the curves in the parameters `names`."""
        return np.concatenate([run.gradients(named, names, n_draw) for run in self.runs], axis=1)

    def gradient(self, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_obs, n) derivatives of the curves in the parameters `names`, for single values."""
        return np.vstack([run.gradient(named, names) for run in self.runs])

    def square(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) the squares of curves of speeds at the points."""
        n_draw = n_draws(named)
        return np.hstack(
            [np.broadcast_to(run.square(named), (n_draw, run.x.size)) for run in self.runs]
        )

    def square_gradient(self, named: Named, names: Sequence[str]) -> FloatArray:
        """(n_obs, n) their derivatives, for single values."""
        return np.vstack([run.square_gradient(named, names) for run in self.runs])


class NormalErrors(Protocol):
    """Normal errors with a covariance C."""

    def root(self, named: Named) -> Root:
        """The triangular root of C, in the order of the points."""

    def residuals(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) independent and of variance 1."""

    def log_variances(self, named: Named) -> FloatArray:
        """(n, n_obs) logarithms of the squared units of these, n the number of draws or 1; their
        sum is the logarithm of the determinant of C up to a constant.
        """


class Likelihood(ABC):
    """The likelihood of one run, or of several that share what their curves lack.

    Of draws `named` holds columns (n_draw, 1), else single values; `names` are all parameters of
    the problem.  Four members make a likelihood; what follows from them is defined once, and again
    only where it is not as simple.
    """

    if TYPE_CHECKING:

        @property
        def points(self) -> Points | StackedPoints:
            """The points and their curve."""

    @abstractmethod
    def pointwise(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) log predictive density of every point given all the other points of the
        run.
        """

    @abstractmethod
    def residuals(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) residuals whose squares sum to twice the log of the highest likelihood
        that any curve reaches, less twice that of this (where x has errors: of the product of
        `pointwise`).
        """

    @abstractmethod
    def information_root(self, named: Named, names: Sequence[str]) -> FloatArray:
        """J (n, n_par) with J^T J the Fisher information about the curve, the noise held; of normal
        errors the derivatives of `residuals`.
        """

    @abstractmethod
    def sd(self, named: Named) -> FloatArray:
        """(n_obs,) standard deviation of each y about the curve; of robust errors that of the good
        ones.
        """

    creeps: ClassVar[bool] = False
    """Whether least squares on `residuals` creep, far from normal as they are, so that steps
    by `scoring` must finish them.
    """

    resolved: ClassVar[float] = 0.0
    """Ratio of singular values of `scoring` below which rounding errors hide them, where these are
    roots of an information matrix.
    """

    @property
    def y(self) -> FloatArray:
        """(n_obs,) the ordinates, less what the measurement itself adds to them on average
        (truncation of a stencil).
        """
        return self.points.y

    @property
    def normal(self) -> NormalErrors | None:
        """The same as normal errors with a covariance; None where they are not."""
        return None

    def log_likelihood(self, named: Named) -> FloatArray:
        """(n_draw,) log density of the data, normalised."""
        return np.sum(self.pointwise(named), axis=1)

    def standardised(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) residuals over their standard deviations, each independent of the others:
        not of one point where errors are correlated.
        """
        return self.residuals(named)

    def size_residuals(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) residuals whose squares sum to chi^2."""
        return self.standardised(named)

    def outlier_probability(self, named: Named) -> FloatArray:
        """(n_draw, n_obs) probability that the point is an outlier; 0 where the noise leaves no
        room for any.
        """
        return np.zeros((n_draws(named), self.points.y.size))

    def scoring(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """J (n, n_par) and r (n,), n >= n_obs, for a step of least squares in the parameters of the
        curve: J^T r is minus the gradient of the log likelihood, J^T J the information that the
        step takes.
        """
        return self.information_root(named, names), self.residuals(named)[0]

    def information(self, named: Named, names: Sequence[str], ends: Ends) -> FloatArray:
        """(n_par, n_par) Fisher information about all parameters; of the noise those in `ends`,
        which has none here.
        """
        root = self.information_root(named, names)
        return root.T @ root

    def whitened(self, named: Named, names: Sequence[str]) -> Whitened:
        """The residuals for tests."""
        return Linear(self.standardised(named)[0], -self.information_root(named, names))

    def squared_size(self, vector: FloatArray, named: Named) -> float:
        """v^T C^-1 v of a vector (n_obs,) in the unit of y."""
        return float(np.sum(np.square(vector / self.sd(named))))


class Noise(ABC):
    """What was assumed of the errors of a run, and of the readings that its points are or were made
    of.

    A law of independent readings with exact x says its `size`, `reading_gain`, `likelihood`,
    `read` and `describe`; all else has an answer here.
    """

    @property
    @abstractmethod
    def size(self) -> NoiseVariance:
        """How large the errors of the readings are, and the scatter that the instrument does not
        explain.
        """

    share: float = 0.0
    """Standard deviation of a reading over the curve; 0 where it is not stated so."""
    holds_slopes: bool = False
    """Whether its likelihood takes the slopes of the curve at the values that it is made with, so
    that a fit must be repeated with those of its result.
    """

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its unknowns."""
        return self.size.parameters

    @property
    def outlier_parameters(self) -> tuple[str, ...]:
        """Those of them that tell how many outliers there are, and how far off."""
        return ()

    @property
    def robust(self) -> bool:
        """Whether it leaves room for outliers."""
        return False

    @property
    def sides(self) -> FloatArray | None:
        """(2, n_obs) stated errors of readings below and above, where they differ."""
        return None

    @property
    def counted(self) -> Counted | None:
        """How y were counted; None where they are readings, which have errors."""
        return None

    own_density: bool = False
    """Whether the curve is the logarithm of the density of each observation, which is the user's
    own: there are no readings, and no residual tests anything."""

    @property
    def made_of_positions(self) -> bool:
        """Whether the ordinates are differences of positions in time: then these are what is
        read.
        """
        return False

    @abstractmethod
    def reading_gain(self) -> FloatArray:
        """(n_obs,) standard deviation of each y for a unit sigma of a reading."""

    @abstractmethod
    def likelihood(self, points: Points, named: Named) -> Likelihood:
        """The likelihood of points whose curve passes near them at the values `named`."""

    def of_size(self, sigma: Scale) -> Noise:
        """The same with readings of that standard deviation, or that times what was stated of each;
        counts have none.
        """
        return self

    def for_search(self) -> Noise:
        """What a search from afar takes in its place: noise whose `residuals` are those of least
        squares.  Itself where they are.
        """
        return self

    def with_normal_errors(self, wider: FloatArray) -> Noise:
        """The noise with normal errors, each `wider` (n_obs,) times as wide, where it leaves room
        for outliers; otherwise itself.
        """
        return self

    def outlier_share(self, named: Named) -> float:
        """The inferred share of outliers; nan where it is not inferred."""
        return float("nan")

    def of_positions(self, points: Points, named: Named) -> csr_array | None:
        """(n_obs, n_row) what shifts of all the positions that were read do to y - f(x); None where
        y is not made of positions.
        """
        return None

    def x_gain(self) -> FloatArray:
        """(n_obs,) standard deviation of each x for a unit sigma of x; 0 where x is exact."""
        return np.zeros(self.reading_gain().size)

    def true_x(
        self, x: FloatArray, gain: FloatArray, named: Named, rng: np.random.Generator
    ) -> FloatArray:
        """Abscissas (n,) as the readings x (n,) leave them possible.  gain : (n,) `x_gain` of these
        rows.
        """
        return x

    def read_x(
        self, x: FloatArray, gain: FloatArray, named: Named, rng: np.random.Generator
    ) -> FloatArray:
        """Readings of abscissas (n,)."""
        return x

    @abstractmethod
    def read(
        self, true: FloatArray, gain: FloatArray, named: Named, rng: np.random.Generator
    ) -> FloatArray:
        """Readings of ordinates (n,), with their scatter; of positions where the ordinates are made
        of these.  gain : (n,) `reading_gain` of these rows.
        """

    def carried(
        self, by_x: FloatArray, by_y: FloatArray, named: Named
    ) -> tuple[FloatArray, FloatArray]:
        """What the errors of the ordinates, and of the readings that they were made of, do to a
        quantity of each point with derivatives by_x, by_y (n_obs,): its covariance (n_obs, n_obs),
        and the variance (n_obs,) of y alone.
        """
        variance = self.size.variance(np.square(self.reading_gain()), named)[0]
        return np.diag(by_y**2 * variance), variance

    @abstractmethod
    def describe(self, *, x_unit: str, y_unit: str, words: Wording) -> str:
        """The noise in words."""


def reading_sd(noise: Noise, named: Named, curve: FloatArray | None = None) -> FloatArray:
    """Standard deviation of each point from the instrument alone, without scatter: broadcasts to
    (n_draw, n_obs).  curve : (n_draw, n_obs) at the points, where it is known.
    """
    if curve is not None and noise.share:
        return noise.share * np.abs(curve)
    return np.sqrt(noise.size.reading_variance(named)) * noise.reading_gain()
