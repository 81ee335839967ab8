"""Prior distributions of one parameter.

Which to choose:
- `Normal`: a measured value with its standard uncertainty (what "0.187(10)" in a campaign means).
- `TruncatedNormal`: the same where part of the line is impossible (a mass ratio below zero).
- `Uniform`: nothing known but a range; the edges are hard, and a posterior that leans on one says so.
- `HalfNormal`: small and not negative (rolling resistance, extra scatter); `scale` is where you would be surprised.
- `LogNormal`: positive, known to a factor.

A prior enters least squares as one residual whose half square is minus its log density up to a constant, exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from estim.arrays import FloatArray
from estim.common import InputError, Quantity, phrase, with_unit
from estim.distributions import normal_below, normal_tail

_LOG_ROOT_2PI = 0.5 * math.log(2.0 * math.pi)
_FAR = 8.0  # standard deviations beyond which a normal distribution has no probability that a number could show
_MOST_LOG_SD = 10.0  # beyond some 18 the standard deviation is no number any more


@runtime_checkable
class Prior(Protocol):
    """What a prior can tell; values in the parameter's unit, any shape in, the same shape out."""

    @property
    def low(self) -> float:
        """Lower end of the support (may be -inf)."""

    @property
    def high(self) -> float:
        """Upper end of the support (may be inf)."""

    @property
    def centre(self) -> float:
        """A typical value inside the support, where a fit may start."""

    @property
    def expectation(self) -> float:
        """Mean of the prior, its cuts included."""

    @property
    def sd(self) -> float:
        """Standard deviation of the prior."""

    def log_density(self, value: ArrayLike) -> FloatArray:
        """Normalised log density, -inf outside the support."""

    def residual(self, value: float) -> float:
        """r with -log density = r^2/2 + constant inside the support; 0 for a uniform prior."""

    def residual_slope(self, value: float) -> float:
        """dr/dvalue."""

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        """`size` independent draws."""

    def describe(self) -> str:
        """A few words for a table of inputs."""


def _positive(value: float, name: str) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError("must be > 0 and finite", field=name, value=value)


def _finite(value: float, name: str) -> None:
    if not math.isfinite(value):
        raise InputError("must be finite", field=name, value=value)


@dataclass(frozen=True)
class Normal:
    """Normal with mean and standard deviation; `low` may be a limit far (8 sd or more) below the mean, impossible beyond."""

    mean: float
    sd: float
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        _finite(self.mean, "mean")
        _positive(self.sd, "sd")
        for field, distance in (("low", self.mean - self.low), ("high", self.high - self.mean)):
            if not distance >= _FAR * self.sd:
                rule = f"must be {_FAR:.0f} standard deviations or more from the mean: a nearer limit makes it a TruncatedNormal"
                raise InputError(rule, field=field, value=getattr(self, field))

    @property
    def centre(self) -> float:
        return self.mean

    @property
    def expectation(self) -> float:
        return self.mean

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value)
        log_p = -0.5 * ((value - self.mean) / self.sd) ** 2 - math.log(self.sd) - _LOG_ROOT_2PI
        return np.where((value >= self.low) & (value <= self.high), log_p, -np.inf)

    def residual(self, value: float) -> float:
        return (value - self.mean) / self.sd

    def residual_slope(self, value: float) -> float:
        return 1.0 / self.sd

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        return self.mean + self.sd * rng.standard_normal(size)

    def describe(self) -> str:
        return phrase("normal")


@lru_cache(maxsize=4096)
def _moments(prior: TruncatedNormal) -> tuple[float, float]:
    """Expectation and standard deviation, which SciPy takes half a millisecond for."""
    return float(prior.frozen().mean()), float(prior.frozen().std())


@dataclass(frozen=True)
class TruncatedNormal:
    """Normal with mean and standard deviation `scale` before it is cut to [low, high]."""

    mean: float
    scale: float
    low: float
    high: float

    def __post_init__(self) -> None:
        _finite(self.mean, "mean")
        _positive(self.scale, "sd")
        if not self.low < self.high:
            raise InputError("must be below 'high'", field="low", value=self.low)
        if not self._mass() > 1e-12:
            raise InputError("must leave some of the normal distribution between 'low' and 'high'", field="mean", value=self.mean)

    def _ends(self) -> tuple[float, float]:
        return (self.low - self.mean) / self.scale, (self.high - self.mean) / self.scale

    def _mass(self) -> float:
        a, b = self._ends()
        return float(normal_below(b) - normal_below(a)) if a < 0 else float(normal_tail(a) - normal_tail(b))

    @property
    def centre(self) -> float:
        inside = min(max(self.mean, self.low), self.high)
        return inside if self.low < inside < self.high else self.expectation

    @property
    def expectation(self) -> float:
        return _moments(self)[0]

    @property
    def sd(self) -> float:
        return _moments(self)[1]

    def frozen(self) -> Any:
        from scipy.stats import truncnorm

        return truncnorm(*self._ends(), loc=self.mean, scale=self.scale)

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value)
        inside = (value >= self.low) & (value <= self.high)
        log_p = -0.5 * ((value - self.mean) / self.scale) ** 2 - math.log(self.scale * self._mass()) - _LOG_ROOT_2PI
        return np.where(inside, log_p, -np.inf)

    def residual(self, value: float) -> float:
        return (value - self.mean) / self.scale

    def residual_slope(self, value: float) -> float:
        return 1.0 / self.scale

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        return np.asarray(self.frozen().rvs(size=size, random_state=rng))

    def describe(self) -> str:
        said = {"mean": self.mean, "scale": self.scale, "low": self.low, "high": self.high}
        if math.isinf(self.high):
            return phrase("normal, {mean:.4g} ± {scale:.4g}, cut below {low:.4g}", **said)
        if math.isinf(self.low):
            return phrase("normal, {mean:.4g} ± {scale:.4g}, cut above {high:.4g}", **said)
        return phrase("normal, {mean:.4g} ± {scale:.4g}, cut to [{low:.4g}, {high:.4g}]", **said)


@dataclass(frozen=True)
class Uniform:
    """Constant density between low and high."""

    low: float
    high: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high)):
            raise InputError("must be finite for a uniform prior", field="low, high", value=(self.low, self.high))
        if not self.low < self.high:
            raise InputError("must be below 'high'", field="low", value=self.low)

    @property
    def centre(self) -> float:
        return self.expectation

    @property
    def expectation(self) -> float:
        return 0.5 * (self.low + self.high)

    @property
    def sd(self) -> float:
        return (self.high - self.low) / math.sqrt(12.0)

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value)
        return np.where((value >= self.low) & (value <= self.high), -math.log(self.high - self.low), -np.inf)

    def residual(self, value: float) -> float:
        return 0.0

    def residual_slope(self, value: float) -> float:
        return 0.0

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        return rng.uniform(self.low, self.high, size)

    def describe(self) -> str:
        return phrase("uniform in [{low:.4g}, {high:.4g}]", low=self.low, high=self.high)


@dataclass(frozen=True)
class HalfNormal:
    """Normal of mean 0 and standard deviation `scale`, folded to values >= 0."""

    scale: float
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = math.inf

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

    def log_density(self, value: ArrayLike) -> FloatArray:
        value = np.asarray(value)
        log_p = math.log(2.0) - 0.5 * (value / self.scale) ** 2 - math.log(self.scale) - _LOG_ROOT_2PI
        return np.where(value >= 0.0, log_p, -np.inf)

    def residual(self, value: float) -> float:
        return value / self.scale

    def residual_slope(self, value: float) -> float:
        return 1.0 / self.scale

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        return self.scale * np.abs(rng.standard_normal(size))

    def describe(self) -> str:
        return phrase("half-normal, scale {scale:.4g}", scale=self.scale)


@dataclass(frozen=True)
class LogNormal:
    """ln(value/median) normal with standard deviation `log_sd` (0.1 is about 10 %)."""

    median: float
    log_sd: float
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = math.inf

    def __post_init__(self) -> None:
        _positive(self.median, "median")
        _positive(self.log_sd, "log_sd")
        if self.log_sd > _MOST_LOG_SD:
            raise InputError(f"must be at most {_MOST_LOG_SD:g} (a factor of {math.exp(_MOST_LOG_SD):.0e})", field="log_sd", value=self.log_sd)

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
        logarithm = np.log(np.where(value > 0.0, value, 1.0))
        log_p = -0.5 * ((logarithm - math.log(self.median)) / self.log_sd) ** 2 - logarithm - math.log(self.log_sd) - _LOG_ROOT_2PI
        return np.where(value > 0.0, log_p, -np.inf)

    def residual(self, value: float) -> float:
        # the factor 1/value of the density completes the square: the mode is at exp(mu - log_sd^2)
        return (math.log(max(value, 1e-300)) - math.log(self.median) + self.log_sd**2) / self.log_sd

    def residual_slope(self, value: float) -> float:
        return 1.0 / (max(value, 1e-300) * self.log_sd)

    def draw(self, rng: np.random.Generator, size: int) -> FloatArray:
        return self.median * np.exp(self.log_sd * rng.standard_normal(size))

    def describe(self, unit: str = "1") -> str:
        """In words; the median with its `unit`."""
        return phrase("log-normal, median {median}, log sd {log_sd:.3g}", median=with_unit(f"{self.median:.4g}", unit), log_sd=self.log_sd)


MEASURED = Normal | TruncatedNormal | LogNormal
"""Priors that stand for a measurement; the others for a range or a size."""


def as_prior(quantity: Quantity, *, low: float) -> Prior:
    """The prior that a measured value stands for: normal, impossible below the physical limit `low`."""
    near = quantity.value - low < _FAR * quantity.u
    return TruncatedNormal(quantity.value, quantity.u, low, float("inf")) if near else Normal(quantity.value, quantity.u, low)


def residuals_and_slopes(prior: Prior, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """`residual` and `residual_slope` of a prior at values (n,): linear in the value for every prior but the log-normal one."""
    if isinstance(prior, LogNormal):
        return np.array([prior.residual(v) for v in values]), np.array([prior.residual_slope(v) for v in values])
    centre = prior.centre
    slope = prior.residual_slope(centre)
    return prior.residual(centre) + slope * (values - centre), np.full(values.shape, slope)
