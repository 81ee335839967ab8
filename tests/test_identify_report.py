"""What a reader sees of identifiability: cells that agree with the records, and figures that
survive odd problems.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from formulas import formula_problem

from estim.campaign import load_campaign
from estim.checks.identifiability import identify
from estim.checks.prior_sensitivity import CONFLICT, power_scaling
from estim.drawing import png
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.fitting.profile import profile_intervals
from estim.problem.priors import Normal, Uniform
from estim.reports.identifiability import direction_figure, identify_section, profile_figure
from estim.reports.rendering import render

X = np.linspace(0.0, 2.0, 12)


def posterior_draws(fit: Fit, rng: np.random.Generator, n: int = 4000) -> np.ndarray:
    """Draws of the posterior, by resampling draws of a wide Gaussian at the fit with their
    importance weights.
    """
    factor = 1.3 * np.linalg.cholesky(fit.cov)
    z = rng.standard_normal((20 * n, fit.values.size))
    proposal = fit.values + z @ factor.T
    log_weight = fit.posterior.log_density(proposal) + 0.5 * np.sum(z**2, axis=1)
    weight = np.exp(log_weight - log_weight.max())
    return proposal[rng.choice(weight.size, n, replace=False, p=weight / weight.sum())]


def section(fit: Fit, draws: np.ndarray) -> dict[str, Any]:
    leaning = power_scaling(fit.problem, draws, fit.posterior.log_likelihood(draws))
    return identify_section(fit.problem, identify(fit), profile_intervals(fit), leaning, draws)


def heavy_04(replica: Path) -> Fit:
    return fit_least_squares(load_campaign(replica / "campaign.toml").problem(["heavy-04"]))


def test_rows_show_degrees_and_open_sides(replica: Path, rng: np.random.Generator) -> None:
    fit = heavy_04(replica)
    draws = posterior_draws(fit, rng)
    rows = {row["symbol"]: row for row in section(fit, draws)["rows"]}
    tilt = rows["φ[heavy-04]"]
    assert tilt["unit"] == "°"
    assert float(tilt["prior_sd"]) == pytest.approx(0.40)
    low, high = (float(end) for end in tilt["profile_68"].strip("[]").split(","))
    assert 0.5 * (low + high) == pytest.approx(np.degrees(fit.values[3]), abs=0.05)
    assert rows["c_rr"]["profile_95"].endswith("(unbounded below)")
    assert rows["κ[heavy]"]["verdict"].endswith("mainly that of γ[heavy]")
    for row, sd in zip(rows.values(), draws.std(axis=0), strict=True):
        assert float(row["ratio"]) == pytest.approx(
            sd / fit.problem.parameters[list(rows).index(row["symbol"])].prior.sd, abs=0.006
        )


def test_template_says_every_sentence_and_row(replica: Path, rng: np.random.Generator) -> None:
    fit = heavy_04(replica)
    found = section(fit, posterior_draws(fit, rng))
    text = render("identifiability.md.j2", identify=found)
    assert all(sentence in text for sentence in found["sentences"])
    table = [
        line
        for line in text.splitlines()
        if line.startswith("| ") and not line.startswith("| parameter")
    ]
    assert len(table) == fit.problem.n_par
    assert {line.count("|") for line in table} == {9}
    assert "Caveat" not in text


@pytest.mark.parametrize("flat", [True, False])
def test_the_caption_says_what_a_flat_prior_counts_as(flat: bool) -> None:
    found = {"sentences": ["all is learnt"], "rows": [], "doubts": [], "flat": flat}
    found |= {"prior_dominated": 0.8, "threshold": 0.05}
    text = render("identifiability.md.j2", identify=found, pictures=["figures/directions.png"])
    assert ("it is treated as 1000 posterior standard deviations wide" in text) is flat


def test_figures_survive_a_direction_that_nothing_holds(rng: np.random.Generator) -> None:
    problem = formula_problem(
        lambda x, a, b: a + b + 0.0 * x,
        X,
        np.ones(12),
        0.1,
        {"a": Uniform(0.0, 1.0), "b": Uniform(0.0, 1.0)},
    )
    fit = fit_least_squares(problem)
    a = rng.random(2000)
    draws = np.column_stack([a, np.clip(1.0 - a + 0.03 * rng.standard_normal(2000), 0.0, 1.0)])
    found = identify(fit)
    for draw in (
        lambda: direction_figure(problem, found),
        lambda: profile_figure(problem, profile_intervals(fit), draws),
    ):
        assert png(draw).startswith(b"\x89PNG")
    shown = section(fit, draws)
    assert shown["rows"][0]["profile_95"] in ("unbounded on both sides", "[0.00, 1.00]")
    assert shown["sentences"][0].startswith("Constrained neither")


def test_figures_of_one_parameter_are_drawn(rng: np.random.Generator) -> None:
    fit = fit_least_squares(
        formula_problem(lambda x, a: a * x, X, 1.1 * X, 0.1, {"a": Normal(1.0, 0.5)})
    )
    draws = posterior_draws(fit, rng)
    assert png(lambda: direction_figure(fit.problem, identify(fit))).startswith(b"\x89PNG")
    assert png(lambda: profile_figure(fit.problem, profile_intervals(fit), draws)).startswith(
        b"\x89PNG"
    )


def test_a_conflict_says_how_far_the_posterior_lies_from_the_prior(
    rng: np.random.Generator,
) -> None:
    """A prior of 1.0(3) and a mean of nine readings 0.9 sd off their expectation: they pull by less
    than 2 prior sd.
    """
    y = np.full(9, 1.9) + 0.01 * np.arange(9)
    fit = fit_least_squares(
        formula_problem(lambda x, a: a + 0.0 * x, X[:9], y, 0.9, {"a": Normal(1.0, 0.3)})
    )
    draws = posterior_draws(fit, rng)
    (leaning,) = power_scaling(fit.problem, draws, fit.posterior.log_likelihood(draws))
    told = identify_section(
        fit.problem,
        identify(fit),
        profile_intervals(fit),
        [replace(leaning, verdict=CONFLICT)],
        draws,
    )["rows"][0]["verdict"]
    pull = (draws[:, 0].mean() - 1.0) / 0.3
    assert 1.0 < pull < 2.0
    assert f"{pull:+.1f} prior sd" in told
    (said,) = section(fit, draws)["rows"]
    assert ("prior sd" in said["verdict"]) == (leaning.verdict == CONFLICT)


@pytest.mark.slow
def test_what_is_hardly_better_known_goes_by_the_draws_as_the_table_does(
    replica: Path, rng: np.random.Generator
) -> None:
    fit = heavy_04(replica)
    shown = section(fit, posterior_draws(fit, rng))
    (said,) = (sentence for sentence in shown["sentences"] if "hardly better known" in sentence)
    assert {row["symbol"] for row in shown["rows"] if float(row["ratio"]) > 0.8} == set(
        said.partition(" are ")[0].replace(" and ", ", ").split(", ")
    )
    sds = np.array([p.prior.sd for p in fit.problem.parameters])
    narrow = fit.values + 0.1 * sds * rng.standard_normal((4000, sds.size))
    assert not any(
        "hardly better known" in sentence for sentence in section(fit, narrow)["sentences"]
    )
