"""Parameters on an edge of their prior: a limit where they may belong there, a status where the
data ask for more.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from posed import curve_problem
from scipy import stats
from troubles import TROUBLES, Disk, uniform

from estim.calibration.trial import posterior_draws
from estim.campaign import load_campaign
from estim.cli.commands import cli
from estim.common.labels import Notation
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.fitting.prior_limits import PRESSED_BELOW, Limit, limit_cell, limit_of, pressed
from estim.problem.priors import HalfNormal, Normal, Prior, Uniform
from estim.sampling import interval_cell, value_cell
from estim.sampling.summary import summarise_parameter

X = np.linspace(0.0, 1.0, 12)
U = 0.3


def posed(y: np.ndarray, k: Prior, u_y: float | None = U, u_a: float = 0.5) -> Fit:
    """A line of height a, slope k; the data know k to 0.27."""
    problem = curve_problem(
        "a + k*x", X, y, start={"a": 1.0, "k": 0.5}, u_y=u_y, priors={"k": k, "a": Normal(1.0, u_a)}
    )
    return fit_least_squares(problem.with_sigma(1.0) if u_y else problem.with_unknown_sigma(U))


@pytest.mark.statistics
def test_truths_from_a_uniform_prior_are_limits_that_hold_and_hardly_ever_a_contradiction() -> None:
    """120 runs; with every mode on an edge a failure, as it was, a tenth of them would fail, and
    more.
    """
    n, on_edge, contradicted, held, limits = 120, 0, 0, {0.68: 0, 0.95: 0}, 0
    for seed in range(n):
        rng = np.random.default_rng([4, seed])
        truth = rng.uniform(0.0, 1.0)
        fit = posed(
            rng.normal(1.0, 0.5) + truth * X + U * rng.standard_normal(X.size), Uniform(0.0, 1.0)
        )
        on_edge += "k" in fit.at_bound
        contradicted += any(p < PRESSED_BELOW for p in pressed(fit).values())
        draws = posterior_draws(fit, 300.0, rng)[0][:, fit.names.index("k")]
        limit = limit_of(fit, "k", draws)
        if limit is None:
            for p in held:
                low, high = np.quantile(draws, [0.5 - 0.5 * p, 0.5 + 0.5 * p])
                held[p] += low <= truth <= high
        else:
            limits += 1
            for p, end in ((0.68, limit.limit_68), (0.95, limit.limit_95)):
                held[p] += truth <= end if limit.side == "upper" else truth >= end
    assert on_edge == limits > 15
    assert contradicted <= 3
    for p, count in held.items():
        assert abs(count - p * n) < 3.5 * math.sqrt(n * p * (1.0 - p))


@pytest.mark.parametrize("u_y", [U, None])
def test_pressure_on_an_edge_is_the_tail_beyond_the_free_estimate(
    u_y: float | None, rng: np.random.Generator
) -> None:
    """Against the line that may pass the edge: k / u(k), normal, or Student's t with errors from
    its residuals.
    """
    y = 1.0 - 0.6 * X + U * rng.standard_normal(X.size)
    fit = posed(y, Uniform(0.0, 1.0), u_y, 0.5 if u_y else 50.0)
    if u_y is not None:
        design = np.vstack([np.column_stack([np.ones_like(X), X]) / U, [2.0, 0.0]])
        free = np.linalg.lstsq(design, np.append(y / U, 2.0), rcond=None)[0][1]
        expected = stats.norm.cdf(free / math.sqrt(np.linalg.inv(design.T @ design)[1, 1]))
        assert pressed(fit)["k"] == pytest.approx(expected, rel=1e-6)
    else:
        line = stats.linregress(X, y)  # such a stated height does not matter
        assert pressed(fit)["k"] == pytest.approx(
            stats.t(X.size - 2).cdf(line.slope / line.stderr), rel=0.02
        )


def test_an_edge_that_is_not_reached_is_not_pressed(rng: np.random.Generator) -> None:
    y = 1.0 + 0.5 * X + U * rng.standard_normal(X.size)
    assert pressed(posed(y, Uniform(0.0, 1.0))) == {}
    assert pressed(posed(y, Uniform(-50.0, 50.0))) == {}


def test_a_quantity_that_cannot_be_negative_is_a_limit_too(rng: np.random.Generator) -> None:
    fit = posed(1.0 - 0.2 * X + U * rng.standard_normal(X.size), HalfNormal(1.0))
    draws = np.abs(0.3 * rng.standard_normal(4000))
    limit = limit_of(fit, "k", draws)
    assert limit is not None
    assert (limit.side, limit.edge) == ("upper", 0.0)
    assert limit.limit_95 == pytest.approx(0.3 * stats.norm.ppf(0.975), rel=0.05)
    assert limit_of(fit, "a", draws) is None


def test_a_limit_is_shown_as_one_in_every_cell(rng: np.random.Generator) -> None:
    fit = posed(1.0 - 0.2 * X + U * rng.standard_normal(X.size), Uniform(0.0, 1.0))
    summary = summarise_parameter(fit, "k", np.abs(0.16 * rng.standard_normal(4000)))
    assert summary.mean is None
    assert summary.sd is None
    assert value_cell(summary, Notation("k").label("1")).startswith("< 0.3")
    assert interval_cell(summary, Notation("k").label("1")).startswith("[0.000, 0.3")
    assert limit_cell(Limit("lower", 1.0, 0.9, 0.8), 100.0) == "> 80.0 (95 %)"


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_parameter_on_an_edge_is_ok_and_never_shown_with_plus_minus(tmp_path: Path) -> None:
    campaign = Disk(gamma=uniform(0.0, 0.185)).write(tmp_path)
    done = CliRunner().invoke(cli, ["fit", str(campaign), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert "γ[b] > 0.17" in done.output
    assert "its most probable value is the edge of its range, 0.185" in done.output
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    gamma = result["parameters"]["gamma[b]"]
    assert (gamma["mean"], gamma["sd"], gamma["limit"]["side"], gamma["limit"]["edge"]) == (
        None,
        None,
        "lower",
        0.185,
    )
    assert gamma["q025"] < gamma["limit"]["limit_95"] < gamma["median"] < 0.185
    report = (tmp_path / "out" / "report.md").read_text().replace("\u00a0", " ")
    rows = [line for line in report.splitlines() if line.startswith("| γ[b] |")]
    assert any("> 0.17" in row and "(95 %)" in row for row in rows)
    assert not any("±" in cell for row in rows for cell in row.split("|"))


def test_an_edge_that_the_data_contradict_is_named_by_its_value(tmp_path: Path) -> None:
    trouble = TROUBLES["gamma at its bound"]
    fit = fit_least_squares(load_campaign(trouble.campaign.write(tmp_path)).problem(["r"]))
    assert fit.at_bound == ("gamma[b]",)
    assert pressed(fit)["gamma[b]"] < PRESSED_BELOW
    (tmp_path / "better").mkdir()
    campaign = load_campaign(replace(Disk(), gamma=uniform(0.0, 0.185)).write(tmp_path / "better"))
    fit = fit_least_squares(campaign.problem(["r"]))
    assert pressed(fit)["gamma[b]"] > 0.05
