"""Calibration: simulated data against an ODE solver, bands and p-values against brute force, and
wrong analyses that must fail.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from command_runner import runner
from test_noise import POSITIONS, TIMES, TRUTH
from test_positions import Line, line_problem

from estim.calibration.calibration import Calibration, coverage_sentence, findings, run_trials
from estim.calibration.experiment import CampaignDesign, PointDesign, campaign_design
from estim.calibration.trial import TrialPlan, _experiment, _rank, measured_anew, reported
from estim.calibration.uniformity import uniformity_band, uniformity_p_value
from estim.campaign import Campaign, load_campaign
from estim.campaign.campaign_file import NoiseTable
from estim.cli.commands import cli
from estim.common.errors import InputError
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.problem.noise_variance import Scale
from estim.problem.posterior import Problem
from estim.problem.priors import Normal, Uniform
from estim.reports.calibration import unlike_fit
from estim.words import describe

QUICK = 500.0  # effective draws
CLOCK = 'release_time_s = "0.000(5)"\noffset_m = "0.0000(5)"'
TEXT = """
title = "one run"
kind = "synthetic"
[shared]
g = 9.81
radius_m = 0.15
phi_deg = "4.0(2)"
[bodies.heavy]
gamma = "0.187(10)"
kappa = {prior = "uniform", low = 0.2, high = 0.8}
[[runs]]
name = "r"
body = "heavy"
file = "r.csv"
theta0_deg = "60(2)"
EXTRA
noise = NOISE
"""
SPEEDS = np.gradient(POSITIONS, TIMES)


def load(
    folder: Path,
    noise: str,
    *,
    every: int = 2,
    extra: str = "",
    text: str = TEXT,
    speeds: bool = True,
) -> Campaign:
    """A campaign whose data are the exact motion, every so many frames."""
    (folder / "c.toml").write_text(text.replace("NOISE", noise).replace("EXTRA", extra))
    header, columns = (
        ("t_s,x_m,v_m_s", (TIMES, POSITIONS, SPEEDS)) if speeds else ("t_s,x_m", (TIMES, POSITIONS))
    )
    rows = "\n".join(
        ",".join(f"{cell:.9f}" for cell in row)
        for row in zip(*(c[::every] for c in columns), strict=True)
    )
    (folder / "r.csv").write_text(f"{header}\n{rows}\n")
    return load_campaign(folder / "c.toml")


def designed(
    campaign: Campaign, *, analysed: NoiseTable | None = None
) -> tuple[CampaignDesign, Fit]:
    fit = fit_least_squares(campaign.problem(["r"]))
    return campaign_design(campaign, ["r"], fitted=fit.values, analysed=analysed), fit


def sbc(
    campaign: Campaign, n: int, *, analysed: NoiseTable | None = None, jobs: int = 1
) -> Calibration:
    design, fit = designed(campaign, analysed=analysed)
    return run_trials(design, fit, "sbc", n_trial=n, seed=3, jobs=jobs, ess=QUICK)


# --- bands and p-values ---


@pytest.mark.parametrize("n", [50, 400])
def test_the_band_holds_all_of_a_uniform_distribution_function_as_often_as_it_says(n, rng):
    n_rank, repeats = 99, 4000
    low, high = uniformity_band(n)
    edge = np.arange(1, n_rank + 1) / (n_rank + 1)
    inside = 0
    for _ in range(repeats):
        # continuous: a place below edge i/(n_rank + 1) is a rank below i
        places = np.sort(rng.random(n))
        ecdf = np.searchsorted(places, edge, side="left") / n
        inside += bool(np.all((ecdf >= low) & (ecdf <= high)))
    assert inside / repeats == pytest.approx(0.95, abs=0.012 if n > 100 else 0.03)
    # one edge at a time the band is wider than a pointwise one, which holds far less than 95 % all
    # along
    pointwise = np.sqrt(edge * (1 - edge) / n) * 1.96
    assert np.mean((high - low)[20:80]) > 2.0 * np.mean(pointwise[20:80])


def test_p_values_of_uniform_ranks_are_uniform_and_those_of_others_small(rng):
    n, repeats = 150, 1500
    p_values = np.array([uniformity_p_value(rng.integers(0, 100, n)) for _ in range(repeats)])
    for level in (0.01, 0.05, 0.5):
        assert np.mean(p_values <= level) == pytest.approx(
            level, abs=3.5 * np.sqrt(level * (1 - level) / repeats)
        )
    # too narrow, too wide, biased
    for a, b in ((0.5, 0.5), (2.0, 2.0), (1.6, 1.0)):
        assert (
            np.median(
                [uniformity_p_value((100 * rng.beta(a, b, n)).astype(int)) for _ in range(50)]
            )
            < 0.005
        )


def test_ranks_of_an_exact_posterior_are_uniform_and_those_of_a_narrow_one_are_not(rng):
    # y ~ N(mu, 1), mu ~ N(0, 1): the posterior is N(y/2, 1/2)
    mu = rng.standard_normal(1500)
    centre = 0.5 * (mu + rng.standard_normal(1500))
    z = rng.standard_normal((99, 1500))
    assert uniformity_p_value(np.sum(centre + np.sqrt(0.5) * z < mu, axis=0)) > 0.01
    assert uniformity_p_value(np.sum(centre + 0.8 * np.sqrt(0.5) * z < mu, axis=0)) < 1e-4


def test_of_many_right_intervals_hardly_ever_is_one_called_wrong(rng):
    """At three standard deviations of each, 25 right quantities were refused in one of eight."""
    n_trial, n, n_report = 200, 25, 200
    reported = {f"q{i}": "1" for i in range(n)}
    refused = 0
    for _ in range(n_report):
        places = rng.uniform(size=(n_trial, n))
        covered = np.abs(places - 0.5)[:, :, None] < 0.5 * np.array([0.68, 0.95])
        ranks = np.floor(100.0 * places).astype(int)
        right = Calibration(
            "coverage", ("r",), reported, {}, places, ranks, covered, 0, {}, 0, {}, (), 1.0, 1
        )
        refused += bool(findings(right))
    assert refused <= 5


def test_equal_numbers_get_random_ranks(rng):
    never = np.full((99, 1), np.inf)
    ranks = np.array([_rank(np.array([np.inf]), never, rng)[0] for _ in range(2000)])
    assert ranks.min() == 0
    assert ranks.max() == 99
    assert uniformity_p_value(ranks) > 0.001


# --- simulated data ---


def truth_of(campaign: Campaign) -> np.ndarray:
    known = {
        **TRUTH,
        "phi": np.radians(4.0),
        "release_time[r]": 0.0,
        "offset[r]": 0.0,
        "outlier_fraction[r]": 0.2,
    }
    known["log_outlier_width[r]"] = np.log(10.0)
    return np.array([known[name] for name in campaign.problem(["r"]).names])


def repeated(
    campaign: Campaign, n: int, rng: np.random.Generator, column: str = "x_m"
) -> np.ndarray:
    """(n, n_row) readings of a column in n simulations at the truth."""
    design, _ = designed(campaign)
    values, out = truth_of(campaign), []
    (run,) = design.problem.runs
    for _ in range(n):
        table = design._table(run, campaign.tables["r"], design.problem.named(values), rng)
        out.append(table.columns[column])
    return np.array(out)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("noise", "extra", "column", "sd"),
    [
        ("{sigma_x_m = 0.001}", "", "x_m", 0.001),
        ('{model = "positions", sigma_x_m = 0.001}', CLOCK, "x_m", 0.001),
        (
            '{model = "positions", sigma_x_m = 0.001, robust = "student-t"}',
            CLOCK,
            "x_m",
            0.001 * np.sqrt(2.0),
        ),
        (
            '{model = "positions", sigma_x_m = 0.001, robust = "mixture"}',
            CLOCK,
            "x_m",
            0.001 * np.sqrt(0.8 + 0.2 * 100.0),
        ),
        # the true position about the reading, read anew
        (
            '{model = "independent", sigma_v_m_s = 0.02, sigma_x_m = 0.003}',
            "",
            "x_m",
            0.003 * np.sqrt(2.0),
        ),
        ('{model = "independent", sigma_v_m_s = 0.02, scatter = 0.015}', "", "v_m_s", 0.025),
    ],
)
def test_simulated_readings_scatter_about_the_motion_by_what_the_noise_says(
    tmp_path, rng, noise, extra, column, sd
):
    readings = repeated(load(tmp_path, noise, extra=extra), 250, rng, column)
    exact = (POSITIONS if column == "x_m" else SPEEDS)[::2]
    assert np.all(
        np.abs(readings.mean(axis=0) - exact)[2:]
        < 5.0 * sd / np.sqrt(250) + (0.0 if column == "x_m" else 0.003)
    )
    heavy = "robust" in noise
    assert readings.std(axis=0).mean() == pytest.approx(sd, rel=0.15 if heavy else 0.04)


@pytest.mark.slow
def test_a_differentiated_run_keeps_its_moment_of_release(tmp_path):
    campaign = load(tmp_path, "{sigma_x_m = 0.001}")
    shifted = replace(
        campaign.tables["r"], columns={**campaign.tables["r"].columns, "t_s": TIMES[::2] + 1.25}
    )
    design, fit = designed(replace(campaign, tables={"r": shifted}))
    assert fit.success
    assert design.release["r"] == pytest.approx(1.25, abs=2e-4)


def test_readings_of_an_encoder_are_rounded_and_scatter_is_added_to_differences(tmp_path, rng):
    text = TEXT.replace(
        "NOISE", "{sigma_theta_rad = 0.002, encoder_step_rad = 0.01, scatter = 0.5}"
    ).replace("EXTRA", "")
    (tmp_path / "c.toml").write_text(text)
    (tmp_path / "r.csv").write_text(
        "t_s,theta_rad\n"
        + "\n".join(f"{t:.6f},{x / 0.15:.9f}" for t, x in zip(TIMES, POSITIONS, strict=True))
    )
    campaign = load_campaign(tmp_path / "c.toml")
    angles = repeated(campaign, 20, rng, "theta_rad")
    np.testing.assert_allclose(angles / 0.01, np.rint(angles / 0.01), atol=1e-9)
    assert np.max(np.abs(angles.mean(axis=0) - POSITIONS / 0.15)) < 0.01
    design, _ = designed(campaign)
    posed = design.simulate(truth_of(campaign), design.problem.parameters, rng)
    (run,) = posed.runs
    residual = run.y - run.noise.derivative.value[run.noise.kept]
    assert residual.std() == pytest.approx(0.5, rel=4.0 / np.sqrt(2 * run.n_obs))


def test_independent_errors_of_differences_are_refused(tmp_path):
    campaign = load(
        tmp_path,
        '{model = "independent", derivative = "central", sigma_v_m_s = 0.02}',
        speeds=False,
    )
    with pytest.raises(InputError, match="cannot be simulated"):
        designed(campaign)


def test_truths_without_data_are_drawn_again_and_counted(tmp_path):
    # the disk starts uphill only where gamma sin(theta0) > sin(phi), above some 22 degrees
    text = TEXT.replace(
        'theta0_deg = "60(2)"', 'theta0_rad = {prior = "uniform", low = 0.05, high = 1.2}'
    )
    design, fit = designed(load(tmp_path, "{sigma_x_m = 0.001}", text=text))
    plan = TrialPlan(design, "sbc", fit.values, fit.names, QUICK, 1)
    angle = fit.names.index("theta0[r]")
    drawn = [_experiment(plan, np.random.default_rng(i)) for i in range(40)]
    assert sum(n for _, _, n in drawn) > 10
    assert min(values[angle] for values, _, _ in drawn) > 0.3


def test_measurements_are_repeated_around_the_truth_and_ranges_stay(tmp_path, rng):
    problem = load(tmp_path, "{sigma_x_m = 0.001}").problem(["r"])
    truth = np.array([0.19, 0.5, 1.0, 0.08])
    centres = np.array(
        [[p.prior.centre for p in measured_anew(problem, truth, rng)] for _ in range(800)]
    )
    for i, p in enumerate(problem.parameters):
        if isinstance(p.prior, Uniform):
            assert np.all(centres[:, i] == p.prior.centre)
            continue
        assert isinstance(p.prior, Normal)
        assert centres[:, i].mean() == pytest.approx(truth[i], abs=4.0 * p.prior.sd / np.sqrt(800))
        assert centres[:, i].std() == pytest.approx(p.prior.sd, rel=0.1)


# --- the whole pipeline ---

N_TRIAL = 24  # find a sigma of half its size in 87 studies of 100 or more, whichever the noise
NOISES = {
    "independent": ('{model = "independent", sigma_v_m_s = 0.02}', 2, ""),
    "errors in x": ('{model = "independent", sigma_v_m_s = 0.02, sigma_x_m = 0.002}', 2, ""),
    "sigma inferred": (
        '{model = "independent", sigma_v_m_s = {prior = "log-normal", median = 0.02, '
        "log_sd = 0.5}}",
        2,
        "",
    ),
    "mixture": ('{model = "independent", sigma_v_m_s = 0.02, robust = "mixture"}', 1, ""),
    "differentiated": ("{sigma_x_m = 0.001}", 2, ""),
    "positions": ('{model = "positions", sigma_x_m = 0.001}', 4, CLOCK),
    "positions, student-t": (
        '{model = "positions", sigma_x_m = 0.001, robust = "student-t"}',
        4,
        CLOCK,
    ),
}


@pytest.mark.statistics
@pytest.mark.parametrize("name", NOISES)
def test_no_noise_model_misstates_its_uncertainty(tmp_path, name):
    noise, every, extra = NOISES[name]
    calibration = sbc(load(tmp_path, noise, every=every, extra=extra), N_TRIAL)
    assert findings(calibration) == ()
    assert calibration.n_failed == 0
    assert calibration.ranks.shape == (N_TRIAL, len(calibration.reported))


@pytest.mark.statistics
def test_a_sigma_half_as_large_is_called_too_narrow(tmp_path):
    calibration = sbc(
        load(tmp_path, "{sigma_x_m = 0.001}"), 40, analysed=NoiseTable(sigma_x_m=0.0005)
    )
    assert calibration.p_value("theta0[r]") < 1e-3
    said = {finding.parameters[0].name: describe(finding) for finding in findings(calibration)}
    assert "intervals are too narrow" in said["theta0[r]"]
    assert "turning_point[r]" in said


@pytest.mark.statistics
def test_differences_taken_for_independent_speeds_are_called_too_wide(tmp_path):
    wrong = NoiseTable(
        model="independent", derivative="central", sigma_v_m_s=0.001 * 30.0 / np.sqrt(2.0)
    )
    text = TEXT.replace('theta0_deg = "60(2)"', 'theta0_deg = "60(5)"')
    calibration = sbc(
        load(tmp_path, "{sigma_x_m = 0.001}", every=1, text=text, speeds=False), 150, analysed=wrong
    )
    assert any(
        finding.parameters[0].name == "theta0[r]" and "too wide" in describe(finding)
        for finding in findings(calibration)
    )


@pytest.mark.statistics
def test_intervals_cover_the_fitted_values_as_often_as_they_say(tmp_path):
    design, fit = designed(load(tmp_path, "{sigma_x_m = 0.001}"))
    calibration = run_trials(design, fit, "coverage", n_trial=50, seed=5, ess=QUICK)
    assert np.all(calibration.truth == calibration.truth[0])
    assert findings(calibration) == ()
    assert coverage_sentence(calibration, "gamma[heavy]").startswith(
        "the 68 % interval of gamma[heavy] covered "
    )

    # with the centres of the priors held at the truth itself, what they determine would be covered
    # always
    class Held(CampaignDesign):
        def simulate(self, values, parameters, rng):
            return super().simulate(values, self.problem.parameters, rng)

    held = Held(design.campaign, design.names, design.problem, design.release)
    assert run_trials(held, fit, "coverage", n_trial=20, seed=5, ess=QUICK).share("phi")[0] > 0.9


class OwnLine(Line):
    """y = a + b x as a user's curve: no end, nothing derived."""

    def end(self, arguments):
        return np.full((1, 1), np.inf)

    def derived(self, arguments):
        return {}


@dataclass(frozen=True, eq=False)
class HalfSigma(PointDesign):
    """Analyses its points with half the standard deviation they have; scale : half of what it
    is.
    """

    scale: float = 0.05

    def simulate(self, values, parameters, rng):
        posed = super().simulate(values, parameters, rng)
        (run,) = posed.runs
        return replace(
            posed, runs=(replace(run, noise=replace(run.noise, sigma=Scale(self.scale))),)
        )


@pytest.mark.statistics
def test_a_curve_of_ones_own_is_calibrated_at_its_points(rng):
    x = np.linspace(0.0, 1.0, 12)
    free = line_problem(x, 1.0 + 2.0 * x + 0.1 * rng.standard_normal(12), 0.0, 0.1)
    (run,) = free.runs
    parameters = tuple(
        replace(p, prior=Normal(mean, 0.5))
        for p, mean in zip(free.parameters, (1.0, 2.0), strict=True)
    )
    problem = Problem(
        parameters, (replace(run, curve=OwnLine(), noise=replace(run.noise, sigma_x=None)),)
    )
    fit = fit_least_squares(problem)
    right, wrong = (
        run_trials(design, fit, "sbc", n_trial=60, seed=2, ess=QUICK)
        for design in (PointDesign(problem), HalfSigma(problem))
    )
    assert tuple(right.reported) == ("a", "b")
    assert findings(right) == ()
    assert {finding.parameters[0].name for finding in findings(wrong)} == {"a", "b"}
    assert all("too narrow" in describe(finding) for finding in findings(wrong))


@pytest.mark.slow
def test_the_same_seed_gives_the_same_ranks_for_any_number_of_jobs(tmp_path):
    campaign = load(tmp_path, '{model = "independent", sigma_v_m_s = 0.02}')
    one, two = sbc(campaign, 6), sbc(campaign, 6, jobs=2)
    np.testing.assert_array_equal(one.ranks, two.ranks)
    np.testing.assert_array_equal(one.truth, two.truth)
    assert len({tuple(row) for row in one.truth}) == 6


def test_turning_points_and_derived_numbers_are_looked_at_too(tmp_path):
    _, fit = designed(load(tmp_path, "{sigma_x_m = 0.001}"))
    column = reported(fit.problem, fit.values[None, :], ["turning_point[r]", "gamma[heavy]"])
    assert column.shape == (1, 2)
    # where the disk of `test_noise` turns by its ODE solver
    assert column[0, 0] == pytest.approx(POSITIONS.max(), abs=0.005)


# --- the command ---


@pytest.mark.parametrize(
    ("said", "beside"),
    [
        ("", "an unmodelled force and default errors of clock and scale"),
        ("unmodelled_force = 0\n", "default errors of clock and scale"),
        ("scale_x = 0\nscale_t = 0\n", "an unmodelled force"),
        ("unmodelled_force = 0\nscale_x = 0\nscale_t = 0\n", None),
    ],
)
def test_what_a_calibration_leaves_out_of_the_fit_is_told(tmp_path, said, beside):
    load(tmp_path, "{sigma_x_m = 0.001}")
    path = tmp_path / "c.toml"
    path.write_text(path.read_text().replace("[shared]\n", f"[shared]\n{said}"))
    campaign = load_campaign(path)
    problem = campaign.problem(["r"])
    found = unlike_fit(problem, campaign.problem(["r"], usual=True))
    assert found.endswith(
        "" if beside is None else f" allow for {beside}, and are not checked here"
    )
    assert bool(found) == (beside is not None)


def calibrate(*arguments: object) -> tuple[int, str, str]:
    done = runner().invoke(cli, ["calibrate", *map(str, arguments)])
    return done.exit_code, done.stdout, done.stderr


def start(*arguments: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "estim", "calibrate", *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        cwd=Path(__file__).parents[1],
    )


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_command_writes_report_figures_and_numbers(tmp_path):
    load(tmp_path, '{model = "independent", sigma_v_m_s = 0.02}')
    code, said, complaints = calibrate(
        tmp_path / "c.toml", "--simulations", 24, "--jobs", 1, "--out", tmp_path / "out"
    )
    assert code in (0, 3), complaints
    assert complaints == ""
    assert "the 68 % interval of gamma[heavy] covered" in said
    unlike = (
        "those of estim fit also allow for an unmodelled force and default errors of clock "
        "and scale, and are not checked here"
    )
    assert f"note: the intervals checked are those of the curve alone; {unlike}\n" in said
    report = (tmp_path / "out" / "report.md").read_text().replace("\xa0", " ")
    assert unlike in report.partition("<details>")[0]
    assert ("are not calibrated" in report.splitlines()[2]) == (code == 3)
    assert {path.name for path in (tmp_path / "out" / "figures").iterdir()} == {
        "ranks.png",
        "coverage-priors.png",
        "coverage-fit.png",
    }
    record = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert record["sbc"]["n_trial"] == 24
    assert record["coverage"]["numbers"]["gamma[heavy]"]["coverage"][0]["probability"] == 0.68
    assert ("not-calibrated" in said) == (code == 3)
    assert "of 24 simulated true values" in (tmp_path / "out" / "report.md").read_text()


def n_worker(parent):
    """How many worker processes a process has."""
    listed = subprocess.run(
        ["ps", "-A", "-ww", "-o", "ppid=,args="], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    return sum(line.split()[0] == str(parent) and "spawn_main" in line for line in listed)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "everybody"),
    [(signal.SIGINT, True), pytest.param(signal.SIGTERM, False, marks=pytest.mark.statistics)],
)
def test_a_signal_to_stop_ends_the_command_with_130_and_leaves_what_can_be_resumed(
    tmp_path, number, everybody
):
    if signal.getsignal(number) is signal.SIG_IGN:
        pytest.skip(
            "the tests were started with this signal ignored (nohup), and so is what they start"
        )
    load(tmp_path, '{model = "independent", sigma_v_m_s = 0.02}')
    running = start(
        tmp_path / "c.toml", "--simulations", 100000, "--jobs", 2, "--out", tmp_path / "out"
    )
    try:
        while n_worker(running.pid) < 2 and running.poll() is None:
            time.sleep(0.1)
        time.sleep(0.5)  # anything between the first import of a worker and its calls
        (os.killpg if everybody else os.kill)(running.pid, number)
        _, complaints = running.communicate(timeout=60)
    finally:
        if running.poll() is None:
            os.killpg(running.pid, signal.SIGKILL)
            running.communicate()
    assert running.returncode == 130, complaints
    assert complaints.splitlines()[-1] == "interrupted: continue with --resume"
    assert "Traceback" not in complaints
    assert {path.name for path in (tmp_path / "out").glob("*")} <= {".checkpoint", ".lock"}


OWN = """title = "A decay"
kind = "synthetic"
[curve]
expression = "A*exp(-b*x)"
x = {column = "t_s", name = "time t", unit = "s"}
y = {column = "u_V", name = "voltage U", unit = "V"}
u_y = 0.05
u_x = U_X
robust = ROBUST
window = {min = 0.3}
[curve.parameters]
A = {start = 1.5, low = 1.0, high = 3.0, unit = "V"}
b = {start = 0.3, low = 0.1, high = 1.0, unit = "1/s"}
[[runs]]
name = "a"
file = "a.csv"
"""


def own_curve(folder, **keys):
    rng = np.random.default_rng(8)
    t = np.linspace(0.0, 4.0, 30)
    u = 2.0 * np.exp(-0.5 * t) + 0.05 * rng.standard_normal(t.size)
    (folder / "a.csv").write_text(
        "t_s,u_V\n" + "\n".join(f"{a:.4f},{b:.5f}" for a, b in zip(t, u, strict=True))
    )
    lines = [line for line in OWN.splitlines() if not line.endswith(("U_X", "ROBUST"))]
    lines[lines.index("window = {min = 0.3}")] += "".join(
        f"\n{key} = {value}" for key, value in keys.items()
    )
    (folder / "c.toml").write_text("\n".join(lines))
    return load_campaign(folder / "c.toml")


@pytest.mark.parametrize(
    ("keys", "sd"), [({}, 0.05), ({"u_x": 0.05}, 0.05), ({"robust": '"student-t"'}, 0.07)]
)
def test_a_curve_campaign_is_simulated_at_its_points(tmp_path, rng, keys, sd):
    campaign = own_curve(tmp_path, **keys)
    problem = campaign.problem(["a"])
    truth = np.array([{"A": 2.0, "b": 0.5}.get(p.name, p.prior.centre) for p in problem.parameters])
    design = campaign_design(campaign, ["a"], fitted=truth)
    runs = [
        posed.runs[0]
        for posed in (design.simulate(truth, problem.parameters, rng) for _ in range(400))
        if posed is not None
    ]
    assert len(runs) == 400
    (real,) = problem.runs
    exact, slope = 2.0 * np.exp(-0.5 * real.x), np.exp(-0.5 * real.x)
    assert real.x.min() > 0.3
    # true abscissas about the readings, in the distribution that is fitted to them, then read anew
    if u_x := keys.get("u_x", 0.0):
        spread = 1.0 / np.sqrt(1.0 / u_x**2 + 1.0 / (np.var(real.x, ddof=1) - u_x**2))
        sd, u_x = np.sqrt(sd**2 + np.mean(slope**2) * spread**2), np.hypot(u_x, spread)
    assert np.mean([run.y - exact for run in runs]) == pytest.approx(
        0.0, abs=4.0 * sd / np.sqrt(400 * real.n_obs)
    )
    assert np.std([run.y - exact for run in runs]) == pytest.approx(
        sd, rel=0.2 if "robust" in keys else 4.0 / np.sqrt(2 * 400 * real.n_obs)
    )
    assert np.std([run.x - real.x for run in runs]) == pytest.approx(u_x, rel=0.04)


@pytest.mark.statistics
def test_a_curve_campaign_is_calibrated_and_half_its_errors_are_not(tmp_path):
    campaign = own_curve(tmp_path)
    problem = campaign.problem(["a"])
    fit = fit_least_squares(problem)
    design = campaign_design(campaign, ["a"], fitted=fit.values)
    right = run_trials(design, fit, "sbc", n_trial=40, seed=3, ess=QUICK)
    wrong = run_trials(HalfSigma(problem, scale=0.5), fit, "sbc", n_trial=40, seed=3, ess=QUICK)
    assert findings(right) == ()
    assert {finding.parameters[0].name for finding in findings(wrong)} == {"A", "b"}


@pytest.mark.slow
def test_the_command_calibrates_a_curve_campaign(tmp_path):
    own_curve(tmp_path)
    choices = ("--simulations", 20, "--seed", 2, "--what", "coverage", "--jobs", 1)
    code, said, complaints = calibrate(tmp_path / "c.toml", *choices, "--out", tmp_path / "out")
    assert (code, complaints) == (0, "")
    assert "the 68 % interval of b covered" in said
    assert "estim fit" not in said  # whose analysis it is


def test_a_share_has_the_decimals_of_its_uncertainty():
    few = SimpleNamespace(n_trial=20, share=lambda name: [0.9])
    assert "covered 90 ± 7 % of 20 " in coverage_sentence(few, "g")
