"""The likelihood of independent points whose abscissas have errors, with its derivatives
(`estim.problem.errors_in_x_quadrature` says what it is).

`LatentErrors` is a likelihood like any other (`estim.problem.likelihood`): densities, residuals,
information and tests of such a run.

The estimated mean and variance of the true abscissas move all points in common.  With t_i the
derivatives of the mean of y_i in these two displacements, in standard deviations of both, and z_i =
(y_i - mean)/sd, integrating them out gives (exact for a line)

    log L = sum log L_i + g^T (1 + H)^-1 g / 2 - log det(1 + H) / 2
    g = sum z_i t_i,    H = sum t_i t_i^T

(The first term added is never above sum z_i^2/2: no misfit is rewarded.  Robust tails bound z_i in
g.)

The least squares of record leave this term out: their best point is the maximum of sum log L_i,
their covariance has the term's effect in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from estim.arrays import (
    BoolArray,
    FloatArray,
    Named,
    all_finite,
    bisected,
    diagonal_scale,
    finite_or,
    in_blocks,
    log_sum_exp,
)
from estim.distributions import normal_log_density
from estim.problem.curve import EXACT
from estim.problem.errors_in_x_quadrature import (
    LOG_WEIGHTS,
    Predictive,
    TrueAbscissas,
    deepened,
    predictive,
    predictive_slopes,
    slopes_in_x,
    true_abscissas,
)
from estim.problem.likelihood import Ends, Likelihood, Points, n_draws, some_draws
from estim.problem.noise_variance import NoiseVariance, Scale
from estim.problem.tails import Tails
from estim.problem.whitened_residuals import TabulatedScores

_BLOCK = 1_000_000  # values of the curve computed at once
_FAREST = 5.0
ROOTED = 2.0 * math.sqrt(EXACT)  # `Likelihood.resolved` of what `rooted` gives


@dataclass(frozen=True, eq=False)
class LatentErrors(Likelihood):
    """Points with independent errors of y, of variance `size.variance(weight)` + (share f)^2 for
    the curve f, and of x.

    weight : (n_obs,) variance of y for a unit sigma^2.  tails : the shape of the errors of y.
    sigma_x : of the errors of x, times relative_x (n_obs,), 0 where x is exact.
    lean : (n_obs,) how far a known error of x moves the y that is expected, over that error: r
        u_y/u_x of errors with the correlation r, where `weight` is 1 - r^2 of the variance.
    """

    points: Points
    size: NoiseVariance
    weight: FloatArray
    tails: Tails
    sigma_x: Scale
    relative_x: FloatArray
    share: float = 0.0
    lean: FloatArray | float = 0.0

    creeps, resolved = True, ROOTED

    @property
    def x(self) -> FloatArray:
        return self.points.x

    def pointwise(self, named: Named) -> FloatArray:
        """The distribution of the true abscissas taken as estimated: the terms do not quite sum to
        `log_likelihood`.
        """
        return self._by_blocks(
            named, lambda part: self._predictive(part).log_density(self.y, self.tails, part)
        )

    def log_likelihood(self, named: Named) -> FloatArray:
        """(n_draw,) of all points together, that distribution integrated out."""
        if np.max(self._abscissas(named).common) == 0.0 or self._well_known(named):
            return np.sum(self.pointwise(named), axis=1)
        return self._by_blocks(named, self._integrated)

    def standardised(self, named: Named) -> FloatArray:
        """Every y mapped to a standard normal variable: its residual in standard deviations, if it
        were normal.
        """
        return self._by_blocks(
            named, lambda part: self._predictive(part).normal_score(self.y, self.tails, part)
        )

    def outlier_probability(self, named: Named) -> FloatArray:
        """Averaged over the true abscissas that y allows."""

        def probability(part: Named) -> FloatArray:
            z, terms = self._predictive(part).terms(self.y, self.tails, part)
            return np.sum(
                _shares(terms) * self.tails.outlier_probability(z, deepened(self.tails, part)),
                axis=-1,
            )

        return self._by_blocks(named, probability)

    def residuals(self, named: Named) -> FloatArray:
        """r with r^2/2 = log of the largest density that any curve reaches - log L_i; signed as the
        residual.
        """

        def residual(part: Named) -> FloatArray:
            density, tails = self._predictive(part), self.tails
            own = self._own_variance(part)
            best = likeliest(self.y, own, self.share)
            variance = own + np.square(self.share * best)
            z = (self.y - best) / np.sqrt(variance)
            highest = tails.log_density(z, part) - 0.5 * np.log(variance)
            height = highest - density.log_density(self.y, tails, part)
            below = best < np.sum(np.exp(density.log_weight) * density.mean, axis=-1)
            return np.where(below, -1.0, 1.0) * np.sqrt(2.0 * np.maximum(height, 0.0))

        return self._by_blocks(named, residual)

    def information_root(self, named: Named, names: Sequence[str]) -> FloatArray:
        return self.scoring(named, names)[0]

    def scoring(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        mask = self._of_curve(names)
        score = np.where(mask, np.sum(self.scores(named, names, {}), axis=0), 0.0)
        return rooted(
            np.where(mask & mask[:, None], self.information(named, names, {}), 0.0),
            score,
            self.y.size,
        )

    def whitened(self, named: Named, names: Sequence[str]) -> TabulatedScores:
        at, scores, slopes = self.score_table(named, names)
        mask = self._of_curve(names)
        return TabulatedScores(
            self.standardised(named)[0],
            self.information_root(named, names),
            at,
            np.where(mask, scores, 0.0),
            np.where(mask, slopes, 0.0),
        )

    def sd(self, named: Named) -> FloatArray:
        """As wide as the slope of the curve makes an error of x: the size of a residual, not what
        its density is made of.
        """
        steep = (self.points.slope(named) - self.lean) * self._sd_of_x(named)[0]
        of_curve = self.share * self.points.value(named)[0]
        return np.sqrt(self._own_variance(named)[0] + steep**2 + of_curve**2)

    def scores(self, named: Named, names: Sequence[str], ends: Ends) -> FloatArray:
        """(n_obs, n_par) derivatives of each log L_i; of the noise parameters those in `ends`."""
        return self._scores(self.y[:, None], named, names, ends)[:, 0, : len(names)]

    def information(self, named: Named, names: Sequence[str], ends: Ends) -> FloatArray:
        """(n_par, n_par) Fisher information of the points, the distribution of the true abscissas
        integrated out.
        """
        density, tails = self._predictive(named), self.tails
        z, weight = _error_nodes(tails, named)
        nodes = np.flatnonzero(LOG_WEIGHTS - np.max(LOG_WEIGHTS) > -9.0)
        nodes = nodes if density.mean.shape[-1] == LOG_WEIGHTS.size else np.zeros(1, dtype=int)
        y = (
            density.mean[0][:, nodes, None] + np.sqrt(density.variance[0][:, nodes, None]) * z
        ).reshape(self.y.size, -1)
        chance = (np.exp(density.log_weight[0][:, nodes, None]) * weight).reshape(self.y.size, -1)
        total = np.zeros((len(names) + 2, len(names) + 2))
        step = max(1, int(4 * _BLOCK / (y.shape[1] * LOG_WEIGHTS.size)))
        for first in range(0, self.y.size, step):
            part = slice(first, first + step)
            scores = self._scores(y[part], named, names, ends, part)
            scores = scores * np.sqrt(chance[part])[..., None]
            flat = scores.reshape(-1, len(names) + 2)
            total += flat.T @ flat
        n = len(names)
        return total[:n, :n] - total[:n, n:] @ np.linalg.solve(
            total[n:, n:] + np.eye(2), total[n:, :n]
        )

    def score_table(
        self, named: Named, names: Sequence[str]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Normal scores e (n,), and for y of that score the scores of log L_i and the derivatives
        of the normal score, (n_obs, n, n_par).

        For tests: of the parameters of the curve only.
        """
        density, tails = self._predictive(named), self.tails
        # points of a table over the normal score of y
        e = np.linspace(-_FAREST, _FAREST, 81)
        y = _quantiles(density, tails, named, e)
        of_mean, of_variance = self._slopes(named, names)
        of_mean, of_variance = of_mean[..., : len(names)], of_variance[..., : len(names)]
        points = density.of()
        sd = np.sqrt(points.variance)
        z = (y[..., None] - points.mean) / sd
        height = points.shares * np.exp(tails.log_density(z, deepened(tails, named)))
        moved = -(height / sd) @ of_mean - (0.5 * height * z / sd**2) @ of_variance
        return (
            e,
            self._scores(y, named, names, {})[..., : len(names)],
            moved / np.exp(normal_log_density(e))[None, :, None],
        )

    def _of_curve(self, names: Sequence[str]) -> BoolArray:
        """(n_par,) which parameters are not of the noise."""
        noise = (*self.size.parameters, self.sigma_x.parameter, *self.tails.parameters)
        return np.array([name not in noise for name in names], dtype=bool)

    def _sd_of_x(self, named: Named) -> FloatArray:
        """(n, n_obs) standard deviations of the errors of the abscissas, n the number of draws or
        1.
        """
        return np.atleast_2d(self.sigma_x.at(named) * self.relative_x)

    def _well_known(self, named: Named) -> bool:
        if self.sigma_x.parameter is not None:
            return False
        # variance of x that is error, as a share, below which the distribution of the true
        # abscissas is known well enough
        return float(np.mean(np.square(self._sd_of_x(named)))) < 1e-3 * float(np.var(self.x))

    def _abscissas(self, named: Named) -> TrueAbscissas:
        return true_abscissas(self.x, self._sd_of_x(named))

    def _values(self, named: Named, nodes: FloatArray) -> FloatArray:
        """The y expected at nodes (n, n_obs, n_node), as (n_draw, n_obs, n_node); a curve of one's
        own sees increasing x.
        """
        leant = self._leant(nodes)
        with np.errstate(all="ignore"):
            if nodes.shape[0] > 1:
                value = self.points.curve.value(
                    nodes.reshape(nodes.shape[0], -1), self.points.bind(named)
                )
                return value.reshape(-1, *nodes.shape[1:]) + leant
            order = np.argsort(nodes.ravel(), kind="stable")
            value = self.points.curve.value(nodes.ravel()[order], self.points.bind(named))
        return value[:, np.argsort(order)].reshape(-1, *nodes.shape[1:]) + leant

    def _leant(self, nodes: FloatArray) -> FloatArray:
        """What errors of x, to the nodes (..., n_obs, n_node), add to the y expected there."""
        return np.reshape(self.lean, (-1, 1)) * (self.x[:, None] - nodes)

    def _own_variance(self, named: Named) -> FloatArray:
        """(n, n_obs) variance of y at a given abscissa."""
        return self.size.variance(self.weight, named)

    def _predictive(self, named: Named) -> Predictive:
        return predictive(
            self._values(named, self._abscissas(named).nodes), self._own_variance(named), self.share
        )

    def _integrated(self, named: Named) -> FloatArray:
        abscissas, tails = self._abscissas(named), self.tails
        values = self._values(named, abscissas.nodes)
        density = predictive(values, self._own_variance(named), self.share)
        along = slopes_in_x(values, abscissas.spread)[..., None] * abscissas.common[:, :, None, :]
        weight = density.shares
        mean = np.sum(weight * density.mean, axis=-1)
        sd = np.sqrt(
            np.sum(weight * (density.variance + (density.mean - mean[..., None]) ** 2), axis=-1)
        )
        moved = (
            np.einsum("dik,dikj->dij", weight, predictive_slopes(values, along)[0]) / sd[..., None]
        )
        pull = tails.score((self.y - mean) / sd, named)
        gradient = np.einsum("dij,di->dj", moved, pull)
        information = tails.information(
            {name: float(np.mean(named[name])) for name in tails.parameters}
        )[0]
        curvature = information * np.einsum("dij,dik->djk", moved, moved) + np.eye(2)
        with np.errstate(all="ignore"):
            step = np.linalg.solve(curvature, gradient[..., None])[..., 0]
            log_density = density.log_density(self.y, tails, named)
            return np.sum(log_density, axis=-1) + 0.5 * (
                np.sum(gradient * step, axis=-1) - np.linalg.slogdet(curvature)[1]
            )

    def _slopes(self, named: Named, names: Sequence[str]) -> tuple[FloatArray, FloatArray]:
        """Derivatives (n_obs, n_component, n_par + 2) of means and variances: in the parameters,
        then in the two common displacements.
        """
        abscissas = self._abscissas(named)
        flat, shape = abscissas.nodes[0].ravel(), abscissas.nodes.shape[1:]
        order = np.argsort(flat, kind="stable")
        at_nodes, inverse = replace(self.points, x=flat[order]), np.argsort(order)
        with np.errstate(all="ignore"):
            local = self.points.curve.local(at_nodes.x, self.points.bind(named))
        values = local.value[0][inverse].reshape(shape)
        values = values + self._leant(abscissas.nodes[0])
        common = (
            slopes_in_x(values, abscissas.spread[0])[..., None] * abscissas.common[0][:, None, :]
        )
        of_curve = at_nodes.gradients_of(local, named, names, 1)[0][inverse].reshape(*shape, -1)
        gradients = np.concatenate([of_curve, common], axis=-1)
        with np.errstate(all="ignore"):
            of_mean, of_variance = predictive_slopes(values, gradients)
        of_variance[..., : len(names)] += self.size.slopes(self.weight, named, names)[:, None, :]
        of_variance += 2.0 * self.share**2 * self._predictive(named).mean[0][..., None] * of_mean
        return of_mean, of_variance

    def _scores(
        self,
        y: FloatArray,
        named: Named,
        names: Sequence[str],
        ends: Ends,
        part: slice = slice(None),
    ) -> FloatArray:
        """(n_part, n, n_par + 2) derivatives of log L_i at y (n_part, n) for the points of
        `part`.
        """
        tails, density = self.tails, self._predictive(named).of(part)
        z, terms = density.terms(y, tails, named)
        share = _shares(terms)
        pull = tails.score(z, deepened(tails, named))
        of_mean, of_variance = (array[part] for array in self._slopes(named, names))
        with np.errstate(all="ignore"):
            scores = (share * pull / np.sqrt(density.variance)) @ of_mean + (
                share * (z * pull - 1.0) / (2.0 * density.variance)
            ) @ of_variance
        for name, (low, high, distance) in ends.items():
            if name in self.size.parameters:
                continue
            below, above = (
                self._predictive(values).of(part).log_density(y, tails, values)
                for values in (low, high)
            )
            scores[..., names.index(name)] = (above - below) / distance
        return scores

    def _by_blocks(self, named: Named, compute: Callable[[Named], FloatArray]) -> FloatArray:
        return in_blocks(
            lambda rows: compute(some_draws(named, rows)),
            np.arange(n_draws(named)),
            _BLOCK // ((LOG_WEIGHTS.size + 2) * self.x.size),
        )


def likeliest(y: FloatArray, variance: FloatArray, share: float) -> FloatArray:
    """(n, n_obs) the value f of a curve at which the density N(y; f, variance + (share f)^2) is
    highest; y itself without a share.

    Root of v (y - f (1 + s^2)) + s^2 f (y^2 - y f - s^2 f^2), by Newton's method from that for
    v = 0.
    """
    s2 = share**2
    f = 2.0 * y / (1.0 + np.sqrt(1.0 + 4.0 * s2)) + 0.0 * variance
    for _ in range(6 if share else 0):
        height = variance * (y - f * (1.0 + s2)) + s2 * f * (y**2 - y * f - s2 * f**2)
        f += height / (variance * (1.0 + s2) - s2 * (y**2 - 2.0 * y * f - 3.0 * s2 * f**2))
    return np.asarray(f)


def rooted(information: FloatArray, score: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    """J (m, n_par) and r (m,), m >= n, with J^T J = information and J^T r = -score, rows of zeros
    added; nan where they are not finite.
    """
    if not (all_finite(information) and all_finite(score)):
        return np.full((max(n, score.size), score.size), np.nan), np.full(
            max(n, score.size), np.nan
        )
    scale = diagonal_scale(information)
    stiffness, axes = np.linalg.eigh(information / np.outer(scale, scale))
    rounding = EXACT * score.size * np.max(stiffness, initial=0.0)
    size = np.sqrt(np.where(stiffness > rounding, stiffness, 0.0))
    height = np.divide(
        -(axes.T @ (score / scale)),
        size,
        out=np.zeros_like(size),
        where=size > 1e-9 * np.max(size, initial=0.0),
    )
    rest = max(0, n - score.size)
    return np.vstack([size[:, None] * axes.T * scale, np.zeros((rest, score.size))]), np.append(
        height, np.zeros(rest)
    )


def _shares(terms: FloatArray) -> FloatArray:
    """Terms of a sum over components as shares of it; 0 where the sum is 0."""
    total = log_sum_exp(terms, axis=-1)[..., None]
    return np.exp(terms - finite_or(total, 0.0))


def _error_nodes(tails: Tails, named: Named) -> tuple[FloatArray, FloatArray]:
    """z and weights of a sum over the errors of y."""
    if not tails.robust:
        z, weight = np.polynomial.hermite_e.hermegauss(3)
    else:
        z = np.linspace(-9.0, 9.0, 37)
        weight = np.exp(
            tails.log_density(
                z, {name: float(np.squeeze(named[name])) for name in tails.parameters}
            )
        )
    return z, weight / np.sum(weight)


def _quantiles(density: Predictive, tails: Tails, named: Named, e: FloatArray) -> FloatArray:
    """(n_obs, n) the y of normal scores e (n,), by bisection."""
    sd = np.sqrt(density.variance[0])
    possible = np.isfinite(density.log_weight[0])
    reach = 40.0 if tails.robust else 2.0 * _FAREST
    low = np.min(np.where(possible, density.mean[0] - reach * sd, np.inf), axis=-1)[
        :, None
    ] * np.ones(e.size)
    high = np.max(np.where(possible, density.mean[0] + reach * sd, -np.inf), axis=-1)[
        :, None
    ] * np.ones(e.size)
    points = density.of()
    return bisected(lambda y: points.normal_score(y, tails, named) > e, low, high, 50)
