"""Real measurements of a rolling wheel, read as they are and fit one by one."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from estim.campaign import Campaign, load_campaign
from estim.fitting import fit_problem
from estim.pipeline import analyse
from estim.reports.result import Result, result_of
from estim.sampling.chain import Target

RUNS = ["class-balanced_1", "class-unbalanced_1", "mixed-balanced_1", "mixed-unbalanced_1"]
FURTHER = [
    *(f"class-balanced_{i}" for i in (2, 3, 4)),
    "class-unbalanced_2",
    "class-unbalanced_3",
    "mixed-balanced_2",
    "mixed-unbalanced_2",
]
FEW = ["class-unbalanced_1", "mixed-unbalanced_1"]
# its readings scatter by twice what the step of the encoder explains
WORST = ("mixed-unbalanced_1",)
WHEEL = Path(__file__).resolve().parents[1] / "data" / "wheel"
QUICK = Target(ess=1000.0)


def wheel(run: str) -> Campaign:
    """The campaign that holds a run."""
    return load_campaign(WHEEL / ("campaign.toml" if run.startswith("class-") else "mixed.toml"))


def result(campaign: Campaign, run: str) -> Result:
    return result_of(campaign, analyse(campaign, [run], seed=11, target=QUICK))


@pytest.mark.slow
@pytest.mark.parametrize(
    "run",
    [
        *FEW,
        *(
            pytest.param(run, marks=pytest.mark.statistics)
            for run in [*RUNS, *FURTHER]
            if run not in FEW
        ),
    ],
)
def test_resisting_moment_lies_where_the_groups_found_it(run: str) -> None:
    analysis = analyse(wheel(run), [run], seed=11, target=QUICK)
    observed, draws = analysis.problem.runs[0], analysis.problem.named(analysis.chain.flat)
    low, high = np.quantile(
        observed.derived(observed.bind(draws))["resisting_moment"].values, [0.025, 0.975]
    )
    found = result_of(wheel(run), analysis)
    if run in WORST:
        assert found.status == "poor-fit"
        assert (
            "the scatter of the readings is at least 2 times the stated error" in found.reasons[0]
        )
    else:
        assert 0.5 < low < high < 1.5
        assert found.status == "ok"
        assert found.deviation is not None
        assert found.deviation[run].probability > 0.99


@pytest.mark.slow
def test_a_run_in_radians_is_spoken_of_as_angles_and_its_priors_by_their_means() -> None:
    campaign, run = wheel("class-balanced_1"), "class-balanced_1"
    hasty = Target(ess=1.0, max_step=100, n_ensemble=2, n_walker=16)
    found = result_of(campaign, analyse(campaign, [run], seed=1, target=hasty))
    shown = found.runs[run]
    assert (shown.what, shown.x, shown.y) == (
        "angular rates",
        "angle turned θ − θ₀ (rad)",
        "angular rate ω (rad/s)",
    )
    assert shown.noise.startswith(
        "angular rates by the five-point derivative of angles, with its exact covariance; "
        "angle readings with an encoder step of 0.01257 rad; "
    )
    assert shown.noise.endswith(
        "; in addition, an unmodelled force along the track and a free start"
    )
    # not the median, 0.034
    assert found.parameters["rolling_resistance"].prior_mean == pytest.approx(
        0.05 * math.sqrt(2.0 / math.pi)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "run", ["class-unbalanced_1", pytest.param("mixed-unbalanced_2", marks=pytest.mark.statistics)]
)
def test_wheel_without_eccentricity_is_a_poor_fit(run: str, tmp_path: Path) -> None:
    text = Path(wheel(run).path).read_text().replace('file = "', f'file = "{WHEEL}/')
    wrong = text.replace('mass_particle_kg = "3.40(3)"', "mass_particle_kg = 0.0").replace(
        "particle_gyration = 0.0572", ""
    )
    (tmp_path / "wrong.toml").write_text(wrong)
    found = result(load_campaign(tmp_path / "wrong.toml"), run)
    assert found.status == "poor-fit"
    assert any("this is a different motion" in reason for reason in found.reasons)


def test_unbalanced_runs_agree_on_the_resisting_moment() -> None:
    """Three runs of one apparatus on one day: modes within the spread that a rough fit of the data
    shows (1.12-1.15 N m).
    """
    from estim.fitting.least_squares import fit_least_squares

    moments = []
    for run in ("class-unbalanced_1", "class-unbalanced_2", "class-unbalanced_3"):
        problem = wheel(run).problem([run])
        fit = fit_least_squares(problem)
        observations = problem.runs[0]
        moments.append(
            float(
                observations.derived(observations.bind(problem.named(fit.values)))[
                    "resisting_moment"
                ].values[0, 0]
            )
        )
    assert np.ptp(moments) < 0.05
    assert np.mean(moments) == pytest.approx(1.13, abs=0.04)


def test_a_real_wheel_that_is_caught_within_the_window_is_fit_not_broken(tmp_path: Path) -> None:
    """The best resistance with exact forces keeps the wheel at rest over all that is fitted."""
    text = Path(wheel("class-balanced_2").path).read_text().replace('file = "', f'file = "{WHEEL}/')
    text = text.replace("window = {theta_min_rad = 0.5, theta_max_rad = 15.0}", "")
    text = text.replace(
        '/class-balanced_2.csv"', '/class-balanced_2.csv"\nwindow = {t_min_s = 3.5}'
    )
    (tmp_path / "caught.toml").write_text(text)
    problem = load_campaign(tmp_path / "caught.toml").problem(["class-balanced_2"])
    fit = fit_problem(problem, rng=np.random.default_rng(1))
    assert np.isfinite(fit.values).all()
