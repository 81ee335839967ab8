"""Real measurements of a rolling wheel, read as they are and fit one by one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from estim.campaign import Campaign, load_campaign
from estim.pipeline import analyse
from estim.result import Result, result_of
from estim.sampling import Target

RUNS = [f"class-balanced_{i}" for i in (1, 2, 3, 4)] + [f"class-unbalanced_{i}" for i in (1, 2, 3)]
RUNS += ["mixed-balanced_1", "mixed-balanced_2", "mixed-unbalanced_1", "mixed-unbalanced_2"]
QUICK = Target(ess=1000.0)


@pytest.fixture
def wheel(project: Path) -> Campaign:
    if not (project.parent / "shared" / "data" / "wheel").is_dir():
        pytest.skip("the wheel's data are not beside the project")
    return load_campaign(project / "tests" / "wheel.toml")


def result(campaign: Campaign, run: str) -> Result:
    return result_of(campaign, analyse(campaign, [run], seed=11, target=QUICK))


@pytest.mark.slow
@pytest.mark.parametrize("run", RUNS)
def test_resisting_moment_lies_where_the_groups_found_it(wheel: Campaign, run: str) -> None:
    found = result(wheel, run)
    moment = found.runs[run].derived["resisting_moment"]
    assert 0.6 < moment.q025 < moment.q975 < 1.5
    # nothing but the quality of the fit may be in doubt, and a doubt has its reason in words
    assert found.status in ("ok", "poor-fit")
    assert (found.status == "ok") == (not found.reasons)
    assert found.runs[run].scatter_ratio < 10.0


@pytest.mark.slow
@pytest.mark.parametrize("run", ["class-unbalanced_1", "mixed-unbalanced_2"])
@pytest.mark.usefixtures("wheel")
def test_wheel_without_eccentricity_is_a_poor_fit(run: str, tmp_path: Path, project: Path) -> None:
    text = (project / "tests" / "wheel.toml").read_text().replace("../../shared", str((project / "../shared").resolve()))
    wrong = text.replace('mass_particle_kg = "3.40(3)"', "mass_particle_kg = 0.0").replace("particle_gyration = 0.0572", "")
    (tmp_path / "wrong.toml").write_text(wrong)
    found = result(load_campaign(tmp_path / "wrong.toml"), run)
    assert found.status == "poor-fit"
    assert found.runs[run].scatter_ratio > 10.0
    assert any("alike" in reason for reason in found.reasons)


def test_unbalanced_runs_agree_on_the_resisting_moment(wheel: Campaign) -> None:
    """Three runs of one apparatus on one day: modes within the spread that a rough fit of the data shows (1.12-1.15 N m)."""
    from estim.fitting import fit_least_squares

    moments = []
    for run in RUNS[4:7]:
        problem = wheel.problem([run])
        fit = fit_least_squares(problem, rng=np.random.default_rng(1), n_start=2)
        observations = problem.runs[0]
        moments.append(float(observations.curve.derived(observations.bind(problem.named(fit.values)))["resisting_moment"].values[0, 0]))
    assert np.ptp(moments) < 0.05
    assert np.mean(moments) == pytest.approx(1.13, abs=0.04)
