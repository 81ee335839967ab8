"""Do runs agree?  The statistics against textbook formulas, their null distribution, and runs that
are wrong on purpose.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from joint_runs import LINE, problem_of, simulated_campaign
from scipy import stats

from estim.campaign import load_campaign
from estim.checks.consistency import PRIORS, Consistency, check_consistency
from estim.common.errors import InputError
from estim.discrepancy.joint_runs import sharing_runs
from estim.drawing import VERMILION, png
from estim.fitting import fit_problem
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.problem.priors import HalfNormal, Normal, Prior, Uniform
from estim.reports.consistency import consistency_text, forest_figure

X = np.linspace(0.0, 1.0, 8)
STATED = {"slope": Normal(1.0, 0.4), "bend": Normal(0.0, 0.4)}
SIGMA = 0.2


def lines(rng: np.random.Generator, slopes: list[float], *, bend: float = 0.0) -> list[np.ndarray]:
    return [
        slope * X + bend * X**2 + rng.normal(0.0, 0.5) + SIGMA * rng.standard_normal(X.size)
        for slope in slopes
    ]


def fitted(ys: list[np.ndarray], shared: dict[str, Prior] | None = None) -> Fit:
    problem = problem_of(
        LINE, STATED if shared is None else shared, {"offset": Normal(0.0, 0.5)}, X, ys, SIGMA
    )
    return fit_least_squares(problem)


def textbook(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Estimate of (slope, bend) and its covariance from one run, offset integrated out, no prior on
    them.
    """
    design = np.column_stack([X, X**2])
    weight = np.linalg.inv(SIGMA**2 * np.eye(X.size) + 0.25)
    cov = np.linalg.inv(design.T @ weight @ design)
    return cov @ design.T @ weight @ y, cov


def minimum(ys: list[np.ndarray], *, prior: bool) -> float:
    """Least chi^2 of runs together by plain linear algebra, the stated values counted once or not
    at all.
    """
    estimates = [textbook(y) for y in ys]
    weight = np.linalg.inv(SIGMA**2 * np.eye(X.size) + 0.25)
    design = np.column_stack([X, X**2])
    information = sum(np.linalg.inv(cov) for _, cov in estimates) + (
        np.eye(2) / 0.16 if prior else 0.0
    )
    right = sum(np.linalg.solve(cov, mean) for mean, cov in estimates) + (
        np.array([1.0, 0.0]) / 0.16 if prior else 0.0
    )
    best = np.linalg.solve(information, right)
    chi2 = sum((y - design @ best) @ weight @ (y - design @ best) for y in ys)
    return float(chi2 + (np.sum((best - [1.0, 0.0]) ** 2) / 0.16 if prior else 0.0))


def test_statistic_is_the_joint_minimum_minus_the_separate_ones_with_priors_counted_once(
    rng: np.random.Generator,
) -> None:
    ys = lines(rng, [1.0, 1.4, 0.8, 1.1])
    found = check_consistency(fitted(ys))
    expected = minimum(ys, prior=True) - sum(minimum([y], prior=False) for y in ys)
    assert found.chi2 == pytest.approx(expected, rel=1e-4)
    assert found.dof == 4 * 2 + 2 - 2
    assert found.p_value == pytest.approx(stats.chi2.sf(expected, 8), rel=1e-3)
    # the wrong version: every separate fit with the stated values in it
    assert (
        abs(minimum(ys, prior=True) - sum(minimum([y], prior=True) for y in ys) - found.chi2) > 0.05
    )


def test_distance_of_a_run_is_its_mahalanobis_distance_from_all_others(
    rng: np.random.Generator,
) -> None:
    ys = lines(rng, [1.0, 1.4, 0.8])
    found = check_consistency(fitted(ys))
    for i, row in enumerate(found.rows[:3]):
        mean, cov = textbook(ys[i])
        others = [textbook(y) for j, y in enumerate(ys) if j != i]
        information = sum(np.linalg.inv(c) for _, c in others) + np.eye(2) / 0.16
        pooled = np.linalg.solve(
            information, sum(np.linalg.solve(c, m) for m, c in others) + np.array([1.0, 0.0]) / 0.16
        )
        distance = (mean - pooled) @ np.linalg.solve(
            cov + np.linalg.inv(information), mean - pooled
        )
        assert row.distance2 == pytest.approx(distance, rel=1e-4)
        assert row.dof == 2
        assert found.others[row.source].mean == pytest.approx(pooled, abs=1e-5)
        assert found.others[row.source].sd == pytest.approx(
            np.sqrt(np.diag(np.linalg.inv(information))), rel=1e-5
        )
    assert found.rows[3].source == PRIORS


def simulated_p_values(
    n: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(n,) p of all together, (n, 3) p of each run against the others, (n, 3) of each run against
    the joint fit it is part of.
    """
    together, apart, naive = [], [], []
    for _ in range(n):
        slope, bend = 1.0 + 0.4 * rng.standard_normal(), 0.4 * rng.standard_normal()
        ys = lines(rng, [slope] * 3, bend=bend)
        fit = fitted(ys)
        found = check_consistency(fit)
        together.append(found.p_value)
        apart.append([row.p_value for row in found.rows[:3]])
        row = []
        for y in ys:
            mean, cov = textbook(y)
            row.append(
                stats.chi2.sf(
                    (mean - fit.values[:2])
                    @ np.linalg.solve(cov + fit.cov[:2, :2], mean - fit.values[:2]),
                    2,
                )
            )
        naive.append(row)
    return np.array(together), np.array(apart), np.array(naive)


@pytest.mark.statistics
def test_p_values_are_uniform_where_runs_agree(rng: np.random.Generator) -> None:
    together, apart, naive = simulated_p_values(400, rng)
    assert stats.kstest(together, "uniform").pvalue > 0.01
    for i in range(3):
        assert stats.kstest(apart[:, i], "uniform").pvalue > 0.003
    # the wrong version: a run against a mean that it is part of
    assert stats.kstest(naive[:, 0], "uniform").pvalue < 1e-6


def test_run_that_disagrees_is_named_and_no_other(rng: np.random.Generator) -> None:
    found = check_consistency(fitted(lines(rng, [1.0, 1.0, 3.0, 1.0, 1.0])))
    assert not found.agree
    assert found.suspects == ("r2",)
    assert "run r2 disagrees with the others" in found.verdict
    holm = {row.source: row.p_holm for row in found.rows}
    assert holm["r2"] < 1e-4
    text = consistency_text(found)
    assert "**Run r2 disagrees" in text
    assert text.count("| slope | r") == 5
    assert text.splitlines()[1] == ""


def test_one_of_very_many_runs_that_disagrees_is_named(rng: np.random.Generator) -> None:
    """Of 150 runs each has less than a hundredth of the information."""
    slopes = [1.0] * 150
    assert check_consistency(fitted(lines(rng, slopes))).agree
    slopes[70] = 4.0
    found = check_consistency(fitted(lines(rng, slopes)))
    assert found.dof > 200
    assert found.suspects == ("r70",)


def test_what_only_stated_values_tell_adds_no_degrees_of_freedom(rng: np.random.Generator) -> None:
    """Beside a bend that was stated far better than eight points tell, runs are compared in what is
    left to them.
    """
    sharp = {"slope": Normal(1.0, 0.4), "bend": Normal(0.0, 0.003)}
    found = check_consistency(fitted(lines(rng, [1.0, 1.0, 1.0, 1.0, 2.5]), sharp))
    assert found.dof == 5
    assert found.suspects == ("r4",)


def test_two_runs_that_disagree_cannot_be_told_apart_without_stated_values(
    rng: np.random.Generator,
) -> None:
    flat = {"slope": Uniform(-10.0, 10.0), "bend": Uniform(-10.0, 10.0)}
    found = check_consistency(fitted(lines(rng, [1.0, 3.5]), flat))
    assert not found.agree
    assert set(found.suspects) == {"r0", "r1"}
    assert "cannot show which of these is wrong: r" in found.verdict
    assert [row.source for row in found.rows] == ["r0", "r1"]
    assert found.rows[0].distance2 == pytest.approx(found.rows[1].distance2)


def test_stated_value_against_all_runs_is_what_is_named(rng: np.random.Generator) -> None:
    found = check_consistency(
        fitted(lines(rng, [1.0] * 6), {"slope": Normal(3.0, 0.1), "bend": Normal(0.0, 0.1)})
    )
    assert found.suspects == (PRIORS,)
    assert "agree with each other but not with the stated values" in found.verdict


def test_parameter_on_its_bound_does_not_alarm(rng: np.random.Generator) -> None:
    """Runs of slope 0 under a prior that starts there: the joint mode lies on the edge."""
    fit = fitted(lines(rng, [-0.1] * 4), {"slope": HalfNormal(0.5), "bend": Normal(0.0, 0.05)})
    found = check_consistency(fit)
    assert found.agree
    assert np.all(np.isfinite(found.joint.mean))


def test_runs_that_share_nothing_are_refused(rng: np.random.Generator) -> None:
    own = {"offset": Normal(0.0, 0.5), "slope": Normal(1.0, 1.0), "bend": Normal(0.0, 1.0)}
    problem = problem_of(LINE, {}, own, X, lines(rng, [1.0, 1.0]), SIGMA)
    with pytest.raises(InputError, match="in common to be compared: r0, r1"):
        check_consistency(fit_least_squares(problem))


# --- rolling disks


def check_disks(folder: Path, rng: np.random.Generator, gammas: list[float]) -> Consistency:
    campaign = simulated_campaign(folder, rng, gammas=gammas, u_phi_deg=0.1)
    return check_consistency(fit_least_squares(campaign.problem(campaign.run_names)))


def test_disk_with_another_gamma_is_named(tmp_path: Path, rng: np.random.Generator) -> None:
    found = check_disks(tmp_path, rng, [0.187, 0.187, 0.187, 0.25, 0.187, 0.187])
    assert found.suspects == ("r3",)
    assert found.rows[3].p_holm < 1e-3
    assert check_disks(tmp_path, rng, [0.187] * 6).agree


@pytest.mark.slow
@pytest.mark.parametrize("each", [2, pytest.param(4, marks=pytest.mark.statistics)])
def test_runs_of_two_bodies_with_forces_agree(each: int, project: Path) -> None:
    """Rounding errors in its information on the other body's parameters were taken for a
    disagreement of 1e21.
    """
    campaign = load_campaign(project / "data" / "replica" / "campaign.toml")
    names = campaign.run_names
    problem = campaign.problem([*names[:each], *names[4 : 4 + each]], usual=True)
    fit = fit_problem(problem, rng=np.random.default_rng(0), near=problem.start())
    found = check_consistency(fit)
    assert len(sharing_runs(problem.runs)) == 2
    assert found.agree
    assert found.p_value > 0.01


@pytest.mark.statistics
def test_p_values_of_disks_that_agree_are_uniform(tmp_path: Path, rng: np.random.Generator) -> None:
    """The curve is not linear: the statistic is still calibrated to what 40 campaigns of 3 runs can
    tell.
    """
    together = []
    for _ in range(40):
        gamma = 0.187 + 0.01 * rng.standard_normal()
        together.append(check_disks(tmp_path, rng, [gamma] * 3).p_value)
    assert stats.kstest(together, "uniform").pvalue > 0.01


def test_figure_marks_the_run_that_disagrees(rng: np.random.Generator) -> None:
    found = check_consistency(fitted(lines(rng, [1.0, 1.0, 3.0, 1.0, 1.0])))
    figure = forest_figure(found)
    bold = [
        tick.get_text()
        for tick in figure.axes[0].get_yticklabels()
        if tick.get_fontweight() == "bold"
    ]
    assert bold == ["r2"]
    colours = [line.get_color() for line in figure.axes[0].get_lines()]
    assert colours.count(VERMILION) == 1
    assert png(lambda: figure)[:4] == b"\x89PNG"
    assert len(re.findall(r"^\| \w+ \| r\d \|", consistency_text(found), re.MULTILINE)) == 10
