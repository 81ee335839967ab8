"""Data against stated values: the test's size and power, and that a wrong stated value is no ok."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import stats
from troubles import Disk

from estim.campaign import Campaign, load_campaign
from estim.cli import cli
from estim.conflict import Conflict, check_stated_values
from estim.fitting import fit_least_squares
from estim.own_curve import fit_curve
from estim.priors import MEASURED, LogNormal, Normal, Uniform
from estim.synthetic import campaign_design
from estim.trial import Engine, Plan, _experiment

X = np.linspace(0.0, 5.0, 20)
U = 0.1


def line(rng: np.random.Generator, **priors: object) -> Conflict:
    y = 2.0 * X + 1.0 + U * rng.standard_normal(X.size)
    return check_stated_values(fit_curve("a*x + b", X, y, start={"a": 2.0, "b": 1.0}, u_y=U, priors=priors, rng=rng).fit)


def test_two_stated_values_of_a_line_are_a_chi_square_of_the_two_measurements(rng: np.random.Generator) -> None:
    """Against generalised least squares of (slope, intercept) by the data and (slope, intercept) as stated."""
    prior = np.array([2.1, 0.8]), np.array([0.05, 0.15])
    y = 2.0 * X + 1.0 + U * rng.standard_normal(X.size)
    found = check_stated_values(
        fit_curve("a*x + b", X, y, start={"a": 2.0, "b": 1.0}, u_y=U, priors={"a": Normal(2.1, 0.05), "b": Normal(0.8, 0.15)}).fit
    )
    design = np.column_stack([X, np.ones_like(X)])
    cov = U**2 * np.linalg.inv(design.T @ design)
    apart = np.linalg.lstsq(design, y, rcond=None)[0] - prior[0]
    expected = apart @ np.linalg.solve(cov + np.diag(prior[1] ** 2), apart)
    assert found.chi2 == pytest.approx(expected, rel=1e-6)
    assert found.dof == 2
    assert found.p_value == pytest.approx(stats.chi2.sf(expected, 2), rel=1e-5)


def test_pull_of_one_stated_value_is_its_distance_from_the_free_fit(rng: np.random.Generator) -> None:
    y = 2.0 * X + 1.0 + U * rng.standard_normal(X.size)
    free = fit_curve("a*x + b", X, y, start={"a": 2.0, "b": 1.0}, u_y=U)
    found = check_stated_values(fit_curve("a*x + b", X, y, start={"a": 2.0, "b": 1.0}, u_y=U, priors={"a": Normal(2.1, 0.05)}).fit)
    assert found.pulls["a"] == pytest.approx((free.values["a"] - 2.1) / np.hypot(free.sds["a"], 0.05), rel=1e-5)
    assert found.chi2 == pytest.approx(found.pulls["a"] ** 2, rel=1e-6)


def test_priors_that_bound_only_say_nothing_to_disagree_with(rng: np.random.Generator) -> None:
    found = line(rng, a=Uniform(0.0, 10.0))
    assert (found.dof, found.p_value, found.pulls) == (0, 1.0, {})


@pytest.mark.parametrize("sd", [0.3, 1.0])
def test_probability_is_uniform_where_truths_come_from_log_normal_priors(sd: float, rng: np.random.Generator) -> None:
    """The mode of a log-normal prior lies below its median; that must not count as a disagreement."""
    p_values = []
    for _ in range(200):
        a = 2.0 * np.exp(sd * rng.standard_normal())
        y = a * X + 1.0 + U * rng.standard_normal(X.size)
        fit = fit_curve("a*x + b", X, y, start={"a": a, "b": 1.0}, u_y=U, priors={"a": LogNormal(2.0, sd)}).fit
        p_values.append(check_stated_values(fit).p_value)
    assert stats.kstest(p_values, "uniform").pvalue > 0.001


@pytest.mark.slow
def test_probability_is_uniform_for_disks_drawn_from_their_priors_and_not_where_they_are_stated_too_well(project: Path) -> None:
    campaign = load_campaign(project / "data" / "replica" / "campaign.toml")
    fit = fit_least_squares(campaign.problem(["heavy-04"]), rng=np.random.default_rng(1))
    plan = Plan(campaign_design(campaign, ["heavy-04"], fitted=fit.values), "sbc", fit.values, (), Engine(), 1)
    right, wrong = [], []
    for i in range(150):
        values, problem, _ = _experiment(plan, np.random.default_rng([5, i]))
        narrow = [replace(p, prior=Normal(p.prior.centre, 0.3 * p.prior.sd)) if isinstance(p.prior, MEASURED) else p for p in problem.parameters]
        for found, posed in ((right, problem), (wrong, replace(problem, parameters=tuple(narrow)))):
            found.append(check_stated_values(fit_least_squares(posed, rng=np.random.default_rng(2), n_start=1, start=values)).p_value)
    assert stats.kstest(right, "uniform").pvalue > 0.001
    assert stats.kstest(wrong, "uniform").pvalue < 1e-6


def disk(folder: Path, **stated: str) -> Campaign:
    return load_campaign(replace(Disk(), **stated).write(folder))


@pytest.mark.parametrize("stated", [{"phi": '"6.0(4)"'}, {"theta0": '"66.0(15)"'}, {"gamma": '"0.230(10)"', "phi": '"4.0(1)"'}])
def test_wrong_stated_values_are_found_and_the_right_ones_are_not(stated: dict[str, str], tmp_path: Path, rng: np.random.Generator) -> None:
    (tmp_path / "right").mkdir()
    right = fit_least_squares(disk(tmp_path / "right").problem(["r"]), rng=rng)
    wrong = fit_least_squares(disk(tmp_path, **stated).problem(["r"]), rng=rng)
    assert check_stated_values(right).p_value > 0.05
    found = check_stated_values(wrong)
    assert not found.agree
    assert next(iter(stated)) in {name.partition("[")[0] for name in list(found.pulls)[:3]}


def test_a_wrong_stated_value_is_no_ok(tmp_path: Path) -> None:
    campaign = replace(Disk(), phi='"6.0(4)"').write(tmp_path)
    done = CliRunner().invoke(cli, ["fit", str(campaign), "--out", str(tmp_path / "out")])
    assert done.exit_code == 3, done.output
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["status"] == "poor-fit"
    (reason,) = (r for r in result["reasons"] if "stated before" in r)
    assert "φ[r] was stated as 6 °" in reason
    report = (tmp_path / "out" / "report.md").read_text()
    assert "## Do data and stated values agree?" in report
    assert reason in report


def test_a_wrong_stated_value_of_a_formula_is_a_poor_fit_though_the_scatter_is_inferred(rng: np.random.Generator) -> None:
    y = 2.0 * X + 1.0 + U * rng.standard_normal(X.size)
    start = {"a": 2.0, "b": 1.0}
    assert fit_curve("a*x + b", X, y, start=start, priors={"a": Normal(2.0, 0.1)}).status == "ok"
    assert fit_curve("a*x + b", X, y, start=start, priors={"a": Normal(3.0, 0.1)}).status == "poor-fit"


def test_what_is_hardly_in_agreement_is_said_on_the_terminal_though_it_is_ok(tmp_path: Path, rng: np.random.Generator) -> None:
    """The stated angle is moved until p is between the two limits."""
    for theta0 in np.arange(60.0, 66.0, 0.25):
        campaign = replace(Disk(), theta0=f'"{theta0:.2f}(150)"').write(tmp_path)
        if 0.012 < check_stated_values(fit_least_squares(load_campaign(campaign).problem(["r"]), rng=rng, n_start=1)).p_value < 0.045:
            break
    done = CliRunner().invoke(cli, ["fit", str(campaign), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "note: the data hardly agree with what was stated before" in done.output
