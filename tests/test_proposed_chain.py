"""A chain of more parameters than a second computation is made for: most of its moves propose from
an adapted proposal.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from estim.sampling import Optima, Target, proposed_chain, sample_posterior
from estim.sampling.diagnostics import mcse_mean
from estim.sampling.proposal import Proposal, adapt_proposal

N_PAR = 24
EDGE = 0.3  # sds: the first parameter is cut off there


class Cut:
    """A normal distribution with correlations .5, parameters of very different size, the first of
    which is >= EDGE of its sd.
    """

    names = tuple(f"p{i}" for i in range(N_PAR))
    sd = np.logspace(-3, 3, N_PAR)
    cov = np.outer(sd, sd) * (0.5 + 0.5 * np.eye(N_PAR))

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        z = draws / self.sd
        square = 2.0 * (np.sum(z**2, axis=1) - np.sum(z, axis=1) ** 2 / (N_PAR + 1.0))
        return np.where(z[:, 0] >= EDGE, -0.5 * square, -np.inf)


def test_moments_are_right_and_come_soon() -> None:
    """The first is a truncated normal of known mean m; given it, each other one has mean m/2."""
    density, target = Cut(), Target(ess=1500.0)
    optima = Optima(np.where(np.arange(N_PAR) == 0, 0.6, 0.3) * density.sd, density.cov)
    chain = proposed_chain(density, optima, target=target, seed=3)
    assert chain.convergence.met
    mean = float(stats.truncnorm(EDGE, np.inf).mean())
    expected = np.where(np.arange(N_PAR) == 0, mean, 0.5 * mean) * density.sd
    error = mcse_mean(chain.draws)
    assert np.all(np.abs(chain.flat.mean(axis=0) - expected) < 4.5 * error)
    # a mean of 0, that of the normal distribution without its edge, is far off
    assert np.max(np.abs(chain.flat.mean(axis=0)) / error) > 20.0
    few = Target(ess=1500.0, max_step=chain.convergence.n_step)
    elsewhere = Proposal.single(optima.value + 100.0 * density.sd, density.cov)
    blind = sample_posterior(
        density,
        optima.value,
        optima.cov,
        target=few,
        rng=np.random.default_rng(3),
        proposal=elsewhere,
    )
    assert blind.convergence.tau > 3.0 * chain.convergence.tau or np.isnan(blind.convergence.tau)


class Round:
    """Six independent unit normal distributions, which count how often they are asked."""

    names = tuple(f"p{i}" for i in range(6))

    def __init__(self) -> None:
        self.asked = 0

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        self.asked += len(draws)
        return -0.5 * np.sum(draws**2, axis=1)


@pytest.mark.parametrize("ess", [4000.0, 12000.0])
def test_a_good_proposal_costs_what_the_draws_asked_for_need(ess: float) -> None:
    density = Round()
    proposal = adapt_proposal(density, np.zeros(6), np.eye(6), rng=np.random.default_rng(1))
    density.asked = 0
    chain = sample_posterior(
        density,
        np.zeros(6),
        np.eye(6),
        target=Target(ess=ess),
        rng=np.random.default_rng(2),
        proposal=proposal,
    )
    convergence = chain.convergence
    assert convergence.met
    least = min(convergence.ess_bulk, convergence.ess_tail)
    assert ess <= least < 2.5 * ess
    assert density.asked < 4.5 * least + 4000  # the latter to weigh where walkers start
    error = 1.0 / np.sqrt(least)
    assert np.all(np.abs(chain.flat.mean(axis=0)) < 4.0 * error)
    assert np.all(np.abs(chain.flat.std(axis=0) - 1.0) < 4.0 * error / np.sqrt(2.0))
