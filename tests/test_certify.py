"""Importance sampling against exact moments, exact evidence and brute-force quadrature; its
verdicts on right and wrong chains.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_t
from targets import COV, Known, banana, bimodal, box, chain_errors, exponential, half_normal, normal

from estim.campaign import load_campaign
from estim.common import QUANTILES
from estim.common.errors import NumericalError
from estim.curve_fitting.single import fit_curve
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.pipeline import sample_curve
from estim.sampling import certificate as importance
from estim.sampling import proposal
from estim.sampling.certificate import Certificate, certify, compare_with_chain
from estim.sampling.chain import Chain, Convergence, Target, sample_posterior
from estim.sampling.importance import pareto_smoothed
from estim.sampling.log_density import Density, log_density_in_batches
from estim.sampling.proposal import Proposal, adapt_proposal
from estim.studies.reanalysis import Reanalysis

TARGETS = {
    "normal": (normal(COV), np.zeros(4), COV),
    "normal, far and narrow start": (normal(COV), np.array([3.0, -3.0, 5.0, 2.0]), 0.01 * COV),
    "normal in 12 dimensions": (normal(np.eye(12)), np.zeros(12), np.eye(12)),
    "half-normal": (half_normal(4), np.full(4, 1e-6), np.eye(4)),
    "mode in the corner": (exponential(3), np.full(3, 1e-6), 1e4 * np.eye(3)),
    "flat box": (box(3), np.zeros(3), 0.3 * np.eye(3)),
    "banana": (banana(0.4), np.zeros(2), np.eye(2)),
}


def test_the_density_of_many_draws_is_that_of_each(rng: np.random.Generator) -> None:
    factors = np.tril(rng.standard_normal((3, 2, 2))) + 3.0 * np.eye(2)
    mixture = Proposal(np.array([0.2, 0.3, 0.5]), rng.standard_normal((3, 2)), factors)
    draws = mixture.draw(rng, 1203)
    each = [
        sum(
            weight * multivariate_t.pdf(draw, mean, factor @ factor.T, df=mixture.dof)
            for weight, mean, factor in zip(
                mixture.weights, mixture.means, mixture.factors, strict=True
            )
        )
        for draw in draws
    ]
    np.testing.assert_allclose(mixture.log_density(draws), np.log(each), rtol=1e-10)
    assert mixture.log_density(draws[:0]).size == 0


def certificate_of(
    density: Density,
    start: np.ndarray,
    cov: np.ndarray,
    *,
    rng: np.random.Generator,
    starts: Sequence[np.ndarray] = (),
) -> Certificate:
    return certify(density, adapt_proposal(density, start, cov, rng=rng, starts=starts), rng=rng)


def deviations(certificate: Certificate, known: Known) -> np.ndarray:
    """Deviations from the truth of means, standard deviations and evidence, in stated Monte-Carlo
    errors.
    """
    evidence = (certificate.log_evidence - known.log_evidence) / certificate.u_log_evidence
    return np.array(
        [
            *(certificate.mean - known.mean) / certificate.mcse_mean,
            *(certificate.sd - known.sd) / certificate.mcse_sd,
            evidence,
        ]
    )


@pytest.mark.parametrize("name", TARGETS)
def test_moments_and_evidence_are_the_known_ones(name: str, rng: np.random.Generator) -> None:
    known, start, cov = TARGETS[name]
    certificate = certificate_of(known, start, cov, rng=rng)
    assert certificate.reliable
    assert certificate.ess > 2500.0
    assert np.all(np.abs(deviations(certificate, known)) < 4.5)
    assert np.all(certificate.mcse_mean < 0.03 * known.sd)
    assert certificate.u_log_evidence < 0.02


@pytest.mark.statistics
@pytest.mark.parametrize("name", ["normal", "half-normal", "banana"])
def test_stated_monte_carlo_errors_are_the_scatter_of_repeated_runs(name: str) -> None:
    known, start, cov = TARGETS[name]
    n_repeat = 40
    runs = [
        certificate_of(known, start, cov, rng=np.random.default_rng([3, i]))
        for i in range(n_repeat)
    ]
    z = np.array([deviations(run, known) for run in runs])
    rms = np.sqrt(np.mean(z**2))
    # parameters of one run are correlated: count the runs alone as independent
    assert abs(rms - 1.0) < 4.0 / math.sqrt(2.0 * n_repeat)
    # a wrong error would show: errors as if all draws had equal weight
    scale = np.array([math.sqrt(run.ess / run.n_draw) for run in runs])
    if name == "half-normal":
        assert np.sqrt(np.mean((z / scale[:, None]) ** 2)) > 1.0 + 4.0 / math.sqrt(2.0 * n_repeat)


def test_quantiles_are_those_of_the_half_normal_distribution(rng: np.random.Generator) -> None:
    from scipy.stats import halfnorm

    certificate = certificate_of(*TARGETS["half-normal"], rng=rng)
    for p in QUANTILES:
        assert np.all(
            np.abs(halfnorm.cdf(certificate.quantiles[p]) - p) < 4.5 * certificate.mcse_shares[p]
        )
        assert np.all(np.abs(certificate.quantiles[p] - halfnorm.ppf(p)) < 0.2)
        assert np.all(certificate.mcse_shares[p] < 0.015)


@pytest.mark.statistics
def test_errors_of_quantiles_are_the_scatter_of_repeated_runs_and_scatter_little_themselves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """An error that is right on average and scatters by a fifth makes false alarms: the tails of
    the ratio are those of Student's t.
    """
    from scipy.stats import norm

    known, proposal, n_repeat, p = (
        normal(np.eye(6)),
        Proposal.single(np.zeros(6), np.eye(6)),
        60,
        np.array(QUANTILES)[:, None],
    )

    def repeated() -> tuple[np.ndarray, np.ndarray]:
        """Deviations in stated errors, and those errors, both (n_repeat, n_probability, n_par)."""
        runs = [
            certify(known, proposal, rng=np.random.default_rng([6, i])) for i in range(n_repeat)
        ]
        errors = np.array([[run.mcse_shares[q] for q in QUANTILES] for run in runs])
        return np.array(
            [norm.cdf([run.quantiles[q] for q in QUANTILES]) - p for run in runs]
        ) / errors, errors

    z, errors = repeated()
    chance = 4.0 / math.sqrt(2.0 * n_repeat * 6)
    assert np.all(np.abs(np.sqrt(np.mean(z**2, axis=(0, 2))) - 1.0) < chance)
    assert np.max(np.std(errors, axis=0) / np.mean(errors, axis=0)) < 0.03

    # the density at an end by the few draws within an error of it, and errors of draws that all
    # weigh the same
    def error_of_a_few(column: importance._Column, p: float) -> float:
        u = math.sqrt(float(np.sum(column.weights**2 * ((column.values <= column.at(p)) - p) ** 2)))
        return (
            float(norm.pdf(norm.ppf(p)))
            * 0.5
            * (column.at(min(p + u, 1.0)) - column.at(max(p - u, 0.0)))
        )

    naive = np.sqrt(p * (1.0 - p) / 8000.0)
    assert np.all(np.sqrt(np.mean((z * errors / naive) ** 2, axis=(0, 2)))[1:4] > 1.0 + chance)
    monkeypatch.setattr(importance._Column, "error_below", error_of_a_few)
    _, noisy = repeated()
    assert np.min((np.std(noisy, axis=0) / np.mean(noisy, axis=0))[[0, -1]]) > 0.12


@pytest.mark.statistics
def test_ends_of_a_short_chain_are_compared_in_errors_that_are_those_of_a_normal_deviate() -> None:
    known, proposal, n_repeat = normal(np.eye(4)), Proposal.single(np.zeros(4), np.eye(4)), 400
    runs = []
    for i in range(n_repeat):
        rng = np.random.default_rng([9, i])
        chain = chain_of(autoregressive(rng, (4, 125, 24, 4), 0.4))
        runs.append(compare_with_chain(certify(known, proposal, rng=rng), chain).z[2:])
    z = np.abs(runs)
    assert abs(np.sqrt(np.mean(z**2)) - 1.0) < 4.0 / math.sqrt(2.0 * z.size)
    # one in a thousand beyond 3.29; three times that is far outside of chance
    assert np.sum(z > 3.2905) < 0.001 * z.size + 4.0 * math.sqrt(0.001 * z.size)
    assert np.max(z) < 4.7


def test_resampled_draws_have_the_moments_of_the_weighted_ones(rng: np.random.Generator) -> None:
    certificate = certificate_of(*TARGETS["normal"], rng=rng)
    n = certificate.draws.shape[0]
    assert np.all(
        np.abs(certificate.draws.mean(axis=0) - certificate.mean)
        < 5.0 * certificate.sd / math.sqrt(n)
    )
    # in random order: the halves agree as well
    first, second = certificate.draws[: n // 2], certificate.draws[n // 2 :]
    assert np.all(
        np.abs(first.mean(axis=0) - second.mean(axis=0)) < 5.0 * certificate.sd * 2.0 / math.sqrt(n)
    )


def test_two_modes_are_weighed_rightly_when_both_starts_are_given_and_one_is_missed_otherwise(
    rng: np.random.Generator,
) -> None:
    known = bimodal(3)
    both = certificate_of(
        known, np.full(3, -4.0), 0.25 * np.eye(3), rng=rng, starts=[np.full(3, 4.0)]
    )
    assert both.reliable
    assert np.all(np.abs(deviations(both, known)) < 4.5)
    one = certificate_of(known, np.full(3, -4.0), 0.25 * np.eye(3), rng=rng)
    assert one.log_evidence - known.log_evidence == pytest.approx(math.log(0.7), abs=0.05)


def test_proposal_with_tails_too_light_is_flagged(rng: np.random.Generator) -> None:
    known = normal(np.eye(4))
    wrong = certify(known, Proposal.single(np.zeros(4), 0.08**2 * np.eye(4)), rng=rng)
    assert not wrong.reliable
    assert wrong.n_draw == 64_000
    right = certify(known, Proposal.single(np.zeros(4), np.eye(4)), rng=rng)
    assert right.reliable
    assert right.n_draw == 8000
    assert (
        compare_with_chain(wrong, chain_of(rng.standard_normal((4, 200, 10, 4)))).verdict
        == "missing"
    )


def test_wide_draws_mend_a_proposal_that_is_too_narrow(rng: np.random.Generator) -> None:
    known, narrow = normal(np.eye(4)), Proposal.single(np.zeros(4), 0.12**2 * np.eye(4))
    bare = narrow.draw(rng, 64_000)
    assert pareto_smoothed(known.log_density(bare) - narrow.log_density(bare))[1] > 0.7
    mended = certify(known, narrow, rng=rng)
    assert mended.reliable
    assert np.all(np.abs(deviations(mended, known)) < 4.5)


def test_pareto_smoothed_leave_ordinary_weights_alone_and_tame_the_largest(
    rng: np.random.Generator,
) -> None:
    even, k_even, log_mean = pareto_smoothed(0.1 * rng.standard_normal(5000))
    assert k_even < 0.3
    assert np.exp(even).sum() == pytest.approx(1.0)
    assert log_mean == pytest.approx(0.005, abs=0.006)
    heavy = rng.pareto(1.0, 5000)
    weights, k_hat, _ = pareto_smoothed(np.log(heavy))
    assert 0.7 < k_hat < 1.3
    assert np.exp(weights.max()) <= heavy.max() / heavy.sum() * 1.5
    assert pareto_smoothed(np.zeros(100))[1] == -math.inf
    assert pareto_smoothed(np.where(np.arange(1000) < 20, 0.0, -np.inf))[1] == math.inf


def test_proposal_density_is_normalised_and_is_that_of_its_draws(rng: np.random.Generator) -> None:
    from scipy.stats import multivariate_t

    factors = np.stack([np.eye(2), np.array([[0.5, 0.0], [0.3, 0.2]])])
    proposal = Proposal(np.array([0.3, 0.7]), np.array([[0.0, 0.0], [2.0, 1.0]]), factors)
    points = rng.standard_normal((50, 2))
    parts = [
        w * multivariate_t(m, f @ f.T, df=5).pdf(points)
        for w, m, f in zip(proposal.weights, proposal.means, factors, strict=True)
    ]
    assert np.allclose(np.exp(proposal.log_density(points)), sum(parts), rtol=1e-10)
    # far from 0, at numbers without rounding
    points, far = np.round(1024.0 * points) / 1024.0, 2.0**30
    moved = dataclasses.replace(proposal, means=proposal.means + far)
    assert np.allclose(moved.log_density(points + far), proposal.log_density(points), rtol=1e-12)
    draws = proposal.draw(rng, 40_000)
    covariance = [5.0 / 3.0 * f @ f.T for f in factors]
    mean = 0.3 * proposal.means[0] + 0.7 * proposal.means[1]
    between = 0.21 * np.outer(proposal.means[1], proposal.means[1])
    assert np.allclose(draws.mean(axis=0), mean, atol=0.04)
    assert np.allclose(
        np.cov(draws.T), 0.3 * covariance[0] + 0.7 * covariance[1] + between, atol=0.06
    )


def test_density_that_is_not_a_number_is_an_error(rng: np.random.Generator) -> None:
    broken = dataclasses.replace(
        normal(COV), function=lambda x: np.where(x[:, 0] > 0.0, np.nan, 0.0)
    )
    with pytest.raises(NumericalError, match=r"not a number .* at p0 = "):
        adapt_proposal(broken, np.zeros(4), COV, rng=rng)
    nowhere = dataclasses.replace(normal(COV), function=lambda x: np.full(len(x), -np.inf))
    with pytest.raises(NumericalError, match="zero or not finite everywhere"):
        adapt_proposal(nowhere, np.zeros(4), COV, rng=rng)


def test_density_is_asked_in_batches_of_bounded_size(rng: np.random.Generator) -> None:
    sizes: list[int] = []

    def function(x: np.ndarray) -> np.ndarray:
        sizes.append(len(x))
        return -0.5 * np.sum(x**2, axis=1)

    draws = rng.standard_normal((4500, 4))
    values = log_density_in_batches(dataclasses.replace(normal(COV), function=function), draws)
    assert np.array_equal(values, -0.5 * np.sum(draws**2, axis=1))
    assert max(sizes) <= 2000


def chain_of(draws: np.ndarray) -> Chain:
    """A chain record around given draws (n_ensemble, n_step, n_walker, n_par)."""
    convergence = Convergence(draws.shape[1], 1.0, 1e4, 1e4, 1.0, True, ())
    names = tuple(f"p{i}" for i in range(draws.shape[-1]))
    return Chain(
        names, draws, np.zeros(draws.shape[:-1]), 0, np.ones(draws.shape[0]), 0, convergence
    )


def autoregressive(rng: np.random.Generator, shape: tuple[int, ...], memory: float) -> np.ndarray:
    """Normal draws along axis 1 with correlation `memory` between neighbours: a chain whose
    Monte-Carlo errors are known.
    """
    draws = rng.standard_normal(shape)
    for i in range(1, shape[1]):
        draws[:, i] = memory * draws[:, i - 1] + math.sqrt(1.0 - memory**2) * draws[:, i]
    return draws


@pytest.mark.statistics
def test_true_agreement_is_called_so_and_its_differences_are_standard_normal() -> None:
    known = normal(np.eye(4))
    verdicts, zs, naive = [], [], []
    for i in range(150):
        rng = np.random.default_rng([8, i])
        chain = chain_of(autoregressive(rng, (4, 150, 16, 4), 0.6))
        comparison = compare_with_chain(
            certify(known, Proposal.single(np.zeros(4), np.eye(4)), rng=rng), chain
        )
        verdicts.append(comparison.verdict)
        zs.append(comparison.z.ravel())
        naive.append(chain.flat.mean(axis=0) * math.sqrt(chain.flat.shape[0]))
    assert set(verdicts) == {"agree"}
    rms = np.sqrt(np.mean(np.square(zs), axis=0))
    # 1/sqrt(2 n) is the standard error of each; 20 of them
    assert np.all(np.abs(rms - 1.0) < 4.0 / math.sqrt(300.0))
    # errors that forget the correlation of the chain would be caught: (1 + 0.6)/(1 - 0.6) = 4 times
    # the variance
    assert np.all(np.sqrt(np.mean(np.square(naive), axis=0)) > 1.0 + 4.0 / math.sqrt(300.0))


def test_chain_errors_are_those_of_theory_for_a_chain_with_known_memory(
    rng: np.random.Generator,
) -> None:
    draws = autoregressive(rng, (4, 2000, 20, 2), 0.6)
    u_mean, u_sd = chain_errors(chain_of(draws))
    n = draws[..., 0].size
    assert u_mean == pytest.approx(math.sqrt(4.0 / n), rel=0.05)
    # squares of such a chain forget twice as fast: memory 0.36
    assert u_sd == pytest.approx(math.sqrt(0.5 * (1.36 / 0.64) / n), rel=0.07)


@pytest.mark.parametrize(
    ("shift", "stretch", "word"), [(0.15, 1.0, "median"), (0.0, 1.12, "97.5 % quantile")]
)
def test_chain_that_is_off_is_called_and_the_parameter_named(
    shift: float, stretch: float, word: str, rng: np.random.Generator
) -> None:
    certificate = certificate_of(normal(np.eye(4)), np.zeros(4), np.eye(4), rng=rng)
    draws = rng.standard_normal((4, 100, 20, 4))
    assert compare_with_chain(certificate, chain_of(draws)).verdict == "agree"
    draws[..., 2] = shift + stretch * draws[..., 2]
    comparison = compare_with_chain(certificate, chain_of(draws))
    assert comparison.verdict == "disagree"
    assert f"the {word} of p2" in comparison.reason
    assert "p1" not in comparison.reason
    quantiles = np.array([-1.96, -0.994, 0.0, 0.994, 1.96])
    assert comparison.differences[:, 2] == pytest.approx(
        shift + (stretch - 1.0) * quantiles, abs=0.1
    )
    assert comparison.largest_difference == np.max(np.abs(comparison.differences))


@pytest.mark.statistics
def test_a_line_through_a_few_points_of_unknown_scatter_raises_no_alarm() -> None:
    """With two degrees of freedom the tail of the scatter has no variance, and its standard
    deviation no error that would mean anything: a comparison of moments called 2 of these.
    """
    for k in range(40):
        rng, n = np.random.default_rng(k), 4 + k % 4
        x = np.arange(1.0, n + 1.0)
        fit = fit_curve("a+b*x", x, 1.0 + x + 0.1 * rng.standard_normal(n))
        assert sample_curve(fit, seed=k + 1).comparison.verdict == "agree", k


def test_negligible_difference_is_not_called_however_well_it_is_known(
    rng: np.random.Generator,
) -> None:
    known = normal(np.eye(1))
    certificate = certify(
        known, Proposal(np.ones(1), np.zeros((1, 1)), np.eye(1)[None]), rng=rng, n_draw=64_000
    )
    comparison = compare_with_chain(
        certificate, chain_of(rng.standard_normal((4, 4000, 20, 1)) + 0.02)
    )
    assert abs(comparison.z[2, 0]) > comparison.limit / 1.5
    assert comparison.verdict == "agree"


def test_no_verdict_where_importance_sampling_or_the_chain_cannot_tell(
    rng: np.random.Generator,
) -> None:
    many = certificate_of(normal(np.eye(15)), np.zeros(15), np.eye(15), rng=rng)
    comparison = compare_with_chain(many, chain_of(rng.standard_normal((4, 100, 30, 15))))
    assert comparison.verdict == "missing"
    assert "14 parameters" in comparison.reason
    few = certificate_of(normal(np.eye(2)), np.zeros(2), np.eye(2), rng=rng)
    comparison = compare_with_chain(few, chain_of(rng.standard_normal((4, 10, 2, 2))))
    assert comparison.verdict == "missing"
    assert "too large for a decision" in comparison.reason


def replica_fit(
    replica: Path, folder: Path, runs: Sequence[str], replace: Sequence[tuple[str, str]] = ()
) -> Fit:
    """The fit of runs of the replica campaign, with some of its quantities said otherwise."""
    text = (replica / "campaign.toml").read_text()
    for old, new in [
        ('file = "runs/', f'file = "{replica}/runs/'),
        ('published = "../paper/published.toml"\n', ""),
        *replace,
    ]:
        assert old in text
        text = text.replace(old, new)
    path = folder / "campaign.toml"
    path.write_text(text.split("[line]")[0])
    return fit_least_squares(load_campaign(path).problem(runs))


def quadrature(fit: Fit, *, n: int, reach: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Means, standard deviations and log evidence by the trapezoidal rule on n^n_par points along
    the axes of the fit's covariance.
    """
    values, vectors = np.linalg.eigh(fit.cov)
    axes = vectors * np.sqrt(values)
    steps = np.linspace(-reach, reach, n)
    grid = np.stack([g.ravel() for g in np.meshgrid(*[steps] * len(values), indexing="ij")], axis=1)
    points = fit.values + grid @ axes.T
    log_p = np.concatenate(
        [fit.posterior.log_density(part) for part in np.array_split(points, 100)]
    )
    edge = np.any(np.abs(grid) > reach - 1e-9, axis=1)
    assert np.max(log_p[edge]) < np.max(log_p) - 12.0, "the grid is too small"
    weights = np.exp(log_p - np.max(log_p))
    log_evidence = (
        np.max(log_p)
        + np.log(weights.sum())
        + np.log(np.abs(np.linalg.det(axes)) * (steps[1] - steps[0]) ** len(values))
    )
    weights /= weights.sum()
    mean = weights @ points
    return mean, np.sqrt(weights @ (points - mean) ** 2), float(log_evidence)


@pytest.mark.slow
def test_certificate_and_chain_agree_with_brute_force_quadrature(
    replica: Path, tmp_path: Path
) -> None:
    exact = [
        ('"0.14929(50)"', "0.14929"),
        ('phi_deg = "3.69(40)"', "phi_deg = 3.69"),
        ('rolling_resistance = {prior = "half-normal", scale = 0.005}', "rolling_resistance = 0.0"),
    ]
    fit = replica_fit(replica, tmp_path, ["heavy-04"], exact)
    assert len(fit.names) == 3
    mean, sd, log_evidence = quadrature(fit, n=31, reach=8.0)
    finer = quadrature(fit, n=39, reach=9.0)
    assert np.all(np.abs(mean - finer[0]) < 1e-3 * sd)
    rng = np.random.default_rng(5)
    proposal = adapt_proposal(fit.posterior, fit.values, fit.cov, rng=rng)
    certificate = certify(fit.posterior, proposal, rng=rng, n_draw=300_000)
    assert certificate.reliable
    chain = sample_posterior(
        fit.posterior,
        fit.values,
        fit.cov,
        target=Target(ess=150_000, n_walker=400),
        rng=rng,
        proposal=proposal,
    )
    assert chain.convergence.met
    # 150 000 effective draws: Monte-Carlo errors of 0.26 % of an sd
    for found_mean, found_sd in (
        (certificate.mean, certificate.sd),
        (chain.flat.mean(axis=0), chain.flat.std(axis=0)),
    ):
        assert np.all(np.abs(found_mean - mean) < 0.01 * sd)
        assert np.all(np.abs(found_sd / sd - 1.0) < 0.01)
    assert abs(certificate.log_evidence - log_evidence) < 4.5 * certificate.u_log_evidence < 0.02
    # the Gaussian approximation of the fit would not pass
    assert np.any(np.abs(fit.values - mean) > 0.01 * sd) or np.any(
        np.abs(np.sqrt(np.diag(fit.cov)) / sd - 1.0) > 0.01
    )


def assert_agree(certificate: Certificate, chain: Chain) -> None:
    assert chain.convergence.met, chain.convergence.message
    comparison = compare_with_chain(certificate, chain)
    assert comparison.verdict == "agree", comparison.reason
    # a chain of another posterior would not pass
    moved = dataclasses.replace(chain, draws=chain.draws + 0.25 * certificate.sd)
    assert compare_with_chain(certificate, moved).verdict == "disagree"


@pytest.mark.slow
def test_chain_and_certificate_agree_for_the_runs_of_the_replica_one_by_one_and_together(
    reanalysed: Reanalysis,
) -> None:
    for analysis in (*reanalysed.single_runs.values(), *(body.joint for body in reanalysed.bodies)):
        assert analysis.certificate is not None
        assert_agree(analysis.certificate, analysis.chain)


@pytest.mark.slow
@pytest.mark.parametrize(
    "which",
    [
        "class-unbalanced_1",
        pytest.param("mixed-balanced_1", marks=pytest.mark.statistics),
        "banana",
        "half-normal",
    ],
)
def test_chain_and_certificate_agree(which: str, project: Path) -> None:
    rng = np.random.default_rng(17)
    if which in TARGETS:
        density, start, cov = TARGETS[which]
    else:
        campaign = "campaign.toml" if which.startswith("class-") else "mixed.toml"
        fit = fit_least_squares(
            load_campaign(project / "data" / "wheel" / campaign).problem([which])
        )
        density, start, cov = fit.posterior, fit.values, fit.cov
    proposal = adapt_proposal(density, start, cov, rng=rng)
    certificate = certify(density, proposal, rng=rng)
    assert_agree(
        certificate,
        sample_posterior(density, start, cov, target=Target(), rng=rng, proposal=proposal),
    )


def test_draws_of_which_one_has_all_the_weight_are_one_component(rng: np.random.Generator) -> None:
    draws, weights = rng.standard_normal((50, 3)), np.eye(50)[7]
    found = proposal._split(draws, weights, 4, rng)
    assert found.weights == pytest.approx([1.0])
    assert found.means[0] == pytest.approx(draws[7], abs=1e-6)
    assert np.all(np.isfinite(found.draw(rng, 10)))


def test_draws_of_a_certificate_come_with_their_density(rng: np.random.Generator) -> None:
    density = normal(COV)
    found = certificate_of(density, np.zeros(4), COV, rng=rng)
    np.testing.assert_array_equal(found.log_density, density.log_density(found.draws))
