"""The map of motions: borders against brute force and closed forms, the places of runs, and `estim
map` from the command line.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from command_runner import runner
from report_words import first_screen, words
from scipy.integrate import solve_ivp

from estim.arrays import FloatArray
from estim.campaign import load_campaign
from estim.cli.commands import cli
from estim.model import (
    Body,
    range_of_release,
    release_for_turn,
    release_that_rolls_on,
    theta_max,
    theta_min,
    trajectory,
    turning_angle,
)
from estim.reports.regimes import regime_figure
from estim.studies.regimes import BodyMap, map_bodies


@pytest.fixture(autouse=True)
def few_draws_of_the_farthest(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coarse where only figures look."""
    monkeypatch.setattr("estim.studies.regimes._FAR_DRAWS", 40)


def stops_after(
    gamma: float, slope: float, theta0: float, *, far: float = 40.0, step: float = 2e-3
) -> float:
    """Where W first falls to 0, by walking; 0 where it does not set off, inf where it goes on."""
    if gamma * math.sin(theta0) <= slope:
        return 0.0
    angle = step
    while angle < far:
        if gamma * (math.cos(theta0) - math.cos(theta0 + angle)) - angle * slope <= 0.0:
            return angle
        angle += step
    return math.inf


def test_borders_are_those_of_a_walk_along_the_energy(rng: np.random.Generator) -> None:
    """Releases on either side of each border do what the border says."""
    seen = {"starts": 0, "turns": 0, "on": 0}
    for _ in range(60):
        gamma, phi, resistance, angle = (
            rng.uniform(0.05, 0.5),
            rng.uniform(-0.15, 0.25),
            rng.uniform(0.0, 0.01),
            rng.uniform(0.5, 5.5),
        )
        slope = math.sin(phi) + resistance * math.cos(phi)
        low, high = (
            float(end) for end in range_of_release(gamma, phi, rolling_resistance=resistance)
        )
        release = float(release_for_turn(angle, gamma, phi, rolling_resistance=resistance))
        on = float(release_that_rolls_on(gamma, phi, rolling_resistance=resistance))
        if abs(slope) < gamma:
            seen["starts"] += 1
            moves = [
                stops_after(gamma, slope, a, far=0.01) > 0.0
                for a in (low - 0.01, low + 0.01, high - 0.01, high + 0.01)
            ]
            assert moves == [False, True, True, False]
        if not math.isnan(release):
            seen["turns"] += 1
            assert stops_after(gamma, slope, release) == pytest.approx(angle, abs=3e-3)
        if -gamma < slope < 0.0 and on < high - 0.02:
            seen["on"] += 1
            assert stops_after(gamma, slope, on - 0.01) == math.inf
            assert stops_after(gamma, slope, on + 0.01) < 2.0 * math.pi
    assert min(seen.values()) > 10


def test_no_release_turns_after_a_distance_that_the_border_denies(rng: np.random.Generator) -> None:
    """The converse: every turning point is on the border of its own distance, and none is lost."""
    gamma, phi, theta0 = (
        rng.uniform(0.05, 0.5, 500),
        rng.uniform(-0.2, 0.3, 500),
        rng.uniform(-1.5, 4.6, 500),
    )
    angle = turning_angle(Body(0.15, gamma, 0.45), phi=phi, theta0=theta0)
    turns = np.isfinite(angle) & (angle > 0.0)
    assert np.sum(turns) > 100
    assert release_for_turn(angle[turns], gamma[turns], phi[turns]) == pytest.approx(
        theta0[turns], abs=1e-12
    )
    assert np.isnan(release_for_turn(2.0 * np.pi, 0.2, 0.05))


def test_the_range_of_release_is_theta_min_and_theta_max_of_the_paper() -> None:
    gamma, phi = 0.187, np.radians([1.0, 4.0, 10.0])
    low, high = range_of_release(gamma, phi, rolling_resistance=0.002)
    assert low == pytest.approx(theta_min(gamma, phi, rolling_resistance=0.002), abs=1e-15)
    assert high == pytest.approx(theta_max(gamma, phi, rolling_resistance=0.002), abs=1e-15)
    assert [float(end) for end in range_of_release(0.0, 0.1)] == [pytest.approx(np.pi / 2)] * 2
    assert [float(end) for end in range_of_release(0.1, -0.2)] == [
        pytest.approx(-np.pi / 2),
        pytest.approx(1.5 * np.pi),
    ]


TEXT = """\
title = "one run"
kind = "synthetic"
[shared]
g = 9.81
radius_m = 0.15
noise = {{sigma_x_m = 0.001{noise}}}
{shared}
[bodies.heavy]
gamma = "{gamma}"
kappa = "0.450(5)"
[[runs]]
name = "a"
body = "heavy"
file = "a.csv"
phi_deg = "{phi}"
theta0_deg = "{theta0}"
"""


def campaign_of(
    folder: Path,
    *,
    shared: str = "",
    noise: str = "",
    gamma: str = "0.187(10)",
    phi: str = "4.0(4)",
    theta0: str = "60.0(15)",
    n: int = 38,
) -> Path:
    t = np.arange(n) / 30
    x = trajectory(
        t, Body(0.15, 0.187, 0.45), phi=math.radians(4), theta0=math.radians(60), g=9.81
    )[0][0]
    x = x + np.random.default_rng(3).normal(0.0, 0.001, t.size)
    write_readings(folder, t, x)
    (folder / "campaign.toml").write_text(
        TEXT.format(shared=shared, noise=noise, gamma=gamma, phi=phi, theta0=theta0)
    )
    return folder / "campaign.toml"


def write_readings(folder: Path, t: FloatArray, x: FloatArray) -> None:
    rows = (f"{a:.6f},{b:.6f}" for a, b in zip(t, x, strict=True))
    (folder / "a.csv").write_text("t_s,x_m\n" + "\n".join(rows))


def mapped(path: Path, **choices: object) -> BodyMap:
    return map_bodies(load_campaign(path), seed=1, **choices)[0]  # type: ignore[arg-type]


def test_a_run_turns_where_a_simulation_of_its_own_does(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    """Stated values drawn here, each draw walked to its turning point; three Monte-Carlo standard
    deviations.
    """
    found = mapped(campaign_of(tmp_path))
    (run,) = found.runs
    n = 800
    draws = zip(
        rng.normal(0.187, 0.01, n),
        np.radians(rng.normal(4.0, 0.4, n)),
        np.radians(rng.normal(60.0, 1.5, n)),
        strict=True,
    )
    stops = 0.15 * np.array(
        [stops_after(gamma, math.sin(phi), theta0, far=7.0) for gamma, phi, theta0 in draws]
    )
    assert run.sets_off == pytest.approx(1.0)
    sd = float(np.std(stops))
    assert run.stop[2] == pytest.approx(
        float(np.median(stops)), abs=3.0 * 1.25 * sd * math.sqrt(1 / n + 1 / 2000)
    )
    assert 0.5 * (run.stop[3] - run.stop[1]) == pytest.approx(sd, rel=0.12)
    assert run.farthest == max(
        float(row.split(",")[1]) for row in (tmp_path / "a.csv").read_text().splitlines()[1:]
    )


def test_bands_of_the_borders_are_those_of_linear_propagation(tmp_path: Path) -> None:
    """u(theta_min) = tan(theta_min) u(gamma)/gamma, and the steepest tilt is asin(gamma)."""
    found = mapped(campaign_of(tmp_path))
    at = int(np.argmin(np.abs(found.phi - math.radians(4.0))))
    least = math.asin(math.sin(found.phi[at]) / 0.187)
    assert found.lowest[2, at] == pytest.approx(least, abs=0.004)
    assert 0.5 * (found.lowest[3, at] - found.lowest[1, at]) == pytest.approx(
        math.tan(least) * 0.01 / 0.187, rel=0.1
    )
    assert found.highest == pytest.approx(np.pi - found.lowest[::-1])
    assert found.steepest[2] == pytest.approx(math.asin(0.187), abs=0.001)
    assert 0.5 * (found.steepest[3] - found.steepest[1]) == pytest.approx(
        0.01 / math.cos(math.asin(0.187)), rel=0.1
    )


def test_values_that_are_exact_have_borders_without_a_band(tmp_path: Path) -> None:
    path = campaign_of(tmp_path, gamma="0.187", phi="4.0", theta0="60.0")
    path.write_text(path.read_text().replace('"0.450(5)"', "0.45"))
    found = mapped(path)
    assert np.ptp(found.lowest, axis=0) == pytest.approx(0.0)
    (run,) = found.runs
    body = Body(0.15, 0.187, 0.45)
    assert run.stop == pytest.approx(
        np.full(5, 0.15 * float(turning_angle(body, phi=math.radians(4), theta0=math.radians(60))))
    )
    assert (run.sets_off, run.phi[1]) == (1.0, 0.0)


def test_the_end_of_the_ramp_is_asked_for_or_stated_or_recorded(tmp_path: Path) -> None:
    path = campaign_of(tmp_path, shared="ramp_length_m = 0.9\nramp_start_m = 0.1")
    assert mapped(path, ramp_length=0.5).end.length == 0.5
    assert mapped(path).end == type(mapped(path).end)(pytest.approx(0.8), "stated")
    assert mapped(campaign_of(tmp_path)).end.origin == "recorded"


def command(*words: object) -> tuple[int, str]:
    done = runner().invoke(cli, [str(word) for word in words], standalone_mode=False)
    code = (
        done.exception.code
        if isinstance(done.exception, SystemExit)
        else 2
        if done.exception
        else 0
    )
    return int(code or 0), done.stdout + str(done.exception or "")


def test_no_name_of_a_run_covers_a_number_of_the_map(replica: Path) -> None:
    figure = regime_figure(mapped(replica / "campaign.toml", bodies=["heavy"]), None)
    figure.draw_without_rendering()
    texts = [(text.get_text(), text.get_window_extent()) for text in figure.axes[0].texts]
    names = [box for words, box in texts if words.startswith("heavy-")]
    numbers = [box for words, box in texts if words.startswith("0.")]
    assert len(names) == 4
    assert len(numbers) > 5
    assert not [box for box in numbers for name in names if box.overlaps(name)]


def test_the_command_maps_what_a_run_should_do(tmp_path: Path) -> None:
    path = campaign_of(tmp_path)
    code, said = command("map", path, "--out", tmp_path / "out", "--ramp-length", "0.45")
    assert code == 0
    assert re.search(r"a: climbs \(P > 0.999\); turns at 0.4[45]", said)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["status"] == "ok"
    report = (tmp_path / "out" / "report.md").read_text().replace("\u00a0", " ")
    names = {"figures/map-heavy.png"}
    assert all(
        f"]({name})" in report and (tmp_path / "out" / name).stat().st_size > 10_000
        for name in names
    )
    first = first_screen(report)
    assert "figures/map-heavy.png" in first
    assert len(words(first)) < 120
    run = result["bodies"]["heavy"]["runs"]["a"]
    assert run["words"] in said
    assert run["words"] in report
    tilts = {round(math.degrees(tilt["phi"])): tilt for tilt in result["bodies"]["heavy"]["tilts"]}
    assert tilts[4]["least"]["median"] == pytest.approx(
        math.asin(math.sin(math.radians(4.0)) / 0.187), abs=0.01
    )
    assert "SYNTHETIC" in report


@pytest.mark.parametrize(
    ("choices", "reason"),
    [
        ({"gamma": "0.100(5)"}, "should turn back at"),
        ({"theta0": "5(2)"}, "should not start"),
        ({"phi": "9.0(4)"}, "should turn back at"),
    ],
)
def test_a_recording_that_the_stated_values_do_not_allow_is_a_contradiction(
    tmp_path: Path, choices: dict[str, str], reason: str
) -> None:
    path = campaign_of(tmp_path, **choices)
    code, said = command("map", path, "--out", tmp_path / "out", "--figures", "none")
    assert code == 3
    assert reason in said
    assert json.loads((tmp_path / "out" / "result.json").read_text())["status"] == "contradiction"


def there_and_back(
    t: FloatArray, *, v0: float = 0.0, drag: float = 0.0, theta0: float = math.radians(60)
) -> FloatArray:
    """Positions from the equation of motion, up the ramp and down again."""
    body, phi, radius = Body(0.15, 0.187, 0.45), math.radians(4.0), 0.15

    def change(_: float, state: FloatArray) -> list[float]:
        angle, rate = state
        push = body.gamma * math.sin(angle) - math.sin(phi)
        centrifugal = body.gamma * math.sin(angle + phi) * rate**2
        inertia = 1.0 + body.inertia_ratio + 2.0 * body.gamma * math.cos(angle + phi)
        resisted = 9.81 / radius * push + centrifugal - drag * radius * rate * abs(rate)
        return [rate, resisted / inertia]

    start = [theta0, v0 / radius]
    turned = solve_ivp(change, (0.0, t[-1]), start, t_eval=t, rtol=1e-10, atol=1e-12).y[0]
    return np.asarray(radius * (turned - theta0))


@pytest.mark.parametrize(
    ("stated", "motion", "wrong"),
    [
        ('release_speed_m_s = "0.60(1)"', {"v0": 0.6}, 'release_speed_m_s = "0.50(1)"'),
        ('quadratic_drag_per_m = "0.5(1)"', {"drag": 0.5}, "quadratic_drag_per_m = 3.0"),
        ('offset_m = "0.050(1)"', {}, ""),
    ],
)
def test_a_run_turns_where_all_that_is_stated_of_it_says(
    tmp_path: Path, stated: str, motion: dict[str, float], wrong: str
) -> None:
    """Drag, a push and a shifted zero are no contradiction, unless another one was stated."""
    path = campaign_of(tmp_path, gamma="0.187(3)", phi="4.0(1)", theta0="60.0(5)")
    t = np.arange(60) / 30
    true = there_and_back(t, **motion)
    x = true + (0.05 if "offset" in stated else 0.0)
    x = x + np.random.default_rng(1).normal(0.0, 0.001, t.size)
    write_readings(tmp_path, t, x)
    text = path.read_text()
    for said, findings in ((stated, 0), (wrong, 1)):
        path.write_text(text + said + "\n")
        found = mapped(path)
        (run,) = found.runs
        assert run.turned
        assert len(found.findings) == findings
        if not findings:
            assert run.stop[2] == pytest.approx(float(np.max(true)), abs=0.004)
            assert run.farthest == pytest.approx(float(np.max(true)), abs=0.004)


@pytest.mark.parametrize("frames", [15, 30, 240])
def test_scatter_and_frames_between_which_a_body_turns_contradict_no_exact_values(
    tmp_path: Path, frames: int
) -> None:
    path = campaign_of(tmp_path, gamma="0.187", phi="4.0", theta0="60.0")
    t = np.arange(2 * frames) / frames
    for seed in range(5):
        scatter = np.random.default_rng(seed).normal(0.0, 0.001, t.size)
        write_readings(tmp_path, t, there_and_back(t) + scatter)
        assert mapped(path).findings == ()
    # some centimetres farther
    write_readings(tmp_path, t, there_and_back(t, theta0=math.radians(55.0)) + scatter)
    assert len(mapped(path).findings) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--body", "none"], "'--body' must name one of the bodies (heavy)"),
        (["--ramp-length", "-1"], "'--ramp-length' must be > 0"),
    ],
)
def test_choices_that_are_wrong_are_refused(
    tmp_path: Path, words: list[str], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = campaign_of(tmp_path)
    monkeypatch.chdir(tmp_path)
    code, found = command("map", path, "--out", tmp_path / "out", *words)
    assert code == 2
    assert said in found


@pytest.mark.slow
def test_the_wheel_rolls_down_and_a_body_without_a_heavy_side_has_no_angle(project: Path) -> None:
    """Downhill: on for ever or rocking.  Balanced: it sets off beyond the tilt at which the weight
    beats the rolling resistance, from any angle.
    """
    balanced, unbalanced = map_bodies(
        load_campaign(project / "data" / "wheel" / "campaign.toml"), seed=1
    )
    assert unbalanced.downhill
    assert not unbalanced.uphill
    assert all(
        place.sets_off > 0.8 and np.isnan(place.stop[2]) and not place.findings
        for place in (*balanced.runs, *unbalanced.runs)
    )
    resistance = 0.6745 * 0.05  # median of the half-normal prior
    first = balanced.phi[np.flatnonzero(balanced.highest[2] - balanced.lowest[2] > 1.0)[-1]]
    assert -math.tan(first) == pytest.approx(resistance, rel=0.06)
