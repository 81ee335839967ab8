"""Prior distributions of one parameter, and of several with a joint one.

Which to choose:
- `Normal`: a measured value with its standard uncertainty (what "0.187(10)" in a campaign means).
- `TruncatedNormal`: the same where part of the line is impossible (a mass ratio below zero).
- `Uniform`: nothing known but a range; the edges are hard, and a posterior that leans on one says
  so.
- `HalfNormal`: small and not negative (rolling resistance, extra scatter); `scale` is where you
  would be surprised.
- `LogNormal`: positive, known to a factor.
- `Beta`: between two limits, with one peak and nothing left at either of them (a share, a
  coefficient of restitution).
- `Flat`: nothing known, limits or none.
- `JointNormal`: several measured values that are correlated, one for each.

A prior enters least squares as one residual whose half square is minus its log density up to a
constant, exactly; where that is no square, as the signed root of what the density has lost since
its mode.

Everything that a prior must provide is a member of `Prior`.  A new one is a class here with its
entry in `PRIORS`, and a case of `tests/test_priors.py`; nothing else depends on which prior it has.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from dataclasses import field as field_of
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import InputError, Label, Quantity, format_quantity, phrase, with_unit
from estim.distributions import normal_below, normal_log_density, normal_quantile, normal_tail

# standard deviations beyond which a normal distribution has no probability that a number could show
_FAR = 8.0
# of the way from the mode to a limit of a beta distribution, short of the limit, where its residual
# stays finite
_ALMOST = 1e-15
_TINY = 1e-300  # in place of 0 under a logarithm
_MOST_LOG_SD = 10.0  # beyond some 18 the standard deviation is no number any more


class Prior(ABC):
    """What a prior provides; values in the parameter's unit, any shape in, the same shape out.

    keys : of its table in a file, in the order of its arguments.
    optional : more of them, named as its arguments.
    measured : whether it stands for a measurement; the others for a range or a size.
    informative : whether it pulls on a fit; a uniform one only bounds it.
    assumed : whether nobody stated it.
    """

    keys: ClassVar[tuple[str, ...]] = ()
    optional: ClassVar[tuple[str, ...]] = ()
    measured: ClassVar[bool] = False
    informative: ClassVar[bool] = True
    assumed: ClassVar[bool] = False

    if TYPE_CHECKING:  # fields or properties

        @property
        def low(self) -> float:
            """Lower end of the support (may be -inf)."""

        @property
        def high(self) -> float:
            """Upper end of the support (may be inf)."""

        @property
        def expectation(self) -> float:
            """Mean of the prior, its cuts included."""

        @property
        def sd(self) -> float:
            """Standard deviation of the prior; inf where it is improper."""

    @property
    def centre(self) -> float:
        """A typical value inside the support, where a fit may start; of a measured prior the value
        that was stated.
        """
        return self.expectation

    @property
    def start_stated(self) -> bool:
        """Whether a person stated the place where a fit starts, rather than a search of the
        points.
        """
        return True

    @abstractmethod
    def log_density(self, value: ArrayLike) -> FloatArray:
        """Normalised log density, -inf outside the support."""

    @abstractmethod
    def residual(self, value: ArrayLike) -> FloatArray:
        """r with -log density = r^2/2 + constant inside the support; 0 for a uniform prior."""

    @abstractmethod
    def residual_slope(self, value: ArrayLike) -> FloatArray:
        """dr/dvalue."""

    @abstractmethod
    def quantile(self, probability: ArrayLike) -> FloatArray:
        """Values below which the prior has a probability."""

    @abstractmethod
    def describe(self, unit: str = "1") -> str:
        """A few words for a table of inputs, numbers with their `unit`."""

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        """`size` independent draws."""
        return self.quantile(rng.random(size))

    def stated_words(self, unit: str, shown: Label) -> str:
        """What was stated before, of a parameter with this `unit` that is `shown` so: '(3.7 ±
        0.4)°', 'uniform in [0, 1]', or "" for nothing.
        """
        return "" if self.assumed or math.isinf(self.sd) else self.describe(unit)

    def pull(self, value: ArrayLike) -> FloatArray:
        """`residual`, counted from the stated value where that is not the mode."""
        return self.residual(value)

    def cut_below(self, limit: float) -> Prior:
        """The prior of a quantity that cannot be below `limit`, where all that was stated is a
        measured value.
        """
        return self

    def widened(self, factor: float) -> Prior:
        """A prior `factor` times as wide about the same place; itself where a width has no such
        meaning (a range).
        """
        return self

    def measured_again(self, truth: float, z: float) -> Prior:
        """What another measurement of `truth`, z standard deviations off, would have given; itself
        where it stands for none.

        Raises InputError where that is so far beyond a limit that nothing is left of the prior.
        """
        return self


def _positive(value: float, name: str) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError("must be > 0 and finite", field=name, value=value)


def _finite(mean: float) -> None:
    if not math.isfinite(mean):
        raise InputError("must be finite", field="mean", value=mean)


def _ordered(prior: Prior) -> None:
    if not prior.low < prior.high:
        raise InputError("must be below 'high'", field="low", value=prior.low)


def _in_unit(words: str, unit: str) -> str:
    return words if unit == "1" else f"{words} {unit}"


class _CutNormal(Prior):
    """Normal with `mean` and standard deviation `scale`, of whose probability `mass` lies between
    `low` and `high`.
    """

    if TYPE_CHECKING:

        @property
        def mean(self) -> float: ...

        @property
        def scale(self) -> float: ...

        @property
        def mass(self) -> float: ...

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value)
        z = (value - self.mean) / self.scale
        log_p = normal_log_density(z) - math.log(self.scale * self.mass)
        return np.where((value >= self.low) & (value <= self.high), log_p, -np.inf)

    def residual(self, value: ArrayLike) -> FloatArray:
        return (np.asarray(value) - self.mean) / self.scale

    def residual_slope(self, value: ArrayLike) -> FloatArray:
        return np.full(np.shape(value), 1.0 / self.scale)

    def quantile(self, probability: ArrayLike) -> FloatArray:
        start, part = (self.low - self.mean) / self.scale, np.asarray(probability) * self.mass
        z = (
            normal_quantile(normal_below(start) + part)
            if start < 0.0
            else -normal_quantile(normal_tail(start) - part)
        )
        return np.clip(self.mean + self.scale * z, self.low, self.high)


@dataclass(frozen=True)
class Normal(_CutNormal):
    """Normal with mean and standard deviation; `low` may be a limit far (8 sd or more) below the
    mean, impossible beyond.
    """

    mean: float
    sd: float
    low: float = -math.inf
    high: float = math.inf

    keys = ("mean", "sd")
    measured = True
    mass = 1.0

    def __post_init__(self) -> None:
        _finite(self.mean)
        _positive(self.sd, "sd")
        for field, distance in (("low", self.mean - self.low), ("high", self.high - self.mean)):
            if not distance >= _FAR * self.sd:
                raise InputError(
                    f"must be {_FAR:.0f} standard deviations or more from the mean: a nearer "
                    "limit makes it a TruncatedNormal",
                    field=field,
                    value=getattr(self, field),
                )

    @property
    def scale(self) -> float:
        return self.sd

    @property
    def expectation(self) -> float:
        return self.mean

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        return self.mean + self.sd * rng.standard_normal(size)

    def describe(self, unit: str = "1") -> str:
        return phrase("normal")

    def stated_words(self, unit: str, shown: Label) -> str:
        return with_unit(
            format_quantity(self.mean * shown.factor, self.sd * shown.factor), shown.unit
        )

    def cut_below(self, limit: float) -> Prior:
        return as_prior(Quantity(self.mean, self.sd), low=limit)

    def widened(self, factor: float) -> Prior:
        bounded = math.isfinite(self.low) or math.isfinite(self.high)
        return (
            TruncatedNormal(self.mean, factor * self.sd, self.low, self.high)
            if bounded
            else Normal(self.mean, factor * self.sd)
        )

    def measured_again(self, truth: float, z: float) -> Prior:
        return as_prior(Quantity(truth + self.sd * z, self.sd), low=self.low)


@dataclass(frozen=True, kw_only=True)
class JointNormal(Normal):
    """Normal, that of one of several parameters with a joint normal distribution.

    correlation : (n, n) matrix of these, one object that all of them have; place : index of this
        one in it.  `Problem` says how they go together, of those that are left where some are held.
         What is made of one of them (`widened`) stands by itself.
    """

    correlation: FloatArray = field_of(compare=False)
    place: int

    def describe(self, unit: str = "1") -> str:
        words = phrase(
            "normal, {mean:.4g} ± {sd:.4g}, correlated with others", mean=self.mean, sd=self.sd
        )
        return _in_unit(words, unit)


@dataclass(frozen=True)
class DefaultError(Normal):
    """Normal about 0 with the size that such an error usually has, where nobody stated it."""

    assumed = True

    def describe(self, unit: str = "1") -> str:
        return phrase("{value} (default)", value=format_quantity(self.mean, self.sd))

    def stated_words(self, unit: str, shown: Label) -> str:
        return ""


@dataclass(frozen=True)
class TruncatedNormal(_CutNormal):
    """Normal with mean and standard deviation `scale` before it is cut to [low, high]."""

    mean: float
    scale: float
    low: float = -math.inf
    high: float = math.inf

    keys, optional = ("mean", "sd"), ("low", "high")
    measured = True

    def __post_init__(self) -> None:
        _finite(self.mean)
        _positive(self.scale, "sd")
        _ordered(self)
        if not self.mass > 1e-12:
            raise InputError(
                "must leave some of the normal distribution between 'low' and 'high'",
                field="mean",
                value=self.mean,
            )

    @cached_property
    def _ends(self) -> FloatArray:
        """(2,) in standard deviations from the mean."""
        return (np.array([self.low, self.high]) - self.mean) / self.scale

    @cached_property
    def mass(self) -> float:
        a, b = self._ends
        return (
            float(normal_below(b) - normal_below(a))
            if a < 0
            else float(normal_tail(a) - normal_tail(b))
        )

    @cached_property
    def _moments(self) -> tuple[float, float]:
        """Mean m = h_a - h_b and variance 1 + (a - m) h_a - (b - m) h_b in standard deviations from
        `mean`; h : density at an end over the mass.
        """
        heights = np.exp(normal_log_density(self._ends)) / self.mass
        mean = float(heights[0] - heights[1])
        a, b = np.where(heights > 0.0, self._ends - mean, 0.0) * heights
        return mean, float(1.0 + a - b)

    @property
    def centre(self) -> float:
        inside = min(max(self.mean, self.low), self.high)
        return inside if self.low < inside < self.high else self.expectation

    @property
    def expectation(self) -> float:
        return self.mean + self.scale * self._moments[0]

    @property
    def sd(self) -> float:
        return self.scale * math.sqrt(self._moments[1])

    def describe(self, unit: str = "1") -> str:
        numbers = {"mean": self.mean, "scale": self.scale, "low": self.low, "high": self.high}
        if math.isinf(self.high):
            return _in_unit(
                phrase("normal, {mean:.4g} ± {scale:.4g}, truncated below {low:.4g}", **numbers),
                unit,
            )
        if math.isinf(self.low):
            return _in_unit(
                phrase("normal, {mean:.4g} ± {scale:.4g}, truncated above {high:.4g}", **numbers),
                unit,
            )
        return _in_unit(
            phrase(
                "normal, {mean:.4g} ± {scale:.4g}, truncated to [{low:.4g}, {high:.4g}]", **numbers
            ),
            unit,
        )

    def widened(self, factor: float) -> Prior:
        return replace(self, scale=factor * self.scale)

    def measured_again(self, truth: float, z: float) -> Prior:
        return replace(self, mean=truth + self.scale * z)


@dataclass(frozen=True)
class HalfNormal(_CutNormal):
    """Normal of mean 0 and standard deviation `scale`, folded to values >= 0."""

    scale: float

    keys = ("scale",)
    mean, mass, low, high = 0.0, 0.5, 0.0, math.inf

    def __post_init__(self) -> None:
        _positive(self.scale, "scale")

    @property
    def centre(self) -> float:
        return 0.67448975 * self.scale  # the median

    @property
    def expectation(self) -> float:
        return self.scale * math.sqrt(2.0 / math.pi)

    @property
    def sd(self) -> float:
        return self.scale * math.sqrt(1.0 - 2.0 / math.pi)

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        return self.scale * np.abs(rng.standard_normal(size))

    def describe(self, unit: str = "1") -> str:
        return _in_unit(phrase("half-normal, scale {scale:.4g}", scale=self.scale), unit)

    def widened(self, factor: float) -> Prior:
        return HalfNormal(factor * self.scale)


@dataclass(frozen=True)
class Uniform(Prior):
    """Constant density between low and high."""

    low: float
    high: float

    keys = ("low", "high")
    informative = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high)):
            raise InputError(
                "must be finite for a uniform prior", field="low, high", value=(self.low, self.high)
            )
        _ordered(self)

    @property
    def expectation(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def sd(self) -> float:
        return (self.high - self.low) / math.sqrt(12.0)

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value)
        return np.where(
            (value >= self.low) & (value <= self.high), -math.log(self.high - self.low), -np.inf
        )

    def residual(self, value: ArrayLike) -> FloatArray:
        return np.zeros(np.shape(value))

    def residual_slope(self, value: ArrayLike) -> FloatArray:
        return np.zeros(np.shape(value))

    def quantile(self, probability: ArrayLike) -> FloatArray:
        return self.low + (self.high - self.low) * np.asarray(probability)

    def describe(self, unit: str = "1") -> str:
        return _in_unit(
            phrase("uniform in [{low:.4g}, {high:.4g}]", low=self.low, high=self.high), unit
        )


class _Default(Prior):
    """A prior that is taken where nobody stated another."""

    assumed = True

    def describe(self, unit: str = "1") -> str:
        return phrase("{value} (default)", value=super().describe(unit))  # type: ignore[safe-super]


@dataclass(frozen=True)
class DefaultNormal(_Default, TruncatedNormal):
    """A truncated normal distribution that nobody stated."""


@dataclass(frozen=True)
class DefaultUniform(_Default, Uniform):
    """A range that nobody stated."""


@dataclass(frozen=True)
class Flat(Uniform):
    """Constant density between low and high, which may be infinite; a fit begins at `start`.

    Where a limit is infinite the prior is improper: data make the posterior proper, but nothing can
    be drawn from the prior and the evidence (and so a Bayes factor) is not defined.  Its log
    density is 0.
    """

    start: float = 0.0
    start_stated: bool = True

    def __post_init__(self) -> None:
        for field, limit in (("low", self.low), ("high", self.high)):
            if math.isnan(limit):
                raise InputError("must be a number", field=field, value=limit)
        _ordered(self)
        if not math.isfinite(self.start):
            raise InputError("must be finite", field="start", value=self.start)
        if not (self.low <= self.start <= self.high):
            raise InputError(
                f"must lie within [{self.low:.6g}, {self.high:.6g}]",
                field="start",
                value=self.start,
            )

    @property
    def proper(self) -> bool:
        """Whether it is a probability density: both limits are finite."""
        return math.isfinite(self.high - self.low)

    @property
    def centre(self) -> float:
        return self.start

    @property
    def expectation(self) -> float:
        return super().expectation if self.proper else math.nan

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value)
        return (
            super().log_density(value)
            if self.proper
            else np.where((value >= self.low) & (value <= self.high), 0.0, -np.inf)
        )

    def quantile(self, probability: ArrayLike) -> FloatArray:
        if not self.proper:
            raise InputError(
                "has a flat prior without limits: nothing can be drawn from it", field="prior"
            )
        return super().quantile(probability)

    def describe(self, unit: str = "1") -> str:
        if self.proper:
            return super().describe(unit)
        if math.isfinite(self.low):
            return _in_unit(phrase("flat above {low:.4g}", low=self.low), unit)
        return (
            _in_unit(phrase("flat below {high:.4g}", high=self.high), unit)
            if math.isfinite(self.high)
            else phrase("flat, no limits")
        )


@dataclass(frozen=True)
class LogNormal(Prior):
    """ln(value/median) normal with standard deviation `log_sd` (0.1 is about 10 %)."""

    median: float
    log_sd: float

    keys = ("median", "log_sd")
    measured = True
    low, high = 0.0, math.inf

    def __post_init__(self) -> None:
        _positive(self.median, "median")
        _positive(self.log_sd, "log_sd")
        if self.log_sd > _MOST_LOG_SD:
            raise InputError(
                f"must be at most {_MOST_LOG_SD:g} (a factor of {math.exp(_MOST_LOG_SD):.0e})",
                field="log_sd",
                value=self.log_sd,
            )

    @property
    def centre(self) -> float:
        return self.median

    @property
    def expectation(self) -> float:
        return self.median * math.exp(0.5 * self.log_sd**2)

    @property
    def sd(self) -> float:
        variance = self.log_sd**2
        return self.median * math.sqrt(math.expm1(variance) * math.exp(variance))

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value, dtype=float)
        log_p = normal_log_density(self.pull(value)) - np.log(
            np.maximum(value, _TINY) * self.log_sd
        )
        return np.where(value > 0.0, log_p, -np.inf)

    def pull(self, value: ArrayLike) -> FloatArray:
        return (np.log(np.maximum(value, _TINY)) - math.log(self.median)) / self.log_sd

    def residual(self, value: ArrayLike) -> FloatArray:
        # the factor 1/value of the density completes the square: the mode is at exp(mu - log_sd^2)
        return self.pull(value) + self.log_sd

    def residual_slope(self, value: ArrayLike) -> FloatArray:
        return 1.0 / (np.maximum(value, _TINY) * self.log_sd)

    def quantile(self, probability: ArrayLike) -> FloatArray:
        return self.median * np.exp(self.log_sd * normal_quantile(probability))

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        return self.median * np.exp(self.log_sd * rng.standard_normal(size))

    def describe(self, unit: str = "1") -> str:
        return phrase(
            "log-normal, median {median}, log sd {log_sd:.3g}",
            median=with_unit(f"{self.median:.4g}", unit),
            log_sd=self.log_sd,
        )

    def widened(self, factor: float) -> Prior:
        return replace(self, log_sd=min(factor * self.log_sd, _MOST_LOG_SD))

    def measured_again(self, truth: float, z: float) -> Prior:
        return replace(self, median=truth * math.exp(self.log_sd * z))


@dataclass(frozen=True)
class Unstated(LogNormal):
    """Log-normal about what the points themselves show, so wide that it hardly matters."""

    assumed = True

    def describe(self, unit: str = "1") -> str:
        median = with_unit(f"{self.median:.2g}", unit)
        return phrase(
            "inferred; weak prior, within a factor {factor:.0f} of {median}",
            factor=math.exp(self.log_sd),
            median=median,
        )


@dataclass(frozen=True)
class Beta(Prior):
    """Beta distribution between low and high with mean and standard deviation.

    In u = (value - low)/(high - low) the density is proportional to u^a (1 - u)^b, a and b > 0,
    largest at u = m = a/(a + b).  With h(z) = z - log(1 + z) its logarithm has lost a h((u - m)/m)
    + b h((m - u)/(1 - m)) at u, in which no digits cancel near the mode.
    """

    mean: float
    sd: float
    low: float = 0.0
    high: float = 1.0

    keys, optional = ("mean", "sd"), ("low", "high")

    def __post_init__(self) -> None:
        _finite(self.mean)
        _positive(self.sd, "sd")
        if not (math.isfinite(self.high - self.low) and self.low < self.high):
            raise InputError("must be below 'high', and both finite", field="low", value=self.low)
        if not self.low < self.mean < self.high:
            raise InputError("must lie between 'low' and 'high'", field="mean", value=self.mean)
        if not min(self._powers) > 0.0:
            raise InputError(
                "must be so small that the density has its peak between 'low' and 'high'",
                field="sd",
                value=self.sd,
            )

    @cached_property
    def _powers(self) -> tuple[float, float]:
        """a and b."""
        width = self.high - self.low
        share, sd = (self.mean - self.low) / width, self.sd / width
        total = share * (1.0 - share) / sd**2 - 1.0
        return share * total - 1.0, (1.0 - share) * total - 1.0

    @property
    def expectation(self) -> float:
        return self.mean

    def _from_mode(self, value: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """(u - m)/m and (m - u)/(1 - m), kept above -1."""
        a, b = self._powers
        deviation = (np.asarray(value) - self.low) / (self.high - self.low) - a / (a + b)
        return np.maximum(deviation * (a + b) / a, -1.0 + _ALMOST), np.maximum(
            -deviation * (a + b) / b, -1.0 + _ALMOST
        )

    def log_density(self, value: ArrayLike) -> FloatArray:
        a, b = self._powers
        norm = (
            math.lgamma(a + b + 2.0)
            - math.lgamma(a + 1.0)
            - math.lgamma(b + 1.0)
            - math.log(self.high - self.low)
        )
        top = norm + a * math.log(a / (a + b)) + b * math.log(b / (a + b))
        value = np.asarray(value)
        return np.where(
            (value > self.low) & (value < self.high), top - 0.5 * self.residual(value) ** 2, -np.inf
        )

    def residual(self, value: ArrayLike) -> FloatArray:
        (a, b), (up, down) = self._powers, self._from_mode(value)
        return np.sign(up) * np.sqrt(2.0 * (a * (up - np.log1p(up)) + b * (down - np.log1p(down))))

    def residual_slope(self, value: ArrayLike) -> FloatArray:
        (a, b), (up, down) = self._powers, self._from_mode(value)
        at_mode = math.sqrt((a + b) ** 3 / (a * b))
        residual, slope = self.residual(value), (a + b) * (up / (1.0 + up) - down / (1.0 + down))
        near = np.abs(residual) < 1e-7
        return np.where(near, at_mode, slope / np.where(near, 1.0, residual)) / (
            self.high - self.low
        )

    def quantile(self, probability: ArrayLike) -> FloatArray:
        from scipy.special import betaincinv

        a, b = self._powers
        return self.low + (self.high - self.low) * betaincinv(a + 1.0, b + 1.0, probability)

    def describe(self, unit: str = "1") -> str:
        words = phrase(
            "beta, {mean:.4g} ± {sd:.4g} in [{low:.4g}, {high:.4g}]",
            mean=self.mean,
            sd=self.sd,
            low=self.low,
            high=self.high,
        )
        return _in_unit(words, unit)


PRIORS: Mapping[str, type[Prior]] = {
    "normal": Normal,
    "uniform": Uniform,
    "half-normal": HalfNormal,
    "log-normal": LogNormal,
    "truncated-normal": TruncatedNormal,
    "beta": Beta,
}
"""The priors that a file may state, by the name of their kind."""


def _beta(a: float, b: float, loc: float, scale: float) -> Prior:
    sd = scale * math.sqrt(a * b / (a + b + 1.0)) / (a + b)
    return Beta(loc + scale * a / (a + b), sd, loc, loc + scale)


_FROM_ZERO: Mapping[str, Callable[..., Prior]] = {
    "halfnorm": lambda scale: HalfNormal(scale),
    "lognorm": lambda s, scale: LogNormal(scale, s),
}
_FROZEN: Mapping[str, Callable[..., Prior]] = {
    "norm": lambda loc, scale: Normal(loc, scale),
    "uniform": lambda loc, scale: Uniform(loc, loc + scale),
    "truncnorm": lambda a, b, loc, scale: TruncatedNormal(
        loc, scale, loc + a * scale, loc + b * scale
    ),
    "beta": _beta,
    **_FROM_ZERO,
}


def of_other_package(stated: Any, field: str) -> Any:
    """The prior that a frozen distribution of scipy.stats stands for, and the `Quantity` that a
    `ufloat` of uncertainties does; anything else as it is.

    Raises InputError naming `field` for a distribution that is none of the priors.
    """
    if hasattr(stated, "nominal_value") and hasattr(stated, "std_dev"):
        return Quantity(float(stated.nominal_value), float(stated.std_dev))
    name = getattr(getattr(stated, "dist", None), "name", None)
    if name is None:
        return stated
    order = [*filter(None, (stated.dist.shapes or "").split(", ")), "loc", "scale"]
    arguments = dict(zip(order, stated.args, strict=False)) | stated.kwds
    at = {key: float(value) for key, value in ({"loc": 0.0, "scale": 1.0} | arguments).items()}
    if name not in _FROZEN or (name in _FROM_ZERO and at.pop("loc") != 0.0):
        rule = f"must be one of {', '.join(_FROZEN)} ({' and '.join(_FROM_ZERO)} with loc = 0)"
        raise InputError(rule, field=field, value=f"scipy.stats.{name}")
    return _FROZEN[name](**at)


def centre_of(source: float | Prior) -> float:
    """An exact value, or the centre of a prior."""
    return source if isinstance(source, float) else source.centre


def as_prior(quantity: Quantity, *, low: float) -> Prior:
    """The prior that a measured value stands for: normal, impossible below the physical limit
    `low`.
    """
    near = quantity.value - low < _FAR * quantity.u
    return (
        TruncatedNormal(quantity.value, quantity.u, low, float("inf"))
        if near
        else Normal(quantity.value, quantity.u, low)
    )
