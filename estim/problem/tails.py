"""The shape of the errors beyond their standard deviation: normal, or with room for bad frames.

Which to choose:

- `Gaussian`: every frame is as good as its sigma says.
- `StudentT`: heavy tails, 4 degrees of freedom, sigma is the scale of the core.  Bad frames lose
  their weight smoothly; no further unknowns.  For a few mild outliers.
- `OutlierMixture`: a frame is good, or (with probability `fraction`) an outlier whose sigma is
  `width` times larger; both are inferred (Hogg, Bovy & Lang 2010, arXiv 1008.4686, eq. 17, with
  the outliers centred on the curve).  For gross outliers, dropouts, a tail of the run that is
  another motion; it names the bad frames.
- `TwoPiece`: another stated error above than below, as in 1.0 (+0.3, -0.2).

Each works on standardised residuals z = (y - f)/sd, point by point.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from estim.arrays import FloatArray, Named, finite_or
from estim.common import phrase
from estim.distributions import (
    normal_log_density,
    normal_quantile,
    normal_tail,
    student_log_density,
    student_tail,
)

NEAR = 1e-4  # of 0: there a density differs from its highest by rounding errors
_SIDE = np.append(np.linspace(0.0, 8.0, 400), np.geomspace(8.05, 1e6, 400))
_GRID = np.append(-_SIDE[:0:-1], _SIDE)


class Tails(ABC):
    """A density of z; `values` holds parameters as scalars or (n_draw, 1), results are shaped like
    z.

    robust : whether it leaves room for outliers.
    skew : (n_obs,) by how much points may lie farther below the curve than above, None: no more.
    """

    robust: ClassVar[bool] = True
    skew: Any = None

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of its own unknowns."""
        return ()

    @abstractmethod
    def log_density(self, z: FloatArray, values: Named) -> FloatArray:
        """Normalised log density."""

    @abstractmethod
    def score(self, z: FloatArray, values: Named) -> FloatArray:
        """Minus the derivative of the log density."""

    @abstractmethod
    def tail(self, z: FloatArray, values: Named) -> FloatArray:
        """Probability of what lies farther from 0 than z."""

    def deviance_residual(self, z: FloatArray, values: Named) -> tuple[FloatArray, FloatArray]:
        """r(z) with r^2/2 = log p(0) - log p(z), signed as z, and dr/dz = score/r: what least
        squares minimises.
        """
        near = np.where(np.abs(z) < NEAR, NEAR, z)  # where the slope is taken
        top = self.log_density(np.zeros_like(z), values)
        root, root_near = (
            np.sqrt(np.maximum(2.0 * (top - self.log_density(at, values)), 0.0)) for at in (z, near)
        )
        return np.sign(z) * root, np.sign(near) * self.score(near, values) / root_near

    def information(self, values: Named) -> tuple[float, float]:
        """Fisher information of one z about its location and about the logarithm of its scale (1
        and 2 if normal).
        """
        with np.errstate(all="ignore"):  # far out a density may be 0
            density, score = np.exp(self.log_density(_GRID, values)), self.score(_GRID, values)
            squares = np.square([score, score * _GRID - 1.0]) * density
        # by the trapezoid rule
        location, scale = finite_or(squares, 0.0) @ np.gradient(_GRID)
        return float(location), float(scale)

    def outlier_probability(self, z: FloatArray, values: Named) -> FloatArray:
        """Probability that this frame is an outlier, given z."""
        return np.zeros_like(z)

    def outlier_share(self, values: Named) -> float:
        """The share of outliers where that is one of its own unknowns, otherwise nan."""
        return math.nan

    def normal_score(self, z: FloatArray, values: Named) -> FloatArray:
        """z mapped to a standard normal variable through its distribution function."""
        tail = np.maximum(self.tail(z, values), 1e-300)
        return np.where(z < 0.0, 1.0, -1.0) * normal_quantile(tail)

    @abstractmethod
    def draw(self, rng: np.random.Generator, size: int, values: Named) -> FloatArray:
        """(size,) random z."""

    @abstractmethod
    def describe(self) -> str:
        """A few words, "" if normal."""


@dataclass(frozen=True)
class Gaussian(Tails):
    """Normal errors; unused : unknowns of other tails, in whose place they stand."""

    robust = False
    unused: tuple[str, ...] = ()

    @property
    def parameters(self) -> tuple[str, ...]:
        return self.unused

    def log_density(self, z: FloatArray, values: Named) -> FloatArray:
        return normal_log_density(z)

    def score(self, z: FloatArray, values: Named) -> FloatArray:
        return z

    def tail(self, z: FloatArray, values: Named) -> FloatArray:
        return normal_tail(np.abs(z))

    def deviance_residual(self, z: FloatArray, values: Named) -> tuple[FloatArray, FloatArray]:
        return z, np.ones_like(z)

    def information(self, values: Named) -> tuple[float, float]:
        return 1.0, 2.0

    def normal_score(self, z: FloatArray, values: Named) -> FloatArray:
        return z

    def draw(self, rng: np.random.Generator, size: int, values: Named) -> FloatArray:
        return rng.standard_normal(size)

    def describe(self) -> str:
        return ""


@dataclass(frozen=True, eq=False)
class TwoPiece(Gaussian):
    """Normal on either side and of one height at 0, `skew` (n_obs,) times as wide below and 1/skew
    times above: of a reading with the errors `minus` and `plus`, skew^2 = plus/minus, where z are
    counted in sqrt(minus plus), for which one normal error would carry as much information.

    The truth may lie `plus` above a reading and `minus` below it: there the log likelihood is lower
    by 1/2, in two half parabolas (Barlow, arXiv:physics/0406120).  As a density it is the two-piece
    normal (Wallis, Statist. Sci. 29 (2014) 106), and (y - f)^2 over the square of the error on its
    side is chi-squared.  Its mode is the curve; the mean of y is not.
    """

    skew: Any = 1.0

    def _side(self, z: FloatArray) -> FloatArray:
        return np.where(z < 0.0, self.skew, 1.0 / self.skew)

    def log_density(self, z: FloatArray, values: Named) -> FloatArray:
        height = np.log(2.0 / (self.skew + 1.0 / self.skew))
        return normal_log_density(z / self._side(z)) + height

    def deviance_residual(self, z: FloatArray, values: Named) -> tuple[FloatArray, FloatArray]:
        side = self._side(z)
        return z / side, 1.0 / side

    def tail(self, z: FloatArray, values: Named) -> FloatArray:
        side = self._side(z)
        return 2.0 * side / (self.skew + 1.0 / self.skew) * normal_tail(np.abs(z / side))

    normal_score = Tails.normal_score

    def draw(self, rng: np.random.Generator, size: int, values: Named) -> FloatArray:
        """Of the points that the errors are stated for."""
        square = np.square(self.skew)
        below = rng.random(size) < square / (1.0 + square)
        return np.where(below, -self.skew, 1.0 / self.skew) * np.abs(rng.standard_normal(size))

    def describe(self) -> str:
        return phrase("another standard deviation above than below")


@dataclass(frozen=True)
class StudentT(Tails):
    """Student's t with `nu` degrees of freedom; sigma is its scale, its standard deviation
    sqrt(nu/(nu-2)) larger.
    """

    nu: float = 4.0

    def log_density(self, z: FloatArray, values: Named) -> FloatArray:
        return student_log_density(z, self.nu)

    def score(self, z: FloatArray, values: Named) -> FloatArray:
        return (self.nu + 1.0) * z / (self.nu + z**2)

    def tail(self, z: FloatArray, values: Named) -> FloatArray:
        return student_tail(np.abs(z), self.nu)

    def outlier_probability(self, z: FloatArray, values: Named) -> FloatArray:
        """t is a normal whose precision follows a Gamma law: probability that this frame's own sd
        is above 3 sigma.
        """
        from scipy.special import gammainc

        # a Student-t frame counts as an outlier where its own sd is more than three sigmas
        return gammainc(0.5 * (self.nu + 1.0), 0.5 * (self.nu + z**2) / 3.0**2)

    def draw(self, rng: np.random.Generator, size: int, values: Named) -> FloatArray:
        return rng.standard_t(self.nu, size)

    def describe(self) -> str:
        return phrase(
            "Student-t tails ({nu:g} degrees of freedom, σ is the scale of the core)", nu=self.nu
        )


@dataclass(frozen=True)
class OutlierMixture(Tails):
    """(1 - fraction) normal + fraction normal of exp(log_width) times the standard deviation; both
    names of parameters.
    """

    fraction: str
    log_width: str

    @property
    def parameters(self) -> tuple[str, ...]:
        return (self.fraction, self.log_width)

    def _parts(self, z: FloatArray, values: Named) -> tuple[FloatArray, FloatArray, FloatArray]:
        """log of the good part, log of the bad part, width; shaped like z."""
        fraction, width = values[self.fraction], np.exp(values[self.log_width])
        with np.errstate(divide="ignore"):
            good = np.log1p(-fraction) + normal_log_density(z)
            bad = np.log(fraction) - np.log(width) + normal_log_density(z / width)
        return good, bad, width

    def log_density(self, z: FloatArray, values: Named) -> FloatArray:
        good, bad, _ = self._parts(z, values)
        return np.logaddexp(good, bad)

    def score(self, z: FloatArray, values: Named) -> FloatArray:
        good, bad, width = self._parts(z, values)
        share = np.exp(bad - np.logaddexp(good, bad))
        return z * (1.0 - share + share / width**2)

    def outlier_probability(self, z: FloatArray, values: Named) -> FloatArray:
        good, bad, _ = self._parts(z, values)
        return np.exp(bad - np.logaddexp(good, bad))

    def outlier_share(self, values: Named) -> float:
        return float(np.squeeze(values[self.fraction]))

    def tail(self, z: FloatArray, values: Named) -> FloatArray:
        fraction, width = values[self.fraction], np.exp(values[self.log_width])
        return (1.0 - fraction) * normal_tail(np.abs(z)) + fraction * normal_tail(np.abs(z) / width)

    def draw(self, rng: np.random.Generator, size: int, values: Named) -> FloatArray:
        bad = rng.random(size) < np.ravel(values[self.fraction])
        return rng.standard_normal(size) * np.where(
            bad, np.exp(np.ravel(values[self.log_width])), 1.0
        )

    def describe(self) -> str:
        return phrase(
            "some readings ({fraction}) may be outliers, exp({width}) times less precise",
            fraction=self.fraction,
            width=self.log_width,
        )


def score_information(tails: Tails, values: Named, ends: tuple[Named, Named, float]) -> float:
    """Mean square, over errors drawn from the tails themselves at `values`, of the score in one of
    their parameters.

    ends : values below and above in that parameter, and their distance.
    """
    z = tails.draw(np.random.default_rng(0), 20_000, values)
    below, above, distance = ends
    score = (tails.log_density(z, above) - tails.log_density(z, below)) / distance
    return float(np.mean(score**2))


GAUSSIAN = Gaussian()
