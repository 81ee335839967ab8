"""A proposal from the normal distributions that a posterior is nearly made of, moved to where it
is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from estim.discrepancy import NormalParts
from estim.discrepancy.grid import prior_grid
from estim.discrepancy.linearised import Linearised, linearise
from estim.discrepancy.normal_parts import normal_parts
from estim.discrepancy.scale_mixture import Shape, diagonalise
from estim.problem.roots import root_of
from estim.sampling import Target, adapt_proposal, proposed_chain
from estim.sampling.certified import Optima
from estim.sampling.importance import kish_ess
from estim.sampling.parts_proposal import proposal_of_parts

N_PAR = 16
# share of the narrow part; how much wider the other is in every second direction
SPIKE, WIDE = 0.85, np.where(np.arange(N_PAR) % 2, 12.0, 1.0)


class Bent:
    """A spike beside a part that is wide in some directions, both bent: normalised, so that the
    mean of density over proposal is 1.
    """

    names = tuple(f"p{i}" for i in range(N_PAR))
    spike = np.full(N_PAR, 0.3)
    centre = np.linspace(-1.0, 1.0, N_PAR)

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        u = draws - self.centre
        first, second = u[:, 0] / 0.3, u[:, 2] / 0.3
        u[:, 5] -= 0.1 * (first**2 - 1.0)
        u[:, 9] -= 0.1 * first * second
        parts = [
            np.log(share) + np.sum(stats.norm.logpdf(u, scale=self.spike * wide), axis=1)
            for share, wide in ((SPIKE, 1.0), (1.0 - SPIKE, WIDE))
        ]
        return np.logaddexp(*parts)

    def parts(self) -> NormalParts:
        """Half a standard deviation off, and straight."""
        covs = np.array([np.diag(self.spike**2), np.diag((self.spike * WIDE) ** 2)])
        return NormalParts(
            np.array([SPIKE, 1.0 - SPIKE]), np.tile(self.centre + 0.15, (2, 1)), covs
        )


def share_and_mean(density: Bent, proposal, rng: np.random.Generator) -> tuple[float, float, float]:
    """Effective share of draws, the mean of their weights and its standard error."""
    draws = proposal.draw(rng, 6000)
    log_ratio = density.log_density(draws) - proposal.log_density(draws)
    ratio = np.exp(log_ratio)
    return (
        kish_ess(log_ratio) / ratio.size,
        float(ratio.mean()),
        float(ratio.std() / np.sqrt(ratio.size)),
    )


def test_a_spike_with_tails_that_bend_is_proposed_as_it_is() -> None:
    density, rng = Bent(), np.random.default_rng(1)
    parts = density.parts()
    proposal = proposal_of_parts(density, parts, density.centre, rng=rng)
    share, mean, error = share_and_mean(density, proposal, rng)
    assert share > 0.5
    assert abs(mean - 1.0) < 4.0 * error < 0.2
    fitted = adapt_proposal(
        density,
        density.centre,
        parts.covs[0],
        rng=rng,
        starts=list(parts.means),
        covs=list(parts.covs),
    )
    assert share_and_mean(density, fitted, rng)[0] < 0.5 * share


def test_parts_that_are_nowhere_near_are_no_proposal() -> None:
    density = Bent()
    far = NormalParts(np.ones(1), density.centre[None] + 40.0, np.diag(density.spike**2)[None])
    assert proposal_of_parts(density, far, far.means[0], rng=np.random.default_rng(1)) is None


def test_a_chain_of_what_is_made_of_parts_takes_its_moves_from_them() -> None:
    density, target = Bent(), Target(max_step=40, n_walker=40)
    parts = density.parts()
    known = Optima(
        density.centre, parts.covs[0], starts=list(parts.means), covs=list(parts.covs), parts=parts
    )
    chains = [
        proposed_chain(density, optima, target=target, seed=1)
        for optima in (known, replace(known, parts=None))
    ]
    assert np.all(chains[0].acceptance > 0.55)
    assert np.all(chains[1].acceptance < 0.35)


def lines(rng: np.random.Generator, slope: int) -> tuple[np.ndarray, np.ndarray, tuple[Shape, ...]]:
    """Residuals and Jacobian of a line in three parameters of which the first, an offset, is shared
    with another; what may deviate from it.
    """
    x = np.linspace(-1.0, 1.0, 12)
    jacobian = np.zeros((12, 3))
    jacobian[:, 0], jacobian[:, slope] = 1.0, x
    return (
        0.2 * rng.standard_normal(12),
        jacobian,
        (Shape("deviation", 1.0, 0.5 * np.cos(np.outer(x, [1.0, 3.0, 5.0])), 0.0),),
    )


def linearised(
    residuals: np.ndarray,
    jacobian: np.ndarray,
    shapes: tuple[Shape, ...],
    precision: np.ndarray,
    score: np.ndarray,
) -> Linearised:
    deviation = diagonalise(
        root_of(np.full(12, 0.04)), shapes, prior_grid(0.7, scales=(1.0,), n_amplitude=4)
    )
    return linearise(
        deviation, residuals, jacobian, precision=precision, pull=np.linalg.solve(precision, score)
    )


def moments(parts: NormalParts) -> tuple[np.ndarray, np.ndarray]:
    mean = parts.weights @ parts.means
    off = parts.means - mean
    return mean, np.einsum("k,kij->ij", parts.weights, parts.covs) + (
        parts.weights[:, None] * off
    ).T @ off


def test_parts_of_one_group_have_the_moments_of_the_linearised_posterior(
    rng: np.random.Generator,
) -> None:
    prior = np.eye(3), np.array([0.1, 0.0, -0.2])
    linear = linearised(*lines(rng, 1), *prior)
    mean, cov = moments(normal_parts([(linear, prior)], prior, np.full(3, 5.0)))
    np.testing.assert_allclose(mean, 5.0 + linear.mean, rtol=1e-9)
    np.testing.assert_allclose(cov, linear.covariance, rtol=1e-6, atol=1e-12)
    # one component alone is another posterior
    assert np.max(np.abs(linear.covariances[0] / linear.covariance - 1.0).diagonal()) > 0.1


def test_parts_of_two_groups_are_those_of_all_their_components(rng: np.random.Generator) -> None:
    """The posterior of the offset is the product of what both groups say of it, over its prior."""
    prior = np.eye(3), np.zeros(3)
    one, other = lines(rng, 1), lines(rng, 2)
    alone = [linearised(*group, *prior) for group in (one, other)]
    told = [
        (np.linalg.inv(a.covariance) - prior[0], np.linalg.solve(a.covariance, a.mean))
        for a in alone
    ]
    besides = [(prior[0] + t[0], prior[1] + t[1]) for t in reversed(told)]
    linear = [
        linearised(*group, *beside) for group, beside in zip((one, other), besides, strict=True)
    ]
    parts = normal_parts(list(zip(linear, besides, strict=True)), prior, np.zeros(3))
    at = np.linspace(-1.0, 1.0, 4001)

    def log_density(a: Linearised) -> np.ndarray:
        sds = np.sqrt(a.covariances[:, 0, 0])
        return np.log(
            np.sum(a.weights[:, None] * stats.norm.pdf(at, a.steps[:, :1], sds[:, None]), axis=0)
        )

    density = np.exp(sum(map(log_density, alone)) - stats.norm.logpdf(at))
    density /= density.sum()
    mean = float(density @ at)
    sd = float(np.sqrt(density @ (at - mean) ** 2))
    found, cov = moments(parts)
    assert abs(found[0] - mean) < 0.05 * sd
    assert abs(np.sqrt(cov[0, 0]) / sd - 1.0) < 0.05
    assert np.sqrt(alone[0].covariance[0, 0]) / sd > 1.2  # one group by itself knows less
