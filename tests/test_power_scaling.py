"""Power-scaling sensitivity against a conjugate problem whose scaled posteriors are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from formulas import formula_problem
from scipy.integrate import quad
from scipy.stats import norm

from estim.checks.prior_sensitivity import (
    BOTH_MATTER,
    CONFLICT,
    DETERMINED,
    PRIOR_MATTERS,
    THRESHOLD,
    UNRELIABLE,
    WEAK,
    power_scaling,
)
from estim.problem.priors import Normal, Uniform

ONE = np.array([1.0])


def conjugate(prior_sd: float, sigma: float, y: float) -> tuple[float, float]:
    """Mean and sd of the posterior of a constant measured as y +- sigma with prior 0 +-
    prior_sd.
    """
    variance = 1.0 / (prior_sd**-2 + sigma**-2)
    return variance * y / sigma**2, math.sqrt(variance)


def rows(prior_sd: float, sigma: float, y: float, rng: np.random.Generator, n: int = 20_000):
    problem = formula_problem(
        lambda x, a: a * x, ONE, np.array([y]), sigma, {"a": Normal(0.0, prior_sd)}
    )
    mean, sd = conjugate(prior_sd, sigma, y)
    draws = mean + sd * rng.standard_normal((n, 1))
    return power_scaling(problem, draws, problem.linearised(np.zeros(1)).log_likelihood(draws))[0]


def exact(base: tuple[float, float], scaled: list[tuple[float, float]]) -> float:
    """Cumulative Jensen-Shannon distance per doubling, by quadrature over normal distribution
    functions.
    """

    def entropy(t: float, p, q) -> float:
        a, b = p(t), q(t)
        return (
            a * math.log2(2.0 * a / (a + b)) + (b - a) / (2.0 * math.log(2.0))
            if a > 0.0
            else b / (2.0 * math.log(2.0))
        )

    total = 0.0
    for mean, sd in scaled:
        distances = []
        for sign in (1.0, -1.0):
            p = norm(sign * base[0], base[1]).cdf
            q = norm(sign * mean, sd).cdf
            # the mass of the distribution functions depends on where the draws end: about 4 sd for
            # 20 000 draws
            low, high = sign * base[0] - 4.05 * base[1], sign * base[0] + 4.05 * base[1]
            split = {"limit": 200}
            divergence = quad(
                lambda t, p=p, q=q: entropy(t, p, q) + entropy(t, q, p), low, high, **split
            )[0]
            distances.append(
                math.sqrt(divergence / quad(lambda t, p=p, q=q: p(t) + q(t), low, high, **split)[0])
            )
        total += max(distances)
    return total / 2.0 / math.log2(1.25)


@pytest.mark.parametrize(
    ("prior_sd", "sigma", "y"),
    [(1.0, 1.0, 0.0), (1.0, 1.0, 2.0), (1.0, 0.2, 0.5), (1.0, 3.0, -1.0)],
)
def test_distances_are_those_of_the_conjugate_posteriors(
    prior_sd: float, sigma: float, y: float, rng: np.random.Generator
) -> None:
    found = rows(prior_sd, sigma, y, rng)
    base = conjugate(prior_sd, sigma, y)
    of_prior = exact(
        base, [conjugate(prior_sd / math.sqrt(alpha), sigma, y) for alpha in (0.8, 1.25)]
    )
    of_likelihood = exact(
        base, [conjugate(prior_sd, sigma / math.sqrt(alpha), y) for alpha in (0.8, 1.25)]
    )
    # the distribution functions are integrated up to the extreme draws, which scatter
    assert found.prior == pytest.approx(of_prior, rel=0.06, abs=0.002)
    assert found.likelihood == pytest.approx(of_likelihood, rel=0.06, abs=0.002)
    assert found.strongest == ("a" if found.prior >= THRESHOLD else None)
    assert found.k_hat < 0.5


def test_verdicts_follow_who_knows_more(rng: np.random.Generator) -> None:
    assert rows(1.0, 0.1, 0.5, rng).verdict == DETERMINED
    assert rows(1.0, 10.0, 0.5, rng).verdict == PRIOR_MATTERS
    assert rows(1.0, 0.6, 6.0, rng).verdict == CONFLICT
    # as sharp, but in agreement: no conflict
    assert rows(1.0, 0.6, 0.6, rng).verdict in (DETERMINED, BOTH_MATTER)


def test_disagreement_is_the_distance_of_prior_and_data_in_their_own_uncertainty(
    rng: np.random.Generator,
) -> None:
    found = rows(1.0, 0.5, 3.0, rng)
    assert found.disagreement == pytest.approx(-3.0 / math.sqrt(1.25), abs=0.03)


@pytest.mark.statistics
def test_conflict_is_rare_where_the_truth_comes_from_the_prior(rng: np.random.Generator) -> None:
    """5 % of data drawn from prior and likelihood are called a conflict at |z| >= 2, within 3
    Monte-Carlo errors.
    """
    z = []
    for _ in range(250):
        y = rng.standard_normal() + 0.7 * rng.standard_normal()
        z.append(rows(1.0, 0.7, y, rng, n=1000).disagreement)
    assert np.std(z) == pytest.approx(1.0, abs=3.0 / math.sqrt(500))
    assert np.mean(np.abs(z) >= 2.0) < 0.0455 + 3.0 * math.sqrt(0.0455 * 0.9545 / 250)


def test_flat_parameter_and_flat_prior_are_told_apart(rng: np.random.Generator) -> None:
    """b does nothing and has a uniform prior: neither prior nor likelihood move it; a has a uniform
    prior and data.
    """
    problem = formula_problem(
        lambda x, a, b: a * x + 0.0 * b,
        ONE,
        ONE,
        0.1,
        {"a": Uniform(-9.0, 9.0), "b": Uniform(0.0, 1.0)},
    )
    draws = np.column_stack([1.0 + 0.1 * rng.standard_normal(8000), rng.random(8000)])
    a, b = power_scaling(
        problem, draws, problem.linearised(np.array([1.0, 0.5])).log_likelihood(draws)
    )
    assert (a.verdict, b.verdict) == (DETERMINED, WEAK)
    assert (a.prior, b.prior) == (0.0, 0.0)
    assert a.strongest is None
    assert b.likelihood < 0.02  # Monte-Carlo noise of 8000 draws


def test_the_prior_that_limits_another_parameter_is_named(rng: np.random.Generator) -> None:
    """a + b is measured well and only b has an informative prior: b's prior limits a; a prior of an
    unrelated c does not.
    """
    priors = {"a": Uniform(-50.0, 50.0), "b": Normal(0.0, 1.0), "c": Normal(0.0, 1.0)}
    problem = formula_problem(
        lambda x, a, b, c: a + b + 0.0 * c * x, ONE, np.array([2.0]), 0.1, priors
    )
    b = rng.standard_normal(8000)
    draws = np.column_stack(
        [2.0 - b + 0.1 * rng.standard_normal(8000), b, rng.standard_normal(8000)]
    )
    found = power_scaling(problem, draws, problem.linearised(np.zeros(3)).log_likelihood(draws))
    assert [row.strongest for row in found] == ["b", "b", "c"]
    assert found[0].verdict == PRIOR_MATTERS


def test_draws_that_are_not_of_the_posterior_are_not_judged(rng: np.random.Generator) -> None:
    """Draws a hundred sds wide give the whole weight to one of them."""
    problem = formula_problem(
        lambda x, a: a * x, ONE, np.array([0.5]), 0.1, {"a": Normal(0.0, 1.0)}
    )
    draws = 0.5 + 100.0 * rng.standard_normal((500, 1))
    found = power_scaling(problem, draws, problem.linearised(np.zeros(1)).log_likelihood(draws))[0]
    assert found.verdict == UNRELIABLE
