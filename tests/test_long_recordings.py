"""Recordings of many frames: what is computed in bands and beside causes is what whole matrices
say.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estim import fit_curve, levenberg_marquardt, load_campaign
from estim.checks.goodness_of_fit import Goodness
from estim.discrepancy import BadFrames, FreeStart, Trajectory, bad_frames, pose_forces, trajectory
from estim.discrepancy.autocorrelated import AutoCorrelated
from estim.discrepancy.smoothing import smoothed_positions
from estim.model import Body, back_and_forth
from estim.problem import correlated_normal, roots
from estim.problem.roots import LowRankRoot
from estim.reports.curve_figures import residual_figure

NOISES = {
    "speeds": 'derivative = "central"',
    "wider speeds": 'derivative = "five-point"',
    "positions": 'model = "positions"',
}


def recording(
    folder: Path, noise: str, n: int, *, more: str = "", bad: float = 0.0, seed: int = 5
) -> Path:
    rng, t = np.random.default_rng(seed), np.linspace(0.0, 3.0, n)
    body = Body(radius=0.15, gamma=0.094, kappa=0.45)
    (x,), _ = back_and_forth(t, body, phi=math.radians(-1.0), theta0=math.radians(20.0))
    x = x + 2e-4 * rng.standard_normal(n)
    x[n // 2] += bad
    (folder / "run.csv").write_text(
        "t_s,x_m\n" + "".join(f"{a:.7f},{b:.6f}\n" for a, b in zip(t, x, strict=True))
    )
    path = folder / "campaign.toml"
    path.write_text(f"""
title = "A long roll down"
kind = "synthetic"
[shared]
g = 9.81
radius_m = "0.1500(5)"
noise = {{sigma_x_m = 0.0002, {noise}{more}}}
[bodies.light]
mass_disk_kg = "0.3022(10)"
mass_particle_kg = "0.0314(37)"
kappa = {{prior = "uniform", low = 0.0, high = 1.0}}
[[runs]]
name = "long"
body = "light"
file = "run.csv"
phi_deg = "-1.0(1)"
theta0_deg = "20.0(1.5)"
""")
    return path


def _posed(path: Path, monkeypatch: pytest.MonkeyPatch, dense: int):
    """Free start, force and bad frames about one point, where more than `dense` points go by
    roots.
    """
    for module in (correlated_normal, roots):
        monkeypatch.setattr(module, "DENSE", dense)
    campaign = load_campaign(path)
    problem = campaign.problem(["long"], usual=True)
    values = np.array([p.prior.centre for p in problem.parameters])
    values[problem.names.index("kappa[light]")] = 0.45
    values[[i for i, p in enumerate(problem.parameters) if p.unit == "s"]] = 0.0
    (run,) = problem.runs
    named = problem.named(values)
    free = FreeStart(run.noise, Trajectory.of(run), BadFrames()).likelihood(run.points, named)
    bad = bad_frames(run, problem, values, known=BadFrames())
    posed = pose_forces(
        problem, values, without=np.ones(problem.n_par), bad={"long": bad}, alone={}
    )
    return problem, named, free, posed, bad


TRUTH = {
    "gamma[light]": 0.094,
    "kappa[light]": 0.45,
    "theta0[long]": math.radians(20.0),
    "phi[long]": math.radians(-1.0),
    "radius": 0.15,
}


def _named_at_the_truth(path: Path) -> list[tuple[str, int]]:
    campaign = load_campaign(path)
    problem = campaign.problem(["long"], usual=True)
    (run,) = problem.runs
    values = np.array([TRUTH.get(name, 0.0) for name in problem.names])
    found = bad_frames(run, problem, values, known=BadFrames())
    return [(jump.kind, jump.row) for jump in found.jumps]


@pytest.mark.slow
def test_of_dense_frames_none_beside_the_release_is_named(tmp_path, monkeypatch):
    def named_of(bad: float = 0.0) -> list[tuple[str, int]]:
        return _named_at_the_truth(recording(tmp_path, NOISES["speeds"], 800, bad=bad, seed=4))

    assert named_of() == []
    assert named_of(bad=0.004) == [("frame", 400)]
    monkeypatch.setattr(trajectory, "smoothed_positions", lambda t, x, speed, sd: x)
    named = named_of()
    assert named
    assert max(row for _, row in named) < 100


@pytest.mark.statistics
@pytest.mark.parametrize(("n", "seeds"), [(1434, range(10)), (5000, range(100, 102))])
def test_of_dense_frames_none_is_named_again_and_again(tmp_path, n, seeds):
    assert [
        _named_at_the_truth(recording(tmp_path, NOISES["speeds"], n, seed=seed)) for seed in seeds
    ] == [[] for _ in seeds]


def test_readings_settle_where_they_are_dense_and_nowhere_else():
    rng, sd, a = np.random.default_rng(3), 2e-4, 0.3
    for n, dense in ((60, False), (6000, True)):
        t = np.linspace(0.09, 1.0, n)
        true = 0.5 * a * t**2
        errors = sd * rng.standard_normal(n)
        off = smoothed_positions(t, true + errors, a * t, sd) - true
        if dense:
            half = 2.0 * sd / (a * t) * n / 0.91  # readings to either side
            many = (half > 2.0) & (t > 0.12)
            assert np.mean(off[many] ** 2 * (2.0 * half[many] + 1.0)) == pytest.approx(
                sd**2, rel=0.5
            )
            np.testing.assert_array_equal(off[half < 1.9], (true + errors - true)[half < 1.9])
            assert np.mean(off[t < 0.15]) == pytest.approx(0.0, abs=0.15 * sd)
        else:
            np.testing.assert_array_equal(off, true + errors - true)


def test_beside_a_turning_point_readings_stay_on_their_path():
    sd, a, t = 2e-4, 0.3, np.linspace(-1.0, 1.0, 4001)
    x = -0.5 * a * t**2
    # the curve stops too early
    off = smoothed_positions(t, x, np.zeros(t.size) + 1.0 * (np.abs(t) > 0.9) * a, sd) - x
    assert 0.01 * sd < np.max(np.abs(off)) < sd / 15.0


@pytest.mark.slow
@pytest.mark.parametrize("noise", NOISES)
def test_bands_say_what_whole_matrices_say(tmp_path, monkeypatch, noise):
    path = recording(tmp_path, NOISES[noise], 301, bad=0.004)
    problem, named, free, posed, bad = _posed(path, monkeypatch, 10)
    _, _, whole_free, whole_posed, whole_bad = _posed(path, monkeypatch, 10**6)
    (run,) = problem.runs
    assert isinstance(free.form.triangle, LowRankRoot)
    assert not isinstance(whole_free.form.triangle, LowRankRoot)
    # of positions, which a push moves by 15,000 sds, the eigenvectors of the whole matrix lose
    # eight digits; by extended precision bands do not
    close = 2e-7 if noise == "positions" else 1e-8
    draws = {name: np.asarray(value) * np.array([[1.0], [1.001]]) for name, value in named.items()}
    for one, other in (
        (free, whole_free),
        (
            posed.noises["long"].likelihood(run.points, named),
            whole_posed.noises["long"].likelihood(run.points, named),
        ),
    ):
        off = close * run.n_obs**0.5  # of a sum of squares of residuals that are of the order of 1
        np.testing.assert_allclose(
            one.log_likelihood(draws), other.log_likelihood(draws), rtol=0.0, atol=off
        )
        (j, r), (whole_j, whole_r) = (
            one.scoring(named, problem.names),
            other.scoring(named, problem.names),
        )
        size = np.linalg.norm(whole_j, axis=0)
        size[size == 0.0] = 1.0
        np.testing.assert_allclose((j / size).T @ r, (whole_j / size).T @ whole_r, atol=close)
        np.testing.assert_allclose(
            (j / size).T @ j / size, (whole_j / size).T @ whole_j / size, rtol=0.0, atol=close
        )
        white, whole = one.whitened(named, problem.names), other.whitened(named, problem.names)
        np.testing.assert_allclose(white.z, whole.z, rtol=0.0, atol=close)
        np.testing.assert_allclose(white.root / size, whole.root / size, rtol=0.0, atol=close)
        np.testing.assert_allclose(one.sd(named), other.sd(named), rtol=1e-9)
        np.testing.assert_allclose(
            one.pointwise(draws), other.pointwise(draws), rtol=0.0, atol=10.0 * close
        )
        assert one.squared_size(run.y, named) == pytest.approx(
            other.squared_size(run.y, named), rel=close
        )
    assert bad.same(whole_bad)
    assert [(jump.kind, jump.row) for jump in bad.jumps] == [("frame", 150)]
    np.testing.assert_allclose(bad.jumps[0].size, whole_bad.jumps[0].size, rtol=1e-8)
    np.testing.assert_allclose(
        posed.forces[0].force.mean,
        whole_posed.forces[0].force.mean,
        atol=1e-8 * np.max(np.abs(whole_posed.forces[0].force.mean)),
    )


def test_where_the_covariance_does_not_stay_the_same_a_recording_has_at_most_3000_frames(tmp_path):
    path = recording(tmp_path, NOISES["speeds"], 3300)
    assert load_campaign(path).problem(["long"]).n_obs > 3000
    recording(
        tmp_path, NOISES["speeds"], 3300, more=', scatter = {prior = "half-normal", scale = 0.1}'
    )
    with pytest.raises(
        Exception, match="'rows to fit' must be at most 3000: state a window for run 'long': 3"
    ):
        load_campaign(path).problem(["long"])


@pytest.mark.slow
def test_a_scan_of_many_points_in_pieces_finds_the_same(monkeypatch):
    rng, t = np.random.default_rng(1), np.linspace(0.0, 20.0, 400)
    y = 2.0 * np.exp(-t / 15.0) * np.cos(3.0 * t + 0.4) + 0.05 * rng.standard_normal(t.size)
    start = {"a": 1.8, "tau": 12.0, "w": 3.02, "p": 0.3}
    found = []
    for batch in (400_000, 2_000):
        monkeypatch.setattr(levenberg_marquardt, "_BATCH", batch)
        found.append(fit_curve("a*exp(-x/tau)*cos(w*x + p)", t, y, u_y=0.05, start=start))
    one, other = found
    for name in start:
        assert one.values[name] == pytest.approx(other.values[name], rel=1e-12)


def test_residuals_of_many_frames_do_not_hide_each_other(tmp_path):
    drawn = []
    for n in (30, 200, 900):
        (run,) = load_campaign(recording(tmp_path, NOISES["positions"], n)).problem(["long"]).runs
        z = np.random.default_rng(n).standard_normal(run.n_obs)
        figure = residual_figure(
            [run], [Goodness("long", z, z, np.ones(z.size), {}, math.nan, 0.0, math.nan)]
        )
        drawn.append(
            [
                (line.get_linestyle(), line.get_markersize())
                for line in figure.axes[0].lines
                if np.size(line.get_xdata()) == run.n_obs
            ]
        )
        figure.draw_without_rendering()
        assert np.all(figure.axes[1].get_xticks() % 1.0 == 0.0)  # numbers of points
    assert drawn[1] == [("-", 6.0), ("None", 3.0)]
    assert drawn[2] == [("None", 1.2)]


@pytest.mark.parametrize(
    "noise_of", [lambda noise: noise, lambda noise: AutoCorrelated(noise, 0.6)]
)
def test_a_few_points_of_a_long_file_have_matrices_of_their_own_size(tmp_path, noise_of):
    """The matrix of all pairs of 200,000 readings would take 320 GB."""
    problem = load_campaign(recording(tmp_path, NOISES["speeds"], 101)).problem(["long"])
    (run,), named = problem.runs, problem.named(problem.start()[None, :])
    derivative = run.noise.derivative
    matrix = derivative.matrix.copy()
    matrix.resize(matrix.shape[0], 200_000)
    far = replace(run.noise, derivative=replace(derivative, matrix=matrix))
    own, of_long = (
        noise_of(noise).likelihood(run.points, named).log_likelihood(named)
        for noise in (run.noise, far)
    )
    assert own == of_long
