"""One run of a joint fit as a function of the parameters that it shares with others.

Given the shared parameters s the runs are independent, and the information of a run about s is its
likelihood with its own parameters l (angle of release, tilt, its own noise) integrated out:

    m(s) = log integral of p(y | s, l) p(l) dl

The integrand is close to a normal density in l around its mode l*(s).  Mode and covariance are
found by a descent at each s (`RunTerm.around`), from the regression of l on s at the fit.
They only place the nodes: `RunTerm.log_marginal` evaluates the posterior itself there, at one
node (Laplace) or at n x n Gauss-Hermite nodes, and `RunTerm.log_joint` serves exact importance
weights, which hold however good they are.

What has a log-normal prior, as the size of the errors of a run has, is integrated over its
logarithm: with few readings that is much nearer to a normal variable.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import ClassVar

import numpy as np

from estim.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    finite_or,
    in_blocks,
    log_sum_exp,
    positive_or,
    squared_rows,
)
from estim.common import InputError
from estim.distributions import normal_log_density
from estim.fitting import Fit
from estim.levenberg_marquardt import minima_from
from estim.problem import LogNormal, NormalErrors, Observations, Posterior, Prior

_ROWS = 512  # rows of a block: its arrays stay in the cache
_N_REFINE, _WIDER = 10, 1.5
# steps to a mode, where they are sought at each draw, and the rise of a log density that ends them
_MOST_STEP, _SETTLED = 20, 1e-4
# conditional standard deviations at the fit: the longest step, and that of differences
_LONGEST_STEP, _DIFFERENCE = 100.0, 1e-3
_LEAST_EIGENVALUE = 1e-12
_NOT_NORMAL = "must have plain normal noise for a marginal over runs: use the sampler"


@dataclass(frozen=True, eq=False)
class RunTerm:
    """One run: its part of the posterior, and which parameters of the whole problem it uses.

    posterior : of this run alone, with the likelihood of the joint fit.
    normal : that as normal errors.
    columns : (n_used,) where its parameters stand in the whole problem, in the order of
        `posterior.names`.
    shared, own : positions within these of the parameters that are shared (given) and its own
        (integrated out).
    centre : (n_used,) the fit.
    regression, scale : (n_own, n_shared), (n_own,) coefficients of the regression of its own
        parameters on the shared ones there, and their standard deviations given these.

    Methods take and give own parameters in the variables of integration: themselves, or their
    logarithms.
    """

    posterior: Posterior
    normal: NormalErrors
    columns: IntArray
    shared: IntArray
    own: IntArray
    centre: FloatArray
    regression: FloatArray
    scale: FloatArray

    @property
    def run(self) -> Observations:
        return self.posterior.problem.runs[0]

    @property
    def own_priors(self) -> tuple[Prior, ...]:
        return tuple(self.posterior.problem.parameters[i].prior for i in self.own)

    @cached_property
    def logs(self) -> IntArray:
        """Which own parameters are integrated over their logarithm."""
        priors = enumerate(self.own_priors)
        return np.array([i for i, prior in priors if isinstance(prior, LogNormal)], dtype=np.int64)

    def values(self, own: FloatArray) -> FloatArray:
        """(n, n_own) values of own parameters from variables of integration."""
        values = own.copy()
        with np.errstate(over="ignore"):  # far away
            values[:, self.logs] = np.exp(own[:, self.logs])
        return values

    def linearised(self, values: FloatArray) -> FloatArray:
        """(n, n_own) variables of integration from values, to first order at the fit."""
        own, fit = values.copy(), self.centre[self.own][self.logs]
        own[:, self.logs] = np.log(fit) + values[:, self.logs] / fit - 1.0
        return own

    @cached_property
    def steps(self) -> FloatArray:
        """(n_own,) of differences, of variables of integration."""
        steps = _DIFFERENCE * self.scale
        steps[self.logs] /= self.centre[self.own][self.logs]
        return steps

    @cached_property
    def limits(self) -> tuple[FloatArray, FloatArray]:
        """(n_own,) just inside the support of the priors, of variables of integration."""
        low = np.array([_just_above(p.low, p.sd) for p in self.own_priors])
        high = -np.array([_just_above(-p.high, p.sd) for p in self.own_priors])
        low[self.logs], high[self.logs] = -np.inf, np.inf
        return low, high

    def inside(self, own: FloatArray) -> FloatArray:
        """Own parameters (n, n_own) moved just inside the support of their priors."""
        return np.clip(own, *self.limits)

    def rows(self, shared: FloatArray, own: FloatArray) -> FloatArray:
        """(n_draw, n_used) values of the parameters of the run from shared (n_draw, n_shared) and
        own (n_draw, n_own).
        """
        rows = np.empty((shared.shape[0], self.columns.size))
        rows[:, self.shared], rows[:, self.own] = shared, self.values(own)
        return rows

    def log_joint(self, shared: FloatArray, own: FloatArray) -> FloatArray:
        """(n_draw,) log p(y | s, l) + log p(l): likelihood of the run and priors of its own
        parameters; -inf outside these, and where the curve is not a number.
        """
        log_p, rows = np.sum(own[:, self.logs], axis=1), self.rows(shared, own)
        for i, prior in zip(self.own, self.own_priors, strict=True):
            log_p += prior.log_density(rows[:, i])
        inside = np.flatnonzero(np.isfinite(log_p))
        if inside.size:
            with np.errstate(all="ignore"):
                log_p[inside] += in_blocks(self.posterior.log_likelihood, rows[inside], _ROWS)
        return np.where(np.isnan(log_p), -np.inf, log_p)

    def around(self, shared: FloatArray) -> Around:
        """Mode and covariance of its own parameters at shared (n_draw, n_shared)."""
        fit = self.centre[self.own]
        values = fit + (shared - self.centre[self.shared]) @ self.regression.T
        # where the density is zero: the centres of stated priors, and the fit where none is stated
        safe = [
            p.centre if math.isfinite(p.sd) else at
            for p, at in zip(self.own_priors, fit, strict=True)
        ]
        mode, informations = minima_from(
            _GivenShared(self, shared),
            self.inside(self.linearised(values)),
            instead=self.inside(self.linearised(np.array([safe])))[0],
            tolerance=_SETTLED,
            max_steps=_MOST_STEP,
        )
        return Around(mode, covariance_roots(informations))

    def log_marginal(self, shared: FloatArray, around: Around, *, n_node: int) -> FloatArray:
        """(n_draw,) m(s) at shared (n_draw, n_shared), with `n_node` Gauss-Hermite nodes along each
        of its own parameters.

        One node is Laplace's approximation, log p at the mode + (1/2) log det(2 pi covariance).
        """
        nodes, log_weights = hermite_nodes(n_node, self.own.size)
        mode, root = around.mode, around.root
        n_draw, k = mode.shape
        points = mode[:, None, :] + np.einsum("nij,qj->nqi", root, nodes)
        repeated = np.repeat(shared, nodes.shape[0], axis=0)
        log_p = self.log_joint(repeated, points.reshape(repeated.shape[0], k)).reshape(n_draw, -1)
        terms = log_p + log_weights - np.sum(normal_log_density(nodes), axis=1)
        log_m = log_sum_exp(terms, axis=1) + log_volume(root)
        return np.where(np.isnan(log_m), -np.inf, log_m)

    def refine_own(
        self, shared: FloatArray, own: FloatArray, rng: np.random.Generator
    ) -> FloatArray:
        """Own parameters (n_draw, n_own), drawn around their mode, moved towards their exact
        distribution given shared.

        Some steps of an independence sampler (Tierney, Ann. Stat. 22 (1994) 1701) whose proposal is
        the normal density around the mode, made wider: its weights are bounded where the
        distribution is skewed, and about half of the steps are taken.
        """
        around = self.around(shared)
        mode, root = around.mode, around.root
        excess = self.log_joint(shared, own) + 0.5 * np.sum(
            np.linalg.solve(_WIDER * root, (own - mode)[..., None])[..., 0] ** 2, axis=1
        )
        for _ in range(_N_REFINE):
            z = rng.standard_normal(own.shape)
            proposed = mode + _WIDER * np.einsum("nij,nj->ni", root, z)
            new = self.log_joint(shared, proposed) + 0.5 * np.sum(z**2, axis=1)
            accepted = np.isfinite(new) & (
                np.log(rng.random(new.size)) < new - finite_or(excess, -1e300)
            )
            own = np.where(accepted[:, None], proposed, own)
            excess = np.where(accepted, new, excess)
        return own


@dataclass(frozen=True, eq=False)
class Around:
    """A run's own parameters given the shared ones of n_draw draws, nearly normal.

    mode : (n_draw, n_own).
    root : (n_draw, n_own, n_own) lower triangular, of their covariance; not a number where none is
        found.
    """

    mode: FloatArray
    root: FloatArray

    def draw(self, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """One of each (n_draw, n_own), and its log density there."""
        z = rng.standard_normal(self.mode.shape)
        log_q = np.sum(normal_log_density(z), axis=1) - log_volume(self.root)
        return self.mode + np.einsum("nij,nj->ni", self.root, z), log_q


def run_terms(fit: Fit, sampled: IntArray) -> tuple[RunTerm, ...]:
    """The runs of a fit as functions of the parameters `sampled` (n_sampled,) of its problem; each
    run's others are its own.

    Raises InputError where the noise of a run is not normal.
    """
    problem = fit.problem
    terms = []
    for group, likelihood in zip(problem.groups, fit.posterior.likelihoods, strict=True):
        alone = problem.restricted(group.runs)
        columns = np.array([problem.names.index(name) for name in alone.names], dtype=np.int64)
        is_shared = np.isin(columns, sampled)
        if likelihood.normal is None:
            raise InputError(_NOT_NORMAL, field="run", value=", ".join(group.run_names))
        posterior = dataclasses.replace(fit.posterior, problem=alone, likelihoods=(likelihood,))
        cov = fit.cov[np.ix_(columns, columns)]
        own, cross = cov[np.ix_(~is_shared, ~is_shared)], cov[np.ix_(is_shared, ~is_shared)]
        solved = np.linalg.solve(cov[np.ix_(is_shared, is_shared)], cross)
        regression: FloatArray = np.asarray(solved.T, dtype=np.float64)
        terms.append(
            RunTerm(
                posterior,
                likelihood.normal,
                columns,
                np.flatnonzero(is_shared),
                np.flatnonzero(~is_shared),
                fit.values[columns],
                regression,
                np.sqrt(np.maximum(np.diag(own - regression @ cross), 1e-6 * np.diag(own))),
            )
        )
    return tuple(terms)


@dataclass(frozen=True, eq=False)
class _GivenShared:
    """Minus `RunTerm.log_joint` at shared (n_draw, n_shared) as an `ObjectiveFunction` of the own
    parameters.
    """

    term: RunTerm
    shared: FloatArray

    quasi_newton: ClassVar[bool] = False
    fraction_to_bound: ClassVar[float] = 1.0

    @property
    def low(self) -> FloatArray:
        return self.term.limits[0]

    @property
    def high(self) -> FloatArray:
        return self.term.limits[1]

    def reach(self, points: FloatArray) -> FloatArray:
        return np.broadcast_to(_LONGEST_STEP / _DIFFERENCE * self.term.steps, points.shape)

    def evaluate(self, points: FloatArray, which: IntArray) -> tuple[FloatArray, FloatArray]:
        return points, -self.term.log_joint(self.shared[which], points)

    def derivatives(
        self, points: FloatArray, which: IntArray, curved: BoolArray
    ) -> tuple[FloatArray, FloatArray]:
        """Not numbers where the curve is none."""
        residuals, jacobian, spread = _slopes(self.term, self.shared[which], points)
        gradient = np.einsum("nok,no->nk", jacobian, residuals) + 0.5 * np.einsum(
            "nok,no->nk", spread, residuals**2 - 1.0
        )
        # far from its mode the size of errors is curved by what the residuals are, not by what
        # they are expected to be
        observed = np.einsum("nok,no->nk", spread**2, residuals**2)
        ratio = observed / positive_or(np.sum(spread**2, axis=1), np.inf)
        spread *= np.sqrt(np.maximum(ratio, 1.0))[:, None, :]
        information = np.einsum("nok,nol->nkl", jacobian, jacobian) + 0.5 * np.einsum(
            "nok,nol->nkl", spread, spread
        )
        gradient[:, self.term.logs] += 1.0  # of the density of a logarithm
        return -gradient, information


def _slopes(
    term: RunTerm, shared: FloatArray, own: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Residuals of points and priors (n, n_obs + n_own); minus their derivatives (n, n_obs + n_own,
    n_own) for errors of the same size, and those of the logarithms of the variances; by
    differences.
    """
    residuals, logs = _residuals(term, shared, own)
    jacobian = np.empty((*residuals.shape, term.own.size))
    spread = np.empty_like(jacobian)
    for i, step in enumerate(term.steps):
        moved = own.copy()
        moved[:, i] += step
        # on the side where the prior is
        moved[:, i] -= 2.0 * step * (term.inside(moved)[:, i] < moved[:, i])
        moved_residuals, moved_logs = _residuals(term, shared, moved)
        shift = (moved - own)[:, i, None]
        spread[:, :, i] = (moved_logs - logs) / shift
        slope = (residuals - moved_residuals) / shift
        jacobian[:, :, i] = slope - 0.5 * spread[:, :, i] * residuals
    return residuals, jacobian, spread


def _residuals(term: RunTerm, shared: FloatArray, own: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residuals (n, n_obs + n_own) of the points and of the priors of its own parameters, and the
    logarithms of their variances (n or 1, n_obs + n_own).
    """
    rows = term.rows(shared, own)
    named = term.posterior.problem.named(rows)
    priors = zip(term.own, term.own_priors, strict=True)
    of_priors = [prior.residual(rows[:, i])[:, None] for i, prior in priors]
    logs = term.normal.log_variances(named)
    return np.hstack([term.normal.residuals(named), *of_priors]), np.pad(
        logs, ((0, 0), (0, term.own.size))
    )


def covariance_roots(information: FloatArray) -> FloatArray:
    """Lower triangular roots (n, n_own, n_own) of the inverses of information matrices; not a
    number where there is none.
    """
    roots = np.full_like(information, np.nan)
    sound = np.all(np.isfinite(information), axis=(1, 2))
    size = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    sound &= np.all((size > 1e-150) & (size < 1e150), axis=1)
    unit = information[sound] / squared_rows(size[sound])
    sound[sound] = np.min(np.linalg.eigvalsh(unit), axis=1, initial=1.0) > _LEAST_EIGENVALUE
    roots[sound] = np.linalg.cholesky(np.linalg.inv(information[sound]))
    return roots


def _just_above(low: float, sd: float) -> float:
    return low + 1e-6 * sd if math.isfinite(low) else low


def hermite_nodes(n_node: int, n_dim: int) -> tuple[FloatArray, FloatArray]:
    """Nodes (n_node^n_dim, n_dim) and log weights (n_node^n_dim,) of the Gauss-Hermite rule for a
    standard normal density.
    """
    z, w = np.polynomial.hermite_e.hermegauss(n_node)
    nodes, log_weights = (
        np.array(list(product(values, repeat=n_dim))) for values in (z, np.log(w / np.sum(w)))
    )
    return nodes, np.sum(log_weights, axis=1)


def log_volume(root: FloatArray) -> FloatArray:
    """(n_draw,) log determinant of lower triangular roots (n_draw, n_own, n_own)."""
    return np.sum(np.log(np.diagonal(root, axis1=1, axis2=2)), axis=1)
