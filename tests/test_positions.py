"""Positions fit as they are, robust tails and errors in the abscissa: recovery of known truths,
beside models that fail.

Positions come from an ODE solver (`test_noise`), which shares no code with `model.motion`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from test_noise import CAMPAIGN, DIFFERENTIATED, POSITIONS, TIMES, TRUTH

from estim.campaign import Campaign, load_campaign
from estim.checks.outliers import find_outliers
from estim.fitting.least_squares import Fit, fit_least_squares
from estim.problem.curve import LocalCurve
from estim.problem.noise import Independent
from estim.problem.noise_variance import Scale
from estim.problem.observations import Observations, Parameter
from estim.problem.posterior import Problem
from estim.problem.priors import Uniform

SIGMA = 0.001
ZERO_KNOWN = "offset_m = 0.0\n"


def campaign(folder: Path, noise: str, extra: str = ZERO_KNOWN) -> Campaign:
    (folder / "c.toml").write_text(CAMPAIGN.replace("noise = NOISE", f"{extra}noise = {noise}"))
    (folder / "r.csv").write_text(
        "t_s,x_m\n" + "\n".join(f"{t:.6f},{x:.9f}" for t, x in zip(TIMES, POSITIONS, strict=True))
    )
    return load_campaign(folder / "c.toml")


def fit_positions(
    pattern: Campaign, x: np.ndarray, rng: np.random.Generator, t: np.ndarray = TIMES
) -> Fit:
    table = pattern.tables["r"]
    lines = np.arange(t.size)
    simulated = replace(table, columns=MappingProxyType({"t_s": t, "x_m": x}), lines=lines)
    problem = replace(pattern, tables=MappingProxyType({"r": simulated})).problem(["r"])
    start = np.array(
        [
            {
                **TRUTH,
                "release_time[r]": 0.0,
                "outlier_fraction[r]": 0.05,
                "log_outlier_width[r]": 3.0,
            }.get(n, 0.0)
            for n in problem.names
        ]
    )
    return fit_least_squares(problem, start=start)


def value(fit: Fit, name: str) -> tuple[float, float]:
    i = fit.names.index(name)
    return float(fit.values[i]), float(np.sqrt(fit.cov[i, i]))


NOISES = {
    "normal": '{model = "positions", sigma_x_m = 0.001}',
    "t": '{model = "positions", sigma_x_m = 0.001, robust = "student-t"}',
    "mixture": '{model = "positions", sigma_x_m = 0.001, robust = "mixture"}',
}


@pytest.mark.statistics
def test_positions_recover_the_truth_with_the_scatter_they_claim(tmp_path, rng):
    pattern, n = campaign(tmp_path, NOISES["normal"]), 60
    pulls = []
    for _ in range(n):
        fit = fit_positions(pattern, POSITIONS + SIGMA * rng.standard_normal(TIMES.size), rng)
        pulls.append(
            [(value(fit, name)[0] - truth) / value(fit, name)[1] for name, truth in TRUTH.items()]
        )
    spread = np.std(pulls, axis=0)
    assert np.all(np.abs(spread - 1.0) < 4.0 / np.sqrt(2 * n)), spread
    assert np.all(np.abs(np.mean(pulls, axis=0)) < 4.0 / np.sqrt(n))


def test_positions_say_no_less_than_their_differences(tmp_path, rng):
    x = POSITIONS + SIGMA * rng.standard_normal(TIMES.size)
    whole = fit_positions(campaign(tmp_path, NOISES["normal"]), x, rng)
    speeds = fit_positions(campaign(tmp_path, DIFFERENTIATED, ""), x, rng)
    all_speeds = fit_positions(
        campaign(tmp_path, f"{DIFFERENTIATED}\nwindow = {{x_min_m = -0.1, x_max_m = 1.0}}", ""),
        x,
        rng,
    )
    for name in TRUTH:
        assert value(whole, name)[1] < value(speeds, name)[1]
        # with every frame and the same zero there is nothing else in the positions than in their
        # differences; near the ends of the motion the errors of the differences are no longer small
        # against the bend of the curve, hence a few per cent
        assert value(whole, name)[1] == pytest.approx(value(all_speeds, name)[1], rel=0.06)
        assert abs(value(whole, name)[0] - value(all_speeds, name)[0]) < 0.2 * value(whole, name)[1]


def test_an_uncertain_zero_of_the_positions_costs_certainty(tmp_path, rng):
    x = POSITIONS + SIGMA * rng.standard_normal(TIMES.size)
    known = fit_positions(campaign(tmp_path, NOISES["normal"]), x, rng)
    unknown = fit_positions(campaign(tmp_path, NOISES["normal"], ""), x, rng)
    assert "offset[r]" in unknown.names
    assert value(unknown, "theta0[r]")[1] > 1.2 * value(known, "theta0[r]")[1]


def test_the_way_back_is_used(tmp_path, rng):
    from test_noise import GAMMA, KAPPA, PHI, RADIUS, THETA0

    from estim.model import Body, back_and_forth

    t = np.arange(0.0, 2.7, 1 / 30)
    truth = back_and_forth(
        t, Body(radius=RADIUS, gamma=GAMMA, kappa=KAPPA), phi=PHI, theta0=THETA0
    )[0][0]
    x = truth + SIGMA * rng.standard_normal(t.size)
    there = fit_positions(campaign(tmp_path, NOISES["normal"]), x[t < 1.4], rng, t[t < 1.4])
    both = fit_positions(campaign(tmp_path, NOISES["normal"]), x, rng, t)
    assert both.problem.n_obs == t.size
    for name, true in TRUTH.items():
        assert abs(value(both, name)[0] - true) < 3.5 * value(both, name)[1]
        assert value(both, name)[1] < 0.7 * value(there, name)[1]


@pytest.mark.parametrize("robust", ["t", "mixture"])
def test_gross_outliers_are_named_and_do_not_move_gamma(tmp_path, rng, robust):
    x = POSITIONS + SIGMA * rng.standard_normal(TIMES.size)
    clean, u = value(fit_positions(campaign(tmp_path, NOISES["normal"]), x, rng), "gamma[heavy]")
    bad = np.array([13, 29])  # 5 % of the frames
    spoiled = x.copy()
    spoiled[bad] += [0.06, -0.04]
    fit = fit_positions(campaign(tmp_path, NOISES[robust]), spoiled, rng)
    assert abs(value(fit, "gamma[heavy]")[0] - clean) < 0.5 * u
    (found,) = find_outliers(fit.posterior, fit.values[None, :])
    assert set(found.frames) == set(bad)
    # a fit that takes every frame at its word is carried away
    carried, _ = value(
        fit_positions(campaign(tmp_path, NOISES["normal"]), spoiled, rng), "gamma[heavy]"
    )
    assert abs(carried - clean) > 1.0 * u


def test_robust_noise_is_refused_for_differences(tmp_path):
    with pytest.raises(ValueError, match="one bad frame affects several differentiated speeds"):
        campaign(tmp_path, '{sigma_x_m = 0.001, robust = "mixture"}')


@dataclass(frozen=True)
class Line:
    """y = a + b x, the simplest curve."""

    mass = None

    def value(self, x, arguments):
        return np.atleast_2d(arguments["a"] + arguments["b"] * x)

    def local(self, x, arguments):
        ones = np.ones((1, x.size))
        return LocalCurve(
            self.value(x, arguments), arguments["b"] * ones, {"a": ones, "b": x * ones}
        )


def line_problem(x, y, sigma_x, sigma_y):
    noise = Independent(Scale(sigma_y), Scale(), np.ones(x.size), sigma_x=Scale(sigma_x))
    run = Observations(
        "line",
        x,
        y,
        None,
        Line(),
        {"a": "a", "b": "b"},
        noise,
        "x",
        "1",
        "y",
        "1",
        (),
        np.zeros((0, 2)),
    )
    return Problem(
        (Parameter("a", "1", Uniform(-50, 50), ""), Parameter("b", "1", Uniform(-50, 50), "")),
        (run,),
    )


def interval_covers(problem, truth, *, naive):
    """Whether the central 68 % interval of the slope holds `truth`, by summing the posterior on a
    grid.
    """
    fit = fit_least_squares(problem, start=np.array([1.0, 2.0]))
    (run,) = problem.runs
    sd = np.sqrt(np.diag(fit.cov))
    a, b = (fit.values[i] + 6.0 * sd[i] * np.linspace(-1, 1, 25) for i in (0, 1))
    draws = np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)
    if naive:
        variance = run.noise.sigma.value**2 + draws[:, 1:] ** 2 * run.noise.sigma_x.value**2
        log_p = -0.5 * np.sum(
            (run.y - draws[:, :1] - draws[:, 1:] * run.x) ** 2 / variance + np.log(variance), axis=1
        )
    else:
        log_p = fit.posterior.log_density(draws)
    density = np.exp(log_p - log_p.max()).reshape(25, 25).sum(axis=0)
    return (
        0.16
        < float(np.interp(truth, b, (np.cumsum(density) - 0.5 * density) / density.sum()))
        < 0.84
    )


@pytest.mark.statistics
@pytest.mark.parametrize("n_obs", [8, 40])
def test_errors_in_x_keep_their_coverage(n_obs, rng):
    truth, sigma_x, sigma_y, n = (1.0, 2.0), 0.1, 0.05, 60 if n_obs == 8 else 40
    right, wrong = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    for i in range(n):
        true_x = rng.uniform(0.0, 1.0, n_obs)
        x = true_x + sigma_x * rng.standard_normal(n_obs)
        y = truth[0] + truth[1] * true_x + sigma_y * rng.standard_normal(n_obs)
        problem = line_problem(x, y, sigma_x, sigma_y)
        right[i] = interval_covers(problem, truth[1], naive=False)
        wrong[i] = interval_covers(problem, truth[1], naive=True)
    error = np.sqrt(0.68 * 0.32 / n)
    assert abs(right.mean() - 0.68) < 3.0 * error + 0.02, right.mean()
    # on the same data true abscissas spread evenly over the whole axis miss too often
    if n_obs == 40:  # its bias grows against the standard deviation
        assert wrong.mean() < 0.68 - 5.0 * error, wrong.mean()


def test_the_score_knows_that_errors_in_x_depend_on_the_slope(rng):
    x = np.linspace(0, 1, 9)
    posterior = line_problem(x, 1.0 + 2.0 * x + rng.normal(0, 0.2, 9), 0.1, 0.1).linearised(
        np.array([1.0, 2.0])
    )
    values, step = np.array([0.9, 2.2]), 1e-5
    numeric = [
        (np.sum(posterior.residuals(end) ** 2) - np.sum(posterior.residuals(start) ** 2)) / 4e-5
        for start, end in ((values - step * e, values + step * e) for e in np.eye(2))
    ]
    jacobian, residuals = posterior.scoring(values)
    np.testing.assert_allclose(jacobian.T @ residuals, numeric, rtol=1e-6)
