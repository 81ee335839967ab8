"""An inference problem: observations, curves, priors and noise, and the posterior density that
follows from them.

`Problem` is what was measured and assumed.  `problem.linearised(values)` is the posterior with
everything that depends only weakly on the parameters (the slope of the curve inside the noise
covariance, the truncation of the stencil) taken at `values`; `estim.fitting.least_squares` repeats
this at its own result until nothing moves.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from estim.arrays import BoolArray, FloatArray, IntArray, finite_or, in_blocks
from estim.common import InputError
from estim.problem.coordinates import Coordinates
from estim.problem.correlated_runs import Group, SharedNoise, grouped
from estim.problem.likelihood import Ends, Likelihood, Noise
from estim.problem.observations import Observations, Parameter, parameters_of, uses_of
from estim.problem.prior_measures import JeffreysPrior, Measure
from estim.problem.priors import Flat, JointNormal, Prior

_BLOCK = 4_000_000  # values of the curve computed at once


@dataclass(frozen=True, eq=False)
class Problem:
    """Parameters and the runs they explain.

    shared : what ties runs together whose errors are not independent; empty where all are.
    """

    parameters: tuple[Parameter, ...]
    runs: tuple[Observations, ...]
    shared: tuple[SharedNoise, ...] = ()

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    @property
    def run_names(self) -> tuple[str, ...]:
        return tuple(run.name for run in self.runs)

    @property
    def n_par(self) -> int:
        return len(self.parameters)

    @property
    def counted(self) -> bool:
        """Whether the y of some run are counts, or its density is a user's own."""
        return self.own_density or any(run.noise.counted is not None for run in self.runs)

    @property
    def own_density(self) -> bool:
        """Whether some run has a log density of the user's own."""
        return any(run.noise.own_density for run in self.runs)

    @property
    def n_obs(self) -> int:
        return sum(run.n_obs for run in self.runs)

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """The runs in groups that are independent of each other."""
        return grouped(self.runs, self.shared)

    @cached_property
    def columns(self) -> tuple[IntArray, ...]:
        """For each group (n_used,) the indices of the parameters that it depends on."""
        index = {name: i for i, name in enumerate(self.names)}
        return tuple(
            np.array(
                sorted(index[name] for name in parameters_of(group.runs) if name in index),
                dtype=np.int64,
            )
            for group in self.groups
        )

    def foremost(self, most: int) -> list[int]:
        """Places of at most `most` parameters: all of them, or those that groups of runs share and
        then the first of the others, in order.
        """
        if self.n_par <= most:
            return list(range(self.n_par))
        uses = np.zeros(self.n_par, dtype=int)
        for used in self.columns:
            uses[used] += 1
        return sorted(np.argsort(uses == 1, kind="stable")[:most].tolist())

    def restricted(self, runs: Sequence[Observations]) -> Problem:
        """The problem of some runs alone: with those parameters that they depend on.

        Raises InputError where one of them shares something with a run that is left out.
        """
        used = parameters_of(runs)
        names = {run.name for run in runs}
        shared = tuple(noise for noise in self.shared if names.intersection(noise.runs))
        for noise in shared:
            if not names.issuperset(noise.runs):
                raise InputError(
                    "share an unmodelled force and cannot be separated",
                    field="runs",
                    value=", ".join(noise.runs),
                )
        return Problem(tuple(p for p in self.parameters if p.name in used), tuple(runs), shared)

    @cached_property
    def noise_names(self) -> frozenset[str]:
        """Parameters of the noise: they enter the covariance, not the curve."""
        return frozenset(name for run in self.runs for name in run.noise.parameters)

    @property
    def sizes_of_errors(self) -> frozenset[str]:
        """Parameters of the noise that are no shares or widths of outliers."""
        outliers = (name for run in self.runs for name in run.noise.outlier_parameters)
        return self.noise_names.difference(outliers)

    @property
    def sizes_from_zero(self) -> BoolArray:
        """(n_par,) which parameters are sizes of errors that may be as small as 0."""
        sizes = self.sizes_of_errors
        return np.array([p.name in sizes and p.prior.low == 0.0 for p in self.parameters])

    @property
    def robust(self) -> bool:
        """Whether some errors leave room for outliers."""
        return any(run.noise.robust for run in self.runs)

    @property
    def of_curve(self) -> list[int]:
        """Places of the parameters of the curves; the others are of the noise."""
        return [i for i, name in enumerate(self.names) if name not in self.noise_names]

    @cached_property
    def readings(self) -> frozenset[str]:
        """Parameters of the curves of single runs whose stated values are readings: they differ
        from run to run.
        """
        uses, centres = uses_of(self.runs), dict[str, dict[str, float]]()
        for parameter in self.parameters:
            if uses[parameter.name] == 1 and parameter.prior.measured:
                centres.setdefault(parameter.name.split("[")[0], {})[parameter.name] = (
                    parameter.prior.centre
                )
        return frozenset(
            name for group in centres.values() if len(set(group.values())) > 1 for name in group
        )

    @cached_property
    def effects(self) -> frozenset[str]:
        """Parameters of the curves that are stated as 0 within an uncertainty."""
        return frozenset(
            p.name
            for p in self.parameters
            if p.prior.measured and p.prior.centre == 0.0 and p.name not in self.noise_names
        )

    @cached_property
    def incidental(self) -> frozenset[str]:
        """`readings`, and where the data of some runs are counts, also the parameters of single
        runs that have no stated prior, which is then flat.
        """
        if not self.counted:
            return self.readings
        uses = uses_of(self.runs)
        unstated = (p.name for p, free in zip(self.parameters, self.unstated, strict=True) if free)
        return self.readings | {name for name in unstated if uses[name] == 1}

    @cached_property
    def unstated(self) -> BoolArray:
        """(n_par,) whether nothing is stated of a parameter of a curve, but at most one limit."""
        return np.array(
            [
                not math.isfinite(p.prior.sd) and p.name not in self.noise_names
                for p in self.parameters
            ]
        )

    @cached_property
    def limited(self) -> BoolArray:
        """(n_par,) whether nothing is stated of it but limits on both sides."""
        return np.array(
            [
                isinstance(p.prior, Flat) and p.prior.proper and p.name not in self.noise_names
                for p in self.parameters
            ]
        )

    def start(self) -> FloatArray:
        """(n_par,) the centres of the priors."""
        return np.array([p.prior.centre for p in self.parameters])

    def prior_draw(self, rng: np.random.Generator) -> FloatArray:
        """(n_par,) one draw of the priors, of a joint one each by itself: to start from."""
        return np.array([float(p.prior.draw(rng, 1)[0]) for p in self.parameters])

    def with_priors(self, priors: Mapping[str, Prior]) -> Problem:
        """The same with `priors`, by name, in place of those of their parameters."""
        changed = (replace(p, prior=priors.get(p.name, p.prior)) for p in self.parameters)
        return replace(self, parameters=tuple(changed))

    def with_noises(
        self, noises: Mapping[str, Noise], shared: tuple[SharedNoise, ...] = ()
    ) -> Problem:
        """The same with `noises`, by run, in place of those of their runs, and tied by `shared`."""
        runs = (replace(run, noise=noises.get(run.name, run.noise)) for run in self.runs)
        return Problem(self.parameters, tuple(runs), shared)

    def support(self) -> tuple[FloatArray, FloatArray]:
        """(n_par,) lowest and highest values that the priors allow."""
        return np.array([p.prior.low for p in self.parameters]), np.array(
            [p.prior.high for p in self.parameters]
        )

    def room(self, values: FloatArray) -> FloatArray:
        """(n_par,) how far values (n_par,) are from the nearer limit of their priors."""
        low, high = self.support()
        return np.minimum(values - low, high - values)

    def named(self, draws: FloatArray) -> dict[str, FloatArray]:
        """Parameter name -> column: (n_par,) gives scalars, (n_draw, n_par) gives (n_draw, 1)."""
        draws = np.asarray(draws)
        columns = draws.T[..., None] if draws.ndim == 2 else draws
        return dict(zip(self.names, columns, strict=True))

    def log_prior(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log density of the priors at draws (n_draw, n_par); -inf outside their
        support.
        """
        total: FloatArray = np.sum(
            [p.prior.log_density(draws[:, i]) for i, p in enumerate(self.parameters)], axis=0
        )
        if self.decorrelation is not None:
            alone, joint = self._alone(draws), self.prior_residuals(draws)
            with np.errstate(invalid="ignore"):  # beyond the support of others
                more = finite_or(0.5 * (alone**2 - joint**2), 0.0)
            total += np.sum(more + np.log(np.diag(self.decorrelation)), 1)
        return total

    @cached_property
    def decorrelation(self) -> FloatArray | None:
        """(n_par, n_par) inverse of the triangular root L of the correlation matrix L L^T of the
        priors; None where all are independent.
        """
        priors = enumerate(p.prior for p in self.parameters)
        joint = {i: prior for i, prior in priors if isinstance(prior, JointNormal)}
        correlation = np.eye(self.n_par)
        for (i, first), (j, second) in product(joint.items(), repeat=2):
            if first.correlation is second.correlation:
                correlation[i, j] = first.correlation[first.place, second.place]
        return np.linalg.inv(np.linalg.cholesky(correlation)) if joint else None

    def _alone(self, draws: FloatArray) -> FloatArray:
        """(..., n_par) residuals of each prior by itself."""
        columns = zip(self.parameters, draws.T, strict=True)
        return np.array([p.prior.residual(column) for p, column in columns]).T

    def _slopes(self, draws: FloatArray) -> FloatArray:
        columns = zip(self.parameters, draws.T, strict=True)
        return np.array([p.prior.residual_slope(column) for p, column in columns]).T

    def decorrelated(self, residuals: FloatArray) -> FloatArray:
        """(..., n_par) independent ones from those of each prior by itself."""
        return residuals if self.decorrelation is None else residuals @ self.decorrelation.T

    def prior_residuals(self, draws: FloatArray) -> FloatArray:
        """(..., n_par) one residual for each prior at draws (..., n_par); 0 for a uniform one, and
        of a joint one independent residuals.
        """
        return self.decorrelated(self._alone(draws))

    def prior_jacobian(self, values: FloatArray) -> FloatArray:
        """(n_par, n_par) their derivatives at `values` (n_par,)."""
        return self.decorrelated(np.diag(self._slopes(values))).T

    def prior_information(self, values: FloatArray) -> FloatArray:
        """(n_par, n_par) that of the priors: J^T J with J their `prior_jacobian`."""
        jacobian = self.prior_jacobian(values)
        return jacobian**2 if self.decorrelation is None else jacobian.T @ jacobian

    def prior_gradient(self, draws: FloatArray) -> FloatArray:
        """(..., n_par) derivatives of half the squares of `prior_residuals`."""
        residuals, whiten = self.prior_residuals(draws), self.decorrelation
        return self._slopes(draws) * (residuals if whiten is None else residuals @ whiten)

    def linearised(self, values: FloatArray) -> Posterior:
        """The posterior with noise covariance and truncation taken at `values` (n_par,)."""
        named = self.named(values)
        return Posterior(self, tuple(group.likelihood(named) for group in self.groups))

    def for_search(self) -> Problem:
        """What a search from afar takes in its place (`Noise.for_search`); itself where no run
        needs that.
        """
        noises = {run.name: run.noise.for_search() for run in self.runs}
        if not self.shared and all(noises[run.name] is run.noise for run in self.runs):
            return self
        return self.with_noises(noises)

    def with_normal_errors(self, wider: Sequence[FloatArray]) -> Problem:
        """The problem with normal errors in place of those that leave room for outliers, `wider`
        (n_obs,) times as wide in each run.
        """
        runs = zip(self.runs, wider, strict=True)
        return self.with_noises(
            {run.name: run.noise.with_normal_errors(factors) for run, factors in runs}
        )


@dataclass(frozen=True, eq=False)
class Posterior:
    """Posterior density of a problem, linearised at one point: one likelihood for each of its
    groups (`Problem.groups`), mostly of one run.

    measure : of readings in a joint fit, where it is to be sampled with one; least squares, optima
        and profiles have none.
    jeffreys : the prior of unstated parameters, likewise.
    flat : coordinates in which the prior of unstated parameters is flat, likewise; where there are
        none, that of values is.
    """

    problem: Problem
    likelihoods: tuple[Likelihood, ...]
    measure: Measure | None = None
    jeffreys: JeffreysPrior | None = None
    flat: Coordinates | None = None

    @property
    def names(self) -> tuple[str, ...]:
        return self.problem.names

    def log_density(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log posterior density, up to the evidence, at draws (n_draw, n_par); -inf
        outside the priors' support.
        """
        log_p = self.problem.log_prior(draws)
        inside = np.flatnonzero(np.isfinite(log_p))
        if inside.size:
            likelihood = self.log_likelihood(draws[inside])
            # nan: a motion that cannot be followed to the last frame (it all but stops on the way)
            # explains no data
            log_p[inside] = np.where(np.isnan(likelihood), -np.inf, log_p[inside] + likelihood)
        if self.measure is not None:
            log_p += self.measure.log(draws[:, self.measure.columns])
        if self.jeffreys is not None:
            inside = np.flatnonzero(np.isfinite(log_p))
            if inside.size:
                log_p[inside] += self.jeffreys.log(draws[inside], self.problem.named)
        if self.flat is not None:
            log_p[inside] -= self.flat.log_volume(draws[inside])
        return log_p

    def height(self, values: FloatArray) -> float:
        """The log density at values (n_par,)."""
        return float(self.log_density(values[None])[0])

    def log_likelihood(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) log likelihood, normalised, of draws (n_draw, n_par) inside the priors'
        support.
        """
        return in_blocks(self._log_likelihood, draws, _BLOCK // self.problem.n_obs)

    def _log_likelihood(self, draws: FloatArray) -> FloatArray:
        named, total = self.problem.named(draws), np.zeros(len(draws))
        # far from the mode a curve may overflow: no density there
        with np.errstate(over="ignore", invalid="ignore"):
            for likelihood in self.likelihoods:
                total += likelihood.log_likelihood(named)
        return total

    def by_run(self, parts: Iterable[FloatArray]) -> tuple[FloatArray, ...]:
        """Rows (n_obs, ...) of each group as those of each run, in the order of the runs."""
        if len(self.problem.runs) == 1:
            return tuple(parts)
        rows = {
            run.name: block
            for group, part in zip(self.problem.groups, parts, strict=True)
            for run, block in zip(group.runs, group.split(part), strict=True)
        }
        return tuple(rows[run.name] for run in self.problem.runs)

    def pointwise(self, draws: FloatArray) -> tuple[FloatArray, ...]:
        """For each run (n_draw, n_obs): log predictive density of every point given all the other
        points of its run, or group of runs.

        Where errors are independent this is the log likelihood of the point (with errors of x:
        given the estimated distribution of the true abscissas, so that the terms do not quite sum
        to `log_likelihood`).
        """
        named = self.problem.named(draws)
        return tuple(
            rows.T
            for rows in self.by_run(
                likelihood.pointwise(named).T for likelihood in self.likelihoods
            )
        )

    def standardised(self, values: FloatArray) -> tuple[FloatArray, ...]:
        """For each run, (n_obs,) residuals over their standard deviations at `values` (n_par,),
        each independent of the others.
        """
        named = self._row(values)
        return self.by_run(likelihood.standardised(named)[0] for likelihood in self.likelihoods)

    def residuals(self, values: FloatArray) -> FloatArray:
        """(n_obs + n_par,) residuals of all runs, then one for each prior: half their squares sum
        to minus the log density.

        Up to a constant, and for given noise parameters.  With normal errors they are the whitened
        residuals.
        """
        return np.concatenate([self.residuals_at(values[None, :])[0], self.prior_residuals(values)])

    def residuals_at(self, draws: FloatArray) -> FloatArray:
        """(n_draw, n_obs) those of all runs at draws (n_draw, n_par)."""
        named = self.problem.named(draws)
        rows = self.by_run(likelihood.residuals(named).T for likelihood in self.likelihoods)
        return rows[0].T if len(rows) == 1 else np.hstack([row.T for row in rows])

    def size_residuals(self, values: FloatArray) -> FloatArray:
        """(n_obs,) residuals whose squares sum to chi^2: those of least squares, with errors of x
        the normal scores (`standardised`).
        """
        named = self._row(values)
        return np.concatenate(
            self.by_run(likelihood.size_residuals(named)[0] for likelihood in self.likelihoods)
        )

    def prior_residuals(self, values: FloatArray) -> FloatArray:
        """(n_par,) one residual for each prior; 0 for a uniform one."""
        return self.problem.prior_residuals(values)

    def jacobian(self, values: FloatArray) -> FloatArray:
        """(n, n_par) J of `scoring`."""
        return self.scoring(values)[0]

    @cached_property
    def _parts(self) -> tuple[tuple[Likelihood, tuple[str, ...], IntArray], ...]:
        """For each group its likelihood, and names and places of the parameters that it depends on:
        derivatives in all others are 0.
        """
        return tuple(
            (likelihood, tuple(self.names[i] for i in columns), columns)
            for likelihood, columns in zip(self.likelihoods, self.problem.columns, strict=True)
        )

    def _widened(self, part: FloatArray, columns: IntArray) -> FloatArray:
        """(n, n_par) derivatives in all parameters from those (n, n_used) in `columns`."""
        if columns.size == self.problem.n_par:
            return part
        wide = np.zeros((len(part), self.problem.n_par))
        wide[:, columns] = part
        return wide

    def scoring(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Jacobian J (n, n_par) and residuals r (n,) of all groups, then of the priors, in the
        curve's parameters for a step of least squares.
        """
        pairs = self.narrow_scoring(values)
        rows = [
            self._widened(jacobian, columns)
            for (jacobian, _), columns in zip(pairs, self.problem.columns, strict=True)
        ]
        return np.vstack([*rows, self.problem.prior_jacobian(values)]), np.concatenate(
            [*(residuals for _, residuals in pairs), self.prior_residuals(values)]
        )

    def narrow_scoring(self, values: FloatArray) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """For each group J (n, n_used) in the parameters that it depends on (`Problem.columns`) and
        r (n,), n >= n_obs.

        J^T r is minus the gradient of the log likelihood; J^T J is the Fisher information where
        residuals of least squares (`residuals`) are far from normal (`Likelihood.creeps`);
        elsewhere r are those, and J their derivatives at fixed noise parameters.
        """
        named = self.problem.named(values)
        return tuple(likelihood.scoring(named, names) for likelihood, names, _ in self._parts)

    def information(self, values: FloatArray) -> FloatArray:
        """(n_par, n_par) Fisher information of the data about all parameters, without the
        priors.
        """
        return np.sum(self.informations(values), axis=0)

    def informations(self, values: FloatArray) -> list[FloatArray]:
        """That of each group of runs."""
        named, parts = self.problem.named(values), []
        for group, (likelihood, names, columns) in zip(
            self.problem.groups, self._parts, strict=True
        ):
            chosen = {name for run in group.runs for name in run.noise.parameters}
            part = np.zeros((values.size, values.size))
            part[np.ix_(columns, columns)] = likelihood.information(
                named, names, self._ends(values, chosen)
            )
            parts.append(part)
        return parts

    def _row(self, values: FloatArray) -> dict[str, FloatArray]:
        """`values` (n_par,) as a single draw."""
        return self.problem.named(values[None, :])

    def _ends(self, values: FloatArray, chosen: Iterable[str]) -> Ends:
        """Values on either side in each of the `chosen` parameters, for differences."""
        ends = {}
        for i, name in enumerate(self.names):
            if name in chosen:
                low, high = _straddle(self.problem.parameters[i].prior, values[i])
                below, above = (
                    self.problem.named(np.where(np.arange(values.size) == i, end, values))
                    for end in (low, high)
                )
                ends[name] = (below, above, high - low)
        return ends

    def log_density_noise_gradient(self, values: FloatArray) -> FloatArray:
        """(n_par,) derivative of the log likelihood in the noise parameters, by central
        differences; zero for the others.
        """
        gradient = np.zeros(values.size)
        chosen = [i for i, name in enumerate(self.names) if name in self.problem.noise_names]
        ends = np.array([_straddle(self.problem.parameters[i].prior, values[i]) for i in chosen])
        points = np.tile(values, (2 * len(chosen), 1))
        points[np.arange(2 * len(chosen)), np.repeat(chosen, 2)] = ends.ravel()
        density = self.log_likelihood(points).reshape(-1, 2)
        gradient[chosen] = np.diff(density)[:, 0] / np.diff(ends)[:, 0]
        return gradient


def _straddle(prior: Prior, value: float) -> tuple[float, float]:
    """Two points beside `value` for a difference, inside the support of `prior`."""
    step = 1e-5 * max(abs(value), 1e-4 * min(prior.sd, 1.0 + abs(value)))
    return max(value - step, prior.low), min(value + step, prior.high)
