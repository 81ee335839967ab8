"""The sampler on targets whose moments are known, and its refusal to call an unfinished chain
finished.
"""

from __future__ import annotations

from dataclasses import dataclass

import emcee
import numpy as np
import pytest

from estim.sampling.chain import Target, sample_posterior
from estim.sampling.diagnostics import mcse_mean, mixing_of


@dataclass(frozen=True, eq=False)
class Gaussian:
    """A correlated normal distribution."""

    cov: np.ndarray

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"p{i}" for i in range(len(self.cov)))

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        return np.asarray(-0.5 * np.sum(draws @ np.linalg.inv(self.cov) * draws, axis=1))


@dataclass(frozen=True)
class Wedge:
    """exp(-x) for x > 0 times a normal of width exp(x/2): skewed, bounded and with a changing
    scale.
    """

    names: tuple[str, ...] = ("x", "y")

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        x, y = draws.T
        inside = x > 0.0
        return np.where(
            inside, -x - 0.5 * y**2 * np.exp(-np.where(inside, x, 0.0)) - 0.5 * x, -np.inf
        )


COV = np.array(
    [[1.0, 0.9, 0.0, 0.0], [0.9, 1.0, 0.0, 0.0], [0.0, 0.0, 4.0, -1.0], [0.0, 0.0, -1.0, 0.5]]
)


def test_sampler_reproduces_a_correlated_normal(rng: np.random.Generator) -> None:
    chain = sample_posterior(Gaussian(COV), np.zeros(4), COV, target=Target(ess=5000), rng=rng)
    assert chain.convergence.met
    sds = np.sqrt(np.diag(COV))
    size = mixing_of(chain.draws).ess_bulk
    assert np.all(np.abs(chain.flat.mean(axis=0)) < 4.0 * sds / np.sqrt(size))
    # a standard deviation from n independent draws is uncertain by 1/sqrt(2 n)
    assert np.all(np.abs(chain.flat.std(axis=0) / sds - 1.0) < 4.0 / np.sqrt(2.0 * size))


@pytest.mark.slow
def test_snooker_move_would_fail_the_same_check() -> None:
    """The wrong move that DESIGN warns of: the check above must be able to see it."""
    sampler = emcee.EnsembleSampler(
        64, 4, Gaussian(np.eye(4)).log_density, vectorize=True, moves=emcee.moves.DESnookerMove()
    )
    sampler.random_state = np.random.RandomState(5).get_state()
    sampler.run_mcmc(np.random.default_rng(5).standard_normal((64, 4)), 1500)
    draws = sampler.get_chain(discard=500)[None]
    deviation = np.abs(draws.reshape(-1, 4).std(axis=0) - 1.0)
    assert np.any(deviation > 4.0 / np.sqrt(2.0 * mixing_of(draws).ess_bulk))


@pytest.mark.slow
def test_sampler_reproduces_a_bounded_skewed_target(rng: np.random.Generator) -> None:
    chain = sample_posterior(
        Wedge(), np.array([0.5, 0.0]), np.diag([0.5, 1.0]), target=Target(ess=4000), rng=rng
    )
    assert chain.convergence.met
    x = chain.flat[:, 0]
    error = 1.0 / np.sqrt(mixing_of(chain.draws).ess_bulk[0])
    # the marginal of x is the unit exponential
    assert abs(x.mean() - 1.0) < 4.0 * error
    for q in (0.025, 0.16, 0.5, 0.84, 0.975):
        tail = np.mean(x < -np.log1p(-q))
        assert abs(tail - q) < 4.0 * np.sqrt(q * (1.0 - q)) * error


def test_same_seed_same_draws_and_numpy_global_state_has_no_say() -> None:
    def draws(seed: int) -> np.ndarray:
        np.random.seed(seed)  # noqa: NPY002  (the state that must not matter)
        chain = sample_posterior(
            Gaussian(COV),
            np.zeros(4),
            COV,
            target=Target(ess=100, max_step=100),
            rng=np.random.default_rng(7),
        )
        return chain.draws

    assert np.array_equal(draws(1), draws(2))


def test_capped_chain_says_that_it_did_not_converge(rng: np.random.Generator) -> None:
    chain = sample_posterior(
        Gaussian(COV), np.zeros(4), COV, target=Target(ess=1e9, max_step=400, n_walker=32), rng=rng
    )
    assert not chain.convergence.met
    assert chain.convergence.n_step == 400
    assert "ESS" in chain.convergence.message


def test_r_hat_sees_ensembles_that_disagree(rng: np.random.Generator) -> None:
    draws = rng.standard_normal((4, 500, 16, 1))
    assert mixing_of(draws).rhat[0] < 1.01
    draws[0] += 0.5
    assert mixing_of(draws).rhat[0] > 1.02


def test_mcse_is_that_of_independent_draws(rng: np.random.Generator) -> None:
    draws = rng.standard_normal((2, 400, 10, 1))
    assert mcse_mean(draws)[0] == pytest.approx(1.0 / np.sqrt(draws.size), rel=0.1)


def test_no_walker_starts_outside_the_support(rng: np.random.Generator) -> None:
    chain = sample_posterior(
        Wedge(), np.array([1e-6, 0.0]), np.eye(2), target=Target(ess=100, max_step=400), rng=rng
    )
    assert np.all(np.isfinite(chain.log_density))
    assert chain.stuck == 0
