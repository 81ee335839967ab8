"""An inference problem: observations, curves, priors and noise, and the posterior density that follows from them.

`Problem` is what was measured and assumed.  `problem.linearised(values)` is the posterior with everything that depends
only weakly on the parameters (the slope of the curve inside the noise covariance, the truncation of the stencil) taken
at `values`; `estim.fitting` repeats this at its own result until nothing moves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.curve import Curve
from estim.noise import Noise, Whitening, variances
from estim.priors import Prior, Uniform

FloatArray = NDArray[np.float64]

_LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, eq=False)
class Parameter:
    """One unknown: `name` as in results ("gamma[heavy]"), `unit` ("1", "rad", "m", ...), prior, and what it is."""

    name: str
    unit: str
    prior: Prior
    meaning: str


@dataclass(frozen=True, eq=False)
class Observations:
    """The speeds of one run that are fit, with their curve and noise.

    x : (n_obs,) position.  y : (n_obs,) speed.  t : (n_obs,) s, or None where it is unknown.
    arguments : argument of the curve -> parameter name, or a fixed number.
    x_name, x_unit, y_name, y_unit : for axes and tables ("position x", "m").
    excluded : why and how many rows were left out, in words.
    excluded_points : (n, 2) the (x, y) of those rows that have a speed, for figures.
    origin : where the drawn curve begins (0: a motion from its release); None where it begins with the data.
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
    excluded: tuple[str, ...]
    excluded_points: FloatArray
    origin: float | None = 0.0

    @property
    def n_obs(self) -> int:
        return int(self.x.size)

    @property
    def x_label(self) -> str:
        return self.x_name if self.x_unit == "1" else f"{self.x_name} ({self.x_unit})"

    @property
    def y_label(self) -> str:
        return self.y_name if self.y_unit == "1" else f"{self.y_name} ({self.y_unit})"

    def bind(self, values: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
        """Arguments of the curve for parameter values (scalars or (n_draw, 1))."""
        return {a: values[source] if isinstance(source, str) else source for a, source in self.arguments.items()}


@dataclass(frozen=True, eq=False)
class Problem:
    """Parameters and the runs they explain."""

    parameters: tuple[Parameter, ...]
    runs: tuple[Observations, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    @property
    def n_par(self) -> int:
        return len(self.parameters)

    @property
    def n_obs(self) -> int:
        return sum(run.n_obs for run in self.runs)

    @property
    def noise_names(self) -> frozenset[str]:
        """Parameters of the noise: they enter the covariance, not the curve."""
        scales = [scale.parameter for run in self.runs for scale in (run.noise.sigma, run.noise.scatter)]
        return frozenset(name for name in scales if name is not None)

    def start(self) -> FloatArray:
        """(n_par,) the centres of the priors."""
        return np.array([p.prior.centre for p in self.parameters])

    def named(self, draws: FloatArray) -> dict[str, FloatArray]:
        """Parameter name -> column: (n_par,) gives scalars, (n_draw, n_par) gives (n_draw, 1)."""
        draws = np.asarray(draws)
        columns = draws.T[..., None] if draws.ndim == 2 else draws
        return dict(zip(self.names, columns, strict=True))

    def log_prior(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log density of the priors at draws (n_draw, n_par); -inf outside their support."""
        return np.sum([p.prior.log_density(draws[:, i]) for i, p in enumerate(self.parameters)], axis=0)

    def linearised(self, values: FloatArray) -> Posterior:
        """The posterior with noise covariance and truncation taken at `values` (n_par,)."""
        named = self.named(values)
        return Posterior(self, tuple(run.noise.whitening(run.curve, run.x, run.bind(named)) for run in self.runs))


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior density of a problem with its covariances diagonalised, one `Whitening` a run."""

    problem: Problem
    whitenings: tuple[Whitening, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return self.problem.names

    def log_density(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log posterior density, up to the evidence, at draws (n_draw, n_par); -inf outside the priors' support."""
        log_p = self.problem.log_prior(draws)
        inside = np.flatnonzero(np.isfinite(log_p))
        if inside.size:
            log_p[inside] += self.log_likelihood(draws[inside])
        return log_p

    def log_likelihood(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log likelihood, normalised, of draws (n_draw, n_par) inside the priors' support."""
        named = self.problem.named(draws)
        total = np.zeros(draws.shape[0])
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            variance = variances(run.noise, whitening, named)
            rotated = (run.y - whitening.offset - run.curve.value(run.x, run.bind(named))) @ whitening.basis
            total -= 0.5 * np.sum(rotated**2 / variance + np.log(variance) + _LOG_2PI, axis=1)
        return total

    def residuals(self, values: FloatArray) -> FloatArray:
        """(n_obs + n_par,) whitened residuals of all runs (in the eigenbasis), then one for each prior."""
        named = self.problem.named(values)
        parts = []
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            curve = np.broadcast_to(run.curve.value(run.x, run.bind(named)), (1, run.n_obs))[0]
            sd = np.sqrt(variances(run.noise, whitening, named))
            parts.append((run.y - whitening.offset - curve) @ whitening.basis / sd)
        return np.concatenate([*parts, self.prior_residuals(values)])

    def prior_residuals(self, values: FloatArray) -> FloatArray:
        """(n_par,) one residual for each prior; 0 for a uniform one."""
        return np.array([p.prior.residual(float(v)) for p, v in zip(self.problem.parameters, values, strict=True)])

    def jacobian(self, values: FloatArray) -> FloatArray:
        """(n_obs + n_par, n_par) derivatives of `residuals` at fixed noise parameters."""
        named = self.problem.named(values)
        blocks = []
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            sd = np.sqrt(variances(run.noise, whitening, named))
            gradient = self.curve_jacobian(run, values)
            blocks.append(-(whitening.basis.T @ gradient) / sd[:, None])
        slopes = [p.prior.residual_slope(float(v)) for p, v in zip(self.problem.parameters, values, strict=True)]
        return np.vstack([*blocks, np.diag(slopes)])

    def curve_jacobian(self, run: Observations, values: FloatArray) -> FloatArray:
        """(n_obs, n_par) derivatives of the run's curve in every parameter."""
        local = run.curve.local(run.x, run.bind(self.problem.named(values)))
        gradient = np.zeros((run.n_obs, self.problem.n_par))
        for argument, source in run.arguments.items():
            if isinstance(source, str):
                gradient[:, self.problem.names.index(source)] += np.broadcast_to(local.gradient[argument], (1, run.n_obs))[0]
        return gradient

    def noise_information(self, values: FloatArray) -> FloatArray:
        """(n_par, n_par) Fisher information of the noise parameters, (1/2) sum dV_a dV_b/V^2; zero for the others."""
        named, names = self.problem.named(values), self.problem.names
        information = np.zeros((len(names), len(names)))
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            variance = variances(run.noise, whitening, named)
            slopes = np.zeros((run.n_obs, len(names)))
            for scale, weight in ((run.noise.sigma, whitening.spectrum), (run.noise.scatter, np.ones(run.n_obs))):
                if scale.parameter is not None:
                    slopes[:, names.index(scale.parameter)] += 2.0 * float(named[scale.parameter]) * weight
            relative = slopes / variance[:, None]
            information += 0.5 * relative.T @ relative
        return information

    def log_density_noise_gradient(self, values: FloatArray) -> FloatArray:
        """(n_par,) derivative of the log likelihood in the noise parameters; zero for the others."""
        named, names = self.problem.named(values), self.problem.names
        gradient = np.zeros(len(names))
        squares = np.split(self.residuals(values)[: self.problem.n_obs] ** 2, np.cumsum([r.n_obs for r in self.problem.runs])[:-1])
        for run, whitening, square in zip(self.problem.runs, self.whitenings, squares, strict=True):
            variance = variances(run.noise, whitening, named)
            for scale, weight in ((run.noise.sigma, whitening.spectrum), (run.noise.scatter, np.ones(run.n_obs))):
                if scale.parameter is not None:
                    slope = 2.0 * float(named[scale.parameter]) * weight
                    gradient[names.index(scale.parameter)] += 0.5 * np.sum((square - 1.0) * slope / variance)
        return gradient


def informative(prior: Prior) -> bool:
    """Whether a prior pulls on the fit (a uniform one only bounds it)."""
    return not isinstance(prior, Uniform)
