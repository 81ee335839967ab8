"""Proposals folded at hard edges and bent along ridges: their densities are exact, and they fit posteriors that lean on an edge."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from targets import Known, half_normal, normal

from estim.sampling import folding
from estim.sampling.bending import Bend, bend_of
from estim.sampling.folding import half_power
from estim.sampling.importance import pareto_smoothed
from estim.sampling.proposal import Proposal, adapt_proposal, grown

FREE = np.inf


def _orthant(rho: float) -> Known:
    """Normal with unit variances, two parameters positive and a third that follows both: P(x > 0, y > 0) = 1/4 + arcsin(rho)/(2 pi) (Sheppard)."""
    cov = np.array([[1.0, rho, 0.6], [rho, 1.0, 0.5], [0.6, 0.5, 1.0]])
    precision = np.linalg.inv(cov)
    height = -0.5 * np.log(np.linalg.det(2.0 * np.pi * cov))

    def log_density(x: np.ndarray) -> np.ndarray:
        return np.where(np.all(x[:, :2] >= 0.0, axis=1), height - 0.5 * np.einsum("ni,ij,nj->n", x, precision, x), -np.inf)

    share = 0.25 + math.asin(rho) / (2.0 * math.pi)
    mean = np.full(3, (1.0 + rho) / (2.0 * math.sqrt(2.0 * math.pi) * share))  # of the first two
    return Known(log_density, math.log(share), mean, np.ones(3))


def _uniform(x: np.ndarray) -> np.ndarray:
    return np.where(np.all((x >= 0.0) & (x <= 1.0), axis=1), 0.0, -np.inf)


FIRST = (np.array([0.0, -FREE, -FREE, -FREE]), np.full(4, FREE))
POSITIVE = np.array([0.0, 0.0, -FREE]), np.full(3, FREE)
SLANTED = np.array([[1.0, 0.5, 0.6], [0.5, 1.0, 0.5], [0.6, 0.5, 1.0]])
NARROW = np.array([[1.0, 0.95, 0.6], [0.95, 1.0, 0.5], [0.6, 0.5, 1.0]])
BOX = Known(_uniform, 0.0, np.full(2, 0.5), np.full(2, 12**-0.5))

LEAN = {
    "half-normal at 0": (half_normal(4), Proposal.single(np.zeros(4), 0.8 * np.eye(4)), (np.zeros(4), np.full(4, FREE))),
    "mean beyond the edge": (half_normal(4), Proposal.single(np.full(4, -0.4), np.eye(4)), (np.zeros(4), np.full(4, FREE))),
    "correlated": (_orthant(0.5), Proposal.single(np.full(3, 0.5), SLANTED), POSITIVE),
    "narrow ridge into a corner": (_orthant(0.96), Proposal.single(np.full(3, 0.4), NARROW), POSITIVE),
    "two edges": (BOX, Proposal.single(np.array([0.4, 0.7]), 0.3**2 * np.eye(2)), (np.zeros(2), np.ones(2))),
}


def _evidence(known: Known, proposal: Proposal, rng: np.random.Generator) -> tuple[float, float]:
    """Evidence by plain importance sampling less the true one, in standard errors; the effective share of the draws."""
    draws = proposal.draw(rng, 40_000)
    weights = np.exp(known.log_density(draws) - proposal.log_density(draws))
    error = np.std(weights) / math.sqrt(weights.size)
    return float((np.mean(weights) - math.exp(known.log_evidence)) / error), float(np.sum(weights) ** 2 / np.sum(weights**2) / weights.size)


@pytest.mark.parametrize("case", LEAN)
def test_a_folded_proposal_gives_the_known_evidence_and_one_without_its_images_does_not(
    case: str, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    known, plain, limits = LEAN[case]
    folded = replace(plain, limits=limits)
    z, share = _evidence(known, folded, rng)
    assert abs(z) < 4.0
    assert share > 1.3 * _evidence(known, plain, rng)[1]
    everything = folding.Folding.distances
    monkeypatch.setattr(folding.Folding, "distances", lambda self, columns, k: everything(self, columns, k)[:1])
    assert abs(_evidence(known, folded, rng)[0]) > 10.0


@pytest.mark.parametrize("case", LEAN)
def test_inside_the_edges_a_folded_density_is_nowhere_below_the_plain_one(case: str, rng: np.random.Generator) -> None:
    _, plain, (low, high) = LEAN[case]
    folded = replace(plain, limits=(low, high))
    draws = folded.draw(rng, 2000)
    draws = draws[np.all((draws >= low) & (draws <= high), axis=1)]
    assert len(draws) > 1200
    assert np.all(folded.log_density(draws) >= plain.log_density(draws) - 1e-12)


def test_means_of_a_truncated_normal_distribution_are_right(rng: np.random.Generator) -> None:
    known, plain, limits = LEAN["correlated"]
    folded = replace(plain, limits=limits)
    draws = folded.draw(rng, 40_000)
    log_weights, k_hat, _ = pareto_smoothed(known.log_density(draws) - folded.log_density(draws))
    weights = np.exp(log_weights)
    error = np.sqrt(weights**2 @ (draws - known.mean) ** 2)
    assert k_hat < 0.5
    assert np.all(np.abs(weights @ draws - known.mean)[:2] < 4.0 * error[:2])


def test_a_mixture_folds_each_component_at_the_edges_in_its_reach(rng: np.random.Generator) -> None:
    means = np.array([[0.3, 0.0, 0.0, 0.0], [9.0, 0.0, 0.0, 0.0]])
    far = Proposal(np.array([0.5, 0.5]), means, np.stack([np.eye(4)] * 2), FIRST)
    assert far._folding is not None
    assert [len(edges) for edges in far._folding.edges] == [1, 0]
    known = _banana(4, 0.0)
    assert abs(_evidence(known, far, rng)[0]) < 4.0
    assert abs(_evidence(known, far.widened(), rng)[0]) < 4.0


def test_what_folds_is_drawn_from_the_cholesky_factor_in_its_own_order() -> None:
    """So that a seed gives the draws that it gives without folds."""
    cov = np.array([[2.0, 0.6, -0.4], [0.6, 1.0, 0.3], [-0.4, 0.3, 1.5]])
    found = folding.folding(np.ones(1), np.zeros((1, 3)), np.linalg.cholesky(cov)[None], np.array([-FREE, -FREE, 0.0]), np.full(3, FREE))
    assert found.order.tolist() == [2, 0, 1]
    np.testing.assert_allclose(found.factors[0], np.linalg.cholesky(cov[np.ix_(found.order, found.order)]), atol=1e-12)


def test_what_folds_to_an_exponential_distribution_starts_at_its_edge() -> None:
    low, high = np.array([0.0, -FREE]), np.full(2, FREE)
    mean, factor = folding.unfolded(np.array([1.0, 2.0]), np.linalg.cholesky(np.array([[1.0, 0.5], [0.5, 1.0]])), low, high)
    assert mean == pytest.approx([0.0, 1.5])  # the other follows by its slope of 1/2
    assert (factor @ factor.T)[0] == pytest.approx([2.0, 1.0])
    far = np.array([5.0, 0.0]), np.eye(2)
    assert folding.unfolded(*far, low, high) == far


def test_far_away_a_folded_density_is_small_and_known() -> None:
    folded = Proposal(np.ones(1), np.zeros((1, 4)), np.eye(4)[None], FIRST)
    near, far = folded.log_density(np.array([[1e30, 0.0, 0.0, 0.0], [1e80, 0.0, 0.0, 0.0]]))
    assert near - far == pytest.approx(9.0 * 50.0 * math.log(10.0))  # |x|^-(5 + 4)


def _banana(n_par: int, bend: float) -> Known:
    """Standard normal u, x1 = u1 + bend (x0^2 - 1), x0 > 0: volumes stay, so that half of the evidence is left."""

    def log_density(x: np.ndarray) -> np.ndarray:
        u = x.copy()
        u[:, 1] -= bend * (x[:, 0] ** 2 - 1.0)
        return np.where(x[:, 0] > 0.0, -0.5 * np.sum(u**2, axis=1), -np.inf)

    return Known(log_density, math.log(0.5) + 0.5 * n_par * math.log(2.0 * math.pi), np.zeros(n_par), np.ones(n_par))


def _adapted(known: Known, n_par: int, low: float, rng: np.random.Generator, *, told: bool) -> Proposal:
    support = np.array([low, *[-FREE] * (n_par - 1)]), np.full(n_par, FREE)
    return adapt_proposal(known, np.zeros(n_par), np.eye(n_par), rng=rng, support=support if told else None)


def test_a_bent_ridge_that_ends_at_an_edge_is_followed(rng: np.random.Generator) -> None:
    known = _banana(6, 1.2)
    told, untold = (_adapted(known, 6, 0.0, rng, told=flag) for flag in (True, False))
    assert told.bend is not None
    assert told.bend.lead == 0
    assert np.argmax(np.abs(told.bend.shift)) == 1
    z, share = _evidence(known, told, rng)
    assert abs(z) < 4.0
    assert share > 1.2 * _evidence(known, untold, rng)[1]
    crooked = replace(told, bent=None)  # drawn as bent, its density taken as straight
    draws = told.draw(rng, 40_000)
    weights = np.exp(known.log_density(draws) - crooked.log_density(draws))
    assert np.mean(weights) > 1.5 * math.exp(known.log_evidence)


def test_a_bend_and_back_is_where_it_was(rng: np.random.Generator) -> None:
    bend = Bend(1, 0.3, 2.0, np.array([0.5, 0.0, -2.0]))
    points = 5.0 * rng.standard_normal((100, 3))
    assert bend.bent(bend.straight(points)) == pytest.approx(points)
    moved = np.eye(3) * 1e-6
    at = bend.straight(points[:1] + np.vstack([moved, -moved]))
    assert np.linalg.det((at[:3] - at[3:]) / 2e-6) == pytest.approx(1.0, abs=1e-6)  # volumes stay


def test_no_bend_is_seen_in_normal_draws_nor_given_to_a_parameter_with_a_limit(rng: np.random.Generator) -> None:
    even = np.full(4000, 1.0 / 4000)
    draws = rng.standard_normal((4000, 3))
    assert bend_of(draws, even, np.ones(3, dtype=bool)) is None
    draws[:, 1] += draws[:, 0] ** 2
    assert bend_of(draws, even, np.array([True, False, True])) is None
    found = bend_of(draws, even, np.array([False, True, True]))
    assert found is not None
    assert found.lead == 0
    assert found.shift == pytest.approx([0.0, found.scale**2, 0.0], abs=0.1)


def test_two_draws_have_no_bend() -> None:
    draws = np.array([[0.0, 1.0, 2.0], [1.0, 3.0, 1.0], [5.0, 5.0, 5.0]])
    assert bend_of(draws, np.array([0.5, 0.5, 0.0]), np.ones(3, dtype=bool)) is None


def test_a_limit_of_a_moved_parameter_does_not_fold_what_is_bent() -> None:
    limits = np.array([-2.0, -2.0]), np.full(2, FREE)
    bend = Bend(0, 0.0, 1.0, np.array([0.0, 0.4]))
    both = Proposal(np.full(2, 0.5), np.zeros((2, 2)), np.stack([np.eye(2)] * 2), limits, bend, np.array([True, False]))
    assert both._folding is not None
    assert [len(edges) for edges in both._folding.edges] == [1, 2]


def test_limits_far_away_change_no_bit(rng: np.random.Generator) -> None:
    known, far = normal(np.eye(4)), (np.full(4, -50.0), np.full(4, 50.0))
    plain, told = (adapt_proposal(known, np.zeros(4), np.eye(4), rng=np.random.default_rng(3), support=support) for support in (None, far))
    assert np.array_equal(plain.means, told.means)
    assert np.array_equal(plain.factors, told.factors)
    assert np.array_equal(plain.draw(np.random.default_rng(1), 10), told.draw(np.random.default_rng(1), 10))


def test_the_component_that_guards_a_bent_ridge_lies_where_the_draws_are() -> None:
    """Ridge y = 5 x^2 +- 0.1: y has mean 5 and standard deviation 7."""
    rng = np.random.default_rng(3)
    x = rng.standard_normal(4000)
    draws = np.column_stack([x, 5.0 * x**2 + 0.1 * rng.standard_normal(x.size)])
    mixture = grown(draws, 2, rng, (np.full(2, -FREE), np.full(2, FREE)))
    assert mixture.bend is not None
    guard = int(np.flatnonzero(~mixture.follows)[0])
    away = (draws - mixture.means[guard]) @ np.linalg.inv(mixture.factors[guard]).T
    assert np.median(np.linalg.norm(away, axis=1)) < 1.0
    wide = mixture.widened()
    assert wide.follows[-1]
    straight = wide.bend.straight(draws)
    away = (straight - wide.means[-1]) @ np.linalg.inv(wide.factors[-1]).T
    assert np.median(np.linalg.norm(away, axis=1)) < 1.0


@pytest.mark.parametrize("halves", [6, 7, 15, 17])
def test_a_half_power_is_the_power(halves: int) -> None:
    values = np.geomspace(1.0, 1e30, 50)
    np.testing.assert_allclose(half_power(values.copy(), halves), values ** (-0.5 * halves), rtol=1e-13)


def test_light_components_fold_at_one_edge_and_keep_the_evidence(rng: np.random.Generator) -> None:
    """A corner of two edges under two hundred components: each folds once, and the density stays exact."""
    n, low = 200, np.zeros(2)
    means = np.abs(rng.standard_normal((n, 2)))
    proposal = Proposal(np.full(n, 1.0 / n), means, np.stack([0.5 * np.eye(2)] * n), (low, np.full(2, np.inf)))
    assert proposal._folding is not None
    assert {len(edges) for edges in proposal._folding.edges} <= {0, 1}
    draws = proposal.draw(rng, 40_000)
    target = np.where(np.all(draws > 0.0, axis=1), -0.5 * np.sum(draws**2, axis=1), -np.inf)
    weights = np.exp(target - proposal.log_density(draws))
    assert abs(np.mean(weights) - 0.5 * np.pi) < 4.0 * np.std(weights) / np.sqrt(weights.size)  # a quarter of 2 pi
    plain = replace(proposal, limits=None)
    wrong = np.exp(target - plain.log_density(draws))
    assert abs(np.mean(wrong) - 0.5 * np.pi) > 10.0 * np.std(wrong) / np.sqrt(wrong.size)


def test_distances_by_products_are_those_from_the_images_themselves(rng: np.random.Generator) -> None:
    """Wide and narrow components at one and two edges; one so narrow that products would not do."""
    widths = np.array([1.0, 0.3, 1e-2, 1e-7])
    means, low, high = np.abs(rng.standard_normal((4, 3))) * widths[:, None], np.array([0.0, 0.0, -FREE]), np.array([0.8, FREE, FREE])
    factors = widths[:, None, None] * (np.eye(3) + 0.3 * np.tril(rng.standard_normal((4, 3, 3))))
    folds = folding.folding(np.full(4, 0.25), means, factors, np.tile(low, (4, 1)), np.tile(high, (4, 1)))
    assert folds is not None
    assert np.flatnonzero(folds._forms.narrow).tolist() == [3]
    n_image = 0
    for own in folds.alike:
        draws = means[own[0]] + rng.standard_normal((500, 3)) @ factors[own[0]].T
        columns = np.abs(draws).T[folds.order]
        direct = folds._distances_one_by_one(columns, own)
        np.testing.assert_allclose(folds.distances(columns, own), direct, rtol=1e-8, atol=1e-8)
        n_image += len(direct)
        found = folds.summed(columns, own, np.full(own.size, 0.5), 5)
        np.testing.assert_allclose(found, np.sum(0.5 * (1.0 + direct / 5.0) ** -4.0, axis=(0, 1)), rtol=1e-7)
    assert n_image > 8
