"""An inference problem: observations, curves, priors and noise, and the posterior density that follows from them.

`Problem` is what was measured and assumed.  `problem.linearised(values)` is the posterior with everything that depends
only weakly on the parameters (the slope of the curve inside the noise covariance, the truncation of the stencil) taken
at `values`; `estim.fitting` repeats this at its own result until nothing moves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.curve import Curve
from estim.noise import Independent, Noise, Whitening, noise_parameters, variances
from estim.priors import Prior, Uniform

FloatArray = NDArray[np.float64]


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
        return frozenset(name for run in self.runs for name in noise_parameters(run.noise))

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


def n_uses(name: str, runs: Sequence[Observations]) -> int:
    """Number of `runs` whose curve has the parameter `name`."""
    return sum(name in run.arguments.values() for run in runs)


def shared_first(parameters: Iterable[Parameter], runs: Sequence[Observations]) -> tuple[Parameter, ...]:
    """`parameters` of a curve with those that several of `runs` share before those of one run, otherwise in their order."""
    return tuple(sorted(parameters, key=lambda p: n_uses(p.name, runs) < 2))


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
            likelihood = self.log_likelihood(draws[inside])
            # nan: a motion that cannot be followed to the last frame (it all but stops on the way) explains no data
            log_p[inside] = np.where(np.isnan(likelihood), -np.inf, log_p[inside] + likelihood)
        return log_p

    def log_likelihood(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log likelihood, normalised, of draws (n_draw, n_par) inside the priors' support."""
        named = self.problem.named(draws)
        total = np.zeros(draws.shape[0])
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            z, log_sd = self._standardised(run, whitening, named)
            total += np.sum(run.noise.tails.log_density(z, named) - log_sd, axis=1)
        return total

    def pointwise(self, draws: FloatArray) -> tuple[FloatArray, ...]:
        """For each run (n_draw, n_obs): log predictive density of every point given all the other points of its run.

        Where errors are independent this is the log likelihood of the point.  Where they are correlated it is the
        conditional density, normal with mean y_i - [C^-1 r]_i/[C^-1]_ii and variance 1/[C^-1]_ii (Buerkner, Gabry,
        Vehtari 2020, Comput. Stat. 36, 1243, eq. 8).
        """
        named = self.problem.named(draws)
        parts = []
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            z, log_sd = self._standardised(run, whitening, named)
            if whitening.basis is None:
                parts.append(run.noise.tails.log_density(z, named) - log_sd)
                continue
            precise = np.broadcast_to(np.exp(-2.0 * log_sd), z.shape)
            inverse = precise @ (whitening.basis**2).T  # diagonal of C^-1
            deviation = (z * np.sqrt(precise)) @ whitening.basis.T / np.sqrt(inverse)
            parts.append(run.noise.tails.log_density(deviation, named) + 0.5 * np.log(inverse))
        return tuple(parts)

    def standardised(self, values: FloatArray) -> tuple[FloatArray, ...]:
        """For each run, (n_obs,) residuals over their standard deviations at `values` (n_par,), in the whitening's basis."""
        return tuple(z[0] for z in self.standardised_draws(values[None, :]))

    def standardised_draws(self, draws: FloatArray) -> tuple[FloatArray, ...]:
        """For each run, (n_draw, n_obs) residuals over their standard deviations at draws (n_draw, n_par)."""
        named = self.problem.named(draws)
        pairs = zip(self.problem.runs, self.whitenings, strict=True)
        return tuple(self._standardised(run, whitening, named)[0] for run, whitening in pairs)

    def _standardised(self, run: Observations, whitening: Whitening, named: Mapping[str, ArrayLike]) -> tuple[FloatArray, FloatArray]:
        """z (n_draw, n_obs) and the logarithm of the standard deviation that normalises its density."""
        held = variances(run.noise, whitening, named)
        rotated = whitening.rotate(run.y - whitening.offset - run.curve.value(run.x, run.bind(named)))
        actual = held
        if isinstance(run.noise, Independent) and run.noise.sigma_x is not None:
            slope = run.noise.steepness(run.curve, run.x, run.bind(named))
            actual = held + np.square(run.noise.sigma_x.at(named)) * (slope**2 - whitening.steepness**2)
        return rotated / np.sqrt(actual), 0.5 * np.log(held)

    def residuals(self, values: FloatArray) -> FloatArray:
        """(n_obs + n_par,) residuals of all runs, then one for each prior: half their squares sum to minus the log density.

        Up to a constant, and for given noise parameters.  With normal errors they are the whitened residuals.
        """
        named = self.problem.named(values)
        pairs = zip(self.problem.runs, self.standardised(values), strict=True)
        parts = [run.noise.tails.deviance_residual(z, named)[0] for run, z in pairs]
        return np.concatenate([*parts, self.prior_residuals(values)])

    def prior_residuals(self, values: FloatArray) -> FloatArray:
        """(n_par,) one residual for each prior; 0 for a uniform one."""
        return np.array([p.prior.residual(float(v)) for p, v in zip(self.problem.parameters, values, strict=True)])

    def jacobian(self, values: FloatArray) -> FloatArray:
        """(n_obs + n_par, n_par) derivatives of `residuals` at fixed noise parameters."""
        named = self.problem.named(values)
        blocks = []
        for run, z, dz in zip(self.problem.runs, self.standardised(values), self.standardised_jacobians(values), strict=True):
            blocks.append(run.noise.tails.deviance_residual(z, named)[1][:, None] * dz)
        slopes = [p.prior.residual_slope(float(v)) for p, v in zip(self.problem.parameters, values, strict=True)]
        return np.vstack([*blocks, np.diag(slopes)])

    def standardised_jacobians(self, values: FloatArray) -> tuple[FloatArray, ...]:
        """For each run, (n_obs, n_par) derivatives of `standardised` at fixed noise parameters."""
        named = self.problem.named(values)
        jacobians = []
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            gradient = self.curve_jacobian(run, values)
            variance = variances(run.noise, whitening, named)
            if not isinstance(run.noise, Independent) or run.noise.sigma_x is None:
                jacobians.append(-whitening.rotate(gradient.T).T / np.sqrt(np.broadcast_to(variance, (1, run.n_obs))[0])[:, None])
                continue
            slope, bend = self._steepness_jacobian(run, run.noise, values)
            sigma = float(np.squeeze(run.noise.sigma_x.at(named)))
            sd = np.sqrt(np.broadcast_to(variance, (1, run.n_obs))[0] + sigma**2 * (slope**2 - whitening.steepness**2))[:, None]
            z = whitening.rotate(run.y - np.broadcast_to(run.curve.value(run.x, run.bind(named)), (1, run.n_obs))[0])[:, None] / sd
            jacobians.append(-gradient / sd - z * (sigma**2 * slope[:, None] * bend) / sd**2)
        return tuple(jacobians)

    def curve_jacobian(self, run: Observations, values: FloatArray) -> FloatArray:
        """(n_obs, n_par) derivatives of the run's curve in every parameter."""
        local = run.curve.local(run.x, run.bind(self.problem.named(values)))
        gradient = np.zeros((run.n_obs, self.problem.n_par))
        for argument, source in run.arguments.items():
            if isinstance(source, str):
                gradient[:, self.problem.names.index(source)] += np.broadcast_to(local.gradient[argument], (1, run.n_obs))[0]
        return gradient

    def _steepness_jacobian(self, run: Observations, noise: Independent, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """What errors of x do to each point, f' (n_obs,), and its derivatives (n_obs, n_par), by central differences."""
        steps = np.array([1e-5 * min(max(abs(v), 1e-3 * p.prior.sd), 1.0 + abs(v)) for p, v in zip(self.problem.parameters, values, strict=True)])
        points = np.vstack([values, values + np.diag(steps), values - np.diag(steps)])
        slope = np.broadcast_to(noise.steepness(run.curve, run.x, run.bind(self.problem.named(points))), (points.shape[0], run.n_obs))
        n = steps.size
        return slope[0], (slope[1 : n + 1] - slope[n + 1 :]).T / (2.0 * steps)

    def noise_information(self, values: FloatArray) -> FloatArray:
        """(n_par, n_par) Fisher information of the noise parameters; zero for the others.

        For the scales  (i/4) sum dV_a dV_b/V^2  with i the information of the tails about a logarithm of scale (2 if
        normal); for the parameters of the tails the mean square of their score, by simulation on a fixed set of quantiles.
        """
        named, names = self.problem.named(values), self.problem.names
        information = np.zeros((len(names), len(names)))
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            variance, noise = variances(run.noise, whitening, named), run.noise
            slopes = np.zeros((run.n_obs, len(names)))
            weights = [(noise.sigma, whitening.spectrum), (noise.scatter, np.ones(run.n_obs))]
            if noise.sigma_x is not None:
                weights.append((noise.sigma_x, whitening.steepness**2))
            for scale, weight in weights:
                if scale.parameter is not None:
                    slopes[:, names.index(scale.parameter)] += 2.0 * float(named[scale.parameter]) * weight
            relative = slopes / np.broadcast_to(variance, (1, run.n_obs)).T
            information += 0.25 * noise.tails.information(named)[1] * relative.T @ relative
            for name in noise.tails.parameters:
                information[names.index(name), names.index(name)] += run.n_obs * self._tail_information(run, name, values)
        return information

    def _tail_information(self, run: Observations, name: str, values: FloatArray) -> float:
        """Mean square, over errors drawn from the tails themselves, of the score in one of their parameters."""
        i = self.problem.names.index(name)
        z = run.noise.tails.draw(np.random.default_rng(0), 20_000, self.problem.named(values))
        low, high = _straddle(self.problem.parameters[i].prior, values[i])
        ends = [self.problem.named(np.where(np.arange(values.size) == i, v, values)) for v in (low, high)]
        score = (run.noise.tails.log_density(z, ends[1]) - run.noise.tails.log_density(z, ends[0])) / (high - low)
        return float(np.mean(score**2))

    def log_density_noise_gradient(self, values: FloatArray) -> FloatArray:
        """(n_par,) derivative of the log likelihood in the noise parameters, by central differences; zero for the others."""
        names, gradient = self.problem.names, np.zeros(values.size)
        chosen = [i for i, name in enumerate(names) if name in self.problem.noise_names]
        ends = [_straddle(self.problem.parameters[i].prior, values[i]) for i in chosen]
        points = np.tile(values, (2 * len(chosen), 1))
        for k, (i, (low, high)) in enumerate(zip(chosen, ends, strict=True)):
            points[2 * k, i], points[2 * k + 1, i] = low, high
        density = self.log_likelihood(points)
        for k, (i, (low, high)) in enumerate(zip(chosen, ends, strict=True)):
            gradient[i] = (density[2 * k + 1] - density[2 * k]) / (high - low)
        return gradient


def _straddle(prior: Prior, value: float) -> tuple[float, float]:
    """Two points beside `value` for a difference, inside the support of `prior`."""
    step = 1e-5 * max(abs(value), 1e-4 * min(prior.sd, 1.0 + abs(value)))
    return max(value - step, prior.low), min(value + step, prior.high)


def informative(prior: Prior) -> bool:
    """Whether a prior pulls on the fit (a uniform one only bounds it)."""
    return not isinstance(prior, Uniform)
