"""Where the uncertainty of a fit comes from: against matrices written out, refits with one input
moved, and draws.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estim import Component, curve_report, fit_curve, sample_curve
from estim.campaign import load_campaign
from estim.curve_fitting.result import CurveFit
from estim.fitting import Fit, fit_least_squares, fit_problem
from estim.problem import Normal, Problem
from estim.problem.roots import covariance_of
from estim.reports.records import labels_of
from estim.reports.uncertainty_budget import shares_of
from estim.sampling import Target
from estim.studies.fit_uncertainty_budget import FitBudget, uncertainty_budget

X = np.linspace(0.0, 1.0, 12)
U, U_CLOCK, U_B = 0.05, 0.02, 0.03


def line() -> CurveFit:
    y = 2.0 * X + 0.1 + U * np.random.default_rng(5).standard_normal(X.size)
    return fit_curve(
        "a*x + b",
        X,
        y,
        u_y=U,
        start={"a": 1.0, "b": 0.0},
        priors={"b": Normal(0.1, U_B)},
        errors=[Component("scale_x", U_CLOCK, "clock")],
        derived={"root": "-b/a", "twice": "2*a"},
    )


def made(fit: Fit, draws: np.ndarray | None = None) -> FitBudget:
    budget = uncertainty_budget(fit, np.tile(fit.values, (3, 1)) if draws is None else draws)
    assert budget is not None
    return budget


def test_parts_are_those_of_matrices_written_out() -> None:
    fit = line()
    budget, (a, _, clock) = made(fit.fit), (fit.values[name] for name in fit.names)
    # the instrument reads (1 + d) x
    jacobian = (
        np.column_stack([X / (1.0 + clock), np.ones(X.size), -a * X / (1.0 + clock) ** 2]) / U
    )
    prior = np.diag([0.0, 1.0 / U_B**2, 1.0 / U_CLOCK**2])
    cov = np.linalg.inv(jacobian.T @ jacobian + prior)
    readings = np.sqrt(np.diag(cov @ jacobian.T @ jacobian @ cov))
    assert [one.name for one in budget.sources] == ["b", "clock", "readings"]
    assert budget.contributions[2, :3] == pytest.approx(readings, rel=1e-6)
    assert budget.contributions[0, :3] == pytest.approx(cov[:, 1] / U_B, rel=1e-6)
    assert budget.contributions[1, :3] == pytest.approx(cov[:, 2] / U_CLOCK, rel=1e-6)
    assert budget.sds[:3] == pytest.approx(np.sqrt(np.diag(cov)), rel=1e-6)


def test_squares_add_up_for_parameters_and_for_what_follows_from_them() -> None:
    budget = made(line().fit)
    assert budget.names == ("a", "b", "clock", "root", "twice")
    assert np.sum(budget.contributions**2, axis=0) == pytest.approx(budget.sds**2, rel=1e-9)
    assert np.sum(budget.shares, axis=0) == pytest.approx(1.0, rel=1e-9)
    assert budget.contributions[:, 4] == pytest.approx(2.0 * budget.contributions[:, 0])


def moved(problem: Problem, name: str, by: float) -> Problem:
    """The problem with another stated value."""
    parameters = tuple(
        replace(p, prior=Normal(p.prior.centre + by, p.prior.sd)) if p.name == name else p
        for p in problem.parameters
    )
    return replace(problem, parameters=parameters)


def test_a_stated_value_that_is_off_by_its_uncertainty_moves_a_refit_by_its_part() -> None:
    fit = line().fit
    budget, step = made(fit), 0.01
    for i, (name, u) in enumerate((("b", U_B), ("clock", U_CLOCK))):
        low, high = (
            fit_least_squares(moved(fit.problem, name, sign * step * u), start=fit.values).values
            for sign in (-1.0, 1.0)
        )
        assert (high - low) / (2.0 * step) == pytest.approx(
            budget.contributions[i, :3], rel=2e-3, abs=1e-6
        )


def test_holding_one_source_fixed_takes_away_more_than_its_part() -> None:
    """The customary difference of squares is no part of a sum: it gives correlated sources the
    credit of each other.
    """
    fit = line()
    budget = made(fit.fit)
    frozen = fit_curve(
        "(1 + clock)*a*x + b",
        X,
        fit.fit.problem.runs[0].y,
        u_y=U,
        start={"a": 1.0},
        fixed={"b": fit.values["b"], "clock": 0.0},
    )
    readings_alone = frozen.sds["a"]
    assert readings_alone < 0.9 * budget.contributions[2, 0]


@pytest.mark.slow
def test_parts_of_a_simulated_experiment_are_how_it_scatters() -> None:
    """Readings alone anew, stated values held: the scatter of refits is the part of the readings,
    and not the whole.
    """
    fit, rng = line().fit, np.random.default_rng(8)
    budget, (run,) = made(fit), fit.problem.runs
    true, ends = run.curve.value(run.x, run.bind(fit.problem.named(fit.values)))[0], []
    for _ in range(200):
        again = replace(fit.problem, runs=(replace(run, y=true + U * rng.standard_normal(X.size)),))
        ends.append(fit_least_squares(again, start=fit.values).values)
    scatter = np.std(ends, axis=0, ddof=1)
    error = 1.0 / np.sqrt(2.0 * 199)
    assert np.all(np.abs(scatter[:2] / budget.contributions[2, :2] - 1.0) < 3.5 * error)
    assert scatter[1] / budget.sds[1] < 1.0 - 3.5 * error  # the whole would be a wrong answer


@pytest.fixture(scope="module")
def report() -> tuple[FitBudget, dict[str, bytes]]:
    fit = line()
    analysis = sample_curve(fit, seed=2, target=Target(ess=2000))
    return made(fit.fit, analysis.chain.flat), curve_report(
        fit, analysis, title="Line", kind="synthetic", figures="none"
    )


def test_draws_say_the_same_of_stated_values(report: tuple[FitBudget, dict[str, bytes]]) -> None:
    """dE[q]/dm = Cov(q, p)/u^2; a covariance from 2000 independent draws is known to a share of
    0.022 of both standard deviations.
    """
    budget, _ = report
    error = budget.posterior[:3] / np.sqrt(2000.0)
    assert np.all(np.abs(budget.drawn[:2, :3] - budget.contributions[:2, :3]) < 4.0 * error)
    assert np.all(np.isnan(budget.drawn[2]))
    # the other sign would be wrong
    assert abs(budget.drawn[0, 0] + budget.contributions[0, 0]) > 4.0 * error[0]


def test_the_record_closes_and_the_report_shows_it(
    report: tuple[FitBudget, dict[str, bytes]],
) -> None:
    _, files = report
    result, text = json.loads(files["result.json"]), files["report.md"].decode()
    for part in result["budget"].values():
        total = sum(one["u"] ** 2 for one in part["sources"]) + part["others"] ** 2
        assert total == pytest.approx(part["sd_linear"] ** 2, rel=1e-9)
    assert "## Uncertainty budget" in text
    assert "| clock, stated |" in text
    assert "| root of the sum of squares |" in text


@pytest.mark.parametrize(("share", "shown"), [(1e-7, False), (1e-3, True)])
def test_others_are_a_row_only_where_there_is_something_to_see(share: float, shown: bool) -> None:
    fit = line()
    analysis = sample_curve(fit, seed=2, target=Target(ess=300))
    budget, labels = made(fit.fit, analysis.chain.flat), labels_of(fit.fit.problem, fit.fit.values)
    shares = budget.shares.copy()
    shares[0] = share  # of the stated b, at each quantity
    rows = shares_of(
        analysis, replace(budget, contributions=np.sqrt(shares) * budget.sds), labels
    ).sources
    assert ("all others" in rows) == shown
    assert len(rows) == 2 + shown


def test_no_budget_without_a_result() -> None:
    fit = fit_curve("a*x", X, 3.0 * X**2 + 0.001 * np.sin(40 * X), u_y=0.01, start={"a": 1.0})
    analysis = sample_curve(fit, seed=2, target=Target(ess=300))
    files = curve_report(fit, analysis, title="Bad", kind="synthetic", figures="none")
    assert fit.status == "poor-fit"
    assert json.loads(files["result.json"])["budget"] is None
    assert "Uncertainty budget" not in files["report.md"].decode()


@pytest.fixture
def rolled(project: Path) -> Fit:
    campaign = load_campaign(project / "data" / "replica" / "campaign.toml")
    return fit_problem(campaign.problem(["heavy-04"], usual=True), rng=np.random.default_rng(1))


def test_a_body_has_parts_of_force_start_scale_and_readings_that_close(rolled: Fit) -> None:
    """The readings are what remains; here written out: the white part of the covariance by
    itself.
    """
    budget = made(rolled)
    names = [one.name for one in budget.sources]
    assert {"unmodelled force", "start", "scale_x", "readings", "phi[heavy-04]"} <= set(names)
    assert np.sum(budget.contributions**2, axis=0) == pytest.approx(budget.sds**2, rel=1e-6)
    (likelihood,), named = rolled.posterior.likelihoods, rolled.problem.named(rolled.values)
    mixture, raw = likelihood.mixture, likelihood.residuals_at(named)  # type: ignore[attr-defined]
    moves = np.linalg.solve(
        covariance_of(mixture.likely(raw)), likelihood.gradient(named, rolled.names) @ rolled.cov
    )  # type: ignore[attr-defined]
    whole = np.einsum("nq,nm,mq->q", moves, covariance_of(mixture.likely(raw)), moves)
    stated = [
        i for i, one in enumerate(budget.sources) if one.kind in ("stated", "prior", "common")
    ]
    others = budget.sds**2 - np.sum(budget.contributions[stated] ** 2, axis=0)
    assert whole == pytest.approx(others, rel=1e-3)
    white = mixture.lifted(raw)[2] * np.sum(
        covariance_of(mixture.deviation.root) @ moves * moves, axis=0
    )
    assert budget.contributions[names.index("readings")] ** 2 == pytest.approx(white, rel=1e-3)
