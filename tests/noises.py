"""Every kind of noise about the line y = a + b x, and what it says by brute force: SciPy's
distributions and sums, no code of estim.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from estim.curves.count_data import EventTimes, counted_points
from estim.curves.formula import Formula, read_formula
from estim.discrepancy.grid import prior_grid
from estim.discrepancy.linearised import linearise
from estim.discrepancy.mixture_likelihood import keep_probable
from estim.discrepancy.noise_with_discrepancy import Stated, WithMixture
from estim.discrepancy.residuals import Residuals
from estim.discrepancy.scale_mixture import Shape, diagonalise
from estim.problem.correlated_normal import GaussianErrors
from estim.problem.count_distributions import BINOMIAL, POISSON
from estim.problem.count_noise import Counts
from estim.problem.curve_noise import Correlated, Readings
from estim.problem.differences import covariance_in_bands
from estim.problem.finite_differences import STENCILS, differentiate
from estim.problem.installed_tails import InstalledTails
from estim.problem.likelihood import Noise, Points
from estim.problem.noise import Differentiated, Independent
from estim.problem.noise_variance import Scale
from estim.problem.roots import root_of
from estim.problem.tails import OutlierMixture, StudentT, TwoPiece

N = 7
X = np.array([0.0, 0.3, 0.4, 0.9, 1.1, 1.6, 2.0])
RELATIVE = np.array([1.0, 0.7, 1.3, 1.0, 2.0, 0.8, 1.1])
INTERVAL = 0.1
Y = 1.0 + 2.0 * X + np.array([0.05, -0.11, 0.02, 0.13, -0.04, 0.21, -0.07])


class LineOfSpeeds(Formula):
    """dx/dt = a + b x."""

    def time_derivative(self, x, arguments, order):
        return arguments["b"] ** order * self.value(x, arguments)


POINTS = Points(LineOfSpeeds(**vars(read_formula("a + b*x"))), X, Y, {"a": "a", "b": "b"})
VALUES = {"a": 1.05, "b": 1.9}
Named = Mapping[str, float]


class Normally:
    """y normal, with mean(named) and cov(named)."""

    def __init__(
        self, mean: Callable[[Named], np.ndarray], cov: Callable[[Named], np.ndarray]
    ) -> None:
        self.mean, self.cov = mean, cov

    def log_density(self, y: np.ndarray, named: Named, at: np.ndarray | None = None) -> float:
        at = np.arange(N) if at is None else at
        return (
            float(
                stats.multivariate_normal(
                    self.mean(named)[at], self.cov(named)[np.ix_(at, at)]
                ).logpdf(y[at])
            )
            if at.size
            else 0.0
        )

    def pointwise(self, y: np.ndarray, named: Named) -> np.ndarray:
        every = self.log_density(y, named)
        return np.array(
            [every - self.log_density(y, named, np.delete(np.arange(N), i)) for i in range(N)]
        )

    def scores(self, y: np.ndarray, named: Named) -> np.ndarray:
        """Of each point given those before it."""
        cov, off = self.cov(named), y - self.mean(named)
        found = []
        for i in range(N):
            share = np.linalg.solve(cov[:i, :i], cov[:i, i])
            found.append((off[i] - share @ off[:i]) / np.sqrt(cov[i, i] - share @ cov[:i, i]))
        return np.array(found)

    def information(self, named: Named, names: Sequence[str]) -> np.ndarray:
        """(n_par, n_par): dm C^-1 dm + tr(C^-1 dC C^-1 dC)/2."""
        inverse = np.linalg.inv(self.cov(named))
        moves = [
            (slope(self.mean, named, name), inverse @ slope(self.cov, named, name))
            for name in names
        ]
        return np.array(
            [[m @ inverse @ n + 0.5 * np.trace(c @ d) for n, d in moves] for m, c in moves]
        )


class Mixed(Normally):
    """y normal with one of several covariances; parts : their weights and covariances.  Tests
    whiten with `cov`, one of them.

    Its information is that of errors with the mean covariance that the parts have given the data.
    """

    def __init__(self, mean, parts, cov) -> None:
        super().__init__(mean, cov)
        self.parts = [
            (np.log(weight), Normally(mean, lambda named, c=covariance: c), covariance)
            for weight, covariance in parts
        ]

    def log_density(self, y: np.ndarray, named: Named, at: np.ndarray | None = None) -> float:
        return float(
            np.logaddexp.reduce(
                [log + part.log_density(y, named, at) for log, part, _ in self.parts]
            )
        )

    def information(self, named: Named, names: Sequence[str] = ()) -> np.ndarray:
        """(n_par,)."""
        every = self.log_density(Y, named)
        together = sum(
            np.exp(log + part.log_density(Y, named) - every) * covariance
            for log, part, covariance in self.parts
        )
        slopes = np.array([slope(self.mean, named, name) for name in named])
        return np.diag(slopes @ np.linalg.solve(together, slopes.T))


class PointByPoint:
    """Independent y with densities pdf(y, named) and distribution functions cdf(y, named),
    (n_obs,).
    """

    def __init__(
        self,
        pdf: Callable[[np.ndarray, Named], np.ndarray],
        cdf: Callable[[np.ndarray, Named], np.ndarray],
        reach: float = 8.0,
    ) -> None:
        self.pdf, self.cdf, self.reach = pdf, cdf, reach

    def log_density(self, y: np.ndarray, named: Named) -> float:
        return float(np.sum(self.pointwise(y, named)))

    def pointwise(self, y: np.ndarray, named: Named) -> np.ndarray:
        return np.log(self.pdf(y, named))

    def scores(self, y: np.ndarray, named: Named) -> np.ndarray:
        return stats.norm.ppf(self.cdf(y, named))

    def information(self, named: Named) -> np.ndarray:
        """(n_par,) its diagonal, mean squares of the scores, by a sum over y."""
        y = line(named) + np.sinh(np.linspace(-self.reach, self.reach, 20_001))[:, None] * 0.01
        chance = self.pdf(y, named) * np.gradient(y, axis=0)
        return np.array(
            [
                np.sum(chance * slope(lambda at: np.log(self.pdf(y, at)), named, name) ** 2)
                for name in named
            ]
        )


class TwoSides(PointByPoint):
    """Independent y that are normal on either side of the line, of one height there."""

    def __init__(self, minus: np.ndarray, plus: np.ndarray) -> None:
        below = plus / (minus + plus)

        def pdf(y, named):
            left, right = (stats.norm(line(named), side).pdf(y) for side in (plus, minus))
            return 2.0 * np.where(y < line(named), below * left, (1.0 - below) * right)

        def cdf(y, named):
            left, right = (stats.norm(line(named), side) for side in (plus, minus))
            above = 1.0 - 2.0 * (1.0 - below) * right.sf(y)
            return np.where(y < line(named), 2.0 * below * left.cdf(y), above)

        super().__init__(pdf, cdf, reach=6.0)
        self.variance = plus * minus

    def cov(self, named: Named) -> np.ndarray:
        """As normal errors would tell as much about the line."""
        return np.diag(self.variance)


class Counted:
    """Counts or fractions y of `trials` with expectations mean(named); law(mean) : a distribution
    of SciPy of trials * y.
    """

    def __init__(
        self,
        mean: Callable[[Named], np.ndarray],
        law: Callable[[np.ndarray], object],
        trials: float = 1.0,
    ) -> None:
        self.mean, self.law, self.trials = mean, law, trials

    def log_density(self, y: np.ndarray, named: Named) -> float:
        return float(np.sum(self.pointwise(y, named)))

    def pointwise(self, y: np.ndarray, named: Named) -> np.ndarray:
        return self.law(self.mean(named)).logpmf(np.rint(self.trials * y))

    def scores(self, y: np.ndarray, named: Named) -> np.ndarray:
        most = self.law(y).logpmf(np.rint(self.trials * y))
        return np.sign(y - self.mean(named)) * np.sqrt(
            2.0 * (most - self.law(self.mean(named)).logpmf(np.rint(self.trials * y)))
        )

    def information(self, named: Named) -> np.ndarray:
        variance = self.law(self.mean(named)).var() / self.trials**2
        return np.array([np.sum(slope(self.mean, named, name) ** 2 / variance) for name in named])


class TimesOfEvents(Counted):
    """Times of events in [0, 2] with the density (a + b t)/(2 a + 2 b), in cells between
    `edges`.
    """

    def __init__(self, times: np.ndarray, edges: np.ndarray) -> None:
        self.times, self.edges, self.trials, self.law = times, edges, 1.0, stats.poisson
        self.mean = lambda named: (
            self.times.size
            * np.diff(named["a"] * edges + named["b"] * edges**2 / 2.0)
            / (2.0 * (named["a"] + named["b"]))
        )

    def density(self, t: np.ndarray, named: Named) -> np.ndarray:
        return (named["a"] + named["b"] * t) / (2.0 * (named["a"] + named["b"]))

    def pointwise(self, y: np.ndarray, named: Named) -> np.ndarray:
        logs = np.log(self.times.size * self.density(self.times, named))
        return np.histogram(self.times, self.edges, weights=logs)[0] - self.mean(named)

    def information(self, named: Named) -> np.ndarray:
        t = np.linspace(0.0, 2.0, 20_001)
        return np.array(
            [
                self.times.size
                * np.trapezoid(
                    slope(lambda at: self.density(t, at), named, name) ** 2
                    / self.density(t, named),
                    t,
                )
                for name in named
            ]
        )


def slope(value: Callable[[Named], np.ndarray], named: Named, name: str) -> np.ndarray:
    """Derivative of value(named) in a parameter, by a central difference."""
    low, high = (value({**named, name: named[name] + sign * 1e-5}) for sign in (-1.0, 1.0))
    return (high - low) / 2e-5


@dataclass(frozen=True, eq=False)
class Case:
    """A kind of noise, values of its parameters, and what it says of y.

    mixed : whether errors are normal with one of several covariances, of which readings know one.
    told_apart : whether outliers are another kind of reading, with a probability.
    unlike : whether y is no sum of the curve and an error.
    of_curve : whether errors are a share of the curve.  lopsided : whether they are so.
    single : of points one by one where that is another thing than all together (errors of x).
    within : what quadrature in estim may be off.
    """

    noise: Noise
    values: Named
    brute: Normally | PointByPoint | Counted
    single: PointByPoint | None = None
    within: float = 1e-9
    outliers: bool = False
    mixed: bool = False
    points: Points = POINTS
    unlike: bool = False
    told_apart: bool = True
    of_curve: bool = False
    lopsided: bool = False

    @property
    def y(self) -> np.ndarray:
        return self.points.y

    @property
    def conditional(self) -> Normally | PointByPoint | Counted:
        return self.single or self.brute

    @property
    def here(self) -> dict[str, float]:
        return VALUES | dict(self.values)


def line(named: Named) -> np.ndarray:
    return named["a"] + named["b"] * X


def one_by_one(mean, sd, shape, *, reach: float = 8.0) -> PointByPoint:
    return PointByPoint(
        lambda y, named: shape(named)[0]((y - mean(named)) / sd(named)) / sd(named),
        lambda y, named: shape(named)[1]((y - mean(named)) / sd(named)),
        reach,
    )


def student(named):
    return stats.t(4.0).pdf, stats.t(4.0).cdf


def logistic(named):
    """In closed form, of standard deviation 1."""
    scale = np.sqrt(3.0) / np.pi
    return lambda z: 0.25 / scale / np.cosh(0.5 * z / scale) ** 2, (
        lambda z: 0.5 + 0.5 * np.tanh(0.5 * z / scale)
    )


def mixture(named):
    share, wide = named["fraction"], stats.norm(0.0, np.exp(named["log_width"]))
    return (
        lambda z: (1.0 - share) * stats.norm.pdf(z) + share * wide.pdf(z),
        lambda z: (1.0 - share) * stats.norm.cdf(z) + share * wide.cdf(z),
    )


def spread(named: Named) -> np.ndarray:
    return np.sqrt((named["s"] * RELATIVE) ** 2 + named["scatter"] ** 2)


def of_curve(named: Named) -> np.ndarray:
    return np.hypot(0.1 * line(named), named["scatter"])


def true_abscissas(u_x: float) -> tuple[np.ndarray, float]:
    """Mean and standard deviation of the true abscissas, whose distribution is fitted to the x."""
    share = u_x**2 / np.var(X, ddof=1)
    return X - share * (X - X.mean()), u_x * np.sqrt(1.0 - share)


def along_the_line(u_x: float, u_y: float) -> Normally:
    """All points together: the mean and ln(variance) of the true abscissas are as uncertain as N
    readings leave them.
    """
    middle, sd = true_abscissas(u_x)
    variance = np.var(X, ddof=1)
    share = u_x**2 / variance
    of_variance = (
        share
        * (1.0 - share)
        * (X - X.mean())
        * np.sqrt(2.0 / (N - 1))
        * variance
        / (variance - u_x**2)
    )
    common = share**2 * variance / N * np.ones((N, N)) + np.outer(of_variance, of_variance)
    return Normally(
        lambda named: named["a"] + named["b"] * middle,
        lambda named: (u_y**2 + named["b"] ** 2 * sd**2) * np.eye(N) + named["b"] ** 2 * common,
    )


def smeared(u_x: float, u_y: float, shape) -> PointByPoint:
    """One point: its density averaged over where its true abscissa may be, on 20 001 points."""
    middle, sd = true_abscissas(u_x)
    t = np.linspace(-8.0, 8.0, 20_001)[:, None]
    weight = stats.norm.pdf(t) * (t[1] - t[0])

    def averaged(which):
        def of(y, named):
            z = (y - named["a"] - named["b"] * (middle + sd * t)) / u_y
            return np.sum(weight * shape(named)[which](z), axis=0) / (u_y if which == 0 else 1.0)

        return of

    return PointByPoint(averaged(0), averaged(1))


def differences(relative: np.ndarray | None = None) -> Case:
    """Speeds by central differences of positions with independent errors, at positions that the
    same errors move.

    relative : size of the error of each position, (N + 2,).
    """
    derivative = differentiate(INTERVAL * np.arange(N + 2), np.zeros(N + 2), STENCILS["central"])
    noise = Differentiated(
        Scale(parameter="s"), Scale(parameter="scatter"), 0.01, derivative, np.arange(N), relative
    )
    steps = (np.eye(N, N + 2, 2) - np.eye(N, N + 2)) / (2.0 * INTERVAL)
    carried = (steps - VALUES["b"] * np.eye(N, N + 2, 1)) * (1.0 if relative is None else relative)
    # dt^2/6 times d^2 v/dt^2 of dx/dt = a + b x, at the linearisation
    truncation = INTERVAL**2 / 6.0 * VALUES["b"] ** 2 * line(VALUES)
    return Case(
        noise,
        {"s": 0.01, "scatter": 0.05},
        Normally(
            lambda named: line(named) + truncation,
            lambda named: (
                (named["s"] ** 2 + 0.01**2 / 12.0) * carried @ carried.T
                + named["scatter"] ** 2 * np.eye(N)
            ),
        ),
    )


def lacking() -> Case:
    """An unmodelled force of unknown size and length, and a push, beside stated errors."""
    sds, push = 0.08 * RELATIVE, 0.05 * (1.0 + X)
    factors = {length: np.exp(-np.abs(X[:, None] - X) / length) for length in (0.3, 1.0)}
    shapes = tuple(
        Shape("force", length, factor, np.log(0.5)) for length, factor in factors.items()
    )
    slopes = np.column_stack([np.ones(N), X, push])
    deviation = diagonalise(
        root_of(sds**2), shapes, prior_grid(0.1, scales=(0.5, 1.0, 1.6), n_amplitude=4)
    )
    found = linearise(deviation, Y - line(VALUES), slopes, precision=np.diag([0.0, 0.0, 1.0]))
    mixture = keep_probable(found, columns=push[:, None], neglected=0.0)
    parts = [
        (
            np.exp(log),
            s**2 * np.diag(sds**2)
            + a**2 * factors[family.length] @ factors[family.length].T
            + np.outer(push, push),
        )
        for family in mixture.deviation.families
        for s, a, log in zip(family.scale, family.amplitude, family.log_prior, strict=True)
    ]
    best = parts[3][1]
    noise = WithMixture(
        Independent(Scale(0.08), Scale(), RELATIVE), mixture, root_of(best), Residuals(np.zeros(N))
    )
    return Case(noise, {}, Mixed(line, parts, lambda named: best), mixed=True)


def counts() -> Case:
    y = np.array([1.0, 2.0, 0.0, 3.0, 4.0, 3.0, 5.0])
    points = Points(POINTS.curve, X, y, POINTS.arguments)
    return Case(
        Counts(POISSON, np.ones(N), y),
        {},
        Counted(line, stats.poisson),
        outliers=False,
        points=points,
        unlike=True,
    )


def fractions() -> Case:
    y = np.array([1.0, 2.0, 0.0, 3.0, 6.0, 8.0, 7.0]) / 8.0
    points = Points(read_formula("(a + b*x)/6"), X, y, POINTS.arguments)
    brute = Counted(lambda named: line(named) / 6.0, lambda mean: stats.binom(8, mean), 8.0)
    return Case(Counts(BINOMIAL, np.full(N, 8.0), y), {}, brute, points=points, unlike=True)


def events() -> Case:
    times = np.array([0.1, 0.35, 0.5, 0.9, 1.2, 1.25, 1.5, 1.55, 1.6, 1.9, 1.95])
    counted = counted_points(EventTimes(0.0, 2.0, 4), times, None, what="events")
    points = Points(counted.expected(POINTS.curve), counted.x, counted.y, POINTS.arguments)
    return Case(
        counted.noise,
        {},
        TimesOfEvents(times, np.linspace(0.0, 2.0, 5)),
        points=points,
        unlike=True,
    )


SCALES = Scale(parameter="s"), Scale(parameter="scatter")
SIZES = {"s": 0.1, "scatter": 0.05}
STATED = 0.01 * np.exp(-np.abs(X[:, None] - X) / 0.5) + 0.002 * np.eye(N)
BOTH = {"fraction": 0.1, "log_width": 2.0}


def in_bands() -> Case:
    """The same with an inferred size alone, as a run of many frames has it: by bands, never the
    whole matrix.
    """
    inner = differences()
    base = replace(inner.noise, scatter=Scale())
    brute = Normally(inner.brute.mean, lambda named: inner.brute.cov({**named, "scatter": 0.0}))
    return Case(Banded(base), {"s": 0.01}, brute)


@dataclass(frozen=True, eq=False)
class Banded(Stated):
    """Noise whose covariance is known in bands."""

    def likelihood(self, points: Points, named: Named) -> GaussianErrors:
        shift = points.y - self.base.likelihood(points, named).y
        return GaussianErrors.in_bands(
            points, self.size, covariance_in_bands(self.base.of_positions(points, named)), shift
        )

    def for_search(self) -> Banded:
        return self


CASES = {
    "independent": Case(
        Independent(*SCALES, RELATIVE),
        SIZES,
        Normally(line, lambda named: np.diag(spread(named) ** 2)),
    ),
    "independent, Student-t": Case(
        Independent(*SCALES, RELATIVE, tails=StudentT()),
        SIZES,
        one_by_one(line, spread, student),
        outliers=True,
    ),
    "independent, mixture": Case(
        Independent(*SCALES, RELATIVE, tails=OutlierMixture("fraction", "log_width")),
        SIZES | BOTH,
        one_by_one(line, spread, mixture),
        outliers=True,
    ),
    "independent, a law of a package": Case(
        Independent(
            *SCALES,
            RELATIVE,
            tails=InstalledTails("logistic", stats.logistic(scale=np.sqrt(3.0) / np.pi)),
        ),
        SIZES,
        one_by_one(line, spread, logistic),
        outliers=True,
        told_apart=False,
    ),
    "positions": Case(
        Independent(Scale(0.05), Scale(), np.ones(N), encoder_step=0.2),
        {},
        Normally(line, lambda named: (0.05**2 + 0.2**2 / 12.0) * np.eye(N)),
    ),
    "differentiated": differences(),
    "differentiated, motion blur": differences(np.linspace(1.0, 3.0, N + 2)),
    "differentiated, in bands": in_bands(),
    "stated covariance": Case(Correlated(STATED), {}, Normally(line, lambda named: STATED)),
    "unmodelled force": lacking(),
    "Poisson counts": counts(),
    "binomial fractions": fractions(),
    "event times": events(),
    "a share of the curve": Case(
        Readings(Scale(1.0), SCALES[1], 0.1 * Y, share=0.1),
        {"scatter": 0.05},
        one_by_one(line, of_curve, lambda named: (stats.norm.pdf, stats.norm.cdf), reach=5.5),
        of_curve=True,
    ),
    "another error above than below": Case(
        Readings(
            Scale(0.1 * np.sqrt(2.0)),
            Scale(),
            np.sqrt(RELATIVE * RELATIVE[::-1]),
            tails=TwoPiece(skew=np.sqrt(2.0 * RELATIVE[::-1] / RELATIVE)),
        ),
        {},
        TwoSides(0.1 * RELATIVE, 0.2 * RELATIVE[::-1]),
        points=replace(POINTS, y=Y + 0.01),  # none at the bend
        lopsided=True,
    ),
    "errors of x": Case(
        Readings(Scale(0.1), Scale(), np.ones(N), sigma_x=Scale(0.2)),
        {},
        along_the_line(0.2, 0.1),
        smeared(0.2, 0.1, lambda named: (stats.norm.pdf, stats.norm.cdf)),
        within=3e-3,
    ),
    "errors of x, mixture": Case(
        Independent(
            Scale(0.1),
            Scale(),
            np.ones(N),
            sigma_x=Scale(0.015),
            tails=OutlierMixture("fraction", "log_width"),
        ),
        BOTH,
        smeared(0.015, 0.1, mixture),
        smeared(0.015, 0.1, mixture),
        within=3e-3,
        outliers=True,
    ),
}
