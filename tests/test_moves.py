"""Chains driven by a proposal: detailed balance on known targets with good and bad proposals, and a
wrong move that the same test fails.
"""

from __future__ import annotations

from itertools import islice

import emcee
import numpy as np
import pytest
from scipy.stats import multivariate_normal
from targets import COV, Known, banana, bimodal, chain_errors, half_normal, normal

from estim.sampling.chain import Chain, Convergence, Target, sample_posterior
from estim.sampling.ensembles import Apart, sampler_of
from estim.sampling.independence_moves import IndependenceMoves, Moves
from estim.sampling.proposal import Proposal, adapt_proposal


def student(mean: np.ndarray, cov: np.ndarray) -> Proposal:
    return Proposal(np.ones(1), np.asarray(mean, dtype=float)[None], np.linalg.cholesky(cov)[None])


def both_modes(n_par: int) -> Proposal:
    return Proposal(
        np.array([0.5, 0.5]),
        np.array([[-4.0] * n_par, [4.0] * n_par]),
        np.stack([0.6 * np.eye(n_par)] * 2),
    )


def no_independence(known: Known) -> IndependenceMoves:
    """Forty walkers by the other moves alone."""
    return IndependenceMoves(student(np.zeros(4), COV), 0.0, 40, 1, known)


CASES = {
    "normal": (normal(COV), student(np.zeros(4), COV)),
    "normal, wrong centre": (normal(COV), student([0.7, -0.7, 1.0, 0.3], COV)),
    "normal, too narrow": (normal(COV), student(np.zeros(4), 0.3 * COV)),
    "normal, too wide": (normal(COV), student(np.zeros(4), 4.0 * np.diag(np.diag(COV)))),
    "banana": (banana(0.8), student(np.zeros(2), np.diag([1.0, 2.0]))),
    "bounded half-normal": (half_normal(3), student(np.full(3, 0.8), 0.5 * np.eye(3))),
    "two modes": (bimodal(2), both_modes(2)),
}
# by the whole sampler; the others in `make test-long`
SAMPLED = ("normal, wrong centre", "banana", "bounded half-normal", "two modes")


def move_alone(known: Known, proposal: Proposal, *, n_step: int, seed: int) -> Chain:
    """Two ensembles moved by nothing but independence moves; the first tenth discarded."""
    moves = Moves(IndependenceMoves(proposal, 1.0, 120, seed, known), ())
    sampler = emcee.EnsembleSampler(
        120, known.mean.size, known.log_density, vectorize=True, moves=moves
    )
    sampler.random_state = np.random.RandomState(seed).get_state()
    points = proposal.draw(np.random.default_rng(seed), 4000)
    start = points[np.isfinite(known.log_density(points))][:120]
    sampler.run_mcmc(start, n_step, skip_initial_state_check=True)
    draws = np.moveaxis(
        sampler.get_chain(discard=n_step // 10).reshape(-1, 2, 60, known.mean.size), 1, 0
    )
    return Chain(
        known.names,
        draws,
        np.zeros(draws.shape[:-1]),
        0,
        np.ones(2),
        0,
        Convergence(n_step, 1.0, 0.0, 0.0, 1.0, True, ()),
    )


def worst(chain: Chain, known: Known) -> float:
    """Largest deviation of a mean or a standard deviation from the truth in Monte-Carlo errors."""
    u_mean, u_sd = chain_errors(chain)
    return float(
        max(
            np.max(np.abs(chain.flat.mean(axis=0) - known.mean) / u_mean),
            np.max(np.abs(chain.flat.std(axis=0) - known.sd) / u_sd),
        )
    )


class WithoutFactor(Proposal):
    """The wrong move: proposes from the same distribution and forgets its density."""

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        return np.zeros(len(draws))


class UpsideDown(Proposal):
    """The other wrong move: the factor with the wrong sign."""

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        return -super().log_density(draws)


@pytest.mark.parametrize("name", CASES)
def test_independence_move_alone_leaves_the_target_as_it_is(name: str) -> None:
    known, proposal = CASES[name]
    assert worst(move_alone(known, proposal, n_step=1500, seed=21), known) < 4.5


@pytest.mark.parametrize(
    ("name", "wrong"),
    [("normal, wrong centre", WithoutFactor), ("bounded half-normal", UpsideDown)],
)
def test_move_with_a_wrong_factor_fails_the_same_test(name: str, wrong: type[Proposal]) -> None:
    known, right = CASES[name]
    proposal = wrong(right.weights, right.means, right.factors)
    assert worst(move_alone(known, proposal, n_step=1500, seed=21), known) > 10.0


@pytest.mark.parametrize(
    "name",
    [
        name if name in SAMPLED else pytest.param(name, marks=pytest.mark.statistics)
        for name in CASES
    ],
)
def test_sampler_with_a_proposal_reproduces_the_target(name: str, rng: np.random.Generator) -> None:
    known, proposal = CASES[name]
    start = np.where(known.mean == 0.0, 0.0, np.abs(known.mean))
    chain = sample_posterior(
        known, start, np.diag(known.sd**2), target=Target(ess=3000), rng=rng, proposal=proposal
    )
    assert chain.convergence.met, chain.convergence.message
    assert worst(chain, known) < 4.5
    assert chain.stuck == 0


def test_hopeless_proposal_costs_time_and_not_correctness(rng: np.random.Generator) -> None:
    """Proposal of another place, nothing of which is ever accepted: the other moves do the work,
    and the walkers start around the fit.
    """
    known = normal(COV)
    elsewhere = student(np.full(4, 300.0), 0.01 * COV)
    chain = sample_posterior(
        known, np.zeros(4), COV, target=Target(ess=2000), rng=rng, proposal=elsewhere
    )
    assert chain.convergence.met
    assert worst(chain, known) < 4.5
    quick = sample_posterior(
        known,
        np.zeros(4),
        COV,
        target=Target(ess=2000),
        rng=rng,
        proposal=student(np.zeros(4), COV),
    )
    assert quick.convergence.n_step < 0.4 * chain.convergence.n_step


@pytest.mark.slow
def test_proposal_that_misses_a_mode_does_not_pass_for_converged_when_walkers_see_both() -> None:
    """Both modes are in the starting scatter, the proposal knows one: R-hat or tau must object, or
    the answer be right.
    """
    known = bimodal(2)
    wide = Proposal(
        np.array([0.9, 0.1]),
        np.array([[-4.0] * 2, [0.0] * 2]),
        np.stack([0.5 * np.eye(2), 6.0 * np.eye(2)]),
    )
    chain = sample_posterior(
        known,
        np.zeros(2),
        20.0 * np.eye(2),
        target=Target(max_step=3000),
        rng=np.random.default_rng(3),
        proposal=wide,
    )
    assert not chain.convergence.met or worst(chain, known) < 4.5


def test_default_target_is_met_in_few_steps_with_an_adapted_proposal(
    rng: np.random.Generator,
) -> None:
    known = normal(COV)
    proposal = adapt_proposal(known, np.zeros(4), COV, rng=rng)
    chain = sample_posterior(known, np.zeros(4), COV, target=Target(), rng=rng, proposal=proposal)
    assert chain.convergence.met
    assert chain.convergence.n_step < 400
    assert np.all(chain.acceptance > 0.5)


def test_same_seed_same_draws_with_a_proposal_whatever_numpy_s_global_state() -> None:
    def draws(global_seed: int) -> np.ndarray:
        np.random.seed(global_seed)  # noqa: NPY002  (the state that must not matter)
        proposal = student(np.zeros(4), COV)
        return sample_posterior(
            normal(COV),
            np.zeros(4),
            COV,
            target=Target(ess=100),
            rng=np.random.default_rng(7),
            proposal=proposal,
        ).draws

    assert np.array_equal(draws(1), draws(2))


def test_ensembles_stay_apart_through_the_whole_sampler() -> None:
    """Two ensembles 1e6 apart: a step that put a walker of one among those of the other would take
    its differences from both.
    """
    flat = Known(lambda draws: np.zeros(len(draws)), 0.0, np.zeros(4), np.ones(4))
    start = np.random.default_rng(1).standard_normal((40, 4))
    start[20:] += 1e6
    sampler = sampler_of(flat, (2, 20), no_independence(flat), seed=3)
    sampler.run_mcmc(start, 3, skip_initial_state_check=True)
    found = sampler.get_last_sample().coords
    assert not np.array_equal(found, start)
    assert max(np.ptp(found[:20]), np.ptp(found[20:])) < 1e4


def test_every_step_has_proposals_of_its_own_with_their_densities() -> None:
    known, proposal = normal(COV), student(np.zeros(4), COV)
    made = [
        one
        for one in islice(IndependenceMoves(proposal, 0.5, 10, 4, known).steps(), 100)
        if one is not None
    ]
    assert 30 < len(made) < 70
    assert len({one[0].tobytes() for one in made}) == len(made)
    for points, log_density, log_proposal in made:
        np.testing.assert_allclose(log_density, known.log_density(points), rtol=1e-12)
        np.testing.assert_allclose(log_proposal, proposal.log_density(points), rtol=1e-12)


def test_capped_chain_with_a_proposal_says_that_it_did_not_converge(
    rng: np.random.Generator,
) -> None:
    chain = sample_posterior(
        normal(COV),
        np.zeros(4),
        COV,
        target=Target(ess=1e9, max_step=100),
        rng=rng,
        proposal=student(np.zeros(4), COV),
    )
    assert not chain.convergence.met
    assert chain.convergence.n_step == 100
    short = sample_posterior(
        normal(COV),
        np.zeros(4),
        COV,
        target=Target(max_step=50),
        rng=rng,
        proposal=student(np.zeros(4), COV),
    )
    assert not short.convergence.met
    assert short.convergence.n_step == 50


def test_a_wide_part_that_is_told_keeps_its_share_of_the_draws(rng: np.random.Generator) -> None:
    """Half a per cent of a posterior in twelve dimensions is four times as wide along two of them:
    seldom drawn, and no walker leaves it soon.
    """
    d = 12
    wide = np.diag([16.0, 16.0, *np.ones(d - 2)])

    class Rare:
        names = tuple(f"p{i}" for i in range(d))

        def log_density(self, draws: np.ndarray) -> np.ndarray:
            parts = [
                multivariate_normal(np.zeros(d), cov).logpdf(draws) for cov in (np.eye(d), wide)
            ]
            return np.logaddexp(np.log(0.995) + parts[0], np.log(0.005) + parts[1])

    density, far = Rare(), rng.multivariate_normal(np.zeros(d), wide, size=4000)
    largest = []
    for covs in ([wide], []):
        proposal = adapt_proposal(
            density,
            np.zeros(d),
            np.eye(d),
            rng=np.random.default_rng(1),
            starts=[np.zeros(d)],
            covs=covs,
        )
        largest.append(float(np.exp(np.max(density.log_density(far) - proposal.log_density(far)))))
    assert largest[0] < 20.0
    assert largest[1] > 500.0


def test_ensembles_that_move_together_never_see_each_other() -> None:
    """What R-hat compares: a difference between walkers of two ensembles would be a million."""
    walkers = np.random.default_rng(1).standard_normal((40, 4))
    walkers[20:] += 1e6
    for move in (emcee.moves.DEMove(), emcee.moves.StretchMove()):
        apart = Apart(move, 2)
        apart.setup(walkers)
        points, _ = apart.get_proposal(walkers[::2], [walkers[1::2]], np.random.RandomState(2))
        assert np.min(np.max(np.abs(points - walkers[::2]), axis=1)) > 0.0
        assert np.max(np.abs(points - walkers[::2])) < 30.0
        move.setup(walkers)
        assert (
            np.max(
                np.abs(
                    move.get_proposal(walkers[::2], [walkers[1::2]], np.random.RandomState(2))[0]
                    - walkers[::2]
                )
            )
            > 1e5
        )


def test_ensembles_that_start_alike_draw_their_own_numbers() -> None:
    start = np.tile(np.random.default_rng(5).standard_normal((20, 4)), (2, 1))
    sampler = sampler_of(normal(COV), (2, 20), no_independence(normal(COV)), seed=3)
    sampler.run_mcmc(start, 30, skip_initial_state_check=True)
    assert len(np.unique(sampler.get_last_sample().coords, axis=0)) == 40
