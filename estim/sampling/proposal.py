"""A proposal adapted to a posterior: a Student-t distribution with 5 degrees of freedom, or a small
mixture of them.

It lives in the space of the parameters themselves.  A Student-t density is finite and positive at a
hard edge, so that weights stay bounded there (transformed parameters would put the edge at
infinity, where the tails of the transformed posterior decide).  Draws outside the support have
weight 0.

`adapt_proposal` starts from the fit and maximises sum_i w_i log q(x_i) over weighted draws of the
round before: EM steps for Student-t mixtures (Cappe, Douc, Guillin, Marin, Robert, Statistics and
Computing 18 (2008) 447, section 4).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from estim.arrays import FloatArray, in_blocks, log_sum_exp
from estim.common import NumericalError
from estim.sampling.cholesky import lower_factor
from estim.sampling.importance import kish_ess, pareto_smoothed, tempered
from estim.sampling.log_density import Density, log_density_in_batches

DOF = 5  # tails heavier than those of most posteriors
_BLOCK = 500  # draws at once: what many components need of them fits in the cache
_N_COMPONENT = 8  # of a mixture fitted to draws from elsewhere
# share and width (in sds of the whole) of the component that guards a mixture
_WIDE_SHARE, _WIDE_FACTOR = 0.05, 2.0
_FAR_SHARE, _FAR_FACTOR = 0.25, 3.0  # the same for `Proposal.widened`


@dataclass(frozen=True, eq=False)
class Proposal:
    """sum_k weights_k t_dof(x; means_k, factors_k factors_k^T).

    weights : (n_component,), sum 1.
    means : (n_component, n_par).
    factors : (n_component, n_par, n_par) lower Cholesky factors of the scale matrices (covariance =
        dof/(dof - 2) of it).
    dof : degrees of freedom of all components.
    """

    weights: FloatArray
    means: FloatArray
    factors: FloatArray
    dof: int = DOF

    @property
    def n_par(self) -> int:
        return int(self.means.shape[1])

    @cached_property
    def _whitening(self) -> FloatArray:
        """(n_component * n_par, n_par + 1) what makes [draw - means_0, 1] distances from the
        centres.
        """
        inverse = np.linalg.inv(self.factors)
        centres = inverse @ (self.means[0] - self.means)[:, :, None]
        return np.concatenate([inverse, centres], axis=2).reshape(-1, self.n_par + 1)

    @cached_property
    def _log_heights(self) -> FloatArray:
        """(n_component,) log of weight times density at the centre."""
        d = self.n_par
        unit = (
            math.lgamma(0.5 * (self.dof + d))
            - math.lgamma(0.5 * self.dof)
            - 0.5 * d * math.log(self.dof * math.pi)
        )
        with np.errstate(divide="ignore"):  # a component may have no weight
            heights = np.log(self.weights)
        return heights + unit - np.sum(np.log(np.diagonal(self.factors, axis1=1, axis2=2)), axis=1)

    @classmethod
    def single(cls, mean: FloatArray, scale: FloatArray) -> Proposal:
        """One component: mean (n_par,), scale matrix (n_par, n_par)."""
        return cls(np.ones(1), mean[None], lower_factor(scale)[None])

    def widened(self) -> Proposal:
        """A quarter of the draws from three times as far around.

        A proposal that was adapted to draws of itself may miss a long tail (of an outlier's width,
        say), and weights cannot show what was never drawn.  Where the wide draws find something,
        k-hat and the effective size show it.
        """
        return self.guarded(_FAR_SHARE, _FAR_FACTOR)

    def guarded(self, share: float, factor: float) -> Proposal:
        """A `share` of the draws from `factor` times as far around."""
        mean = self.weights @ self.means
        deviations = self.means - mean
        scale = (
            np.einsum("k,kij,klj->il", self.weights, self.factors, self.factors)
            + (self.weights[:, None] * deviations).T @ deviations
        )
        return self.mixed_with(Proposal.single(mean, factor**2 * scale), share)

    def mixed_with(self, other: Proposal, share: float) -> Proposal:
        """A `share` of the draws from another proposal."""
        return replace(
            self,
            weights=np.concatenate([(1.0 - share) * self.weights, share * other.weights]),
            means=np.vstack([self.means, other.means]),
            factors=np.concatenate([self.factors, other.factors]),
        )

    def draw(self, rng: np.random.Generator, n: int) -> FloatArray:
        """(n, n_par) independent draws."""
        normal = (
            rng.standard_normal((n, self.n_par))
            / np.sqrt(rng.chisquare(self.dof, n) / self.dof)[:, None]
        )
        if self.weights.size == 1:
            return self.means[0] + normal @ self.factors[0].T
        which = rng.choice(self.weights.size, n, p=self.weights)
        return self.means[which] + np.einsum("nij,nj->ni", self.factors[which], normal)

    def distances(self, draws: FloatArray) -> FloatArray:
        """(n_component, n_draw) squared distances from the centres in units of the scale
        matrices.
        """
        columns = np.vstack([(draws - self.means[0]).T, np.ones(len(draws))])
        whitened = (self._whitening @ columns).reshape(*self.means.shape, -1)
        return np.einsum("kin,kin->kn", whitened, whitened)

    def component_log_densities(self, distances: FloatArray) -> FloatArray:
        """(n_component, n_draw) log of weight times density of each component."""
        # several times faster than log1p, whose digits nobody needs
        tails = np.log(1.0 + distances / self.dof)
        return self._log_heights[:, None] - 0.5 * (self.dof + self.n_par) * tails

    def log_density(self, draws: FloatArray) -> FloatArray:
        """(n_draw,) normalised log density at draws (n_draw, n_par)."""

        def log_densities(some: FloatArray) -> FloatArray:
            return log_sum_exp(self.component_log_densities(self.distances(some)), axis=0)

        return in_blocks(log_densities, draws, _BLOCK)


def adapt_proposal(
    density: Density,
    start: FloatArray,
    cov: FloatArray,
    *,
    rng: np.random.Generator,
    starts: Sequence[FloatArray] = (),
    covs: Sequence[FloatArray] = (),
    n_round: int = 2000,
) -> Proposal:
    """A proposal adapted to `density` from one component at each start.

    start : (n_par,) the fit.
    cov : (n_par, n_par) the covariance there, used at the other `starts` (further modes) too where
        they have no `covs`.
    covs : those of `starts`, whose components then keep two fifths of the draws whatever the rounds
        make of the others.
    n_round : draws in each round, at least 500 for each start.  Where one Student-t gives uneven
        weights, mixtures of more are tried and kept if better.

    Raises NumericalError where the density is nowhere finite around the fit.
    """
    centres = np.vstack([start, *starts])
    n_round = max(n_round, 500 * len(centres))
    factors = lower_factor(np.stack([cov, *(covs or [cov] * len(starts))]))
    mixture = _equally_weighted(centres, factors)
    best, quality, draws, weights = _adapted(
        density, _shrunk_into_support(density, mixture, rng), rng, n_round
    )
    for n_component in (4, 8):
        # effective share of the draws above which one Student-t suffices; it falls with the number
        # of parameters, because the weights become less even
        if quality > 0.4 * min(1.0, 6.0 / mixture.n_par):
            break
        split = _split(draws, weights, max(n_component, len(centres) + 1), rng)
        candidate, better, candidate_draws, candidate_weights = _adapted(
            density, split, rng, 4 * n_round
        )
        if better > 1.15 * quality:
            best, quality, draws, weights = candidate, better, candidate_draws, candidate_weights
    # 40 % of the draws come from components around modes that are known: a wide mode of little
    # weight is seldom drawn, and a chain that has entered it does not leave it soon
    return best.mixed_with(_equally_weighted(centres[1:], factors[1:]), 0.4) if covs else best


def _equally_weighted(means: FloatArray, factors: FloatArray) -> Proposal:
    return Proposal(np.full(len(means), 1.0 / len(means)), means, factors)


def _adapted(
    density: Density, mixture: Proposal, rng: np.random.Generator, n_round: int
) -> tuple[Proposal, float, FloatArray, FloatArray]:
    """Rounds of (draw; weigh; fit) until weights get no more even: best proposal, its quality, its
    draws and weights.
    """
    proposal = mixture
    rounds: list[tuple[Proposal, float, FloatArray, FloatArray]] = []
    for _ in range(12):
        draws = proposal.draw(rng, n_round)
        log_ratio = log_density_in_batches(density, draws) - proposal.log_density(draws)
        if not np.any(np.isfinite(log_ratio)):
            break
        quality = _quality(log_ratio)
        weights = tempered(log_ratio, least=min(0.1 * n_round, 20.0 * proposal.n_par))
        rounds.append((proposal, quality, draws, weights))
        # from 0.7 on, one more round costs more draws than it can save
        if (len(rounds) > 1 and quality > 0.7) or (
            len(rounds) > 2 and 0.05 < quality < 1.1 * max(f[1] for f in rounds[:-1])
        ):
            break
        mixture = _fit(mixture, draws, weights)
        proposal = _guarded(mixture, draws, weights)
    if not rounds:
        raise NumericalError(
            "importance sampling cannot start: the posterior density is zero or not finite "
            "everywhere around the fit"
        )
    return max(rounds, key=lambda f: f[1])


def _quality(log_ratio: FloatArray) -> float:
    """Effective share of weighted draws; a third of it where k-hat shows that a tail is missed."""
    share = kish_ess(log_ratio) / log_ratio.size
    return share if pareto_smoothed(log_ratio)[1] <= 0.5 else share / 3.0


def _fit(mixture: Proposal, draws: FloatArray, weights: FloatArray) -> Proposal:
    """EM steps of a Student-t mixture towards weighted draws; components that explain next to
    nothing are dropped.
    """
    floor, d = 1e-8 * _covariance(draws, weights)[1], mixture.n_par
    used = weights > 0.0
    draws, weights = draws[used], weights[used]
    for _ in range(25):
        distances = mixture.distances(draws)
        parts = mixture.component_log_densities(distances)
        heights = np.exp(parts - np.max(parts, axis=0))
        share = heights * (weights / np.sum(heights, axis=0))
        size = np.sum(share, axis=1)
        # a component must rest on enough draws for a covariance
        components = np.flatnonzero(
            size**2 / np.maximum(np.sum(share**2, axis=1), 1e-300) > 3.0 * d
        )
        if components.size == 0:
            break
        pull = share * (DOF + d) / (DOF + distances)
        means, scales = [], []
        for k in components:
            mean = pull[k] @ draws / np.sum(pull[k])
            deviation = draws - mean
            means.append(mean)
            scales.append((pull[k][:, None] * deviation).T @ deviation / size[k] + floor)
        before = mixture
        mixture = Proposal(
            size[components] / np.sum(size[components]),
            np.array(means),
            lower_factor(np.array(scales)),
        )
        converged = (
            components.size == before.weights.size
            and np.max(np.abs(mixture.weights - before.weights)) < 1e-3
        )
        if converged and np.max(before.distances(mixture.means).diagonal()) < 1e-5:
            break
    return mixture


def _split(
    draws: FloatArray, weights: FloatArray, n_component: int, rng: np.random.Generator
) -> Proposal:
    """A mixture of equal components centred on draws that lie far from each other, each a part of
    the whole in width.
    """
    mean, cov = _covariance(draws, weights)
    factor = lower_factor(cov)
    whitened = np.linalg.solve(factor, (draws - mean).T).T
    centres, nearest = [int(rng.choice(weights.size, p=weights))], np.full(weights.size, np.inf)
    for _ in range(n_component - 1):
        nearest = np.minimum(nearest, np.sum((whitened - whitened[centres[-1]]) ** 2, axis=1))
        chance = weights * nearest
        if not np.sum(chance) > 0.0:  # a single draw has all the weight: nothing to part
            break
        centres.append(int(rng.choice(weights.size, p=chance / np.sum(chance))))
    n = len(centres)
    factors = np.stack([n ** (-1.0 / draws.shape[1]) * factor] * n)
    return _fit(_equally_weighted(draws[centres], factors), draws, weights)


def _guarded(mixture: Proposal, draws: FloatArray, weights: FloatArray) -> Proposal:
    """A mixture of several with a wide component added, so that no region between and around them
    is without draws.
    """
    if mixture.weights.size == 1:
        return mixture
    mean, cov = _covariance(draws, weights)
    return mixture.mixed_with(Proposal.single(mean, _WIDE_FACTOR**2 * cov), _WIDE_SHARE)


def mixture_of_draws(draws: FloatArray, rng: np.random.Generator) -> Proposal:
    """A mixture fitted to draws (n_draw, n_par) of equal weight that come from elsewhere, with the
    component that guards it.
    """
    weights = np.full(len(draws), 1.0 / len(draws))
    return _guarded(_split(draws, weights, _N_COMPONENT, rng), draws, weights)


def _shrunk_into_support(density: Density, mixture: Proposal, rng: np.random.Generator) -> Proposal:
    """`mixture`, narrowed until one draw in 50 at least lies inside the support."""
    for _ in range(30):
        if np.mean(np.isfinite(density.log_density(mixture.draw(rng, 500)))) >= 0.02:
            break
        mixture = replace(mixture, factors=0.5 * mixture.factors)
    return mixture


def _covariance(draws: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    mean = weights @ draws
    deviation = draws - mean
    return mean, (weights[:, None] * deviation).T @ deviation
