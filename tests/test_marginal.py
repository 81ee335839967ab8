"""The marginal over runs against closed forms, grids and the full chain; and its own checks against
a marginal made wrong on purpose.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from joint_runs import DECAY, GROWTH, LINE, problem_of
from scipy import stats
from scipy.special import logsumexp

from estim.campaign import load_campaign
from estim.campaign.campaign_file import NoiseTable
from estim.common.errors import InputError
from estim.curve_fitting.joint_fit import fit_curves
from estim.curves import DataSet
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.pipeline import _hard_for_a_chain, _integrable, analyse_fit
from estim.problem.posterior import Problem
from estim.problem.priors import HalfNormal, LogNormal, Normal, Uniform
from estim.problem.robust_likelihood import RobustErrors
from estim.problem.tails import StudentT
from estim.sampling import conditional
from estim.sampling.chain import Target, sample_posterior
from estim.sampling.conditional import RunTerm, hermite_nodes, log_volume
from estim.sampling.diagnostics import mixing_of
from estim.sampling.importance import pareto_smoothed
from estim.sampling.marginal import MarginalPosterior, sample_marginal
from estim.sampling.marginal_draws import marginal_chain

X = np.linspace(0.0, 1.0, 9)


def fitted(problem: Problem) -> Fit:
    return fit_least_squares(problem)


def error_of_mean(found: MarginalPosterior, columns: list[int]) -> np.ndarray:
    return np.sqrt(
        np.exp(2.0 * found.log_weights) @ (found.draws[:, columns] - found.mean[columns]) ** 2
    )


# --- closed form: everything linear and normal


def linear_problem(rng: np.random.Generator) -> tuple[Problem, np.ndarray, np.ndarray, float]:
    """Five lines of one slope and bend with offsets of their own; posterior mean and covariance and
    log evidence by linear algebra.
    """
    prior = {"slope": Normal(1.0, 0.5), "bend": Normal(0.0, 1.0)}
    ys = [
        1.3 * X + 0.2 * X**2 + rng.normal(0.0, 0.7) + 0.2 * rng.standard_normal(X.size)
        for _ in range(5)
    ]
    problem = problem_of(LINE, prior, {"offset": Normal(0.0, 0.7)}, X, ys, 0.2)
    design = np.zeros((5 * X.size, 7))
    for i in range(5):
        rows = slice(i * X.size, (i + 1) * X.size)
        design[rows, 0], design[rows, 1], design[rows, 2 + i] = X, X**2, 1.0
    mean0, cov0 = np.array([1.0, 0.0] + 5 * [0.0]), np.diag([0.25, 1.0] + 5 * [0.49])
    cov = np.linalg.inv(design.T @ design / 0.04 + np.linalg.inv(cov0))
    mean = cov @ (design.T @ np.concatenate(ys) / 0.04 + np.linalg.solve(cov0, mean0))
    evidence = stats.multivariate_normal(
        design @ mean0, design @ cov0 @ design.T + 0.04 * np.eye(design.shape[0])
    ).logpdf(np.concatenate(ys))
    return problem, mean, cov, float(evidence)


def test_linear_problem_is_answered_exactly(rng: np.random.Generator) -> None:
    problem, mean, cov, evidence = linear_problem(rng)
    found = sample_marginal(fitted(problem), rng=rng)
    assert found.sampled == ("slope", "bend")
    assert found.trusted
    assert found.k_hat < 0.5
    assert found.log_evidence == pytest.approx(evidence, abs=4.0 * found.u_log_evidence)
    assert found.log_evidence_all == pytest.approx(
        evidence, abs=4.0 * np.sqrt(2.0) * found.u_log_evidence
    )
    sd = np.sqrt(np.diag(cov))
    assert np.all(np.abs(found.mean - mean) < 4.0 * sd / np.sqrt(found.ess))
    draws = found.resampled(4000, rng=rng)
    correlation = np.corrcoef(draws.T)
    # a correlation from n draws is uncertain by at most 1/sqrt(n)
    assert np.max(np.abs(correlation - cov / np.outer(sd, sd))) < 4.5 / np.sqrt(4000)
    assert np.max(np.abs(draws.std(axis=0) / sd - 1.0)) < 4.0 / np.sqrt(2.0 * 4000)


def test_without_the_laplace_factor_the_evidence_is_wrong(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, _, _, evidence = linear_problem(rng)
    monkeypatch.setattr(conditional, "log_volume", lambda root: np.zeros(root.shape[0]))
    found = sample_marginal(fitted(problem), rng=rng)
    assert abs(found.log_evidence - evidence) > 50.0 * found.u_log_evidence


# --- a grid in one shared parameter: amplitudes enter linearly, so given the rate each run is
# normal


def decay_problem(
    rng: np.random.Generator, rate_prior: Uniform | HalfNormal, *, rate: float, n_run: int
) -> tuple[Problem, np.ndarray, np.ndarray]:
    """Runs size * exp(-rate x); the grid of rates and the log of the marginal on it."""
    ys = [
        rng.normal(1.0, 0.3) * np.exp(-rate * X) + 0.3 * rng.standard_normal(X.size)
        for _ in range(n_run)
    ]
    problem = problem_of(DECAY, {"rate": rate_prior}, {"size": Normal(1.0, 0.3)}, X, ys, 0.3)
    grid = np.linspace(max(rate_prior.low, 0.0), min(rate_prior.high, 6.0), 1500)
    log_p = rate_prior.log_density(grid)
    for k, value in enumerate(grid):
        shape = np.exp(-value * X)
        normal = stats.multivariate_normal(
            shape, 0.09 * np.outer(shape, shape) + 0.09 * np.eye(X.size)
        )
        log_p[k] += np.sum(normal.logpdf(np.array(ys)))
    return problem, grid, log_p


def grid_moments(grid: np.ndarray, log_p: np.ndarray) -> tuple[float, float, float]:
    weight = np.exp(log_p - np.max(log_p))
    weight[[0, -1]] *= 0.5
    mean = float(np.average(grid, weights=weight))
    sd = float(np.sqrt(np.average((grid - mean) ** 2, weights=weight)))
    return mean, sd, float(np.log(np.sum(weight) * (grid[1] - grid[0])) + np.max(log_p))


@pytest.mark.slow
def test_volume_of_each_run_moves_the_shared_parameter_as_a_grid_says(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, grid, log_p = decay_problem(rng, Uniform(0.0, 6.0), rate=1.5, n_run=25)
    mean, sd, evidence = grid_moments(grid, log_p)
    fit = fitted(problem)
    found = sample_marginal(fit, rng=rng)
    error = error_of_mean(found, [0])[0]
    assert abs(found.mean[0] - mean) < 4.0 * error
    assert found.log_evidence == pytest.approx(evidence, abs=4.0 * found.u_log_evidence)
    # the wrong version: the mode of each run in place of its integral
    monkeypatch.setattr(conditional, "log_volume", lambda root: np.zeros(root.shape[0]))
    wrong = sample_marginal(fit, rng=rng)
    assert abs(wrong.mean[0] - mean) > 10.0 * error_of_mean(wrong, [0])[0]
    assert abs(wrong.mean[0] - mean) > 0.2 * sd


@pytest.mark.slow
def test_exact_weights_notice_a_wrong_marginal(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    fit = fitted(decay_problem(rng, Uniform(0.0, 6.0), rate=1.5, n_run=25)[0])
    right = RunTerm.log_marginal
    monkeypatch.setattr(
        RunTerm,
        "log_marginal",
        lambda self, s, e, *, n_node: right(self, s, e, n_node=n_node) - log_volume(e.root),
    )
    found = sample_marginal(fit, rng=rng)
    assert not found.trusted
    assert "exact weights shift a shared parameter" in found.reasons[0]


@pytest.mark.parametrize("prior", [HalfNormal(0.3), Uniform(0.0, 0.4)])
def test_shared_parameter_at_a_hard_edge_is_that_of_a_grid(
    prior: HalfNormal | Uniform, rng: np.random.Generator
) -> None:
    problem, grid, log_p = decay_problem(rng, prior, rate=0.03, n_run=3)
    mean, sd, evidence = grid_moments(grid, log_p)
    found = sample_marginal(fitted(problem), rng=rng)
    inside = np.isfinite(found.log_weights)
    assert np.all((found.draws[inside, 0] >= prior.low) & (found.draws[inside, 0] <= prior.high))
    assert abs(found.mean[0] - mean) < 4.0 * error_of_mean(found, [0])[0]
    assert found.sd[0] == pytest.approx(sd, rel=4.0 / np.sqrt(found.ess))
    assert found.log_evidence == pytest.approx(evidence, abs=4.0 * found.u_log_evidence)


# --- brute force in three dimensions: own parameters that are not normal


@pytest.mark.slow
def test_evidence_is_that_of_brute_force_and_nodes_remove_the_error_of_laplace(
    rng: np.random.Generator,
) -> None:
    x = X[:4]
    ys = [0.5 * x + np.exp(size) + 0.8 * rng.standard_normal(x.size) for size in (-0.8, 0.2, -0.3)]
    fit = fitted(
        problem_of(GROWTH, {"rate": Normal(0.0, 1.0)}, {"log_size": Normal(0.0, 1.0)}, x, ys, 0.8)
    )
    rates, sizes = np.linspace(-6.0, 6.0, 401), np.linspace(-8.0, 4.0, 1201)
    log_p = stats.norm(0.0, 1.0).logpdf(rates)
    for y in ys:
        mean = rates[:, None, None] * x + np.exp(sizes)[None, :, None]
        terms = np.sum(stats.norm(mean, 0.8).logpdf(y), axis=2) + stats.norm(0.0, 1.0).logpdf(sizes)
        log_p += logsumexp(terms, axis=1) + np.log(sizes[1] - sizes[0])
    mean, sd, evidence = grid_moments(rates, log_p)
    laplace = sample_marginal(fit, rng=rng, n_draw=20_000)
    nodes = sample_marginal(fit, rng=rng, n_draw=20_000, n_node=15)
    assert abs(laplace.log_evidence - evidence) > 10.0 * laplace.u_log_evidence
    assert nodes.log_evidence == pytest.approx(evidence, abs=4.0 * nodes.u_log_evidence)
    assert abs(nodes.mean[0] - mean) < 4.0 * error_of_mean(nodes, [0])[0]
    assert nodes.sd[0] == pytest.approx(sd, rel=4.0 / np.sqrt(nodes.ess))
    assert nodes.log_evidence_all == pytest.approx(evidence, abs=5.0 / np.sqrt(nodes.ess_all))


@pytest.mark.parametrize(("n_node", "n_dim"), [(1, 2), (3, 2), (5, 1), (4, 0)])
def test_hermite_nodes_integrate_a_normal_density_exactly(n_node: int, n_dim: int) -> None:
    nodes, log_weights = hermite_nodes(n_node, n_dim)
    weights = np.exp(log_weights)
    assert nodes.shape == (n_node**n_dim, n_dim)
    assert np.sum(weights) == pytest.approx(1.0)
    if n_node > 1 and n_dim:
        assert weights @ nodes**2 == pytest.approx(np.ones(n_dim))


# --- own noise, edges, refusals


@pytest.mark.slow
def test_inferred_noise_of_each_run_is_integrated_out(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Own standard deviations, far from 0: marginal against a long chain in all dimensions."""
    x = np.linspace(0.0, 1.0, 40)
    ys = [0.7 * x - 0.1 + s * rng.standard_normal(x.size) for s in (0.1, 0.3)]
    fit = fitted(
        problem_of(
            LINE,
            {"slope": Normal(0.0, 1.0), "bend": Normal(0.0, 0.1)},
            {"offset": Normal(0.0, 1.0)},
            x,
            ys,
            Uniform(0.0, 2.0),
        )
    )
    found = sample_marginal(fit, rng=rng, n_node=3)
    assert found.sampled == ("slope", "bend")
    chain = sample_posterior(fit.posterior, fit.values, fit.cov, target=Target(ess=1500), rng=rng)
    size = mixing_of(chain.draws).ess_bulk
    error = np.hypot(
        chain.flat.std(axis=0) / np.sqrt(size), error_of_mean(found, list(range(fit.problem.n_par)))
    )
    difference = np.abs(found.mean - chain.flat.mean(axis=0))
    assert found.refined == ("r0", "r1")
    assert np.all(difference < 4.0 * error)
    # the wrong version: own parameters left normal around their mode
    monkeypatch.setattr(RunTerm, "refine_own", lambda self, shared, own, rng: own)
    wrong = sample_marginal(fit, rng=rng, n_node=3)
    assert np.max(np.abs(wrong.mean - chain.flat.mean(axis=0)) / error) > 10.0


def test_own_parameters_close_to_an_edge_are_sampled_or_refused(rng: np.random.Generator) -> None:
    prior, own = {"slope": Normal(1.0, 1.0), "bend": Normal(0.0, 1.0)}, {"offset": HalfNormal(0.2)}
    ys = [X + 0.2 * rng.standard_normal(X.size) for _ in range(12)]
    assert sample_marginal(
        fitted(problem_of(LINE, prior, own, X, ys[:2], 0.2)), rng=rng
    ).sampled == ("slope", "bend", "offset[0]", "offset[1]")
    with pytest.raises(
        InputError,
        match=r"too many to sample at once \(14, at most 12\), 12 of them close to the edge",
    ):
        sample_marginal(fitted(problem_of(LINE, prior, own, X, ys, 0.2)), rng=rng)


def test_runs_that_share_nothing_are_refused(rng: np.random.Generator) -> None:
    x = np.arange(6.0)
    sets = {name: DataSet(x, 1.0 + x + 0.1 * rng.standard_normal(6), 0.1) for name in "ab"}
    apart = fit_curves("a + b*x", sets, shared=[])
    with pytest.raises(InputError, match="must share a parameter"):
        sample_marginal(apart.held, rng=rng)


def test_noise_that_is_not_normal_is_refused(rng: np.random.Generator) -> None:
    fit = fitted(linear_problem(rng)[0])
    heavy = tuple(
        RobustErrors(one.points, one.size, one.form.spectrum, StudentT())
        for one in fit.posterior.likelihoods
    )
    with pytest.raises(InputError, match="plain normal noise"):
        sample_marginal(replace(fit, posterior=replace(fit.posterior, likelihoods=heavy)), rng=rng)


def test_single_run_is_sampled_in_all_dimensions(rng: np.random.Generator) -> None:
    ys = [X + 0.2 * rng.standard_normal(X.size)]
    fit = fitted(
        problem_of(
            LINE,
            {"slope": Normal(1.0, 1.0), "bend": Normal(0.0, 1.0)},
            {"offset": Normal(0.0, 1.0)},
            X,
            ys,
            0.2,
        )
    )
    found = sample_marginal(fit, rng=rng)
    assert found.sampled == fit.names
    assert np.all(np.abs(found.mean - fit.values) < 4.0 * error_of_mean(found, [0, 1, 2]))
    assert any("every parameter was sampled" in reason for reason in found.reasons)


def test_too_few_draws_are_not_trusted_and_options_are_checked(rng: np.random.Generator) -> None:
    found = sample_marginal(fitted(linear_problem(rng)[0]), rng=rng, n_draw=200)
    assert not found.trusted
    assert "effective draws" in found.reasons[0]


def test_same_seed_gives_the_same_draws(rng: np.random.Generator) -> None:
    fit = fitted(linear_problem(rng)[0])
    one, two = (sample_marginal(fit, rng=np.random.default_rng(4), n_draw=500) for _ in range(2))
    assert np.array_equal(one.draws, two.draws)
    assert np.array_equal(one.log_weights, two.log_weights)


def test_k_hat_tells_a_proposal_that_is_too_narrow(rng: np.random.Generator) -> None:
    """N(0, s^2) proposed for N(0, 1): the weights have finite moments below 1/(1 - s^2), so k = 1 -
    s^2.
    """
    z = rng.standard_normal(20_000)
    for s, low, high in ((0.4, 0.7, 1.0), (0.8, 0.2, 0.55), (1.5, -np.inf, 0.3)):
        weights, k_hat, _ = pareto_smoothed(
            stats.norm.logpdf(s * z) - stats.norm(0.0, s).logpdf(s * z)
        )
        assert low < k_hat < high
        assert np.sum(np.exp(weights)) == pytest.approx(1.0)


# --- measured-like runs against the full chain


@pytest.mark.slow
def test_two_runs_agree_with_the_chain_in_all_dimensions(
    replica: Path, rng: np.random.Generator
) -> None:
    fit = fit_least_squares(
        load_campaign(replica / "campaign.toml").problem(["heavy-02", "heavy-04"])
    )
    found = sample_marginal(fit, rng=rng, n_draw=20_000)
    chain = sample_posterior(
        fit.sampled, fit.values, fit.cov, target=Target(ess=500, max_step=1000), rng=rng
    )
    size = mixing_of(chain.draws).ess_bulk
    sd = chain.flat.std(axis=0)
    error = np.hypot(sd / np.sqrt(size), error_of_mean(found, list(range(fit.problem.n_par))))
    assert found.trusted
    assert np.all(np.abs(found.mean - chain.flat.mean(axis=0)) < 4.0 * error)
    # neither density is normal: a standard deviation is uncertain by at most 1/sqrt(n) here
    assert np.all(
        np.abs(found.sd / sd - 1.0) < 4.0 * np.hypot(1.0 / np.sqrt(size), 1.0 / np.sqrt(found.ess))
    )


@pytest.mark.slow
def test_eight_runs_take_a_moment_and_the_exact_weights_agree(
    replica: Path, rng: np.random.Generator
) -> None:
    campaign = load_campaign(replica / "campaign.toml")
    fit = fit_least_squares(campaign.problem(campaign.run_names))
    found = sample_marginal(fit, rng=rng)
    assert found.trusted
    assert found.ess > 3000.0
    assert found.k_hat_all < 0.7
    assert found.shift < 0.1
    assert found.log_evidence_all == pytest.approx(found.log_evidence, abs=0.1)


# --- the choice of `estim fit --joint`


@pytest.mark.slow
def test_joint_fits_of_positions_go_through_the_marginal(project: Path) -> None:
    """Whose exact weights in all dimensions are its second opinion."""
    whole, noise = (
        load_campaign(project / "data" / "replica" / "campaign.toml"),
        NoiseTable(model="positions", sigma_x_m=0.001),
    )
    two, three = (
        whole.problem(runs, noise=noise)
        for runs in (["heavy-04", "heavy-08"], ["heavy-02", "heavy-04", "heavy-08"])
    )
    assert (two.n_par, three.n_par) == (12, 16)
    fits = []
    for posed in (two, three):
        posterior = posed.linearised(posed.start())
        stand_in = SimpleNamespace(
            problem=posed, posterior=posterior, jeffreys=None, spreads_and_effects=((), ())
        )
        fits.append(cast(Fit, stand_in))
    assert [_hard_for_a_chain(fit) and _integrable(fit) for fit in fits] == [False, True]
    few = {
        n: replace(t, columns={c: v[::6] for c, v in t.columns.items()}, lines=t.lines[::6])
        for n, t in whole.tables.items()
    }
    campaign = replace(whole, tables=few)
    problem = campaign.problem(["heavy-04", "heavy-08"], noise=noise, usual=True)
    chosen = analyse_fit(
        fit_least_squares(problem), seed=1, target=Target(ess=1000.0), marginal=True
    )
    assert "exact weights in all dimensions confirm the result" in chosen.comparison.reason
    assert chosen.diagnosis.ok, chosen.diagnosis.reasons


@pytest.mark.slow
def test_runs_of_few_points_need_nodes_and_get_them() -> None:
    """Thirty decays of four points each share their amplitude: the skewness of a single lifetime
    hardly shows, thirty of them move the amplitude by a fifth of its standard deviation.
    """
    rng = np.random.default_rng(1)
    x, sd = np.linspace(0.3, 3.0, 4), 0.15
    tables = {
        f"r{i}": 2.0 * np.exp(-x / rng.lognormal(0.0, 0.4)) + sd * rng.standard_normal(4)
        for i in range(30)
    }
    priors = {"a": LogNormal(2.0, 0.5), "tau": LogNormal(1.0, 0.8)}
    data = {name: DataSet(x, y, u_y=sd) for name, y in tables.items()}
    found = fit_curves("a*exp(-x/tau)", data, shared=["a"], priors=priors, scan=False).fit
    few = {"n_draw": 2000, "n_check": 2000}
    laplace = sample_marginal(found, rng=np.random.default_rng(5), **few)
    assert not laplace.trusted
    chain, agreement = marginal_chain(found, target=Target(), rng=np.random.default_rng(5))
    assert agreement.verdict == "agree"
    # by quadrature: over ln tau in each run, then over a
    a, log_tau = np.linspace(1.6, 2.3, 71), np.linspace(-3.0, 4.0, 351)
    curve = a[:, None, None] * np.exp(-x / np.exp(log_tau)[:, None])
    log_density = stats.norm.logpdf(np.log(a), np.log(2.0), 0.5) - np.log(a)
    for y in tables.values():
        terms = stats.norm.logpdf(y, curve, sd).sum(axis=2) + stats.norm.logpdf(log_tau, 0.0, 0.8)
        log_density += np.logaddexp.reduce(terms, axis=1)
    p = np.exp(log_density - log_density.max())
    mean = p @ a / p.sum()
    width = np.sqrt(p @ (a - mean) ** 2 / p.sum())
    draws, place = chain.flat, found.names.index("a")
    assert draws[:, place].mean() == pytest.approx(mean, abs=0.06 * width)
    assert draws[:, place].std() == pytest.approx(width, rel=0.06)
    assert abs(laplace.mean[place] - mean) > 0.1 * width
