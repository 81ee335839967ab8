"""The second opinion against closed forms and against a grid that shares no code with it; a long
tail that an adapted proposal leaves out.

The curve is a sum of two exponentials, one slower than 1.25 and one faster, whose rates the data
hardly tell apart: the slower one has a long tail to 0.  `grid` integrates it over k, q and a by the
midpoint rule, over b by the normal distribution function.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy.special import ndtr
from targets import COV, Known, banana, bimodal, box, exponential, half_normal, normal

from estim.curve_fitting.single import fit_curve
from estim.fitting.least_squares import Fit
from estim.pipeline import Analysis, analyse_fit
from estim.sampling import certificate, certified
from estim.sampling.certificate import Agreement, Certificate, certify, compare_with_chain
from estim.sampling.chain import Chain, Target, sample_posterior
from estim.sampling.diagnostics import effective_size
from estim.sampling.independent_check import second_opinion
from estim.sampling.proposal import Proposal, adapt_proposal
from estim.sampling.ridges import ridge_proposal

U_Y, SLOWEST, FASTEST, MOST = 0.02, 1.25, 20.0, 3.0


@cache
def points() -> tuple[np.ndarray, np.ndarray]:
    x = np.linspace(0.0, 4.0, 30)
    return x, np.exp(-1.1 * x) + np.exp(-2.0 * x) + U_Y * np.random.default_rng(2).standard_normal(
        x.size
    )


@cache
def two_exponentials() -> Fit:
    bounds = {"k": (0.0, SLOWEST), "q": (SLOWEST, FASTEST), "a": (0.0, MOST), "b": (0.0, MOST)}
    start = {"a": 1.0, "k": 1.0, "b": 1.0, "q": 2.5}
    return fit_curve(
        "a*exp(-k*x) + b*exp(-q*x)", *points(), u_y=U_Y, start=start, bounds=bounds
    ).fit


@dataclasses.dataclass(frozen=True)
class Truth:
    sd: float
    below: float  # P(k < 0.7)
    q025: float
    sd_a: float


@cache
def grid(n: int = 200) -> Truth:
    x, y = points()
    middles = (np.arange(n) + 0.5) / n
    k, a = SLOWEST * middles, MOST * middles
    stretch = np.log(FASTEST / SLOWEST)
    # dq = 2 q stretch t dt: fine where q is near its limit
    q = SLOWEST * np.exp(stretch * middles**2)
    slow, fast, data = np.exp(-np.outer(k, x)) / U_Y, np.exp(-np.outer(q, x)) / U_Y, y / U_Y
    ss, ff, sf = np.sum(slow**2, axis=1)[:, None], np.sum(fast**2, axis=1), slow @ fast.T
    sy, fy = (slow @ data)[:, None], fast @ data
    best = 0.5 * np.max((sy**2 * ff - 2.0 * sy * fy * sf + fy**2 * ss) / (ss * ff - sf**2))
    of_kq, of_a = np.zeros((n, n)), np.zeros(n)
    for i, height in enumerate(a):
        centre, sd = (fy - height * sf) / ff, ff**-0.5
        weight = (
            np.exp(height * sy - 0.5 * height**2 * ss + 0.5 * ff * centre**2 - best) * q * middles
        )
        weight = weight * sd * (ndtr((MOST - centre) / sd) - ndtr(-centre / sd))
        of_kq += weight
        of_a[i] = np.sum(weight)
    of_k, of_a = np.sum(of_kq, axis=1) / np.sum(of_kq), of_a / np.sum(of_a)
    edges, below = SLOWEST * np.arange(1, n + 1) / n, np.cumsum(of_k)
    return Truth(
        float(np.sqrt(of_k @ k**2 - (of_k @ k) ** 2)),
        float(np.interp(0.7, edges, below)),
        float(np.interp(0.025, below, edges)),
        float(np.sqrt(of_a @ a**2 - (of_a @ a) ** 2)),
    )


@cache
def analysed(seed: int) -> Analysis:
    return analyse_fit(two_exponentials(), seed=seed, target=Target(ess=9000.0))


def share_below(chain: Chain, at: float) -> tuple[float, float]:
    """Share of the draws of k below a value, and its Monte-Carlo error."""
    inside = (chain.draws[..., 1:2] < at).astype(float)
    share = float(inside.mean())
    return share, float(np.sqrt(share * (1.0 - share) / effective_size(inside)[0]))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.statistics)])
def test_chain_has_the_long_tail_of_two_exponentials(seed: int) -> None:
    truth, analysis = grid(), analysed(seed)
    assert truth.sd == pytest.approx(grid(120).sd, rel=2e-3)
    chain = analysis.chain
    assert chain.names == ("a", "k", "b", "q")
    assert chain.convergence.met
    squares = (chain.draws[..., 1:2] - chain.flat[:, 1].mean()) ** 2
    u_sd = squares.std() / np.sqrt(effective_size(squares)[0]) / (2.0 * truth.sd)
    assert abs(chain.flat[:, 1].std() - truth.sd) < 4.0 * u_sd < 0.06 * truth.sd
    share, u = share_below(chain, 0.7)
    assert abs(share - truth.below) < 4.0 * u
    assert u < 0.25 * truth.below
    assert analysis.comparison.verdict == "agree", analysis.comparison.reason


@pytest.mark.slow
def test_adapted_proposal_alone_leaves_it_out_and_its_own_weights_do_not_show_that() -> None:
    """What the second opinion was before: the wrong model beside the test above."""
    fit, rng = two_exponentials(), np.random.default_rng(3).spawn(2)
    alone = adapt_proposal(fit.posterior, fit.values, fit.cov, rng=rng[0], starts=tuple(fit.others))
    same = certify(fit.posterior, alone, rng=rng[0])
    assert same.reliable
    # draws without the tail are nearly normal: u(sd) = sd/sqrt(2 n)
    assert same.sd[1] < (1.0 - 4.0 / np.sqrt(2.0 * same.ess)) * grid().sd
    chains = [
        sample_posterior(
            fit.posterior, fit.values, fit.cov, target=Target(ess=1500.0), rng=one, proposal=alone
        )
        for one in rng[1].spawn(4)
    ]
    assert all(chain.convergence.met for chain in chains)
    assert np.mean([share_below(chain, 0.7)[0] for chain in chains]) < 0.75 * grid().below
    # along the ridges it is seen, by importance sampling as well
    ridges = ridge_proposal(fit.posterior, fit.values, fit.cov, support=fit.problem.support())
    other = certify(
        fit.posterior,
        alone.mixed_with(ridges, 0.5),
        rng=np.random.default_rng(3),
        least_ess=20_000.0,
    )
    assert other.reliable
    assert abs(other.sd[1] - grid().sd) < 4.0 * other.mcse_sd[1] < 0.04 * grid().sd


@pytest.mark.slow
def test_second_opinion_agrees_with_the_grid() -> None:
    fit, truth = two_exponentials(), grid()
    certificate = certify(
        fit.posterior, second_proposal(fit), rng=np.random.default_rng(1), least_ess=40_000.0
    )
    assert abs(certificate.sd[1] - truth.sd) < 4.0 * certificate.mcse_sd[1] < 0.06 * truth.sd
    assert abs(certificate.sd[0] - truth.sd_a) < 4.0 * certificate.mcse_sd[0] < 0.04 * truth.sd_a
    assert certificate.quantiles[0.025][1] == pytest.approx(truth.q025, abs=0.1 * truth.sd)


def second_proposal(fit: Fit) -> Proposal:
    """What the second opinion draws from."""
    adapted = adapt_proposal(
        fit.posterior, fit.values, fit.cov, rng=np.random.default_rng(2), starts=tuple(fit.others)
    )
    ridges = ridge_proposal(fit.posterior, fit.values, fit.cov, support=fit.problem.support())
    return adapted.mixed_with(ridges, 0.5)


def test_importance_sampling_goes_on_until_the_ends_of_a_heavy_tail_are_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Student's t with 3 degrees of freedom: its mean is known long before its 2.5 % quantile,
    -3.182.
    """
    known = Known(
        lambda x: -2.0 * np.log1p(x[:, 0] ** 2 / 3.0),
        float(np.log(np.sqrt(3.0) * np.pi / 2.0)),
        np.zeros(1),
        np.full(1, np.sqrt(3.0)),
    )

    def error(found: Certificate) -> float:
        height = 2.0 / (np.pi * np.sqrt(3.0)) / (1.0 + 3.18245**2 / 3.0) ** 2
        return float(found.mcse_shares[0.025][0] / height / np.sqrt(3.0))

    wide, few, limit = (
        Proposal.single(np.zeros(1), np.eye(1)),
        {"n_draw": 1000, "least_ess": 500.0},
        certificate._UNSURE_END,
    )
    found = certify(known, wide, rng=np.random.default_rng(5), **few)
    assert found.n_draw > 1000
    assert error(found) < 1.2 * limit  # it takes the density there from the draws
    assert abs(found.quantiles[0.025][0] + 3.18245) < 4.0 * error(found) * np.sqrt(3.0)
    monkeypatch.setattr(certificate, "_UNSURE_END", np.inf)
    short = certify(known, wide, rng=np.random.default_rng(5), **few)
    assert short.n_draw == 1000
    assert error(short) > 1.2 * limit


@dataclasses.dataclass(frozen=True, eq=False)
class Cut:
    """A posterior without what lies below a value of k."""

    posterior: object
    at: float

    @property
    def names(self) -> tuple[str, ...]:
        return self.posterior.names

    def log_density(self, draws: np.ndarray) -> np.ndarray:
        return np.where(draws[:, 1] > self.at, self.posterior.log_density(draws), -np.inf)


@pytest.mark.slow
def test_chain_without_a_tail_disagrees(monkeypatch: pytest.MonkeyPatch) -> None:
    """A chain that cannot go below k = 0.85, a proposal that never does: 4 % of the posterior."""

    def sample_cut(posterior: object, *args: object, **choices: object) -> Chain:
        return sample_posterior(Cut(posterior, 0.85), *args, **choices)

    monkeypatch.setattr(certified, "sample_posterior", sample_cut)
    analysis = analyse_fit(two_exponentials(), seed=1)
    assert analysis.comparison.verdict == "disagree"
    assert (
        "chain and importance sampling differ (as they did before, with other random numbers) in"
        in analysis.comparison.reason
    )
    assert "of k by" in analysis.comparison.reason
    assert analysis.comparison.z[0, 1] > analysis.comparison.limit
    assert any(finding.status == "methods-disagree" for finding in analysis.diagnosis.findings)


@pytest.mark.slow
def test_difference_that_does_not_come_back_was_chance(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first pair is made to differ; the second, with other random numbers, is the result and
    says that there was a first.
    """
    compared: list[Chain] = []

    def compare(certificate: Certificate, chain: Chain, *, most: int) -> Agreement:
        compared.append(chain)
        shifted = dataclasses.replace(chain, draws=chain.draws + 0.3 * chain.flat.std(axis=0))
        return compare_with_chain(certificate, shifted if len(compared) == 1 else chain, most=most)

    monkeypatch.setattr(certified, "compare_with_chain", compare)
    fit = two_exponentials()
    analysis = analyse_fit(fit, seed=1, target=Target(ess=7000.0))
    first, second = compared
    assert not np.array_equal(first.draws[0, :20], second.draws[0, :20])
    # compared as they were drawn, in logarithms of what is known by its size
    assert np.array_equal(analysis.chain.draws, fit.coordinates.values(second.draws))
    assert analysis.comparison.verdict == "agree"
    chance = (
        r"; both were computed twice, because the first pair differed by \d+\.\d Monte-Carlo "
        r"errors, by chance$"
    )
    assert re.search(chance, analysis.comparison.reason)
    assert not any(finding.status == "methods-disagree" for finding in analysis.diagnosis.findings)


def test_tail_that_changes_no_moment_is_called_by_the_ends_of_the_interval(
    rng: np.random.Generator,
) -> None:
    """Draws with the mean and the standard deviation of a normal distribution and other tails."""
    from test_certify import chain_of

    known = normal(np.eye(2))
    certificate, _ = opinion(known, np.zeros(2), np.eye(2))
    good = rng.standard_normal((4, 200, 20, 2))
    assert compare_with_chain(certificate, chain_of(good)).verdict == "agree"
    flat = good.copy()
    flat[..., 1] = np.sqrt(3.0) * rng.uniform(-1.0, 1.0, good.shape[:-1])
    comparison = compare_with_chain(certificate, chain_of(flat))
    assert comparison.verdict == "disagree"
    assert "quantile of p1" in comparison.reason
    assert "p0" not in comparison.reason
    assert "the mean" not in comparison.reason


def opinion(
    known: Known, start: np.ndarray, cov: np.ndarray, **choices: object
) -> tuple[Certificate, object]:
    rng = np.random.default_rng(4)
    return second_opinion(
        known, start, cov, adapt_proposal(known, start, cov, rng=rng), rng=rng, **choices
    )


def inside(low: float, high: float) -> Callable[[int], tuple[np.ndarray, np.ndarray]]:
    return lambda n: (np.full(n, low), np.full(n, high))


FREE = inside(-np.inf, np.inf)
CLOSED = {
    f"normal {n}": (normal(COV[:n, :n]), np.zeros(n), COV[:n, :n], FREE(n), ())
    for n in (1, 2, 3, 4)
}
CLOSED |= {
    f"half-normal {n}": (half_normal(n), np.full(n, 1e-6), np.eye(n), inside(0.0, np.inf)(n), ())
    for n in (1, 2, 3, 4)
}
CLOSED |= {
    f"exponential {n}": (
        exponential(n),
        np.full(n, 1e-6),
        1e4 * np.eye(n),
        inside(0.0, np.inf)(n),
        (),
    )
    for n in (1, 3, 4)
}
CLOSED |= {
    f"box {n}": (box(n), np.zeros(n), 0.3 * np.eye(n), inside(-1.0, 1.0)(n), ()) for n in (1, 4)
}
CLOSED |= {
    f"two modes {n}": (bimodal(n), np.full(n, -4.0), 0.25 * np.eye(n), FREE(n), (np.full(n, 4.0),))
    for n in (1, 2, 3)
}
CLOSED |= {"limit not told": (half_normal(2), np.full(2, 1e-6), np.eye(2), FREE(2), ())}
CLOSED |= {
    f"banana {bend}": (banana(bend), np.array([0.0, -bend]), np.eye(2), FREE(2), ())
    for bend in (0.4, 2.0)
}


@pytest.mark.parametrize("name", CLOSED)
def test_it_gives_closed_forms_within_the_error_that_it_states(name: str) -> None:
    known, start, cov, support, starts = CLOSED[name]
    certificate, _ = opinion(known, start, cov, support=support, starts=starts)
    assert certificate.reliable
    for found, true, stated in (
        (certificate.mean, known.mean, certificate.mcse_mean),
        (certificate.sd, known.sd, certificate.mcse_sd),
    ):
        assert np.all(np.abs(found - true) < 4.5 * stated)
        assert np.all(stated < 0.03 * known.sd)
    assert (
        abs(certificate.log_evidence - known.log_evidence) < 4.0 * certificate.u_log_evidence < 0.08
    )


def test_quantiles_are_those_of_a_truncated_correlated_normal_distribution() -> None:
    """x0 > 0 and correlation 0.9: x0 is half-normal, x1 skew-normal (Azzalini 1985) with shape
    0.9/sqrt(1 - 0.81).
    """
    from scipy.stats import halfnorm, skewnorm

    cut = dataclasses.replace(
        normal(COV[:2, :2]),
        function=lambda x: np.where(x[:, 0] >= 0.0, normal(COV[:2, :2]).log_density(x), -np.inf),
    )
    support = (np.array([0.0, -np.inf]), np.full(2, np.inf))
    certificate, _ = opinion(cut, np.array([0.0, 0.0]), COV[:2, :2], support=support)
    for p, quantile in certificate.quantiles.items():
        shares = np.array(
            [halfnorm.cdf(quantile[0]), skewnorm.cdf(quantile[1], 0.9 / np.sqrt(0.19))]
        )
        assert np.all(np.abs(shares - p) < 4.0 * certificate.mcse_shares[p])
        assert np.all(certificate.mcse_shares[p] < 0.01)


def test_good_proposal_stays_as_it_is_and_a_deficient_one_is_mended() -> None:
    known, start, cov = normal(np.eye(6)), np.zeros(6), np.eye(6)
    rng = np.random.default_rng(5)
    good = adapt_proposal(known, start, cov, rng=rng)
    certificate, kept = second_opinion(known, start, cov, good, rng=rng)
    assert kept is good
    narrow = adapt_proposal(
        dataclasses.replace(known, function=lambda x: 8.0 * known.log_density(x)),
        start,
        cov,
        rng=rng,
    )
    certificate, mended = second_opinion(known, start, cov, narrow, rng=rng)
    assert np.all(np.abs(certificate.sd - 1.0) < 4.5 * certificate.mcse_sd)
    assert mended is not narrow
    draws = rng.standard_normal((20_000, 6))
    ratio = [
        np.max(known.log_density(draws) - known.log_evidence - p.log_density(draws))
        for p in (narrow, mended)
    ]
    assert ratio[0] > np.log(50.0)
    assert ratio[1] < np.log(30.0)
