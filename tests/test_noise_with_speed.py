"""Whether the noise grows with the speed, as that of blurred pictures does: p-values uniform where
it does not, tiny where it does.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from estim.campaign import load_campaign
from estim.checks.goodness_of_fit import P_TOLD, Check, Goodness, check_goodness
from estim.common import Kind
from estim.distributions import normal_below
from estim.fitting.least_squares import fit_least_squares
from estim.model import Body, trajectory
from estim.pipeline import analyse
from estim.reports.result import result_of
from estim.sampling.chain import Target

TEXT = """\
title = "a run"
kind = "synthetic"
[shared]
g = 9.81
radius_m = 0.15
unmodelled_force = 0
noise = {{sigma_x_m = 0.0005{noise}}}
[bodies.heavy]
gamma = "0.187(10)"
kappa = "0.450(5)"
[[runs]]
name = "a"
body = "heavy"
file = "a.csv"
phi_deg = "4.0(4)"
theta0_deg = "60.0(15)"
"""
DIFFERENTIATED, POSITIONS = "", ', model = "positions"'
EXPOSURE = 1.0 / 60.0  # s


def run_of(
    folder: Path, noise: str, rng: np.random.Generator, *, blur: float = 0.0, n: int = 80
) -> Path:
    """A run up to just before its turning point, readings of 0.5 mm, and of `blur` seconds of its
    speed beside.
    """
    t = 0.02 + np.arange(n) / n * 1.36
    x, v = (
        values[0]
        for values in trajectory(
            t, Body(0.15, 0.187, 0.45), phi=math.radians(4), theta0=math.radians(60), g=9.81
        )
    )
    x = x + rng.normal(0.0, np.hypot(0.0005, v * blur / math.sqrt(12.0)))
    (folder / "a.csv").write_text(
        "t_s,x_m\n" + "\n".join(f"{a:.6f},{b:.6f}" for a, b in zip(t, x, strict=True))
    )
    (folder / "campaign.toml").write_text(TEXT.format(noise=noise))
    return folder / "campaign.toml"


def checked(path: Path, rng: np.random.Generator) -> Goodness:
    fit = fit_least_squares(load_campaign(path).problem(["a"]))
    return check_goodness(fit, rng=rng)[0]


def speed_of(path: Path, rng: np.random.Generator) -> Check:
    found = checked(path, rng).speed
    assert found is not None
    return found


@pytest.mark.parametrize("noise", [DIFFERENTIATED, POSITIONS])
def test_blur_shows_and_is_gone_where_the_exposure_is_stated(
    tmp_path: Path, rng: np.random.Generator, noise: str
) -> None:
    path = run_of(tmp_path, noise, rng, blur=EXPOSURE)
    assert speed_of(path, rng).p_value < P_TOLD
    path.write_text(TEXT.format(noise=f"{noise}, exposure_s = 0.016"))
    assert speed_of(path, rng).p_value > 0.01


def test_the_size_of_the_noise_is_no_matter(tmp_path: Path, rng: np.random.Generator) -> None:
    """Readings three times better than stated everywhere: nothing grows with the speed."""
    path = run_of(tmp_path, POSITIONS, rng)
    path.write_text(path.read_text().replace("sigma_x_m = 0.0005", "sigma_x_m = 0.0015"))
    assert speed_of(path, rng).p_value > 0.01


def test_it_is_told_with_the_key_and_fails_nothing(
    tmp_path: Path, rng: np.random.Generator, few_draws: None
) -> None:
    """Beside the other checks in the result; the run fails by those, or not."""
    path = run_of(tmp_path, DIFFERENTIATED, rng, blur=EXPOSURE)
    good = checked(path, rng)
    assert "speed" not in good.checks
    assert "speed" not in good.failed
    campaign = load_campaign(path)
    analysis = analyse(campaign, ["a"], seed=1, target=Target(ess=400.0))
    assert Kind.NOISE_WITH_SPEED in {remark.kind for remark in analysis.diagnosis.remarks}
    assert any("exposure_s in the noise table" in note for note in analysis.diagnosis.notes)
    assert result_of(campaign, analysis).runs["a"].checks["speed"].p_value < P_TOLD


@pytest.mark.slow
@pytest.mark.parametrize(
    ("noise", "later"),
    [
        (DIFFERENTIATED, False),
        (POSITIONS, True),
        pytest.param(DIFFERENTIATED, True, marks=pytest.mark.statistics),
        pytest.param(POSITIONS, False, marks=pytest.mark.statistics),
    ],
)
def test_readings_that_are_off_where_the_body_is_fast_are_no_blur(
    tmp_path: Path, rng: np.random.Generator, few_draws: None, noise: str, later: bool
) -> None:
    """One reading, or all from one on: either made residuals there so large that blurred pictures
    were named (p < 5e-5).
    """
    path = run_of(tmp_path, noise, rng)
    clean = (tmp_path / "a.csv").read_text().splitlines()
    fast = 35
    rows = [line.split(",") for line in clean[1:]]
    moved = [
        f"{t},{float(x) + (0.02 if i == fast or (later and i > fast) else 0.0):.6f}"
        for i, (t, x) in enumerate(rows)
    ]
    (tmp_path / "a.csv").write_text("\n".join([clean[0], *moved]))
    analysis = analyse(load_campaign(path), ["a"], seed=1, target=Target(ess=400.0))
    assert not analysis.diagnosis.ok
    assert Kind.NOISE_WITH_SPEED not in {remark.kind for remark in analysis.diagnosis.remarks}


@pytest.mark.slow
def test_an_encoder_has_no_pictures(
    tmp_path: Path, rng: np.random.Generator, few_draws: None
) -> None:
    path = run_of(tmp_path, POSITIONS, rng, blur=EXPOSURE)
    path.write_text(path.read_text().replace("sigma_x_m = 0.0005", "encoder_step_rad = 0.0115"))
    rows = [line.split(",") for line in (tmp_path / "a.csv").read_text().splitlines()[1:]]
    (tmp_path / "a.csv").write_text(
        "t_s,theta_rad\n" + "\n".join(f"{t},{float(x) / 0.15:.6f}" for t, x in rows)
    )
    analysis = analyse(load_campaign(path), ["a"], seed=1, target=Target(ess=400.0))
    (note,) = [note for note in analysis.diagnosis.notes if "where the body is fast" in note]
    assert "encoder" in note
    assert "pictures" not in note


@pytest.mark.statistics
@pytest.mark.parametrize("noise", [DIFFERENTIATED, POSITIONS])
def test_p_values_are_uniform_without_blur_and_small_with_it(
    tmp_path: Path, rng: np.random.Generator, noise: str
) -> None:
    """Kolmogorov's distance of 120 p-values from uniform ones, below its 0.1 % point; half of the
    blurred ones below 0.005.
    """
    n = 120
    p = np.sort([speed_of(run_of(tmp_path, noise, rng), rng).p_value for _ in range(n)])
    steps = np.arange(n)
    assert float(np.max(np.maximum((steps + 1) / n - p, p - steps / n))) < 1.95 / math.sqrt(n)
    mean = 0.5 - float(np.mean(p))
    assert 2.0 * normal_below(-abs(mean) * math.sqrt(12.0 * n)) > 1e-3
    blurred = [
        speed_of(run_of(tmp_path, noise, rng, blur=EXPOSURE), rng).p_value for _ in range(20)
    ]
    assert float(np.median(blurred)) < P_TOLD
