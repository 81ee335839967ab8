"""From a file of the program Tracker to a report (docs/from-video-to-report.md); every number
beside one found without estim.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from stand_ins import FALLS, ROLLS, error_of_slope, frequency

from estim.campaign import load_campaign
from estim.checks.goodness_of_fit import check_goodness
from estim.checks.model_discrepancy import wrong_curves
from estim.cli.commands import cli
from estim.common import Kind
from estim.fitting import fit_problem
from estim.fitting.least_squares import Fit
from estim.fitting.optimum import fit_optimum
from estim.pipeline import analyse
from estim.sampling.chain import Target

PAGE = Path(__file__).parents[1] / "docs" / "from-video-to-report.md"
FALL, SWING, WHOLE_FALLS, WHOLE_SWING = re.findall(
    r"```toml\n(.*?)```", PAGE.read_text(), flags=re.DOTALL
)
WHOLE = FALL.replace("x0 + v*(x - 1.5)", "x0 + v*(x - 1.5) + 0.5*a*(x - 1.5)**2").replace(
    "window = {min = 1.33}\n\n[curve.parameters]\n",
    '[curve.parameters]\na = {start = 0.0, unit = "m/s²", meaning = "acceleration"}\n',
)


@pytest.fixture
def tracker(tracker_folder: Path) -> Path:
    return tracker_folder


def run(*arguments: object) -> Result:
    return CliRunner().invoke(cli, [str(argument) for argument in arguments])


def imported(source: Path, target: Path, *options: str) -> np.ndarray:
    """The CSV that `estim import` makes of `source`: t and x, (2, n)."""
    target.unlink(missing_ok=True)  # what stands there is another file's
    assert run("import", source, "-o", target, *options).exit_code == 0
    rows = [
        line.split(",")[:2]
        for line in target.read_text().splitlines()
        if line[0].isdigit() or line[0] == "-"
    ]
    return np.array(rows, dtype=float).T


def fitted(folder: Path, campaign: str) -> tuple[Result, dict, str]:
    """Outcome of `estim fit`, result.json and the report."""
    (folder / "campaign.toml").write_text(campaign)
    done = run("fit", folder / "campaign.toml", "--out", folder / "out")
    return (
        done,
        json.loads((folder / "out" / "result.json").read_text()),
        (folder / "out" / "report.md").read_text(),
    )


def best(folder: Path, campaign: str) -> Fit:
    (folder / "campaign.toml").write_text(campaign)
    loaded = load_campaign(folder / "campaign.toml")
    return fit_optimum(loaded.problem(loaded.run_names), rng=np.random.default_rng(1))


def value(fit: Fit, name: str) -> tuple[float, float]:
    i = fit.names.index(name)
    return float(fit.values[i]), float(np.sqrt(fit.cov[i, i]))


@pytest.mark.usefixtures("undrawn")
def test_speed_at_the_end_of_a_fall_is_that_of_a_straight_line(
    tracker: Path, stand_ins: Path, tmp_path: Path
) -> None:
    t, x = imported(tracker / "viscosity" / "CIMG9886.trk", tmp_path / "a1.csv")
    late = t >= 1.33
    (slope, _), cov = np.polyfit(t[late], x[late], 1, cov=True)
    done, result, report = fitted(tmp_path, FALL)
    v = result["parameters"]["v"]
    assert (done.exit_code, result["status"]) == (0, "ok"), done.output
    assert abs(v["mean"] - slope) < 0.1 * v["sd"]
    # the size of the errors is inferred: Student's t against normal
    assert v["sd"] == pytest.approx(np.sqrt(cov[0, 0]), rel=0.3)
    assert "distance fallen (m)" in report
    assert "speed at the end of the track" in report
    text = (tracker / "viscosity" / "CIMG9886.trk").read_text()
    # 2847.0156 of the real one
    scale = float(re.findall(r'"xscale" type="double">([0-9.]+)<', text)[0])
    assert f"scale {scale:.8g} pixels/m" in report
    assert "the body already moves at" not in report  # which matters for a rolling disk only
    assert f"scale {scale:.8g} pixels/m" in json.dumps(result["runs"]["a1"], ensure_ascii=False)
    if tracker == stand_ins:
        _, speed, a = FALLS["CIMG9886"]
        assert abs(v["mean"] - (speed + a * t[late].mean())) < 4.0 * error_of_slope(t[late])


@pytest.mark.parametrize(
    ("video", "export"),
    [("CIMG9886.trk", "a1.txt"), ("CIMG9888.trk", "a2.txt"), ("CIMG9892.trk", "b3.txt")],
)
def test_video_file_and_export_of_one_track_give_one_speed(
    tracker: Path, tmp_path: Path, video: str, export: str
) -> None:
    speeds = []
    for file, options in ((video, ("--along", "-y")), (export, ())):
        t, x = imported(tracker / "viscosity" / file, tmp_path / "a1.csv", *options)
        found, _ = value(best(tmp_path, FALL), "v")
        assert found == pytest.approx(np.polyfit(t[t >= 1.33], x[t >= 1.33], 1)[0], rel=1e-6)
        speeds.append(found)
    assert speeds[0] == pytest.approx(speeds[1], rel=1e-4)  # an export holds seven digits


def test_ball_is_still_slowing_down_where_its_track_ends(tracker: Path, tmp_path: Path) -> None:
    """No terminal speed stands in these data: every whole track has an acceleration below zero by
    more than ten standard deviations.
    """
    for video in ("CIMG9886.trk", "CIMG9888.trk", "CIMG9892.trk"):
        t, x = imported(tracker / "viscosity" / video, tmp_path / "a1.csv")
        a, u = value(best(tmp_path, WHOLE), "a")
        half, _, _ = np.polyfit(t, x, 2)
        assert a == pytest.approx(2.0 * half, rel=1e-6)
        assert a < -10.0 * u


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
def test_neighbouring_frames_of_a_whole_fall_are_not_independent_and_the_report_says_so(
    tracker: Path, tmp_path: Path
) -> None:
    """The same track with every third frame passes: then the errors are as independent as the noise
    model says.
    """
    t, x = imported(tracker / "viscosity" / "CIMG9886.trk", tmp_path / "a1.csv")
    residuals = x - np.polyval(np.polyfit(t, x, 2), t)
    # 0 for independent errors
    assert np.sum(residuals[1:] * residuals[:-1]) / np.sum(residuals**2) > 0.4
    done, result, _ = fitted(tmp_path, WHOLE)
    assert (done.exit_code, result["status"]) == (3, "poor-fit")
    assert any(
        "neighbouring points lie off the curve by similar amounts" in reason
        and "p < 5e-5" in reason
        for reason in result["reasons"]
    )
    (tmp_path / "a1.csv").write_text(
        "t_s,x_m\n"
        + "\n".join(f"{a!r},{b!r}" for a, b in zip(t[::3].tolist(), x[::3].tolist(), strict=True))
    )
    thinned = analyse(
        load_campaign(tmp_path / "campaign.toml"), ["a1"], seed=1, target=Target(ess=1000.0)
    ).diagnosis
    assert thinned.status == "ok", thinned.reasons


def crossings(t: np.ndarray, x: np.ndarray, level: float) -> np.ndarray:
    """Times at which x passes `level`, by straight lines between frames."""
    i = np.flatnonzero((x[1:] - level) * (x[:-1] - level) < 0.0)
    return t[i] + (level - x[i]) * (t[i + 1] - t[i]) / (x[i + 1] - x[i])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "options", "window"),
    [("Klipp0.csv", (), (25.0, 31.5)), ("52.txt", ("--drop-duplicates",), (14.0, 20.0))],
)
def test_frequency_of_a_half_pipe_is_that_of_its_crossings_and_of_its_spectrum(
    tracker: Path,
    stand_ins: Path,
    tmp_path: Path,
    file: str,
    options: tuple[str, ...],
    window: tuple[float, float],
) -> None:
    t, x = imported(tracker / "halfpipe" / file, tmp_path / "swing.csv", *options)
    fit = best(
        tmp_path, SWING.replace("min = 25.0, max = 31.5", f"min = {window[0]}, max = {window[1]}")
    )
    f, rest = value(fit, "f")[0], value(fit, "c")[0]
    inside = (t >= window[0]) & (t <= window[1])
    found = crossings(t[inside], x[inside], rest)
    assert found.size >= 5
    assert f == pytest.approx((found.size - 1) / (2.0 * (found[-1] - found[0])), rel=0.02)
    even = np.arange(*window, 0.01)
    swing = np.interp(even, t, x) - rest
    spectrum = np.abs(np.fft.rfft(swing * np.hanning(even.size), 64 * even.size))
    assert f == pytest.approx(np.fft.rfftfreq(64 * even.size, 0.01)[np.argmax(spectrum)], rel=0.02)
    if tracker == stand_ins:
        assert f == pytest.approx(frequency(*window), rel=0.003)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "few_draws")
def test_damped_cosine_does_not_explain_a_half_pipe_and_the_report_says_so(
    tracker: Path, tmp_path: Path
) -> None:
    """The share that every swing loses grows, that of a damped cosine does not: one in five frames
    is enough to tell.
    """
    t, x = imported(tracker / "halfpipe" / "Klipp0.csv", tmp_path / "swing.csv")
    (tmp_path / "swing.csv").write_text(
        "t_s,x_m\n"
        + "\n".join(f"{a!r},{b!r}" for a, b in zip(t[::5].tolist(), x[::5].tolist(), strict=True))
    )
    done, result, report = fitted(tmp_path, SWING)
    assert (done.exit_code, result["status"]) == (3, "poor-fit"), done.output
    assert result["parameters"]["f"]["mean"] is None
    assert "neighbouring points lie off the curve by similar amounts" in report
    assert "osition (m) against time t (s)" in report


def spoiled(tracker: Path, folder: Path) -> None:
    """Every second frame of a fall, two of them read 5 mm too far."""
    t, x = imported(tracker / "viscosity" / "CIMG9886.trk", folder / "a1.csv")
    t, x = t[::2], x[::2].copy()
    x[[6, 17]] += 0.005
    (folder / "a1.csv").write_text(
        "t_s,x_m\n" + "\n".join(f"{a!r},{b!r}" for a, b in zip(t.tolist(), x.tolist(), strict=True))
    )


@pytest.mark.parametrize("robust", ["mixture", "student-t"])
def test_two_spoiled_frames_move_a_robust_fit_little(
    tracker: Path, tmp_path: Path, robust: str
) -> None:
    t, x = imported(tracker / "viscosity" / "CIMG9886.trk", tmp_path / "a1.csv")
    truth = 2.0 * np.polyfit(t[::2], x[::2], 2)[0]
    spoiled(tracker, tmp_path)
    stated = WHOLE.replace("[curve.parameters]", "u_y = 0.00007\n[curve.parameters]", 1)
    plain, _ = value(best(tmp_path, stated), "a")
    good, u = value(
        best(tmp_path, stated.replace("u_y = 0.00007", f'u_y = 0.00007\nrobust = "{robust}"')), "a"
    )
    assert abs(good - truth) < 2.0 * u
    assert abs(plain - truth) > 10.0 * abs(good - truth)
    assert abs(plain - truth) > 10.0 * u


@pytest.mark.slow
def test_errors_of_the_times_count_as_errors_of_the_distance(tracker: Path, tmp_path: Path) -> None:
    """u_x = 1 ms at 0.0574 m/s is 57 um: the standard deviation of v grows by sqrt(1 + (v
    u_x/u_y)^2).
    """
    imported(tracker / "viscosity" / "CIMG9886.trk", tmp_path / "a1.csv")
    stated = FALL.replace("[curve.parameters]", "u_y = 0.00007\n[curve.parameters]", 1)
    v, u = value(best(tmp_path, stated), "v")
    v_x, u_x = value(
        best(tmp_path, stated.replace("u_y = 0.00007", "u_y = 0.00007\nu_x = 0.001")), "v"
    )
    assert v_x == pytest.approx(v, rel=1e-4)
    assert u_x / u == pytest.approx(np.sqrt(1.0 + (v * 0.001 / 0.00007) ** 2), rel=1e-3)


def with_deviation(
    folder: Path, campaign: str, name: str
) -> tuple[Fit, tuple[str, ...], list[Kind]]:
    """The fit of one run of a campaign, the tests that it fails, and why the deviation is another
    curve.
    """
    (folder / "campaign.toml").write_text(campaign)
    loaded = load_campaign(folder / "campaign.toml")
    rng = np.random.default_rng(1)
    fit = fit_problem(loaded.problem([name]), rng=rng)
    return (
        fit,
        check_goodness(fit, rng=rng)[0].failed,
        [one.kind for one in wrong_curves(fit.deviations)],
    )


def sd(fit: Fit, name: str) -> float:
    i = fit.names.index(name)
    return float(np.sqrt(fit.deviations[0].cov[i, i]))


@pytest.mark.slow
def test_whole_falls_give_an_acceleration_where_what_the_formula_lacks_is_irregular(
    tracker: Path, stand_ins: Path, tmp_path: Path
) -> None:
    """With independent errors alone all of the real ones fail; so do the stand-ins whose marks are
    averages of three.

    A ball that slows down towards a speed is no parabola: what is left of b3, and of the real a2,
    is a trend.
    """
    kept = {}
    for name in ("a1", "a2", "b3"):
        t, x = imported(tracker / "viscosity" / f"{name}.txt", tmp_path / f"{name}.csv")
        kept[name] = (t, x)
    for name, (t, x) in kept.items():
        fit, failed, why = with_deviation(tmp_path, WHOLE_FALLS, name)
        assert failed == ()
        assert why == (
            [Kind.DEVIATION_TOO_SLOW]
            if name in ({"b3"} if tracker == stand_ins else {"a2", "b3"})
            else []
        )
        a, u = value(fit, "a")[0], sd(fit, "a")
        assert a < 0.0
        assert abs(a - 2.0 * np.polyfit(t, x, 2)[0]) < 3.0 * u
        if tracker == stand_ins and name != "b3":
            assert abs(a - FALLS[{"a1": "CIMG9886", "a2": "CIMG9888"}[name]][2]) < 3.0 * u


def test_a_bump_of_the_track_is_another_curve_and_no_irregular_deviation(
    tracker: Path, stand_ins: Path, tmp_path: Path
) -> None:
    """The stand-in has no bump: its marks are those of the formula, and nothing counts against
    it.
    """
    for name in ("a1", "a2", "b3"):
        imported(tracker / "rolling_ball" / "kulefullbane.txt", tmp_path / f"{name}.csv")
    fit, failed, why = with_deviation(
        tmp_path, WHOLE_FALLS.replace("deviation = 0.001 ", "deviation = 5.0 "), "a1"
    )
    assert failed == ()
    if tracker == stand_ins:
        assert why == []
        assert abs(value(fit, "a")[0] - 100.0 * ROLLS["kulefullbane"][1]) < 3.0 * sd(fit, "a")
    else:
        assert why == [Kind.DEVIATION_TOO_SLOW]


@pytest.mark.slow
def test_a_misfit_in_time_with_the_swing_is_refused_with_a_deviation_too(
    tracker: Path, stand_ins: Path, tmp_path: Path
) -> None:
    """The stand-in is nearly that formula: its marks lie on an arc and are exact, so that the
    little that it lacks is seen all the better.
    """
    imported(tracker / "halfpipe" / "Klipp0.csv", tmp_path / "swing.csv")
    fit, failed, _ = with_deviation(tmp_path, WHOLE_SWING, "swing")
    assert "autocorrelation" in failed
    assert value(fit, "f")[0] == pytest.approx(
        frequency(20.0, 20.0) if tracker == stand_ins else 0.458, rel=0.002
    )
