"""An inference problem: observations, curves, priors and noise, and the posterior density that follows from them.

`Problem` is what was measured and assumed.  `problem.linearised(values)` is the posterior with everything that depends
only weakly on the parameters (the slope of the curve inside the noise covariance, the truncation of the stencil) taken
at `values`; `estim.fitting.least_squares` repeats this at its own result until nothing moves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estim.arrays import FloatArray
from estim.problem.latent import Ends, root
from estim.problem.noise import Whitening, noise_parameters, variances
from estim.problem.observations import Observations, Parameter
from estim.problem.priors import Prior, Uniform


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

    def restricted(self, runs: Sequence[Observations]) -> Problem:
        """The problem of some runs alone: with those parameters that they depend on."""
        used = frozenset[str]().union(*(run.parameters for run in runs))
        return Problem(tuple(p for p in self.parameters if p.name in used), tuple(runs))

    @property
    def noise_names(self) -> frozenset[str]:
        """Parameters of the noise: they enter the covariance, not the curve."""
        return frozenset(name for run in self.runs for name in noise_parameters(run.noise))

    def start(self) -> FloatArray:
        """(n_par,) the centres of the priors."""
        return np.array([p.prior.centre for p in self.parameters])

    def support(self) -> tuple[FloatArray, FloatArray]:
        """(n_par,) lowest and highest values that the priors allow."""
        return np.array([p.prior.low for p in self.parameters]), np.array([p.prior.high for p in self.parameters])

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
            likelihood = self.log_likelihood(draws[inside])
            # nan: a motion that cannot be followed to the last frame (it all but stops on the way) explains no data
            log_p[inside] = np.where(np.isnan(likelihood), -np.inf, log_p[inside] + likelihood)
        return log_p

    def log_likelihood(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log likelihood, normalised, of draws (n_draw, n_par) inside the priors' support."""
        named = self.problem.named(draws)
        total = np.zeros(draws.shape[0])
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            if run.latent is not None:
                total += run.latent.log_likelihood(named)
                continue
            z, log_sd = self._standardised(run, whitening, named)
            total += np.sum(run.noise.tails.log_density(z, named) - log_sd, axis=1)
        return total

    def pointwise(self, draws: FloatArray) -> tuple[FloatArray, ...]:
        """For each run (n_draw, n_obs): log predictive density of every point given all the other points of its run.

        Where errors are independent this is the log likelihood of the point (with errors of x: given the estimated distribution of the
        true abscissas, so that the terms do not quite sum to `log_likelihood`).  Where they are correlated it is the
        conditional density, normal with mean y_i - [C^-1 r]_i/[C^-1]_ii and variance 1/[C^-1]_ii (Buerkner, Gabry,
        Vehtari 2020, Comput. Stat. 36, 1243, eq. 8).
        """
        named = self.problem.named(draws)
        parts = []
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            if run.latent is not None:
                parts.append(run.latent.log_density(named))
                continue
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
        """For each run, (n_obs,) residuals over their standard deviations at `values` (n_par,), in the whitening's basis.

        With errors of x: the normal score of each y under its density given x.
        """
        return tuple(z[0] for z in self.standardised_draws(values[None, :]))

    def standardised_draws(self, draws: FloatArray) -> tuple[FloatArray, ...]:
        """For each run, (n_draw, n_obs) residuals over their standard deviations at draws (n_draw, n_par)."""
        named = self.problem.named(draws)
        return tuple(
            self._standardised(run, whitening, named)[0] if run.latent is None else run.latent.normal_score(named)
            for run, whitening in zip(self.problem.runs, self.whitenings, strict=True)
        )

    def _standardised(self, run: Observations, whitening: Whitening, named: Mapping[str, ArrayLike]) -> tuple[FloatArray, FloatArray]:
        """z (n_draw, n_obs) and the logarithm of the standard deviation that normalises its density."""
        variance = variances(run.noise, whitening, named)
        rotated = whitening.rotate(run.y - whitening.offset - run.curve.value(run.x, run.bind(named)))
        return rotated / np.sqrt(variance), 0.5 * np.log(variance)

    def residuals(self, values: FloatArray) -> FloatArray:
        """(n_obs + n_par,) residuals of all runs, then one for each prior: half their squares sum to minus the log density.

        Up to a constant, and for given noise parameters.  With normal errors they are the whitened residuals.
        """
        return np.concatenate([*self._residual_parts(values), self.prior_residuals(values)])

    def _residual_parts(self, values: FloatArray) -> list[FloatArray]:
        named, parts = self.problem.named(values), []
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            if run.latent is not None:
                parts.append(run.latent.deviance_residual(named)[0])
                continue
            z = self._standardised(run, whitening, self.problem.named(values[None, :]))[0][0]
            parts.append(run.noise.tails.deviance_residual(z, named)[0])
        return parts

    def size_residuals(self, values: FloatArray) -> FloatArray:
        """(n_obs,) residuals whose squares sum to chi^2: those of least squares, with errors of x the normal scores (`standardised`)."""
        pairs = zip(self.problem.runs, self._residual_parts(values), self.standardised(values), strict=True)
        return np.concatenate([residual if run.latent is None else z for run, residual, z in pairs])

    def prior_residuals(self, values: FloatArray) -> FloatArray:
        """(n_par,) one residual for each prior; 0 for a uniform one."""
        return np.array([p.prior.residual(float(v)) for p, v in zip(self.problem.parameters, values, strict=True)])

    def jacobian(self, values: FloatArray) -> FloatArray:
        """(n_obs + n_par, n_par) derivatives of `residuals` at fixed noise parameters."""
        slopes = [p.prior.residual_slope(float(v)) for p, v in zip(self.problem.parameters, values, strict=True)]
        return np.vstack([*self._jacobian_parts(values), np.diag(slopes)])

    def _jacobian_parts(self, values: FloatArray) -> list[FloatArray]:
        named, blocks = self.problem.named(values), []
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            if run.latent is not None:
                blocks.append(np.where(self._of_noise, 0.0, run.latent.deviance_jacobian(named, self.names)))
                continue
            z = self._standardised(run, whitening, self.problem.named(values[None, :]))[0][0]
            blocks.append(run.noise.tails.deviance_residual(z, named)[1][:, None] * self._standardised_jacobian(run, whitening, values))
        return blocks

    def scoring(self, values: FloatArray) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """For each run a Jacobian J (n, n_par) and residuals r (n,) in the curve's parameters for a step of least squares, n >= n_obs.

        J^T r is minus the gradient of the log likelihood; J^T J is the Fisher information where errors of x make residuals of least squares
        (`residuals`) far from normal, and that of `jacobian` elsewhere.
        """
        pairs = []
        for run, jacobian, residual in zip(self.problem.runs, self._jacobian_parts(values), self._residual_parts(values), strict=True):
            if run.latent is not None:
                named = self.problem.named(values)
                score = np.where(self._of_noise, 0.0, np.sum(run.latent.scores(named, self.names, {}), axis=0))
                information = np.where(self._of_noise | self._of_noise[:, None], 0.0, run.latent.information(named, self.names, {}))
                jacobian, residual = root(information, score, run.n_obs)
            pairs.append((jacobian, residual))
        return tuple(pairs)

    @property
    def _of_noise(self) -> NDArray[np.bool_]:
        return np.array([name in self.problem.noise_names for name in self.names])

    def location_information(self, values: FloatArray) -> FloatArray:
        """(n_par, n_par) Fisher information of the data about the curve, where it does not mix with that about the noise: without errors of x."""
        total = np.zeros((values.size, values.size))
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            if run.latent is None:
                root = self._location_root(run, whitening, values)
                total += root.T @ root
        return total

    def information_roots(self, values: FloatArray) -> tuple[FloatArray, ...]:
        """For each run J (n, n_par) with J^T J the Fisher information of its data about the curve, the noise held."""
        pairs = zip(self.problem.runs, self.whitenings, self.scoring(values), strict=True)
        return tuple(self._location_root(run, whitening, values) if run.latent is None else scoring[0] for run, whitening, scoring in pairs)

    def _location_root(self, run: Observations, whitening: Whitening, values: FloatArray) -> FloatArray:
        location = np.where(self._of_noise, 0.0, self._standardised_jacobian(run, whitening, values))
        return np.asarray(np.sqrt(run.noise.tails.information(self.problem.named(values))[0]) * location)

    def _standardised_jacobian(self, run: Observations, whitening: Whitening, values: FloatArray) -> FloatArray:
        """(n_obs, n_par) derivatives of the standardised residuals at fixed noise parameters."""
        variance = variances(run.noise, whitening, self.problem.named(values))
        gradient = self.curve_jacobian(run, values)
        return -whitening.rotate(gradient.T).T / np.sqrt(np.broadcast_to(variance, (1, run.n_obs))[0])[:, None]

    def curve_jacobian(self, run: Observations, values: FloatArray) -> FloatArray:
        """(n_obs, n_par) derivatives of the run's curve in every parameter."""
        local = run.curve.local(run.x, run.bind(self.problem.named(values)))
        gradient = np.zeros((run.n_obs, self.problem.n_par))
        for argument, source in run.arguments.items():
            if isinstance(source, str):
                gradient[:, self.problem.names.index(source)] += np.broadcast_to(local.gradient[argument], (1, run.n_obs))[0]
        return gradient

    def noise_information(self, values: FloatArray) -> FloatArray:
        """(n_par, n_par) Fisher information of the noise parameters; zero for the others, but for runs with errors of x, where all mix.

        For the scales  (i/4) sum dV_a dV_b/V^2  with i the information of the tails about a logarithm of scale (2 if
        normal); for the parameters of the tails the mean square of their score, by simulation on a fixed set of quantiles.
        """
        named, names = self.problem.named(values), self.problem.names
        information = np.zeros((len(names), len(names)))
        for run, whitening in zip(self.problem.runs, self.whitenings, strict=True):
            if run.latent is not None:
                information += run.latent.information(named, names, self._ends(values, noise_parameters(run.noise)))
                continue
            variance, noise = variances(run.noise, whitening, named), run.noise
            slopes = np.zeros((run.n_obs, len(names)))
            for scale, weight in ((noise.sigma, whitening.spectrum), (noise.scatter, np.ones(run.n_obs))):
                if scale.parameter is not None:
                    slopes[:, names.index(scale.parameter)] += 2.0 * float(named[scale.parameter]) * weight
            relative = slopes / np.broadcast_to(variance, (1, run.n_obs)).T
            information += 0.25 * noise.tails.information(named)[1] * relative.T @ relative
            for name in noise.tails.parameters:
                information[names.index(name), names.index(name)] += run.n_obs * self._tail_information(run, name, values)
        return information

    def _ends(self, values: FloatArray, chosen: Iterable[str]) -> Ends:
        """Values on either side in each of the `chosen` parameters, for differences."""
        ends = {}
        for i, name in enumerate(self.names):
            if name in chosen:
                low, high = _straddle(self.problem.parameters[i].prior, values[i])
                below, above = (self.problem.named(np.where(np.arange(values.size) == i, end, values)) for end in (low, high))
                ends[name] = (below, above, high - low)
        return ends

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
